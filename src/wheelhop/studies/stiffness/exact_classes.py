"""Roads of exact ISO 8608 classes, the class unknown: twelve cases, changing roads, a leak."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np

from wheelhop.estimators.changing import (
    EXACT_CLASSES,
    bind_speed,
    changing_filter,
    changing_params,
    changing_prior,
)
from wheelhop.estimators.stiffness import StiffnessTuning
from wheelhop.evaluation.bounds import pressure_deviation
from wheelhop.evaluation.tracking import Interval
from wheelhop.studies.frame import Advance, Store
from wheelhop.studies.stiffness.frame import RATE, SPEEDS, StiffnessSettings, drive_settings
from wheelhop.studies.stiffness.runs import (
    Estimator,
    corner_rate,
    followed,
    keep_theta,
    kept_times,
    ln_sigma,
)
from wheelhop.studies.stiffness.truth import Drives, simulated, speeds, times
from wheelhop.vehicle.parameters import QuarterCar, brancati_suv
from wheelhop.vehicle.road import class_level
from wheelhop.vehicle.tire import pressure_from_stiffness

CLASSES = ("A", "B", "C", "D")

CASES = tuple((p, c) for p in (130e3, 180e3, 230e3) for c in CLASSES)
"""Pressure [Pa] and class of each constant case."""

DURATION = 10.0
CHANGE = 5.0
"""When the road changes, and the leak begins [s]."""

LEAK = (230e3, 180e3)
LEAKS_FOR = 1.5

ROAD_CHANGES = {"A to D": ("A", "D"), "D to A": ("D", "A")}

_STRIDE = 10
_LONGEST_LAG = 3.0


class ExactClasses(NamedTuple):
    """Results.

    Attributes:
        time: [s], [time].
        error: of the pressure in each of `CASES`, estimate minus truth [Pa], [cases, runs, time].
        bound: standard deviation of the pressure that nothing beats even where the class is known
            [Pa], over the speeds of the runs, [cases, time].
        change_error: of the pressure through each of `ROAD_CHANGES` [Pa], [runs, time].
        change_bound: likewise, [time].
        leak_truth: pressure of the leaking tyre [Pa], [time].
        leak: its estimates [Pa], [runs, time].
    """

    time: np.ndarray
    error: np.ndarray
    bound: np.ndarray
    change_error: dict[str, np.ndarray]
    change_bound: dict[str, np.ndarray]
    leak_truth: np.ndarray
    leak: np.ndarray


def exact_classes(settings: StiffnessSettings, store: Store, advance: Advance) -> ExactClasses:
    """Run all cases through an IMM over the four classes.

    Args:
        settings: of the study.
        store: of finished cases.
        advance: told of cases.
    """
    car = brancati_suv()
    t = times(DURATION)
    total = len(CASES) + len(ROAD_CHANGES) + 2
    done = 0

    def estimate(name: str, pressure: np.ndarray, level: np.ndarray) -> np.ndarray:
        nonlocal done
        work = partial(_estimated, name, car, pressure, level, settings)
        found = store.arrays(_file(name), drive_settings(settings), work)
        done += 1
        advance(done, total)
        return found["pressure"]

    runs = settings.runs
    errors = []
    for pressure, letter in CASES:
        p = np.full((runs, len(t)), pressure)
        g = np.full((runs, len(t)), class_level(letter))
        errors.append(estimate(f"{pressure / 1e3:.0f} kPa {letter}", p, g) - pressure)
    cycled = np.array([CASES[4 * (run % 3)][0] for run in range(runs)])
    changed = {}
    for name, (before, after) in ROAD_CHANGES.items():
        g = np.where(t <= CHANGE, class_level(before), class_level(after))
        p = np.repeat(cycled[:, None], len(t), axis=1)
        changed[name] = estimate(name, p, np.broadcast_to(g, p.shape)) - cycled[:, None]
    truth = np.interp(t, [CHANGE, CHANGE + LEAKS_FOR], LEAK)
    g = np.array([class_level(CLASSES[run % 4]) for run in range(runs)])
    shape = (runs, len(t))
    leak = estimate("leak", np.broadcast_to(truth, shape), np.broadcast_to(g[:, None], shape))
    kept = kept_times(DURATION, _STRIDE)
    bounds = store.arrays("classes_bound", settings.noise, lambda: _bounds(car, settings.noise))
    advance(total, total)
    return ExactClasses(
        kept,
        np.stack(errors),
        bounds["cases"],
        changed,
        {name: bounds[name] for name in ROAD_CHANGES},
        np.interp(kept, t, truth),
        leak,
    )


def class_estimator(car: QuarterCar, noise: float) -> Estimator:
    """The IMM over exact classes, in the tuning for them but for the sensors' noise."""
    dt = 1.0 / RATE
    tuning = StiffnessTuning(noise_a_s=noise, noise_a_u=noise)
    params = changing_params(car, 15.0, dt, tuning, EXACT_CLASSES, CLASSES)
    prior = changing_prior(params, tuning, EXACT_CLASSES, CLASSES)
    return Estimator(changing_filter(dt), prior, params, bind_speed, keep_theta)


