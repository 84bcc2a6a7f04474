"""What a vertical estimator's data say of four tyres, whatever its prior said.

A belief over x = ln k_t is a posterior; beside other knowledge only the likelihood behind it may
count. It is carried as a whitened measurement z = H x + N(0, I), so that a direction of which
nothing is known is a row of zeros, and an infinite variance is no special case.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax.numpy as jnp

from wheelhop.estimators.pressure import StiffnessBelief
from wheelhop.filtering.smallmat import rows_of
from wheelhop.filtering.symmetric import eigh, factor_of, inverse, whitened

_WHEELS = 4
_DROPPED = 10.0


class VerticalEvidence(NamedTuple):
    """Likelihood of the vertical data, as a measurement z = H x + N(0, I).

    Attributes:
        matrix: H, [4, 4]; zeros where nothing was measured.
        value: z, [4].
    """

    matrix: Any
    value: Any


def walked(prior: StiffnessBelief, walk: Any, elapsed: Any) -> StiffnessBelief:
    """What a prior says of tyres that have taken a random walk since.

    Args:
        prior: before the first sample, [4], [4, 4].
        walk: of ln k_t that the estimator assumes [1/sqrt(s)].
        elapsed: time since [s].
    """
    grown = jnp.asarray(walk**2 * elapsed, prior.cov.dtype)
    return StiffnessBelief(prior.mean, prior.cov + grown * jnp.eye(_WHEELS, dtype=grown.dtype))


def vertical_evidence(
    belief: StiffnessBelief,
    reference: Any,
    prior: StiffnessBelief | None = None,
    bias: Any = None,
) -> VerticalEvidence:
    """The likelihood behind a belief of one instant; map it over time.

    Bayes: l(x) = p(x | data) / p(x), both Gaussian, so that their informations subtract. The prior
    is the one of the same instant (`walked`), not the one before the first sample, which a filter
    that follows changing tyres forgets. A wheel whose mean or variance is not finite has no
    belief; the others keep theirs.

    Args:
        belief: over ln k_t, [4], [4, 4].
        reference: ln k_t from which x is counted (`FusionParams.reference`), [4].
        prior: that the belief contains, [4], [4, 4]; none if left out, as where the data outweigh
            it by far.
        bias: covariance of errors of the belief that its own covariance does not hold
            (`calibration.bias_cov`), [4, 4].
    """
    cov = belief.cov
    variance = jnp.diagonal(cov)
    valid = jnp.isfinite(belief.mean) & jnp.isfinite(variance) & (variance > 0)
    both = valid[:, None] & valid[None, :]
    valid = valid & jnp.all(jnp.isfinite(jnp.where(both, cov, 0.0)), axis=1)
    information, vector = _information(belief, valid, reference)
    largest = jnp.max(jnp.diagonal(information))
    if prior is not None:
        known, told = _information(prior, valid, reference)
        information, vector = information - known, vector - told
    strength, axes = eigh(information)
    # what the subtraction leaves by rounding is nothing, and may be negative
    kept = strength > _DROPPED * jnp.finfo(cov.dtype).eps * largest
    along = jnp.where(kept[:, None] & kept[None, :], axes.T @ information @ axes, 0.0)
    root = factor_of(along + jnp.where(kept, 0.0, 1.0)[:, None] * _eye(cov))
    upper = jnp.stack(rows_of(root)).T
    matrix = jnp.where(kept[:, None], upper @ axes.T, 0.0)
    value = whitened(root, jnp.where(kept, axes.T @ vector, 0.0))
    if bias is not None:
        wide = matrix @ jnp.asarray(bias, cov.dtype) @ matrix.T + _eye(cov)
        factor = factor_of(wide)
        matrix, value = whitened(factor, matrix), whitened(factor, value)
    return VerticalEvidence(matrix, value)


def no_evidence(reference: Any) -> VerticalEvidence:
    """What a vertical estimator knows that knows nothing."""
    zero = jnp.zeros_like(reference)
    return VerticalEvidence(zero[:, None] * zero[None, :], zero)


def _information(belief: StiffnessBelief, valid: Any, reference: Any) -> tuple[Any, Any]:
    """Inverse covariance, and that times the mean, of those wheels that are valid."""
    both = valid[:, None] & valid[None, :]
    filled = jnp.where(both, belief.cov, 0.0) + jnp.where(valid, 0.0, 1.0)[:, None] * _eye(
        belief.cov
    )
    information = jnp.where(both, inverse(filled), 0.0)
    return information, information @ jnp.where(valid, belief.mean - reference, 0.0)


def _eye(like: Any) -> Any:
    return jnp.eye(_WHEELS, dtype=like.dtype)
