"""The Gaussian measurement update shared by the filters of this room."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp

from wheelhop.filtering import smallmat
from wheelhop.filtering.gaussian import Gaussian
from wheelhop.filtering.interface import Flags, Info, Lower, Named, all_finite
from wheelhop.filtering.lanes import same_names
from wheelhop.filtering.sigma_points import Moments
from wheelhop.staging import stage


@stage
def mask_missing(y: Named, moments: Moments, noise: Lower) -> tuple[tuple, tuple, Lower, list]:
    """Innovation and its ingredients with the missing entries taken out.

    A missing entry gets innovation 0, no correlation with anything and variance 1, so that
    the gain, the likelihood and all gradients see the present entries alone.

    Returns:
        innovation, rows of G, lower triangle of even part + noise, presence of each entry.
    """
    same_names(y, moments.mean, "the measurement")
    present = [jnp.isfinite(v) for v in y]
    innovation = tuple(
        jnp.where(p, jnp.where(p, v, 0.0) - m, 0.0)
        for p, v, m in zip(present, y, moments.mean, strict=True)
    )
    odd = tuple(jnp.where(p[None], g, 0.0) for p, g in zip(present, moments.odd, strict=True))
    residual = smallmat.add(moments.even, noise)
    residual = tuple(
        tuple(
            jnp.where(present[i] & present[j], entry, 1.0 if i == j else 0.0)
            for j, entry in enumerate(row)
        )
        for i, row in enumerate(residual)
    )
    return innovation, odd, residual, present


@stage
def condition(
    predicted: Gaussian, factor: Lower, moments: Moments, noise: Lower, y: Named, guarded: Any
) -> tuple[Gaussian, Info]:
    """Condition a Gaussian on a measurement, without subtracting covariances.

    With P = L L^T, cov(x, y) = L G^T and S = G G^T + E + R the posterior covariance is
    (L - K G)(L - K G)^T + K (E + R) K^T, a sum of squares.

    Args:
        predicted: belief before the measurement.
        factor: Cholesky factor L of its covariance.
        moments: moments of the observation under it.
        noise: lower triangle of R.
        y: measurement; non-finite entries are missing.
        guarded: whether a guard has acted earlier in this step.
    """
    innovation, odd, residual, present = mask_missing(y, moments, noise)
    innovation_cov = smallmat.add(smallmat.gram(odd), residual)
    root, guard_acted = smallmat.cholesky(innovation_cov)

    rows = smallmat.rows_of(factor)
    gain = gain_rows(rows, odd, root)
    mean = [
        x + sum(k * r for k, r in zip(gain_row, innovation, strict=True))
        for x, gain_row in zip(predicted.mean, gain, strict=True)
    ]
    noise_root, noise_guarded = smallmat.cholesky(residual)
    kept = [
        jnp.concatenate([without_gain(row, k, odd), gain_times(k, noise_root)])
        for row, k in zip(rows, gain, strict=True)
    ]
    updated = Gaussian(type(predicted.mean)(*mean), smallmat.gram(kept))

    info = report(
        type(y)(*innovation),
        innovation_cov,
        smallmat.solve_lower(root, innovation),
        root,
        present,
        updated,
        guarded | guard_acted | noise_guarded,
    )
    return updated, info


def report(
    innovation: Named,
    innovation_cov: Lower,
    white: Sequence[Any],
    root: Lower,
    present: Sequence[Any],
    updated: Any,
    guarded: Any,
) -> Info:
    """The step's `Info`.

    Args:
        innovation: masked.
        innovation_cov: S, masked.
        white: innovation divided by the factor of S.
        root: Cholesky factor of S.
        present: which entries were measured.
        updated: the new state, searched for what is not finite.
        guarded: whether a guard acted in the step.
    """
    nis = sum((w * w for w in white[1:]), white[0] * white[0])
    count = sum(p.astype(nis.dtype) for p in present)
    log_likelihood = -0.5 * (nis + smallmat.log_det(root) + math.log(2 * math.pi) * count)
    # no variance at all is no infinite likelihood: an optimiser would run for it
    log_likelihood = jnp.where(log_likelihood == jnp.inf, jnp.nan, log_likelihood)
    flags = Flags(
        missing=len(present) - sum(p.astype(jnp.int32) for p in present),
        guarded=guarded,
        nonfinite=~all_finite((updated, log_likelihood)),
        lost_members=jnp.zeros_like(present[0], jnp.int32),
        rejected=jnp.zeros_like(present[0], jnp.int32),
    )
    return Info(innovation, innovation_cov, log_likelihood, nis, flags)


@stage
def gain_rows(rows: Sequence[Any], odd: Sequence[Any], root: Lower) -> list[tuple[Any, ...]]:
    """Rows of the gain K = L G^T S^-1.

    Args:
        rows: rows of L, columns on a leading axis.
        odd: rows of G, likewise.
        root: Cholesky factor of S.
    """
    cross = [[jnp.sum(row * g, 0) for g in odd] for row in rows]
    return [smallmat.solve_lower_transposed(root, smallmat.solve_lower(root, c)) for c in cross]


def without_gain(row: Any, gain_row: Sequence[Any], odd: Sequence[Any]) -> Any:
    """Row of L - K G, columns on a leading axis."""
    return row - sum(k[None] * g for k, g in zip(gain_row, odd, strict=True))


def gain_times(gain_row: Sequence[Any], root: Lower) -> Any:
    """Row of K C for a lower triangular C, columns on a leading axis."""
    m = len(root)
    return jnp.stack([sum(gain_row[i] * root[i][j] for i in range(j, m)) for j in range(m)])
