"""A front and a rear corner in one track, against the bound that their common road allows."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from wheelhop.estimators.axle_pair import axle_pair
from wheelhop.estimators.axle_pair_settings import (
    AxlePairTuning,
    axle_pair_params,
    axle_pair_prior,
    read_pair,
)
from wheelhop.estimators.stiffness import bind_speed
from wheelhop.evaluation.bounds import bound, pair_information
from wheelhop.evaluation.linearisation import linearised
from wheelhop.evaluation.spectra import IsoRoad
from wheelhop.studies.frame import Advance, Store
from wheelhop.studies.stiffness.frame import RATE, SPEEDS, StiffnessSettings, drive_settings
from wheelhop.studies.stiffness.pair_truth import (
    AXLES,
    WHEELBASE,
    PairDrives,
    pair_drives,
    simulated_pair,
)
from wheelhop.studies.stiffness.runs import DRAWN, Estimator, followed, kept_times, ln_sigma
from wheelhop.studies.stiffness.truth import times
from wheelhop.vehicle.parameters import QuarterCar, brancati_suv
from wheelhop.vehicle.tire import stiffness_from_pressure

COHERENCES = (0.99, 0.9)
"""Of the two wheels' roads, equal at all wavelengths."""

DURATION = 20.0
REPORTED = (2.0, 5.0, 10.0, 20.0)
"""Times of the figures [s]."""

_UNKNOWN = ("k_t", "level", "delay")
_STRIDE = 50


class PairReading(NamedTuple):
    """Means of both ln k_t, and the lower triangle of their covariance row by row."""

    mean: Any
    cov: Any


class PairTrack(NamedTuple):
    """One coherence.

    Attributes:
        error: of ln k_t of both wheels, estimate minus truth, [runs, time, 2].
        cov: its stated covariance, [runs, time, 2, 2].
        bound: root of the mean over wheels and runs of the bound's variance of ln k_t; level and
            delay unknown, with the prior of what is drawn, [time].
    """

    error: np.ndarray
    cov: np.ndarray
    bound: np.ndarray


class AxlePairs(NamedTuple):
    """Results: time [s], [time], and tracks by coherence."""

    time: np.ndarray
    tracks: dict[float, PairTrack]


def axle_pairs(settings: StiffnessSettings, store: Store, advance: Advance) -> AxlePairs:
    """Run the joint filter of both corners at every coherence.

    Args:
        settings: of the study.
        store: of finished runs.
        advance: told of steps.
    """
    duration = min(DURATION, settings.longest)
    drives, kept = pair_drives(settings), kept_times(duration, _STRIDE)
    cars = tuple(brancati_suv(axle) for axle in AXLES)
    truth = np.log(
        np.stack(
            [
                np.asarray(stiffness_from_pressure(drives.pressure[:, i], car.tire))
                for i, car in enumerate(cars)
            ],
            axis=1,
        )
    )
    tracks = {}
    for number, coherence in enumerate(COHERENCES):
        work = partial(_followed, cars, drives, coherence, duration, settings)
        found = store.arrays(f"axle_pair_{coherence:g}", drive_settings(settings), work)
        advance(2 * number + 1, 2 * len(COHERENCES))
        best = store.arrays(
            f"axle_pair_{coherence:g}_bound",
            [drive_settings(settings), settings.bound_runs],
            partial(_bound, cars, drives, coherence, kept, settings),
        )
        advance(2 * number + 2, 2 * len(COHERENCES))
        error = found["mean"] - truth[:, None]
        tracks[coherence] = PairTrack(error, found["cov"], best["bound"])
    return AxlePairs(kept, tracks)


def pair_estimator(cars: tuple[QuarterCar, ...], coherence: float, noise: float) -> Estimator:
    """Recursive maximum likelihood over an axle pair whose tyres and road hold."""
    dt = 1.0 / RATE
    corner = replace(DRAWN, noise_a_s=noise, noise_a_u=noise)
    tuning = AxlePairTuning(corner=corner)
    params = axle_pair_params(cars[0], cars[1], WHEELBASE, 15.0, coherence, dt, tuning)
    prior = axle_pair_prior(params, tuning)
    return Estimator(axle_pair(dt, 1.1 * WHEELBASE / SPEEDS[0]), prior, params, bind_speed, _keep)


def _keep(state: Any, info: Any) -> PairReading:
    del info
    belief = read_pair(state)
    (front,), (across, rear) = belief.cov
    return PairReading(tuple(belief.mean), (front, across, rear))


def _followed(
    cars: tuple[QuarterCar, ...],
    drives: PairDrives,
    coherence: float,
    duration: float,
    settings: StiffnessSettings,
) -> dict[str, np.ndarray]:
    measured = simulated_pair(cars, drives, coherence, len(times(duration)), settings)
    estimator = pair_estimator(cars, coherence, settings.noise)
    found = followed(estimator, measured, drives.indicated, _STRIDE)
    mean = np.stack(found.mean, axis=-1)
    front, across, rear = found.cov
    cov = np.stack([np.stack([front, across], -1), np.stack([across, rear], -1)], -1)
    return {"mean": mean, "cov": cov}


def _bound(
    cars: tuple[QuarterCar, ...],
    drives: PairDrives,
    coherence: float,
    time: np.ndarray,
    settings: StiffnessSettings,
) -> dict[str, np.ndarray]:
    variances = []
    count = min(settings.bound_runs, settings.runs)
    for pressures, level, speed in list(
        zip(drives.pressure, drives.level, drives.speed, strict=False)
    )[:count]:
        road, v = IsoRoad(float(level)), float(speed)
        front, rear = (float(p) for p in pressures)
        near = (linearised(cars[0], front, road, v), linearised(cars[1], rear, road, v))
        noise = (settings.noise, settings.noise)
        information = pair_information(
            near, (front, rear), road, v, WHEELBASE, coherence, noise, _UNKNOWN, RATE
        )
        prior = {
            "k_t front": ln_sigma(DRAWN, cars[0]),
            "k_t rear": ln_sigma(DRAWN, cars[1]),
            "level": DRAWN.prior_level_sigma,
            "delay": AxlePairTuning().speed_sigma * WHEELBASE / v,
        }
        best = bound(information, time, prior)
        places = [best.names.index(name) for name in ("k_t front", "k_t rear")]
        cov = np.linalg.inv(best.information)
        variances.append(cov[:, places, places].mean(axis=1))
    return {"bound": np.sqrt(np.mean(variances, axis=0))}
