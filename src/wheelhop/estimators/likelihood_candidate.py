"""Recursive maximum likelihood as a candidate beside the filters of Brancati & Tufano 2022."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import jax.numpy as jnp

from wheelhop.estimators.candidate import Candidate, Reading, Tuning
from wheelhop.estimators.candidates import NOISE
from wheelhop.estimators.changing import (
    bind_speed,
    changing_filter,
    changing_modes,
    changing_params,
    changing_prior,
)
from wheelhop.estimators.stiffness import StiffnessTuning
from wheelhop.filtering import (
    Gaussian,
    InteractingParams,
    InteractingState,
    SensitivityPrior,
    standard_deviation,
)
from wheelhop.vehicle.parameters import QuarterCar

_SPEED = 15.0


class _Setting(NamedTuple):
    """Parameters and belief before the first sample."""

    params: InteractingParams
    prior: SensitivityPrior


def maximum_likelihood(
    cars: Mapping[str, QuarterCar], dt: float, convention: str = "iso8608", noise: float = NOISE
) -> Candidate:
    """The IMM of RML filters over one corner, with nothing to tune.

    It knows no road classes, and therefore needs no convention and one corner only: that of class
    B, or of the class nearest to it. Its initial motion is off as that of the other filters; its
    pressure and road level start from their prior.

    Args:
        cars: the corner by road class.
        dt: sampling interval [s].
        convention: of road levels; not used.
        noise: of both accelerometers [m/s^2].
    """
    del convention
    car = cars[min(cars, key=lambda name: abs(ord(name) - ord("B")))]
    tuning = StiffnessTuning(noise_a_s=noise, noise_a_u=noise)
    params = changing_params(car, _SPEED, dt, tuning)
    return Candidate(
        "maximum likelihood",
        changing_modes(dt, tuning).names,
        {},
        changing_filter(dt),
        _Setting(params, changing_prior(params, tuning)),
        _prior,
        _params,
        _inputs,
        bind_speed,
        _read,
        states=4,
    )


def _prior(tuning: Tuning, setting: _Setting, normal: Any) -> SensitivityPrior:
    del tuning
    state = setting.prior.state
    sigma = standard_deviation(state)
    moved = (m + s * normal[i] for i, (m, s) in enumerate(zip(state.mean, sigma, strict=True)))
    return setting.prior._replace(state=Gaussian(type(state.mean)(*moved), state.cov))


def _params(tuning: Tuning, setting: _Setting) -> InteractingParams:
    del tuning
    return setting.params


def _inputs(key: Any, speed: Any, setting: _Setting) -> Any:
    del key, setting
    return speed


def _read(state: InteractingState) -> Reading:
    theta = state.combined.theta
    stiffness = jnp.exp(theta.mean.ln_k_t)
    return Reading(
        stiffness,
        stiffness * jnp.sqrt(theta.cov[0][0]),
        jnp.exp(state.log_probabilities),
        jnp.exp(state.members.theta.mean.ln_k_t),
    )
