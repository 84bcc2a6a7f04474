"""Loads by every estimator in the paper's maneuvers, sensors without noise: Fig. 5, 6 and 7."""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from wheelhop.estimators.algebraic_load import algebraic_loads, distribution_of
from wheelhop.estimators.inverse_load import LoadSensors
from wheelhop.estimators.joint_load import JointLoadTuning, wheel_loads
from wheelhop.studies.filipozzi.drives import (
    BRAKE,
    BRAKE_BARRED,
    LANE_CHANGE,
    LANE_CHANGE_BARRED,
    ROAD,
    SLOPE,
    SWEEP,
    Drive,
    cases,
    drives,
)
from wheelhop.studies.filipozzi.methods import (
    DERIVATIVE,
    HALF_CAR,
    PERFECT,
    UNBIASED,
    YOULA,
    Signals,
    observed,
)
from wheelhop.studies.filipozzi.settings import FilipozziSettings
from wheelhop.studies.frame import Advance, Store
from wheelhop.vehicle.corner_suspension import corner_suspensions
from wheelhop.vehicle.full_vehicle import FullVehicle
from wheelhop.vehicle.load_record import VehicleLoadSample

ALGEBRAIC, JOINT, JOINT_WHEEL = "algebraic", "joint", "joint, wheel sensors"
METHODS = (ALGEBRAIC, YOULA, UNBIASED, DERIVATIVE, HALF_CAR, JOINT, JOINT_WHEEL)
"""In the order of the tables; `JOINT` has the paper's sensors, `JOINT_WHEEL` accelerometers on the
wheel carriers too."""

WORDS = {
    BRAKE: "5a: braking",
    LANE_CHANGE: "5b: double lane change",
    SWEEP: "6: bounce sine sweep",
    SLOPE: "7: slope",
    LANE_CHANGE_BARRED: "lane change, anti-roll bars",
    BRAKE_BARRED: "braking, anti-roll bars",
    ROAD: "class C road",
}
"""The drives by what a reader knows them as; the last three are not the paper's."""

SETTLED = 0.5
"""Time from which on errors count [s]."""

CLOSE = 0.05
"""Error of a load, per that load, that counts as converged."""

CALM = 0.9
"""Until when convergence is watched [s]; the maneuvers begin at 1 s or later."""

LONGEST_DELAY = 0.05
"""Of an estimator that is looked for [s]."""


class Maneuvers(NamedTuple):
    """Results.

    Attributes:
        settings: that made them.
        drives: what truly happened, by name.
        loads: by drive and method, [time, 4] N.
    """

    settings: FilipozziSettings
    drives: dict[str, Drive]
    loads: dict[str, dict[str, np.ndarray]]


class Score(NamedTuple):
    """How good an estimator is in a drive.

    Attributes:
        rmse: over time and corners from `SETTLED` on [N].
        bias: mean error likewise [N].
        steady: mean error over the last half second [N].
        delay: shift of the estimate in time at which it fits best [s].
        aligned: rmse at that shift [N].
        converged: last time in the calm first second at which an error exceeded `CLOSE` [s]; NaN
            where it still does at its end.
        change: rms of the load's own change from its mean [N].
    """

    rmse: float
    bias: float
    steady: float
    delay: float
    aligned: float
    converged: float
    change: float


def maneuvers(settings: FilipozziSettings, store: Store, advance: Advance) -> Maneuvers:
    """Drive, and estimate the loads of every drive.

    Args:
        settings: of the study.
        store: of what is finished.
        advance: told of the drives.
    """
    advance(0, 1 + len(WORDS))
    driven = drives(settings, store, lambda done, of: None)
    vehicles = {name: case.vehicle for name, case in cases(settings).items()}
    found = {}
    for k, name in enumerate(WORDS):
        advance(1 + k, 1 + len(WORDS))
        work = partial(estimates, driven[name], vehicles[name], settings)
        depends = (settings.seed, settings.rate, settings.bandwidth, settings.quick)
        found[name] = store.arrays(f"loads_{name}", depends, work)
    advance(1 + len(WORDS), 1 + len(WORDS))
    return Maneuvers(settings, {name: driven[name] for name in WORDS}, found)


