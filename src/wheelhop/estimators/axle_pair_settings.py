"""What an axle pair is told and what it tells: parameters, tuning, prior and readings."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from wheelhop.errors import require_in_range
from wheelhop.estimators.axle_pair_model import PairBelief
from wheelhop.estimators.stiffness import StiffnessTuning, prior_ln_sigma, validate_tuning
from wheelhop.filtering import Gaussian, SensitivityParams, SensitivityPrior, independent
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.quarter_car import RelativeState
from wheelhop.vehicle.tire import stiffness_from_pressure

_REST = RelativeState(0.02, 0.01, 0.3, 1.0)


class PairTheta(NamedTuple):
    """What is estimated of an axle pair.

    Attributes:
        ln_k_front, ln_k_rear: log of the tyre stiffness in N/m.
        ln_level: log of the road's level over that of the parameters.
        ln_speed: log of the true over the indicated speed, or of the wheelbase's over its true
            length: the delay is l / v exp(-ln_speed).
        ln_own: log of the odds (1 - gamma^2) / gamma^2 of the rear wheel's road being its own,
            over those of the parameters.
    """

    ln_k_front: Any
    ln_k_rear: Any
    ln_level: Any
    ln_speed: Any
    ln_own: Any


class PairStiffness(NamedTuple):
    """Log of both tyres' stiffness in N/m."""

    ln_k_front: Any
    ln_k_rear: Any


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class PairParams:
    """Parameters of the pair; the speed may vary in time (`stiffness.bind_speed`).

    Attributes:
        front, rear: the corners; their tyres' stiffness is not used.
        wheelbase: l [m].
        speed: indicated v [m/s].
        level: Gd(W0) of the road [m^3/rad] from which `PairTheta.ln_level` deviates.
        coherence: gamma of the two wheels' roads [-], 0 to 1.
        bandwidth: of the coherence [Hz].
        noise_a_s, noise_a_u: standard deviations of the accelerometers [m/s^2].
        dt: sampling interval [s].
        speed_sigma: largest standard deviation of `PairTheta.ln_speed` [-].
        speed_forgetting: rate at which it grows towards that [1/s].
    """

    front: QuarterCar
    rear: QuarterCar
    wheelbase: Any
    speed: Any
    level: Any
    coherence: Any
    bandwidth: Any
    noise_a_s: Any
    noise_a_u: Any
    dt: Any
    speed_sigma: Any
    speed_forgetting: Any


@dataclass(frozen=True)
class AxlePairTuning:
    """What a user may tune.

    Attributes:
        corner: noise, priors and walks that a lone corner has too; both corners get them.
        bandwidth: frequency [Hz] at which the coherence of the model has fallen by half.
        speed_sigma: standard deviation of `PairTheta.ln_speed` [-].
        speed_walk: its random walk [1/sqrt(s)].
        speed_forgetting: rate [1/s] at which its variance grows, not beyond the prior's.
            A delay that starts far off moves slowly, for far off the likelihood is flat; without
            forgetting it would be believed before it is found.
        own_sigma: standard deviation of `PairTheta.ln_own`; 0 where the coherence is known.
        own_walk: its random walk [1/sqrt(s)].
    """

    corner: StiffnessTuning = field(default_factory=StiffnessTuning)
    bandwidth: float = 800.0
    speed_sigma: float = 0.015
    speed_walk: float = 0.0
    speed_forgetting: float = 4.0
    own_sigma: float = 0.0
    own_walk: float = 0.0


_RANGES = {
    "bandwidth": (1.0, 800.0, "Hz"),
    "speed_sigma": (0.0, 0.2, "(no unit)"),
    "speed_walk": (0.0, 1.0, "1/sqrt(s)"),
    "speed_forgetting": (0.0, 100.0, "1/s"),
    "own_sigma": (0.0, 10.0, "(no unit)"),
    "own_walk": (0.0, 10.0, "1/sqrt(s)"),
}


