"""What noisy sensors do to the estimates: Fig. 10, and a rough road with datasheet sensors."""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import numpy as np

from wheelhop.estimators.inverse_load import LoadSensors
from wheelhop.estimators.joint_load import wheel_loads
from wheelhop.studies.filipozzi.drives import (
    BRAKE,
    ROAD,
    Drive,
    cases,
    drives,
)
from wheelhop.studies.filipozzi.maneuvers import (
    JOINT,
    JOINT_WHEEL,
    SETTLED,
    joint_sample,
    joint_tuning,
)
from wheelhop.studies.filipozzi.methods import DERIVATIVE, UNBIASED, YOULA, Signals, observed
from wheelhop.studies.filipozzi.sensed import DATASHEET_NOISE, PAPER_NOISE, Sensed, noisy
from wheelhop.studies.filipozzi.settings import FilipozziSettings
from wheelhop.studies.frame import Advance, Store
from wheelhop.vehicle.corner_suspension import corner_suspensions
from wheelhop.vehicle.full_vehicle import FullVehicle

CASES = {"brake, paper's noise": (BRAKE, PAPER_NOISE), "road, datasheet": (ROAD, DATASHEET_NOISE)}
"""Drive and kind of noise by name."""

METHODS = (YOULA, UNBIASED, DERIVATIVE, JOINT, JOINT_WHEEL)

JOINT_RUNS = 4
"""Most runs that the joint filter is given."""

SENSORS = {
    PAPER_NOISE: LoadSensors(acceleration_noise=0.1, deflection_noise=3.2e-4),
    DATASHEET_NOISE: LoadSensors(acceleration_noise=0.5, deflection_noise=5e-4),
}
"""What the estimators believe: white noise of the true size. The paper's is held for 10 ms."""


class Noisy(NamedTuple):
    """What noise does to one estimator in one case, from `SETTLED` on.

    Attributes:
        clean: front left load from sensors without noise, [time] N; the estimator believes in the
            same noise.
        first: front left load of the first noisy run, [time] N.
        first_sigma: that it states, [time] N.
        rmse: error against the truth over runs, corners and time [N].
        spread: standard deviation that the noise makes, about the run without noise [N].
        stated: rms of the standard deviation stated [N].
        inside: share of the true loads within two stated standard deviations.
        runs: noisy runs.
    """

    clean: np.ndarray
    first: np.ndarray
    first_sigma: np.ndarray
    rmse: Any
    spread: Any
    stated: Any
    inside: Any
    runs: Any


class Noise(NamedTuple):
    """Results.

    Attributes:
        settings: that made them.
        drives: what truly happened, by case.
        found: by case and method.
    """

    settings: FilipozziSettings
    drives: dict[str, Drive]
    found: dict[str, dict[str, Noisy]]


def noise(settings: FilipozziSettings, store: Store, advance: Advance) -> Noise:
    """Estimate the loads from noisy sensors, many times.

    Args:
        settings: of the study.
        store: of what is finished.
        advance: told of case and method.
    """
    driven = drives(settings, store, lambda done, of: None)
    vehicles = {name: case.vehicle for name, case in cases(settings).items()}
    found: dict[str, dict[str, Noisy]] = {}
    total = len(CASES) * len(METHODS)
    for case, (name, kind) in CASES.items():
        found[case] = {}
        sensed = noisy(driven[name], settings, name, kind)
        for method in METHODS:
            advance(len(METHODS) * (len(found) - 1) + len(found[case]), total)
            work = partial(_measured, method, driven[name], sensed, vehicles[name], kind, settings)
            depends = (settings.runs, settings.seed, settings.rate, settings.bandwidth)
            kept = f"noise_{name}_{method.replace(' ', '_').replace(',', '')}"
            found[case][method] = Noisy(**store.arrays(kept, depends, work))
    advance(total, total)
    return Noise(settings, {case: driven[name] for case, (name, _) in CASES.items()}, found)


def _measured(
    method: str,
    drive: Drive,
    sensed: Sensed,
    vehicle: FullVehicle,
    kind: str,
    settings: FilipozziSettings,
) -> dict[str, np.ndarray]:
    if method in (JOINT, JOINT_WHEEL):
        clean, load, sigma = _joint(method == JOINT_WHEEL, drive, sensed, vehicle, kind, settings)
    else:
        clean, load, sigma = _corner(method, drive, sensed, vehicle, kind, settings)
    late = (drive.t >= SETTLED) & np.isfinite(load).all((0, 2))
    off = (load - drive.load)[:, late]
    spread = (load - clean)[:, late]
    within = np.abs(off) < 2.0 * np.broadcast_to(sigma, load.shape)[:, late]
    return {
        "clean": clean[:, 0],
        "first": load[0, :, 0],
        "first_sigma": np.broadcast_to(sigma, load.shape)[0, :, 0],
        "rmse": np.sqrt(np.mean(off**2)),
        "spread": np.sqrt(np.mean(spread**2)),
        "stated": np.sqrt(np.mean(np.broadcast_to(sigma, load.shape)[:, late] ** 2)),
        "inside": np.mean(within),
        "runs": np.asarray(len(load)),
    }


def _corner(
    method: str,
    drive: Drive,
    sensed: Sensed,
    vehicle: FullVehicle,
    kind: str,
    settings: FilipozziSettings,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    corners, dt, sensors = corner_suspensions(vehicle), 1.0 / settings.rate, SENSORS[kind]
    # the run without noise rides along as the first
    a, q = (
        np.concatenate([np.asarray(clean)[None], np.asarray(noise)])
        for clean, noise in (
            (drive.body_acceleration, sensed.body_acceleration),
            (drive.compression, sensed.compression),
        )
    )
    found = observed(method, Signals(a, q), corners, dt, settings.bandwidth, sensors)
    return found.load[0], found.load[1:], found.sigma[1:]


def _joint(
    wheel_sensors: bool,
    drive: Drive,
    sensed: Sensed,
    vehicle: FullVehicle,
    kind: str,
    settings: FilipozziSettings,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    tuning, dt = joint_tuning(SENSORS[kind]), 1.0 / settings.rate
    runs = min(settings.runs, JOINT_RUNS)
    every: list[Any] = [drive, *(Sensed(*(x[k] for x in sensed)) for k in range(runs))]
    found = [wheel_loads(joint_sample(one, wheel_sensors), dt, vehicle, tuning) for one in every]
    return (
        found[0].load,
        np.stack([one.load for one in found[1:]]),
        np.stack([one.sigma for one in found[1:]]),
    )
