"""Alarms on beliefs of the four-corner filter: what is found in time, and what is falsely said."""

from __future__ import annotations

import zlib
from dataclasses import replace
from functools import lru_cache, partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.estimators.alarm_events import detection_times
from wheelhop.estimators.alarms import AlarmSettings, alarm_params, run_alarms
from wheelhop.estimators.estimate_vehicle import COMMON_DRIFT, SINGLE_DRIFT
from wheelhop.estimators.four_corners import (
    VEHICLE_TUNING,
    WHEELS,
    bind_speed,
    changing_four_corner_filter,
    changing_four_corner_params,
    changing_four_corner_prior,
)
from wheelhop.estimators.pressure import StiffnessBelief
from wheelhop.estimators.stiffness import read_theta
from wheelhop.studies.frame import Advance, Store
from wheelhop.studies.stiffness.frame import RATE, StiffnessSettings, drive_settings
from wheelhop.studies.stiffness.runs import Estimator, followed
from wheelhop.studies.stiffness.several_wheels import vehicle
from wheelhop.studies.stiffness.truth import Drives, levels, simulated, speeds, times
from wheelhop.vehicle.quarter_car import Accelerations

DURATION, BEGIN, LASTS = 120.0, 50.0, 10.0
"""Of a drive, when the loss begins and how long it takes [s]."""

PLACARD = 230e3
"""Recommended pressure [Pa]."""

IN_TIME = 60.0
"""Within which a loss must be found [s]."""

LOSSES: dict[str, tuple[tuple[int, ...], float]] = {
    "one tyre, 15 %": ((1,), 0.15),
    "two tyres, 15 %": ((0, 3), 0.15),
    "three tyres, 15 %": ((0, 1, 3), 0.15),
    "one tyre, 20 %": ((2,), 0.20),
    "four tyres, 20 %": ((0, 1, 2, 3), 0.20),
}
"""Which wheels lose how much of the placard pressure."""

_THIN = 2
_KEPT_EVERY = 125
_HEALTHY = 4
_N = len(WHEELS)


class AlarmDrives(NamedTuple):
    """Results.

    Attributes:
        time: of the beliefs [s], [time].
        found: time from the loss to the alarm of the last wheel that lost pressure [s], inf where
            it does not come, [drives], by loss.
        accused: whether a sound wheel had an alarm, [drives], by loss.
        false: whether a drive without any loss had an alarm, [drives].
        early: whether a drive had one before its loss, [drives].
        spread: NEES of ln k_t, the drift included, at the end of the sound drives, [drives].
    """

    time: np.ndarray
    found: dict[str, np.ndarray]
    accused: dict[str, np.ndarray]
    false: np.ndarray
    early: np.ndarray
    spread: np.ndarray


