"""What the later samples of a record say of one state, as a Gaussian factor.

The quotient of a smoothed belief and its prediction, in components whitened by the prediction,
so that singular covariances need no inverse.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from wheelhop.filtering import smallmat
from wheelhop.filtering.gaussian import Gaussian
from wheelhop.filtering.interface import Lower, Named, Params, StateSpaceModel
from wheelhop.filtering.smoothing import TransitionMoments, step_back


class Evidence(NamedTuple):
    """Later samples' likelihood of x = mean + factor u, where u ~ N(0, 1) without them.

    log l(u) = t.u - |Y^T tau^-1 (u - t)|^2 / 2 + constant.

    Attributes:
        mean: of the reference, a NamedTuple.
        factor: of its covariance; a direction below its type's resolution is 0.
        shift: t, the mean of u given the later samples.
        spread: Cholesky factor tau of the covariance T of u given them.
        gained: lower triangular Y, Y Y^T = 1 - tau^T tau: T^-1 = 1 + tau^-T Y Y^T tau^-1.
    """

    mean: Named
    factor: Lower
    shift: tuple[Any, ...]
    spread: Lower
    gained: Lower


def evidence(
    model: StateSpaceModel,
    moments_of: TransitionMoments,
    reference: Gaussian,
    later: Gaussian,
    params: Params,
) -> Evidence:
    """Evidence of the later samples on one state, by a smoother step in whitened components."""
    factor = _resolved(reference)

    def place(u: Named) -> Named:
        moved = zip(reference.mean, _times(factor, u), strict=True)
        return type(u)(*(_as(m, v) + v for m, v in moved))

    white = StateSpaceModel(
        lambda u, p: model.transition(place(u), p),
        model.observation,
        lambda u, p: model.process_cov(place(u), p),
        model.observation_cov,
    )
    n = len(factor)
    zero = jnp.zeros_like(factor[0][0])
    unit = tuple(tuple(zero + float(i == j) for j in range(i + 1)) for i in range(n))
    smoothed = step_back(
        white, moments_of, Gaussian(type(reference.mean)(*[zero] * n), unit), later, params
    )
    spread, _ = smallmat.cholesky(smoothed.cov)
    columns = _columns(smallmat.rows_of(spread))
    covered = smallmat.gram(columns)
    remaining = tuple(
        tuple(float(i == j) - entry for j, entry in enumerate(row)) for i, row in enumerate(covered)
    )
    return Evidence(reference.mean, factor, tuple(smoothed.mean), spread, positive_part(remaining))


def times_evidence(member: Gaussian, told: Evidence) -> tuple[Gaussian, Any]:
    """The member's Gaussian times the evidence: normalised, and the log of its integral."""
    n = len(told.shift)
    factor, _ = smallmat.cholesky(member.cov)
    rows = smallmat.rows_of(factor)

    def informed(deviation: Any) -> tuple[Any, ...]:
        """Y^T tau^-1 d for a deviation d of u."""
        scaled = smallmat.solve_lower(told.spread, deviation)
        return tuple(sum(told.gained[r][c] * scaled[r] for r in range(c, n)) for c in range(n))

    start = smallmat.solve_lower(
        told.factor, [x - m for x, m in zip(member.mean, told.mean, strict=True)]
    )
    turned = jax.vmap(lambda column: smallmat.solve_lower(told.factor, column))(rows)
    seen = jax.vmap(informed)(turned)
    missed = informed([t - d for t, d in zip(told.shift, start, strict=True)])

    precision = smallmat.gram(_columns(seen))
    one = smallmat.diagonal([jnp.ones_like(start[0])] * n)
    root, _ = smallmat.cholesky(smallmat.add(one, precision))
    pull = sum(d * t[None] for d, t in zip(turned, told.shift, strict=True)) + sum(
        v * q[None] for v, q in zip(seen, missed, strict=True)
    )
    white = smallmat.solve_lower(root, list(pull))
    move = jnp.stack(smallmat.solve_lower_transposed(root, white))
    mean = [x + jnp.sum(row * move, 0) for x, row in zip(member.mean, rows, strict=True)]
    kept = jax.vmap(lambda row: smallmat.solve_lower(root, row))(_columns(rows))

    exponent = sum(t * d for t, d in zip(told.shift, start, strict=True)) + 0.5 * (
        sum(w * w for w in white) - sum(q * q for q in missed) - smallmat.log_det(root)
    )
    return Gaussian(type(member.mean)(*mean), smallmat.gram(_columns(kept))), exponent


def _columns(rows: Sequence[Any]) -> tuple[Any, ...]:
    """Columns of a matrix whose rows have their columns on a leading axis, or the reverse."""
    matrix = jnp.stack(tuple(rows))
    return tuple(matrix[:, c] for c in range(len(rows)))


def _times(factor: Lower, u: Named) -> list[Any]:
    """L u, where the entries of u may have more leading axes than those of L."""
    return [sum(_as(factor[i][j], u[j]) * u[j] for j in range(i + 1)) for i in range(len(factor))]


def _as(entry: Any, like: Any) -> Any:
    """An entry with leading axes of length 1 up to the number of axes of another."""
    return entry.reshape((1,) * (jnp.ndim(like) - entry.ndim) + entry.shape)


def _resolved(belief: Gaussian) -> Lower:
    """Factor of the covariance without the columns and rows that are rounding alone.

    They would turn the rounding of means and covariances into evidence for a mode. Rounding
    is a pivot that the guard made, and a deviation within the last digits of the mean.
    """
    factor, _ = smallmat.cholesky(belief.cov)
    eps = float(jnp.finfo(factor[0][0].dtype).eps)
    digits = [(16.0 * eps * mean) ** 2 for mean in belief.mean]
    random = [row[-1] > square for row, square in zip(belief.cov, digits, strict=True)]
    column = [
        row[-1] * row[-1] > 128.0 * eps * cov[-1] + square
        for row, cov, square in zip(factor, belief.cov, digits, strict=True)
    ]
    return tuple(
        tuple(jnp.where(random[i] & column[j], entry, 0.0) for j, entry in enumerate(row))
        for i, row in enumerate(factor)
    )


def positive_part(a: Lower) -> Lower:
    """Cholesky factor of a matrix below 1 that may be indefinite: what is negative counts as 0.

    Where the matrix is positive semidefinite this is its factor. Elsewhere a correlation is
    cut to what its variances allow, so that no entry of the factor exceeds 1.
    """
    n = len(a)
    rest = [list(row) for row in a]
    resolution = 16.0 * float(jnp.finfo(a[0][0].dtype).eps)
    zero = jnp.zeros_like(a[0][0])
    factor: list[list[Any]] = [[zero] * (i + 1) for i in range(n)]
    for j in range(n):
        positive = rest[j][j] > resolution
        root = jnp.sqrt(jnp.where(positive, rest[j][j], 1.0))
        factor[j][j] = jnp.where(positive, root, 0.0)
        for i in range(j + 1, n):
            room = rest[i][i] > resolution
            limit = jnp.sqrt(jnp.where(room, rest[i][i], 1.0))
            entry = jnp.clip(rest[i][j] / root, -limit, limit)
            factor[i][j] = jnp.where(positive & room, entry, 0.0)
        for i in range(j + 1, n):
            for k in range(j + 1, i + 1):
                rest[i][k] = rest[i][k] - factor[i][j] * factor[k][j]
    return tuple(tuple(row) for row in factor)
