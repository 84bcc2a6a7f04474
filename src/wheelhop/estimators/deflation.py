"""Level and rate of ln k_t over minutes, from an estimator's belief at each instant."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from wheelhop.filtering import smallmat

_UNSEEN = 1.0
"""Variance of ln k_t before the first belief; small enough for float32 to subtract from."""

_ABSENT = 1e6
"""Variance of the measurement that a wheel without a belief gives."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class DeflationParams:
    """Model of how ln k_t changes: d x = r dt + level_walk dW, d r = -r/rate_memory dt + ... .

    Attributes:
        dt: time between beliefs [s].
        belief_walk: random walk of ln k_t that the estimator itself assumes [1/sqrt(s)].
        level_walk: of ln k_t here [1/sqrt(s)].
        rate_walk: of its rate [1/s per sqrt(s)].
        rate_memory: time after which a rate is forgotten [s].
    """

    dt: Any
    belief_walk: Any
    level_walk: Any
    rate_walk: Any
    rate_memory: Any


class DeflationState(NamedTuple):
    """Gaussian over ln k_t and its rate.

    Attributes:
        level: ln k_t, [wheels].
        rate: its time derivative [1/s], [wheels].
        level_cov, cross_cov, rate_cov: covariances (level by rate for the second),
            [wheels, wheels].
        seen: whether a wheel ever had a belief, [wheels].
    """

    level: Any
    rate: Any
    level_cov: Any
    cross_cov: Any
    rate_cov: Any
    seen: Any


def deflation_init(wheels: int, params: DeflationParams, dtype: Any = None) -> DeflationState:
    """State that knows nothing of the level, and of the rate what its random walk says."""
    dtype = jnp.result_type(float) if dtype is None else dtype
    zero, eye = jnp.zeros(wheels, dtype), jnp.eye(wheels, dtype=dtype)
    rate_variance = jnp.asarray(0.5 * params.rate_walk**2 * params.rate_memory, dtype)
    return DeflationState(
        zero,
        zero,
        _UNSEEN * eye,
        0.0 * eye,
        rate_variance * eye,
        jnp.zeros(wheels, bool),
    )


def deflation_step(
    state: DeflationState, mean: Any, cov: Any, params: DeflationParams
) -> tuple[DeflationState, Any]:
    """One belief later.

    Successive beliefs share nearly all their errors, so they are no independent measurements.
    An estimator in its steady state, Sigma = inv(inv(Sigma + w^2 dt I) + J), takes in J per
    step; its mean therefore counts as a measurement of covariance
    R = J^-1 = Sigma + Sigma^2 / (w^2 dt). While it still converges from its prior this counts
    too little.
    What a wheel without a belief last had is kept, and only its covariance grows.

    Args:
        state: the last state.
        mean: of ln k_t, [wheels]; NaN for a wheel without a belief.
        cov: its covariance, [wheels, wheels].
        params: model.

    Returns:
        The state, and which wheels had a belief, [wheels].
    """
    p: DeflationParams = jax.tree.map(lambda a: jnp.asarray(a, mean.dtype), params)
    valid = jnp.isfinite(mean) & (jnp.diagonal(cov) > 0) & jnp.isfinite(jnp.diagonal(cov))
    # a finite wheel with a broken covariance to another finite one has no usable belief either
    both = valid[:, None] & valid[None, :]
    valid = valid & jnp.all(jnp.isfinite(jnp.where(both, cov, 0.0)), axis=1)
    both = valid[:, None] & valid[None, :]

    known = jnp.where(both, cov, 0.0)
    eye = jnp.eye(len(mean), dtype=mean.dtype)
    noise = known + known @ known / (p.belief_walk**2 * p.dt)
    noise = noise + jnp.where(valid, 0.0, _ABSENT)[:, None] * eye

    first = valid & ~state.seen
    level = jnp.where(first, mean, state.level + jnp.where(valid, state.rate * p.dt, 0.0))
    decay = 1.0 - p.dt / p.rate_memory
    rate = jnp.where(valid, decay * state.rate, state.rate)
    a, b, c = state.level_cov, state.cross_cov, state.rate_cov
    q = p.rate_walk**2 * p.dt
    a = a + p.dt * (b + b.T) + p.dt**2 * c + (p.level_walk**2 * p.dt + q * p.dt**2 / 3.0) * eye
    b = decay * (b + p.dt * c) + 0.5 * q * p.dt * eye
    c = decay**2 * c + q * eye

    factor, _ = smallmat.cholesky(smallmat.from_dense(a + noise))
    innovation = jnp.where(valid, mean - level, 0.0)
    whitened = smallmat.solve_lower(factor, list(jnp.concatenate([innovation[:, None], a, b], 1)))
    rows = jnp.stack(whitened)
    n = len(mean)
    nu, to_level, to_rate = rows[:, 0], rows[:, 1 : n + 1], rows[:, n + 1 :]
    updated = DeflationState(
        level + jnp.where(valid, to_level.T @ nu, 0.0),
        rate + jnp.where(valid, to_rate.T @ nu, 0.0),
        a - to_level.T @ to_level,
        b - to_level.T @ to_rate,
        c - to_rate.T @ to_rate,
        state.seen | valid,
    )
    return updated, valid
