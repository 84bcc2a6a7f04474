"""Roads of any level between classes A and D: one corner against its Cramer-Rao bound."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from wheelhop.estimators import changing, immuf, stiffness
from wheelhop.evaluation.bounds import bound, deviation
from wheelhop.studies.frame import Advance, Store
from wheelhop.studies.stiffness.frame import PRESSURES, RATE, StiffnessSettings, drive_settings
from wheelhop.studies.stiffness.runs import (
    DRAWN,
    Estimator,
    Reading,
    corner_rate,
    followed,
    keep_theta,
    kept_times,
    ln_sigma,
)
from wheelhop.studies.stiffness.truth import Drives, levels, simulated, speeds, times, uniform
from wheelhop.vehicle.parameters import QuarterCar, brancati_suv
from wheelhop.vehicle.tire import stiffness_from_pressure

DURATION = 60.0
REPORTED = (2.0, 5.0, 10.0, 20.0, 60.0)
"""Times of the figures [s]."""

_STRIDE = 50
_NAME = "continuous roughness"


class Row(NamedTuple):
    """A filter and the road that it is judged on.

    Attributes:
        words: what it is.
        make: (car, noise of the accelerometers [m/s^2]) -> filter.
        road: one of `truth.ROADS`.
    """

    words: str
    make: Callable[[QuarterCar, float], Estimator]
    road: str = "white"


class Track(NamedTuple):
    """Errors of one row: ln k_t estimate minus truth, and its stated variance, [runs, time]."""

    error: np.ndarray
    variance: np.ndarray


class Continuous(NamedTuple):
    """Results.

    Attributes:
        time: [s], [time].
        tracks: by name of the row.
        bound: root of the mean over the runs of the bound's variance of ln k_t, level unknown,
            with the prior of what is drawn, [time].
    """

    time: np.ndarray
    tracks: dict[str, Track]
    bound: np.ndarray


def _tuning(noise: float, walk: float | None = None) -> stiffness.StiffnessTuning:
    tuning = replace(DRAWN, noise_a_s=noise, noise_a_u=noise)
    return tuning if walk is None else replace(tuning, stiffness_walk=walk)


def recursive_likelihood(car: QuarterCar, noise: float) -> Estimator:
    """Recursive maximum likelihood for a tyre and a road that hold."""
    dt, tuning = 1.0 / RATE, _tuning(noise)
    params = stiffness.stiffness_params(car, 15.0, dt, tuning)
    prior = stiffness.stiffness_prior(params, tuning)
    chosen = stiffness.stiffness_filter(dt)
    return Estimator(chosen, prior, params, stiffness.bind_speed, keep_theta)


def watching_changes(car: QuarterCar, noise: float) -> Estimator:
    """The IMM over what changes, in its default walks."""
    dt, tuning = 1.0 / RATE, _tuning(noise, stiffness.StiffnessTuning().stiffness_walk)
    params = changing.changing_params(car, 15.0, dt, tuning)
    prior = changing.changing_prior(params, tuning)
    return Estimator(changing.changing_filter(dt), prior, params, changing.bind_speed, keep_theta)


def joint_state(car: QuarterCar, noise: float) -> Estimator:
    """The corrected filter of Brancati & Tufano, in its default tuning."""
    dt, prior = 1.0 / RATE, DRAWN.prior_pressure
    tuning = immuf.Tuning(noise, noise, prior_pressure=prior)
    tuning = replace(tuning, prior_pressure_sigma=DRAWN.prior_pressure_sigma)
    params = immuf.immuf_params(car, 15.0, dt, tuning)
    return Estimator(
        immuf.immuf(dt), immuf.prior(car, tuning), params, immuf.bind_speed, _keep_joint
    )


def _keep_joint(state: Any, info: Any) -> Reading:
    del info
    belief = state.combined
    return Reading(belief.mean.ln_k_t, belief.cov[4][4])


MAIN, DEFAULT = "RML", "IMM of RML"
SHAPED = "RML, shape-filter road"

ROWS = {
    MAIN: Row("recursive maximum likelihood for a tyre that holds", recursive_likelihood),
    DEFAULT: Row("the default, which watches for abrupt changes too", watching_changes),
    "IMM-UKF": Row(
        "the corrected filter of Brancati & Tufano 2022 over exact classes, its default tuning",
        joint_state,
    ),
    SHAPED: Row(
        "the first on roads from the shape filter of Brancati & Tufano 2022, whose spectrum "
        "levels off at long wavelengths as no model of the filter's does",
        recursive_likelihood,
        "shaped",
    ),
}
"""Filters and roads by name; a row joins by one entry."""


def continuous(settings: StiffnessSettings, store: Store, advance: Advance) -> Continuous:
    """Run every row on the same scenarios.

    Args:
        settings: of the study.
        store: of finished rows.
        advance: told of rows.
    """
    car = brancati_suv()
    duration = min(DURATION, settings.longest)
    pressure = uniform(f"{_NAME}, pressure", settings, *PRESSURES)
    level, v = levels(_NAME, settings), speeds(_NAME, settings)
    shape = (settings.runs, len(times(duration)))
    drives = Drives(
        np.broadcast_to(pressure[:, None], shape), np.broadcast_to(level[:, None], shape), v
    )
    truth = np.log(np.asarray(stiffness_from_pressure(pressure, car.tire)))
    tracks = {}
    for done, (name, row) in enumerate(ROWS.items()):
        work = partial(_followed, car, row, drives, settings)
        file = f"continuous_{name.replace(', ', '_').replace(' ', '_')}"
        found = store.arrays(file, drive_settings(settings), work)
        tracks[name] = Track(found["ln_k_t"] - truth[:, None], found["variance"])
        advance(done + 1, len(ROWS) + 1)
    kept = kept_times(duration, _STRIDE)
    points = [(p, g, u) for p, g, u in zip(pressure, level, v, strict=True)][: settings.bound_runs]
    found = store.arrays(
        "continuous_bound",
        [drive_settings(settings), settings.bound_runs],
        lambda: {"bound": _bound(car, points, kept, settings.noise)},
    )
    advance(len(ROWS) + 1, len(ROWS) + 1)
    return Continuous(kept, tracks, found["bound"])


def _followed(
    car: QuarterCar, row: Row, drives: Drives, settings: StiffnessSettings
) -> dict[str, np.ndarray]:
    measured = simulated(_NAME, car, drives, settings, row.road)
    found = followed(row.make(car, settings.noise), measured, drives.speed, _STRIDE)
    return dict(found._asdict())


def _bound(
    car: QuarterCar, points: list[tuple[float, float, float]], time: np.ndarray, noise: float
) -> np.ndarray:
    prior = {"k_t": ln_sigma(DRAWN, car), "level": DRAWN.prior_level_sigma}
    each = [
        deviation(bound(corner_rate(car, p, g, v, noise), time, prior), "k_t") ** 2
        for p, g, v in points
    ]
    return np.asarray(np.sqrt(np.mean(each, axis=0)))
