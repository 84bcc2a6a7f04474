"""The full vehicle as truth: four tyres on roads nobody measured, with identified corners."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from wheelhop.estimators import four_corners
from wheelhop.estimators.calibration import calibrate
from wheelhop.estimators.stiffness import StiffnessTuning
from wheelhop.filtering import run_batch
from wheelhop.identification import identify, search_space
from wheelhop.studies.stiffness import hop_band
from wheelhop.studies.stiffness.frame import RATE, Advance, StiffnessSettings, Store
from wheelhop.studies.stiffness.vehicle_cases import (
    KNOWN,
    Case,
    data_directory,
    to_calibrate,
    to_disturb,
    to_identify,
    to_try,
)
from wheelhop.studies.stiffness.vehicle_drives import VehicleDrive, VehicleLogs, drive_vehicles
from wheelhop.vehicle.parameters import QuarterCar, brancati_suv, with_suspension
from wheelhop.vehicle.quarter_car import Accelerations
from wheelhop.vehicle.record import CornerRecord
from wheelhop.vehicle.suspension import Suspension
from wheelhop.vehicle.tire import pressure_from_stiffness, stiffness_from_pressure

DURATION = 60.0
"""Of a drive [s]."""

IDENTIFIED = ("suspension.damping", "suspension.stiffness", "sprung_mass", "unsprung_mass")
"""Parameters of a corner that are identified; the tyre's law is known."""

TUNING = StiffnessTuning(
    stiffness_walk=0.001, level_walk=0.3, waviness_sigma=0.4, damping_sigma=0.15
)
"""Of the estimators: tyres that hold, a road that is not equally rough all along."""

FASTEST = 80 / 3.6
FLEET = 8

_RECORD = 12.0
_CERTAIN = 1e-3


class Followed(NamedTuple):
    """What an estimator says once a second: theta and the covariance of ln k_t.

    Attributes:
        theta: [runs, time, p], ln k_t of the four wheels first.
        cov: of ln k_t, [runs, time, 4, 4].
    """

    theta: np.ndarray
    cov: np.ndarray


Follow = Callable[[Sequence[QuarterCar], VehicleLogs, float], Followed]
"""(corners, logs, factor on the known speed) -> what the estimator says."""


def in_band(tuning: StiffnessTuning, settings: StiffnessSettings) -> Follow:
    """The estimator of `hop_band` in a tuning."""
    tuning = _with_noise(tuning, settings)

    def follow(cars: Sequence[QuarterCar], logs: VehicleLogs, speed: float = 1.0) -> Followed:
        dt = hop_band.BLOCK * logs.dt
        measured = hop_band.WheelAcceleration(_float(hop_band.means(logs.measured.a_u)))
        count = measured.a_u.shape[1]
        v = hop_band.means(logs.speed[:, :, None])[:, :count, 0]
        params = hop_band.hop_params(cars, dt, tuning)
        prior = hop_band.hop_prior(params, tuning)
        filter = hop_band.hop_filter(dt)
        return _followed(filter, prior, params, measured, speed * v, hop_band.bind_speed, dt)

    return follow


def bare(tuning: StiffnessTuning, settings: StiffnessSettings) -> Follow:
    """`four_corner_filter`: every sample of both accelerometers, waviness 2, known dampers."""
    tuning = replace(_with_noise(tuning, settings), level_walk=0.0)

    def follow(cars: Sequence[QuarterCar], logs: VehicleLogs, speed: float = 1.0) -> Followed:
        params = four_corners.four_corner_params(cars, 15.0, logs.dt, tuning)
        prior = four_corners.four_corner_prior(params, tuning)
        filter = four_corners.four_corner_filter(logs.dt)
        measured = Accelerations(_float(logs.measured.a_s), _float(logs.measured.a_u))
        bind = four_corners.bind_speed
        return _followed(filter, prior, params, measured, speed * logs.speed, bind, logs.dt)

    return follow


BARE, BAND, FREE_WAVINESS, MAIN = (
    "every sample, both accelerometers",
    "band of the wheel hop",
    "and the waviness free",
    "and the damping free",
)

