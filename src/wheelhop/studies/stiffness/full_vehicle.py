"""The full vehicle as truth: four tyres on roads nobody measured, with identified corners."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from wheelhop.estimators.calibration import calibrate
from wheelhop.identification import identify, search_space
from wheelhop.studies.frame import Advance, Store
from wheelhop.studies.stiffness.frame import RATE, StiffnessSettings
from wheelhop.studies.stiffness.vehicle_cases import (
    DISTURBANCES,
    KNOWN,
    NOMINAL,
    Case,
    data_directory,
    to_calibrate,
    to_disturb,
    to_identify,
    to_try,
)
from wheelhop.studies.stiffness.vehicle_drives import VehicleDrive, VehicleLogs, drive_vehicles
from wheelhop.studies.stiffness.vehicle_estimators import MAIN, ROWS, Followed
from wheelhop.vehicle.parameters import QuarterCar, brancati_suv, with_suspension
from wheelhop.vehicle.quarter_car import Accelerations
from wheelhop.vehicle.record import CornerRecord
from wheelhop.vehicle.suspension import Suspension
from wheelhop.vehicle.tire import pressure_from_stiffness, stiffness_from_pressure

DURATION = 60.0
"""Of a drive [s]."""

IDENTIFIED = ("suspension.damping", "suspension.stiffness", "sprung_mass", "unsprung_mass")
"""Parameters of a corner that are identified; the tyre's law is known."""

FASTEST = 80 / 3.6
FLEET = 8

_RECORD = 12.0


class VehicleStudy(NamedTuple):
    """Results.

    Attributes:
        time: [s], [time].
        cases: what was driven.
        values: of `IDENTIFIED`, front and rear, [2, 4].
        unexplained: share of the accelerations that the identified corners leave, [2].
        pressure: true, [cases, 4] [Pa].
        estimates: by row: theta less the calibration's offset of ln k_t, and its covariance.
        offset: of ln k_t by row, from the calibration, [4].
        disturbed: final ln k_t of `to_disturb`, not calibrated, [2, disturbances, 4].
        disturbed_pressure: true, [2, 4] [Pa].
        mistimed: the same of the undisturbed ones whose speed is told 1 % too high, [2, 4].
    """

    time: np.ndarray
    cases: tuple[Case, ...]
    values: np.ndarray
    unexplained: np.ndarray
    pressure: np.ndarray
    estimates: dict[str, Followed]
    offset: dict[str, np.ndarray]
    disturbed: np.ndarray
    disturbed_pressure: np.ndarray
    mistimed: np.ndarray