def count_of(settings: StiffnessSettings) -> int:
    """Drives with each loss."""
    return max(2, settings.runs // 4)


def duration_of(settings: StiffnessSettings) -> float:
    """Of a drive [s]; with short settings the loss comes earlier too."""
    return DURATION * min(1.0, settings.longest / 60.0)


def hours(result: AlarmDrives) -> float:
    """Without a loss: of sound drives, and of the others before their loss [h]."""
    whole = float(result.time[-1])
    before = len(result.early) * BEGIN / DURATION * whole
    return (len(result.false) * whole + before) / 3600.0


def alarm_drives(settings: StiffnessSettings, store: Store, advance: Advance) -> AlarmDrives:
    """Drive with and without losses, estimate all four tyres, and watch.

    Args:
        settings: of the study.
        store: of finished runs.
        advance: told of Monte Carlos.
    """
    small = replace(settings, runs=count_of(settings))
    names = [*LOSSES, *(f"sound {k}" for k in range(_HEALTHY))]
    outcome = {}
    for done, name in enumerate(names):
        wheels, loss = LOSSES.get(name, ((), 0.0))
        work = partial(_watched, name, wheels, loss, small)
        outcome[name] = store.arrays(f"beliefs_{done}", [drive_settings(small), name], work)
        advance(done + 1, len(names))
    time = outcome[names[0]]["time"]
    begin = _scaled(settings, BEGIN)
    found, accused, early = {}, {}, []
    for name, (wheels, _) in LOSSES.items():
        alarm, _ = alarms_on(name, outcome[name], settings)
        early.append(alarm[:, time < begin].any(axis=(1, 2)))
        late = alarm & ~alarm[:, [int(np.argmax(time >= begin)) - 1]]
        found[name] = detection_times(time, late, begin)[:, list(wheels)].max(axis=1)
        sound = [i for i in range(_N) if i not in wheels]
        accused[name] = np.asarray(alarm[:, :, sound].any(axis=(1, 2)))
    sound_drives = [alarms_on(name, outcome[name], settings) for name in names[len(LOSSES) :]]
    false = np.concatenate([alarm.any(axis=(1, 2)) for alarm, _ in sound_drives])
    spread = np.concatenate([nees for _, nees in sound_drives])
    return AlarmDrives(time, found, accused, false, np.concatenate(early), spread)


def _scaled(settings: StiffnessSettings, seconds: float) -> float:
    return seconds * duration_of(settings) / DURATION


def _watched(
    name: str, wheels: tuple[int, ...], loss: float, settings: StiffnessSettings
) -> dict[str, np.ndarray]:
    """Beliefs of one Monte Carlo: time [time], mean and cov of ln k_t."""
    cars, t = vehicle(), times(duration_of(settings))
    runs = settings.runs
    begin, lasts = _scaled(settings, BEGIN), _scaled(settings, LASTS)
    course = PLACARD * (1.0 - loss * np.clip((t - begin) / lasts, 0.0, 1.0))
    whole = np.full_like(t, PLACARD)
    label, shape = f"alarms, {name}", (runs, len(t))
    road = np.broadcast_to(levels(label, settings)[:, None], shape)
    v = speeds(label, settings)
    each = []
    for i, car in enumerate(cars):
        pressure = np.broadcast_to(course if i in wheels else whole, shape)
        both = simulated(f"{label}, {WHEELS[i]}", car, Drives(pressure, road, v), settings)
        each.append([a[:, _THIN - 1 :: _THIN] for a in both])
    measured = Accelerations(*(np.stack(entries, axis=-1) for entries in zip(*each, strict=True)))
    found = followed(_estimator(cars, settings.noise), measured, v, _KEPT_EVERY)
    mean, cov = _dense(found)
    time = _KEPT_EVERY * _THIN / RATE * np.arange(1, mean.shape[1] + 1)
    return {"time": time, "mean": mean, "cov": cov}


def alarms_on(
    name: str,
    beliefs: dict[str, np.ndarray],
    settings: StiffnessSettings,
    how: AlarmSettings = AlarmSettings(),
) -> tuple[np.ndarray, np.ndarray]:
    """Alarms [drives, time, wheels] on drifted beliefs, and NEES at the end [drives].

    Args:
        name: of the Monte Carlo, for the drift's draws.
        beliefs: time, mean and cov of a Monte Carlo.
        settings: of the study.
        how: settings of the alarms.
    """
    mean, cov, time = (beliefs[key] for key in ("mean", "cov", "time"))
    rng = np.random.default_rng([settings.seed, zlib.crc32(name.encode())])
    common, single = rng.normal(size=(len(mean), 1, 1)), rng.normal(size=(len(mean), 1, _N))
    drifted = mean + COMMON_DRIFT * common + SINGLE_DRIFT * single
    bias = COMMON_DRIFT**2 * np.ones((_N, _N)) + SINGLE_DRIFT**2 * np.eye(_N)
    tire = jax.tree.map(lambda *a: np.array(a, float), *(car.tire for car in vehicle()))
    params = alarm_params(
        tire,
        PLACARD,
        wheels=_N,
        dt=float(time[0]),
        belief_walk=VEHICLE_TUNING.stiffness_walk,
        bias=bias,
        settings=how,
    )
    output = _alarms()(StiffnessBelief(jnp.asarray(drifted), jnp.asarray(cov)), params)
    error = drifted[:, -1] - np.asarray(params.reference)
    nees = np.einsum("ri,rij,rj->r", error, np.linalg.inv(cov[:, -1] + bias), error)
    return np.asarray(output.alarm), nees


def _estimator(cars: Any, noise: float) -> Estimator:
    dt = _THIN / RATE
    tuning = replace(VEHICLE_TUNING, noise_a_s=noise, noise_a_u=noise)
    params = changing_four_corner_params(cars, 15.0, dt, tuning)
    prior = changing_four_corner_prior(params, tuning)
    return Estimator(changing_four_corner_filter(dt), prior, params, bind_speed, _keep)


def _keep(state: Any, info: Any) -> Any:
    del info
    theta = read_theta(state)
    return tuple(theta.mean[:_N]), tuple(theta.cov[i][: i + 1] for i in range(_N))


def _dense(found: Any) -> tuple[np.ndarray, np.ndarray]:
    mean = np.stack(found[0], axis=-1)
    cov = np.empty((*mean.shape, _N))
    for i in range(_N):
        for j in range(i + 1):
            cov[..., i, j] = cov[..., j, i] = found[1][i][j]
    return mean, cov


@lru_cache(maxsize=1)
def _alarms() -> Any:
    return jax.jit(jax.vmap(run_alarms, in_axes=(0, None)))
