"""Filters over many runs of a Monte Carlo, and the bounds that they are judged by."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.estimators.stiffness import StiffnessTuning, prior_ln_sigma, read_theta
from wheelhop.evaluation.bounds import Information, corner_information
from wheelhop.evaluation.linearisation import linearised
from wheelhop.evaluation.spectra import IsoRoad
from wheelhop.filtering import Filter, run_batch
from wheelhop.filtering.batch import LANES
from wheelhop.filtering.drive import Bind, Keep
from wheelhop.studies.stiffness.frame import PRESSURES, RATE
from wheelhop.vehicle.parameters import QuarterCar

DRAWN = StiffnessTuning(
    prior_pressure=0.5 * (PRESSURES[0] + PRESSURES[1]),
    prior_pressure_sigma=(PRESSURES[1] - PRESSURES[0]) / 12.0**0.5,
    stiffness_walk=0.0,
)
"""Tuning with the mean and the spread of what is drawn, for tyres that hold their pressure:
with another prior neither NEES nor the bound would say anything about short times."""


class Estimator(NamedTuple):
    """A filter ready to run.

    Attributes:
        filter: any `Filter`.
        prior: belief before the first sample.
        params: its parameters.
        bind: puts a speed [m/s] into them.
        keep: (state, info) -> what to store of a step, a NamedTuple of numbers.
    """

    filter: Filter
    prior: Any
    params: Any
    bind: Bind
    keep: Keep


class Reading(NamedTuple):
    """What a filter says of one tyre: mean and variance of ln k_t."""

    ln_k_t: Any
    variance: Any


def keep_theta(state: Any, info: Any) -> Reading:
    """`Keep` of a recursive maximum likelihood filter, or of an IMM of them."""
    del info
    theta = read_theta(state)
    return Reading(theta.mean.ln_k_t, theta.cov[0][0])


def followed(estimator: Estimator, measured: Any, speed: np.ndarray, stride: int) -> Any:
    """What the estimator keeps, as NumPy arrays [runs, kept]; sample `stride` is the first.

    Args:
        estimator: the filter.
        measured: what it takes in, entries [runs, time, ...].
        speed: of the runs [m/s], [runs].
        stride: keep every so many samples.
    """
    runs, samples = jax.tree.leaves(measured)[0].shape[:2]
    chunks = -(-runs // LANES)
    found = run_batch(
        estimator.filter,
        estimator.filter.init(estimator.prior, estimator.params),
        jax.tree.map(lambda a: jnp.asarray(a, float), measured),
        estimator.params,
        inputs=jnp.broadcast_to(jnp.asarray(speed, float)[:, None], (runs, samples)),
        bind=estimator.bind,
        keep=estimator.keep,
        lanes=-(-runs // chunks),
    )
    return jax.tree.map(lambda leaf: np.asarray(leaf)[:, stride - 1 :: stride], found)


def kept_times(duration: float, stride: int) -> np.ndarray:
    """Times that `followed` keeps [s]."""
    return np.arange(stride, round(duration * RATE) + 1, stride) / RATE


def ln_sigma(tuning: StiffnessTuning, car: QuarterCar) -> float:
    """Standard deviation of ln k_t before the first sample."""
    return float(prior_ln_sigma(tuning, car.tire))


def corner_rate(
    car: QuarterCar,
    pressure: float,
    level: float,
    speed: float,
    noise: float,
    free: tuple[str, ...] = ("k_t", "level"),
) -> Information:
    """Information per second of one corner at one operating point, its suspension linearised."""
    road = IsoRoad(float(level))
    near = linearised(car, float(pressure), road, float(speed))
    return corner_information(near, float(pressure), road, float(speed), (noise, noise), free, RATE)


def at(time: np.ndarray, wanted: float) -> int:
    """Place of a time [s] among increasing ones that hold it."""
    return int(np.argmin(np.abs(time - wanted)))


def reported(duration: float, wanted: tuple[float, ...]) -> tuple[float, ...]:
    """Those of the wanted times [s] that a drive reaches."""
    return tuple(t for t in wanted if t <= duration + 1e-9)