def _file(name: str) -> str:
    return "classes_" + name.replace(" ", "_")


def _estimated(
    name: str, car: QuarterCar, pressure: np.ndarray, level: np.ndarray, settings: StiffnessSettings
) -> dict[str, np.ndarray]:
    """Estimated pressure [Pa], [runs, kept]."""
    name = f"exact classes, {name}"
    v = speeds(name, settings)
    measured = simulated(name, car, Drives(pressure, level, v), settings)
    found = followed(class_estimator(car, settings.noise), measured, v, _STRIDE)
    return {"pressure": np.asarray(pressure_from_stiffness(np.exp(found.ln_k_t), car.tire))}


def _bounds(car: QuarterCar, noise: float) -> dict[str, np.ndarray]:
    """Bounds with the class known and the filter's prior, averaged over the speeds."""
    t = kept_times(DURATION, _STRIDE)
    nodes, weights = np.polynomial.legendre.leggauss(4)
    v = 0.5 * (SPEEDS[0] + SPEEDS[1]) + 0.5 * (SPEEDS[1] - SPEEDS[0]) * nodes
    prior = ln_sigma(StiffnessTuning(), car) ** -2

    def rates(pressure: float, letter: str) -> np.ndarray:
        level = class_level(letter)
        each = [corner_rate(car, pressure, level, u, noise, ("k_t",)).rate for u in v]
        return np.array(each)[:, 0, 0]

    rate = {case: rates(*case) for case in CASES}
    cases = [_over_speeds(car, p, prior + rate[p, c][:, None] * t, weights) for p, c in CASES]
    found = {"cases": np.sqrt(cases)}
    before, after = np.minimum(t, CHANGE), np.maximum(t - CHANGE, 0.0)
    for name, (first, second) in ROAD_CHANGES.items():
        each = []
        for p in dict.fromkeys(p for p, _ in CASES):
            gathered = rate[p, first][:, None] * before + rate[p, second][:, None] * after
            each.append(_over_speeds(car, p, prior + gathered, weights))
        found[name] = np.sqrt(np.mean(each, axis=0))
    return found


def _over_speeds(
    car: QuarterCar, pressure: float, information: np.ndarray, weights: np.ndarray
) -> np.ndarray:
    """Mean variance of the pressure [Pa^2], [time], for information of ln k_t [speeds, time]."""
    each = pressure_deviation(information**-0.5, car, pressure) ** 2
    return np.asarray(0.5 * weights @ each)


def lag(
    time: np.ndarray, truth: np.ndarray, estimate: np.ndarray, begin: float, seed: int = 0
) -> tuple[Interval, float]:
    """How far the estimates trail the truth: the shift in time that fits best.

    Args:
        time: [s], equally spaced, [time].
        truth: [time].
        estimate: [runs, time].
        begin: time from which they are compared [s].
        seed: of the bootstrap over runs.

    Returns:
        The shift [s], and the rms of what it leaves.
    """
    late = time >= begin
    shifts = np.arange(0.0, _LONGEST_LAG + 1e-9, time[1] - time[0])
    late_truth = np.stack([np.interp(time[late] - s, time, truth) for s in shifts])
    # [runs, shifts]
    square = np.stack([np.mean((estimate[:, late] - row) ** 2, axis=1) for row in late_truth], 1)
    best = int(np.argmin(square.mean(axis=0)))
    rng = np.random.default_rng(seed)
    drawn = rng.integers(0, len(square), (1000, len(square)))
    found = shifts[np.argmin(square[drawn].mean(axis=1), axis=1)]
    low, high = np.quantile(found, [0.025, 0.975])
    return Interval(float(shifts[best]), float(low), float(high)), float(
        np.sqrt(square[:, best].mean())
    )