def validate_pair_tuning(tuning: AxlePairTuning) -> AxlePairTuning:
    """The same tuning, checked.

    Raises:
        InputError: naming the figure that is out of range.
    """
    validate_tuning(tuning.corner)
    for entry in fields(tuning):
        if entry.name in _RANGES:
            low, high, unit = _RANGES[entry.name]
            require_in_range(f"tuning.{entry.name}", getattr(tuning, entry.name), low, high, unit)
    return tuning


def axle_pair_params(
    front: QuarterCar,
    rear: QuarterCar,
    wheelbase: float,
    speed: Any,
    coherence: Any,
    dt: float,
    tuning: AxlePairTuning = AxlePairTuning(),
) -> SensitivityParams:
    """Parameters of `axle_pair`, arrays of JAX's default floating type.

    Args:
        front, rear: the corners; their tyres' stiffness is not used.
        wheelbase: l [m].
        speed: v [m/s] until `stiffness.bind_speed` sets another.
        coherence: gamma of the two wheels' roads below the bandwidth [-], 0 to 1, or where
            `tuning.own_sigma` leaves it free the one to start from.
        dt: sampling interval [s].
        tuning: priors, walks and noise.

    Raises:
        InputError: if the tuning, the wheelbase or the coherence is out of range.
    """
    c = validate_pair_tuning(tuning).corner
    require_in_range("wheelbase", wheelbase, 0.1, 20.0, "m")
    if not isinstance(coherence, jax.core.Tracer):
        require_in_range("coherence", coherence, 0.0, 1.0, "(no unit)")
    inner = PairParams(
        front,
        rear,
        wheelbase,
        speed,
        c.prior_level,
        coherence,
        tuning.bandwidth,
        c.noise_a_s,
        c.noise_a_u,
        dt,
        tuning.speed_sigma,
        tuning.speed_forgetting,
    )
    walk = PairTheta(
        c.stiffness_walk, c.stiffness_walk, c.level_walk, tuning.speed_walk, tuning.own_walk
    )
    params = SensitivityParams(inner, PairTheta(*(w * w * dt for w in walk)))
    return jax.tree.map(lambda a: jnp.asarray(a, float), params)


def axle_pair_prior(
    params: SensitivityParams, tuning: AxlePairTuning = AxlePairTuning()
) -> SensitivityPrior:
    """Belief before the first sample: moving a little, theta as in the tuning.

    Args:
        params: from `axle_pair_params` with this tuning.
        tuning: priors.
    """
    c, p = tuning.corner, params.inner
    tires = (p.front.tire, p.rear.tire)
    sigma = PairTheta(
        prior_ln_sigma(c, p.front.tire),
        prior_ln_sigma(c, p.rear.tire),
        c.prior_level_sigma,
        tuning.speed_sigma,
        tuning.own_sigma,
    )
    front, rear = (jnp.log(stiffness_from_pressure(c.prior_pressure, tire)) for tire in tires)
    theta = independent(PairTheta(front, rear, 0.0, 0.0, 0.0), sigma)
    theta = jax.tree.map(lambda a: jnp.asarray(a, float), theta)
    zero = 0.0 * p.speed
    rest = RelativeState(zero, zero, zero, zero)
    sigmas = (*_REST, *_REST, 0.0)
    rows = tuple(
        jnp.stack([zero + s if i == j else zero for j in range(len(sigmas))])
        for i, s in enumerate(sigmas)
    )
    return SensitivityPrior(PairBelief(rest, rest, zero, rows), theta)


def read_pair_theta(state: Any) -> Gaussian:
    """`Gaussian` of `PairTheta`, of a state of `axle_pair`."""
    return state.pair.theta


def read_pair(state: Any) -> Gaussian:
    """`Gaussian` of `PairStiffness`, of a state of `axle_pair`."""
    theta = read_pair_theta(state)
    return Gaussian(PairStiffness(*theta.mean[:2]), theta.cov[:2])
