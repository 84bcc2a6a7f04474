"""Four corners whose roads are equally rough: how well tyres, and their differences, are known."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from wheelhop.estimators.four_corners import (
    WHEELS,
    bind_speed,
    four_corner_filter,
    four_corner_params,
    four_corner_prior,
)
from wheelhop.estimators.stiffness import read_theta
from wheelhop.evaluation.bounds import bound, pooled
from wheelhop.studies.four_tyres import corners
from wheelhop.studies.frame import Advance, Store
from wheelhop.studies.stiffness.frame import PRESSURES, RATE, StiffnessSettings, drive_settings
from wheelhop.studies.stiffness.runs import (
    DRAWN,
    Estimator,
    corner_rate,
    followed,
    kept_times,
    ln_sigma,
)
from wheelhop.studies.stiffness.truth import Drives, levels, simulated, speeds, times, uniform
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.quarter_car import Accelerations
from wheelhop.vehicle.tire import stiffness_from_pressure

DURATION = 20.0
REPORTED = (2.0, 10.0, 20.0)
"""Times of the figures [s]."""

ABSOLUTE, AGAINST_MEAN, PAIRS = "absolute", "against the mean of the four", "between two wheels"

_N = len(WHEELS)

COMBINATIONS = {
    ABSOLUTE: np.eye(_N),
    AGAINST_MEAN: np.eye(_N) - 1.0 / _N,
    PAIRS: np.array([np.eye(_N)[i] - np.eye(_N)[j] for i in range(_N) for j in range(i)]),
}
"""What is judged, as rows of weights on the four ln k_t, [figures, wheels]."""

_STRIDE = 50
_NAME = "four corners"


class WheelsReading(NamedTuple):
    """Mean of the four ln k_t, and the lower triangle of their covariance row by row."""

    mean: Any
    cov: Any


class SeveralWheels(NamedTuple):
    """Results.

    Attributes:
        time: [s], [time].
        error: of ln k_t, estimate minus truth, [runs, time, wheels].
        cov: its stated covariance, [runs, time, wheels, wheels].
        bound: of each of `COMBINATIONS`: root of the mean over its rows and the runs of the
            bound's variance, level unknown, with the prior of what is drawn, [time].
    """

    time: np.ndarray
    error: np.ndarray
    cov: np.ndarray
    bound: dict[str, np.ndarray]


def several_wheels(settings: StiffnessSettings, store: Store, advance: Advance) -> SeveralWheels:
    """Run the joint filter over four corners, each with a pressure and a road of its own.

    Args:
        settings: of the study.
        store: of finished runs.
        advance: told of steps.
    """
    cars = vehicle()
    duration = min(DURATION, settings.longest)
    pressure = np.stack(
        [uniform(f"{_NAME}, {wheel}", settings, *PRESSURES) for wheel in WHEELS], axis=1
    )
    level, v = levels(_NAME, settings), speeds(_NAME, settings)
    work = partial(_followed, cars, pressure, level, v, duration, settings)
    found = store.arrays("four_corners", drive_settings(settings), work)
    advance(1, 2)
    truth = [
        np.log(np.asarray(stiffness_from_pressure(pressure[:, i], car.tire)))
        for i, car in enumerate(cars)
    ]
    kept = kept_times(duration, _STRIDE)
    count = settings.bound_runs
    bounds = store.arrays(
        "four_corners_bound",
        [drive_settings(settings), count],
        lambda: _bounds(cars, pressure[:count], level, v, kept, settings.noise),
    )
    advance(2, 2)
    return SeveralWheels(
        kept, found["mean"] - np.stack(truth, axis=1)[:, None], found["cov"], bounds
    )


def vehicle() -> tuple[QuarterCar, ...]:
    """The corners FL, FR, RL, RR."""
    return corners()


def four_estimator(cars: tuple[QuarterCar, ...], noise: float) -> Estimator:
    """Recursive maximum likelihood over four tyres and a road that hold."""
    dt, tuning = 1.0 / RATE, replace(DRAWN, noise_a_s=noise, noise_a_u=noise)
    params = four_corner_params(cars, 15.0, dt, tuning)
    return Estimator(
        four_corner_filter(dt), four_corner_prior(params, tuning), params, bind_speed, _keep
    )


def _keep(state: Any, info: Any) -> WheelsReading:
    del info
    theta = read_theta(state)
    return WheelsReading(
        tuple(theta.mean[:_N]), tuple(theta.cov[i][j] for i in range(_N) for j in range(i + 1))
    )


def _followed(
    cars: tuple[QuarterCar, ...],
    pressure: np.ndarray,
    level: np.ndarray,
    v: np.ndarray,
    duration: float,
    settings: StiffnessSettings,
) -> dict[str, np.ndarray]:
    shape = (settings.runs, len(times(duration)))
    road = np.broadcast_to(level[:, None], shape)
    each = [
        simulated(
            f"{_NAME}, {wheel}",
            car,
            Drives(np.broadcast_to(pressure[:, i, None], shape), road, v),
            settings,
        )
        for i, (wheel, car) in enumerate(zip(WHEELS, cars, strict=True))
    ]
    measured = Accelerations(*(np.stack(entries, axis=-1) for entries in zip(*each, strict=True)))
    found = followed(four_estimator(cars, settings.noise), measured, v, _STRIDE)
    mean = np.stack(found.mean, axis=-1)
    cov = np.empty((*mean.shape, _N))
    places = [(i, j) for i in range(_N) for j in range(i + 1)]
    for (i, j), entry in zip(places, found.cov, strict=True):
        cov[..., i, j] = cov[..., j, i] = entry
    return {"mean": mean, "cov": cov}


def _bounds(
    cars: tuple[QuarterCar, ...],
    pressure: np.ndarray,
    level: np.ndarray,
    v: np.ndarray,
    time: np.ndarray,
    noise: float,
) -> dict[str, np.ndarray]:
    names = [f"k_t {wheel}" for wheel in WHEELS]
    prior = dict.fromkeys(names, ln_sigma(DRAWN, cars[0])) | {"level": DRAWN.prior_level_sigma}
    variances: dict[str, list[np.ndarray]] = {name: [] for name in COMBINATIONS}
    for pressures, g, u in zip(pressure, level, v, strict=False):
        parts = {
            wheel: corner_rate(car, p, g, u, noise)
            for wheel, car, p in zip(WHEELS, cars, pressures, strict=True)
        }
        best = bound(pooled(parts), time, prior)
        places = [best.names.index(name) for name in names]
        cov = np.linalg.inv(best.information)[:, places][:, :, places]
        for name, rows in COMBINATIONS.items():
            variances[name].append(combined_variance(cov, rows).mean(axis=-1))
    return {name: np.sqrt(np.mean(each, axis=0)) for name, each in variances.items()}


def combined_variance(cov: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Variance of each weighted sum, [..., figures]; cov [..., wheels, wheels]."""
    return np.einsum("fi,...ij,fj->...f", rows, cov, rows)
