"""Four tyres from the wheels' accelerations in the band of the wheel hop, on a road of any slope.

A vehicle is a quarter car only there: above some 30 Hz the contact patch averages the road away
and measured roads hold nothing, and the body's accelerations belong to all four wheels together.
So the wheels' accelerations alone are used, as means over intervals of `BLOCK` samples; the
contact patch is a first-order low-pass, and the road's waviness and the damping are estimated too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.estimators.hop_model import HopParams, hop_model, hop_state_prior
from wheelhop.estimators.stiffness import (
    StiffnessTuning,
    bind_theta,
    prior_ln_sigma,
    stiffness_params,
    theta_type,
)
from wheelhop.filtering import (
    Filter,
    SensitivityParams,
    SensitivityPrior,
    extended,
    independent,
    joint_sensitivity,
)
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.tire import stiffness_from_pressure

BLOCK = 8
"""Samples of 500 Hz per mean: means every 16 ms pass what lies below 30 Hz."""

MEAN_OVER = 0.016
"""Interval of the means [s]."""

PATCH = 0.09
"""Half-length of the contact patch [m] of a passenger-car tyre."""

HOP_TUNING = StiffnessTuning(
    stiffness_walk=0.005, level_walk=0.3, waviness_sigma=0.4, damping_sigma=0.15
)
"""Default tuning: a road that is not equally rough, nor equally wavy, all along."""

FREE = ("waviness", "ln_damping")
"""What the four corners share beside ln G."""

_FINE = 0.002


class HopTheta(NamedTuple):
    """What is estimated of a vehicle.

    Attributes:
        ln_k_t_fl, ln_k_t_fr, ln_k_t_rl, ln_k_t_rr: log of the tyres' stiffness in N/m.
        ln_level: log of the road's level over that of the parameters.
        waviness: deviation of the road's waviness from that of the parameters [-].
        ln_damping: log of the dampers' force over that of the parameters.
    """

    ln_k_t_fl: Any
    ln_k_t_fr: Any
    ln_k_t_rl: Any
    ln_k_t_rr: Any
    ln_level: Any
    waviness: Any
    ln_damping: Any


_PLACES = tuple((i, 4, 5, 6) for i in range(4))


def hop_filter(dt: float) -> Filter:
    """Recursive maximum likelihood over four wheels; dt is the interval of the means [s]."""
    return _hop_filter(max(1, round(dt / _FINE)))


@lru_cache(maxsize=4)
def _hop_filter(substeps: int) -> Filter:
    return joint_sensitivity(extended(hop_model(substeps)), bind_hop, theta_type(FREE), _PLACES)


def bind_hop(params: HopParams, theta: Any) -> HopParams:
    """The parameters of a corner with theta in effect."""
    return replace(params, corner=bind_theta(params.corner, theta))


def hop_params(
    cars: Sequence[QuarterCar],
    dt: float,
    tuning: StiffnessTuning = HOP_TUNING,
    block: int = BLOCK,
    patch: float = PATCH,
    waviness: float = 2.0,
) -> SensitivityParams:
    """Parameters of `hop_filter`.

    Args:
        cars: the corners FL, FR, RL, RR.
        dt: interval of the means [s].
        tuning: priors, walks and noise of a single sample.
        block: samples per mean.
        patch: half-length of the contact patch [m].
        waviness: mean of its prior.
    """
    each = [stiffness_params(car, 15.0, dt, tuning, FREE, waviness) for car in cars]
    inner = jax.tree.map(lambda *a: jnp.stack(a), *(e.inner for e in each))
    inner = replace(inner, noise_a_u=inner.noise_a_u / block**0.5)
    tyre, level, waviness_walk, damping_walk = each[0].walk
    walk = HopTheta(tyre, tyre, tyre, tyre, level, waviness_walk, damping_walk)
    return SensitivityParams(HopParams(inner, jnp.full((4,), patch, inner.dt.dtype)), walk)


def hop_prior(params: SensitivityParams, tuning: StiffnessTuning = HOP_TUNING) -> SensitivityPrior:
    """Belief before the first mean: moving a little, theta as in the tuning."""
    inner = params.inner
    tires = [jax.tree.map(lambda a, i=i: a[i], inner.corner.car.tire) for i in range(4)]
    mean = [jnp.log(stiffness_from_pressure(tuning.prior_pressure, tire)) for tire in tires]
    sigma = [prior_ln_sigma(tuning, tire) for tire in tires]
    zero = jnp.zeros_like(mean[0])
    shared = (tuning.prior_level_sigma, tuning.waviness_sigma, tuning.damping_sigma)
    theta = independent(
        HopTheta._make([*mean, zero, zero, zero]), HopTheta._make([*sigma, *shared])
    )
    theta = jax.tree.map(lambda a: jnp.asarray(a, float), theta)
    none = jnp.broadcast_to(zero, (4,))
    local = theta_type(FREE)(jnp.stack(mean), none, none, none)
    return SensitivityPrior(hop_state_prior(jax.vmap(bind_hop)(inner, local)), theta)


def bind_speed(params: SensitivityParams, speed: Any) -> SensitivityParams:
    """The parameters at a time of speed [m/s]."""
    corner = params.inner.corner
    every = jnp.broadcast_to(speed, (*corner.speed.shape[:1], *jnp.shape(speed)))
    inner = replace(params.inner, corner=replace(corner, speed=every))
    return replace(params, inner=inner)


def means(samples: np.ndarray, block: int = BLOCK) -> np.ndarray:
    """Means over blocks of samples [..., time, wheels]; what does not fill a block is left out."""
    count = samples.shape[-2] // block
    cut = samples[..., : count * block, :]
    return cut.reshape(*cut.shape[:-2], count, block, cut.shape[-1]).mean(-2)
