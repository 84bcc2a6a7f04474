"""A Gaussian over named components, and mixtures of them."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from wheelhop.filtering import smallmat
from wheelhop.filtering.interface import Lower, Named
from wheelhop.staging import stage


class Gaussian(NamedTuple):
    """Mean and covariance, kept as components.

    Attributes:
        mean: a NamedTuple of n named scalars.
        cov: lower triangle of the n x n covariance, entries in the order of the fields.
    """

    mean: Named
    cov: Lower


def gaussian(mean: Named, cov: Float[Array, "rows columns"] | Lower) -> Gaussian:
    """Gaussian from a NamedTuple of scalars and a dense covariance or its lower triangle.

    All entries become arrays of one floating type, so that a scan can carry the result.

    Raises:
        ValueError: if the covariance does not have one row per component, or if it is concrete
            and not symmetric or has a variance that is negative or NaN.
    """
    if not isinstance(cov, tuple):
        shape = jnp.shape(cov)
        if len(shape) != 2 or shape[0] != shape[1]:
            raise ValueError(f"cov has shape {shape}; give a square matrix or its lower triangle")
    lower = cov if isinstance(cov, tuple) else smallmat.from_dense(jnp.asarray(cov))
    if len(lower) != len(mean):
        raise ValueError(
            f"cov has {len(lower)} rows for the {len(mean)} components {mean._fields}; "
            "give one row and column per component, in that order"
        )
    _refuse_impossible(lower, cov)
    dtype = jnp.result_type(float, *jax.tree.leaves((mean, lower)))
    return jax.tree.map(lambda a: jnp.asarray(a, dtype), Gaussian(mean, lower))


def _refuse_impossible(lower: Lower, cov: Any) -> None:
    for i, row in enumerate(lower):
        variance = row[-1]
        if not isinstance(variance, jax.core.Tracer) and not (np.asarray(variance) >= 0).all():
            raise ValueError(f"cov[{i}][{i}]={variance} is no variance; give numbers from 0 up")
    if not isinstance(cov, tuple | jax.core.Tracer):
        matrix = np.asarray(cov, float)
        if not np.allclose(matrix, matrix.T, rtol=1e-5, atol=0):
            raise ValueError(f"cov={matrix.tolist()} is not symmetric; give cov[i, j] = cov[j, i]")


def independent(mean: Named, standard_deviation: Named) -> Gaussian:
    """Gaussian with independent components, from their means and standard deviations."""
    return gaussian(mean, smallmat.diagonal([jnp.asarray(s) ** 2 for s in standard_deviation]))


def standard_deviation(belief: Gaussian) -> Named:
    """Standard deviation of every component, as the NamedTuple of the mean."""
    return type(belief.mean)(*(jnp.sqrt(row[-1]) for row in belief.cov))


def dense(belief: Gaussian) -> tuple[Array, Array]:
    """Mean [..., n] and covariance [..., n, n] as arrays."""
    return jnp.stack(tuple(belief.mean), axis=-1), smallmat.to_dense(belief.cov)


@stage
def moment_match(weights: Any, stacked: Gaussian) -> Gaussian:
    """One Gaussian with the mean and covariance of a mixture.

    cov = sum_i w_i (P_i + (x_i - x)(x_i - x)^T): the spread of the means is included.
    A component of weight 0 is ignored even where it holds NaN.

    Args:
        weights: [m], nonnegative, summing to one.
        stacked: components on a leading axis, entries [m].
    """
    axes = max(weights.ndim, *(entries.ndim for entries in jax.tree.leaves(stacked)))
    weights = trailing(weights, axes)
    used = weights > 0
    stacked = jax.tree.map(lambda entries: jnp.where(used, trailing(entries, axes), 0.0), stacked)

    def average(entries: Any) -> Any:
        return jnp.sum(weights * entries, 0)

    mean = tuple(average(x) for x in stacked.mean)
    spread = [x - m[None] for x, m in zip(stacked.mean, mean, strict=True)]
    cov = tuple(
        tuple(average(stacked.cov[i][j] + spread[i] * spread[j]) for j in range(i + 1))
        for i in range(len(mean))
    )
    return Gaussian(type(stacked.mean)(*mean), cov)


def trailing(array: Any, axes: int) -> Any:
    """The array with axes of length 1 appended up to a number of axes."""
    return array.reshape(array.shape + (1,) * (axes - array.ndim))


@stage
def normalised_square(deviation: Named, cov: Lower) -> Any:
    """d^T cov^-1 d: the squared Mahalanobis length behind NEES and NIS."""
    factor, _ = smallmat.cholesky(cov)
    white = smallmat.solve_lower(factor, tuple(deviation))
    return sum(w * w for w in white[1:]) + white[0] * white[0]