ROWS: dict[str, tuple[Callable[..., Follow], StiffnessTuning]] = {
    BARE: (bare, TUNING),
    BAND: (in_band, replace(TUNING, waviness_sigma=_CERTAIN, damping_sigma=_CERTAIN)),
    FREE_WAVINESS: (in_band, replace(TUNING, damping_sigma=_CERTAIN)),
    MAIN: (in_band, TUNING),
}
"""What is left out of the model, step by step; the last is the estimator."""


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
    disturbed = to_disturb(settings)
    fleets = -(-len(cases) // FLEET)
    steps = 2 + fleets + 2
    depends = {"settings": asdict(settings), "cases": [c.name for c in cases]}
    duration = min(DURATION, settings.longest)

    found = store.arrays("vehicle_corners", depends, lambda: _identified(settings, duration))
    cars = corners(found["values"])
    advance(1, steps)
    known = store.arrays(
        "vehicle_known", depends, lambda: _known(settings, cars, duration)
    )
    advance(2, steps)
    offset = {row: known[f"offset {row}"] for row in ROWS}
    parts = []
    for k in range(fleets):
        part = cases[k * FLEET : (k + 1) * FLEET]
        parts.append(
            store.arrays(
                f"vehicle_tried_{k}",
                depends,
                lambda part=part: _tried(settings, cars, [c.drive for c in part], duration),
            )
        )
        advance(3 + k, steps)
    last = store.arrays(
        "vehicle_disturbed", depends, lambda: _disturbed(settings, cars, disturbed, duration)
    )
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
        disturbed=last["told"].reshape(2, -1, 4),
        disturbed_pressure=np.array([disturbed[0].pressures, disturbed[-1].pressures], float),
        mistimed=last["mistimed"],
    )


def pressure_error(ln_k_t: np.ndarray, pressure: np.ndarray) -> np.ndarray:
    """Estimated over true pressure, less one [-]; arguments [..., 4]."""
    found = pressure_from_stiffness(np.exp(ln_k_t), brancati_suv().tire)
    return np.asarray(found / pressure - 1.0, float)


def true_ln_stiffness(pressure: np.ndarray) -> np.ndarray:
    """ln k_t of the tyres at pressures [Pa], any shape."""
    return np.log(np.asarray(stiffness_from_pressure(pressure, brancati_suv().tire), float))


def corners(values: np.ndarray) -> list[QuarterCar]:
    """FL, FR, RL, RR from values of `IDENTIFIED`, front and rear, [2, 4]."""
    cars = []
    for axle, (damping, stiffness, sprung, unsprung) in zip(
        ("front", "rear"), values.tolist(), strict=True
    ):
        car = with_suspension(brancati_suv(axle), Suspension(stiffness, 0.0, damping, 0.0))
        cars += [replace(car, sprung_mass=sprung, unsprung_mass=unsprung)] * 2
    return cars


def _with_noise(tuning: StiffnessTuning, settings: StiffnessSettings) -> StiffnessTuning:
    return replace(tuning, noise_a_s=settings.noise, noise_a_u=settings.noise)


def _float(values: np.ndarray) -> Any:
    return jnp.asarray(values, float)


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
    settings: StiffnessSettings,
    cars: Sequence[QuarterCar],
    drives: Sequence[VehicleDrive],
    duration: float,
) -> dict[str, np.ndarray]:
    make, tuning = ROWS[MAIN]
    follow = make(tuning, settings)
    told, mistimed = [], []
    for first in range(0, len(drives), FLEET):
        logs = _padded(_driven(settings, drives[first : first + FLEET], duration))
        told.append(follow(cars, logs, 1.0).theta[:, -1, :4])
        mistimed.append(follow(cars, logs, 1.01).theta[0, -1, :4])
    return {"told": np.stack(told), "mistimed": np.stack(mistimed)}


def _padded(logs: VehicleLogs) -> VehicleLogs:
    """As many runs as a fleet: the filters are compiled once."""
    index = np.minimum(np.arange(FLEET), len(logs.pressure) - 1)
    measured = Accelerations(*(a[index] for a in logs.measured))
    return VehicleLogs(measured, logs.speed[index], logs.elevation[index], logs.pressure[index])


def _keep(state: Any, info: Any) -> tuple:
    del info
    return tuple(state.theta.mean), tuple(row[:4] for row in state.theta.cov[:4])


def _followed(
    filter: Any, prior: Any, params: Any, measured: Any, speed: np.ndarray, bind: Any, dt: float
) -> Followed:
    state = filter.init(prior, params)
    mean, rows = run_batch(
        filter, state, measured, params, inputs=_float(speed), bind=bind, keep=_keep
    )
    count = next(iter(measured)).shape[1]
    places = np.round(np.arange(1.0, count * dt + 1e-6) / dt).astype(int) - 1
    places = np.minimum(places, count - 1)
    theta = np.stack([np.asarray(m)[:, places] for m in mean], -1)
    cov = np.empty((*theta.shape[:2], 4, 4))
    for i, row in enumerate(rows):
        for j, entry in enumerate(row[: i + 1]):
            cov[..., i, j] = cov[..., j, i] = np.asarray(entry)[:, places]
    return Followed(theta, cov)