def vehicle_study(settings: StiffnessSettings, store: Store, advance: Advance) -> VehicleStudy:
    """Identify, calibrate, try on every road, disturb.

    Args:
        settings: of the study.
        store: of finished steps.
        advance: told of steps.
    """
    cases = to_try(settings, data_directory())
    fleets = -(-len(cases) // FLEET)
    steps = 2 + fleets + 2
    depends = {"settings": asdict(settings), "cases": [c.name for c in cases]}
    duration = min(DURATION, settings.longest)

    found = store.arrays("vehicle_corners", depends, lambda: _identified(settings, duration))
    cars = corners(found["values"])
    advance(1, steps)
    known = store.arrays("vehicle_known", depends, lambda: _known(settings, cars, duration))
    advance(2, steps)
    offset = {row: known[f"offset {row}"] for row in ROWS}
    parts = []
    for k in range(fleets):
        part = cases[k * FLEET : (k + 1) * FLEET]
        parts.append(
            store.arrays(
                f"vehicle_tried_{k}",
                depends,
                partial(_tried, settings, cars, [c.drive for c in part], duration),
            )
        )
        advance(3 + k, steps)
    last = store.arrays("vehicle_disturbed", depends, lambda: _disturbed(settings, cars, duration))
    advance(steps, steps)
    estimates = {}
    for row in ROWS:
        theta = np.concatenate([p[f"theta {row}"] for p in parts])
        theta[..., :4] -= offset[row]
        cov = np.concatenate([p[f"cov {row}"] for p in parts]) + known[f"cov {row}"]
        estimates[row] = Followed(theta, cov)
    count = next(iter(estimates.values())).theta.shape[1]
    return VehicleStudy(
        time=np.arange(1, count + 1.0),
        cases=tuple(cases),
        values=found["values"],
        unexplained=found["unexplained"],
        pressure=np.array([c.drive.pressures for c in cases], float),
        estimates=estimates,
        offset=offset,
        disturbed=last["told"],
        disturbed_pressure=np.array([part[0].pressures for part in to_disturb(settings)], float),
        mistimed=last["mistimed"],
    )


def pressure_error(ln_k_t: np.ndarray, pressure: np.ndarray) -> np.ndarray:
    """Estimated over true pressure, less one [-]; arguments [..., 4]."""
    found = pressure_from_stiffness(np.exp(ln_k_t), brancati_suv().tire)
    return np.asarray(found / pressure - 1.0, float)


def true_ln_stiffness(pressure: np.ndarray) -> np.ndarray:
    """ln k_t of the tyres at pressures [Pa], any shape."""
    stiffness = stiffness_from_pressure(pressure, brancati_suv().tire)
    return np.asarray(np.log(np.asarray(stiffness, float)))


def corners(values: np.ndarray) -> list[QuarterCar]:
    """FL, FR, RL, RR from values of `IDENTIFIED`, front and rear, [2, 4]."""
    cars = []
    for axle, (damping, stiffness, sprung, unsprung) in zip(
        ("front", "rear"), values.tolist(), strict=True
    ):
        car = with_suspension(brancati_suv(axle), Suspension(stiffness, 0.0, damping, 0.0))
        cars += [replace(car, sprung_mass=sprung, unsprung_mass=unsprung)] * 2
    return cars


def _driven(
    settings: StiffnessSettings, drives: Sequence[VehicleDrive], duration: float
) -> VehicleLogs:
    return drive_vehicles(drives, duration, FASTEST, FLEET, settings.seed)


def _identified(settings: StiffnessSettings, duration: float) -> dict[str, np.ndarray]:
    logs = _driven(settings, to_identify(settings), duration)
    count = round(min(_RECORD, duration) * RATE)
    t = logs.dt * np.arange(1, count + 1)
    space = search_space(IDENTIFIED)
    values, unexplained = [], []
    for axle, wheel in (("front", 0), ("rear", 2)):
        records = [
            CornerRecord(
                t,
                logs.measured.a_s[r, :count, wheel],
                logs.measured.a_u[r, :count, wheel],
                logs.speed[r, :count],
                np.full(count, logs.pressure[r, wheel]),
                logs.elevation[r, :count, wheel],
            )
            for r in range(len(logs.pressure))
        ]
        start = brancati_suv(axle)
        linear = replace(start.suspension, cubic_stiffness=0.0, quadratic_damping=0.0)
        fit = identify(records, with_suspension(start, linear), space=space, starts=1)
        values.append(fit.values)
        unexplained.append(fit.unexplained)
    return {"values": np.array(values), "unexplained": np.array(unexplained)}


def _known(
    settings: StiffnessSettings, cars: Sequence[QuarterCar], duration: float
) -> dict[str, np.ndarray]:
    """Offset of every row over the stretches at the known pressure, and its covariance."""
    logs = _padded(_driven(settings, to_calibrate(settings), duration))
    count = len(to_calibrate(settings))
    result = {}
    for row, (make, tuning) in ROWS.items():
        told = make(tuning, settings)(cars, logs, 1.0)
        t = np.arange(1.0, told.theta.shape[1] + 1.0)
        each = [
            calibrate(
                t,
                told.theta[r, :, :4],
                told.cov[r],
                brancati_suv().tire,
                KNOWN,
                belief_walk=tuning.stiffness_walk,
                shortest=min(20.0, 0.9 * duration),
            )
            for r in range(count)
        ]
        result[f"offset {row}"] = np.mean([c.offset for c in each], axis=0)
        result[f"cov {row}"] = np.mean([c.cov for c in each], axis=0) / count
    return result


def _tried(
    settings: StiffnessSettings,
    cars: Sequence[QuarterCar],
    drives: Sequence[VehicleDrive],
    duration: float,
) -> dict[str, np.ndarray]:
    logs = _padded(_driven(settings, drives, duration))
    result = {}
    for row, (make, tuning) in ROWS.items():
        told = make(tuning, settings)(cars, logs, 1.0)
        result[f"theta {row}"] = told.theta[: len(drives)]
        result[f"cov {row}"] = told.cov[: len(drives)]
    return result


def _disturbed(
    settings: StiffnessSettings, cars: Sequence[QuarterCar], duration: float
) -> dict[str, np.ndarray]:
    make, tuning = ROWS[MAIN]
    follow = make(tuning, settings)
    nominal = list(DISTURBANCES).index(NOMINAL)
    told, mistimed = [], []
    for drives in to_disturb(settings):
        logs = _padded(_driven(settings, drives, duration))
        told.append(follow(cars, logs, 1.0).theta[: len(drives), -1, :4])
        mistimed.append(follow(cars, logs, 1.01).theta[nominal, -1, :4])
    return {"told": np.stack(told), "mistimed": np.stack(mistimed)}


def _padded(logs: VehicleLogs) -> VehicleLogs:
    """As many runs as a fleet: the filters are compiled once."""
    index = np.minimum(np.arange(FLEET), len(logs.pressure) - 1)
    measured = Accelerations(*(a[index] for a in logs.measured))
    return VehicleLogs(measured, logs.speed[index], logs.elevation[index], logs.pressure[index])