def estimates(
    drive: Drive, vehicle: FullVehicle, settings: FilipozziSettings
) -> dict[str, np.ndarray]:
    """Loads by every one of `METHODS`, [time, 4] N.

    Args:
        drive: noise-free.
        vehicle: that was driven.
        settings: rate and bandwidth.
    """
    dt = 1.0 / settings.rate
    corners = corner_suspensions(vehicle)
    signals = Signals(drive.body_acceleration, drive.compression)
    found = {
        ALGEBRAIC: np.asarray(
            algebraic_loads(
                jnp.asarray(drive.a_x), jnp.asarray(drive.a_y), distribution_of(vehicle)
            )
        )
    }
    for method in (YOULA, UNBIASED, DERIVATIVE, HALF_CAR):
        found[method] = observed(method, signals, corners, dt, settings.bandwidth).load
    for method, wheel_sensors in ((JOINT, False), (JOINT_WHEEL, True)):
        sample = joint_sample(drive, wheel_sensors)
        found[method] = wheel_loads(
            sample, dt, vehicle, joint_tuning(PERFECT), uninitialised=True
        ).load
    return found


def joint_tuning(sensors: LoadSensors) -> JointLoadTuning:
    """What the joint filter believes of the sensors that the others believe in."""
    return JointLoadTuning(
        body_acceleration=sensors.acceleration_noise,
        wheel_acceleration=sensors.acceleration_noise,
        compression=sensors.deflection_noise,
    )


def joint_sample(drive: Any, wheel_sensors: bool) -> VehicleLoadSample:
    """What the joint filter measures of a drive or of noisy sensors, [time, 4] entries.

    Args:
        drive: `Drive`, or one run of `sensed.Sensed`.
        wheel_sensors: with the accelerometers on the wheel carriers.
    """
    wheel = np.asarray(drive.wheel_acceleration)
    parts = (
        np.asarray(drive.body_acceleration),
        np.asarray(drive.compression),
        wheel if wheel_sensors else np.full_like(wheel, np.nan),
    )
    return VehicleLoadSample(*(jnp.asarray(part[:, k]) for part in parts for k in range(4)))


def score(drive: Drive, load: np.ndarray) -> Score:
    """How good loads [time, 4] N are."""
    t, truth = drive.t, drive.load
    dt = float(t[1] - t[0])
    off = load - truth
    late = t >= SETTLED
    shifts = np.arange(round(LONGEST_DELAY / dt) + 1)
    aligned = [_rms((load[k:] - truth[: len(t) - k])[late[: len(t) - k]]) for k in shifts]
    best = int(np.argmin(aligned))
    calm = t < CALM
    outside = np.flatnonzero((~(np.abs(off) < CLOSE * truth)).any(1)[calm])
    ends = len(outside) and outside[-1] == calm.sum() - 1
    converged = 0.0 if not len(outside) else float(t[outside[-1]])
    return Score(
        _rms(off[late]),
        float(np.nanmean(off[late])),
        float(np.nanmean(off[t >= t[-1] - 0.5])),
        shifts[best] * dt,
        aligned[best],
        np.nan if ends else converged,
        _rms((truth - truth.mean(0))[late]),
    )


def scores(result: Maneuvers) -> dict[str, dict[str, Score]]:
    """By drive and method."""
    return {
        name: {m: score(result.drives[name], load) for m, load in loads.items()}
        for name, loads in result.loads.items()
    }


def total_error(drive: Drive, load: np.ndarray) -> float:
    """Rms error of the sum of the four loads from `SETTLED` on [N]."""
    return _rms((load.sum(1) - drive.load.sum(1))[drive.t >= SETTLED])


def _rms(values: Any) -> float:
    return float(np.sqrt(np.nanmean(np.square(values))))
