"""Algebra for small matrices, unrolled over their entries.

A symmetric or triangular matrix is its lower triangle `a[i][j]` (j <= i), a tuple of tuples
of arrays of one shape. Every operation is elementwise over that shape, so under `jax.vmap`
the batch stays in SIMD lanes: no LAPACK call and no batched dot per tiny matrix.
Meant for n <= 8; the cost of tracing grows with n^3.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from wheelhop.filtering.interface import Lower
from wheelhop.staging import stage


def from_dense(matrix: Float[Array, "n n"]) -> Lower:
    """Lower triangle of a dense symmetric or lower triangular matrix."""
    n = matrix.shape[-1]
    return tuple(tuple(matrix[..., i, j] for j in range(i + 1)) for i in range(n))


def to_dense(lower: Lower) -> Array:
    """Dense symmetric matrix [..., n, n] of a lower triangle with entries [...]."""
    n = len(lower)
    rows = [
        jnp.stack([jnp.asarray(lower[max(i, j)][min(i, j)]) for j in range(n)], axis=-1)
        for i in range(n)
    ]
    return jnp.stack(rows, axis=-2)


def diagonal(entries: Sequence[Any]) -> Lower:
    """Lower triangle of a diagonal matrix with these entries."""
    zero = 0.0 * entries[0]
    return tuple(
        tuple(entries[i] if i == j else zero for j in range(i + 1)) for i in range(len(entries))
    )


def add(a: Lower, b: Lower) -> Lower:
    """Sum of two lower triangles."""
    return tuple(tuple(p + q for p, q in zip(r, s, strict=True)) for r, s in zip(a, b, strict=True))


def gram(rows: Sequence[Array]) -> Lower:
    """Lower triangle of R R^T, where `rows[i]` is row i of R as a leading axis [k, ...]."""
    return tuple(
        tuple(jnp.sum(rows[i] * rows[j], 0) for j in range(i + 1)) for i in range(len(rows))
    )


@stage
def cholesky(a: Lower, guard: float | None = None) -> tuple[Lower, Any]:
    """Lower Cholesky factor of a positive semidefinite matrix.

    A pivot below `guard * a[j][j]` is raised to it. The guard is relative, so it does not
    depend on units; a matrix that is exactly singular because a row is zero is left so, and
    its factor and gradient stay finite.

    Args:
        a: lower triangle.
        guard: relative pivot guard; default 64 machine epsilons of the entries' type.

    Returns:
        The factor's lower triangle, and True where the guard acted.
    """
    n = len(a)
    if guard is None:
        guard = 64.0 * float(jnp.finfo(jnp.result_type(a[0][0])).eps)
    factor: list[list[Any]] = [[None] * (i + 1) for i in range(n)]
    guarded = jnp.zeros(jnp.shape(a[0][0]), dtype=bool)
    for j in range(n):
        pivot = a[j][j]
        for k in range(j):
            pivot = pivot - factor[j][k] * factor[j][k]
        floor = guard * a[j][j]
        guarded = guarded | (pivot < floor)
        pivot = jnp.maximum(pivot, floor)
        positive = ~(pivot <= 0)  # a NaN stays a NaN
        root = jnp.sqrt(jnp.where(positive, pivot, 1.0))
        inverse = jnp.where(positive, 1.0 / root, 0.0)
        factor[j][j] = jnp.where(positive, root, 0.0)
        for i in range(j + 1, n):
            entry = a[i][j]
            for k in range(j):
                entry = entry - factor[i][k] * factor[j][k]
            factor[i][j] = entry * inverse
    return tuple(tuple(row) for row in factor), guarded


def _divide(a: Any, pivot: Any) -> Any:
    """a / pivot, and 0 where the pivot is zero: a direction without variance has no weight."""
    positive = pivot != 0
    return jnp.where(positive, a / jnp.where(positive, pivot, 1.0), 0.0)


def solve_lower(factor: Lower, b: Sequence[Any]) -> tuple[Any, ...]:
    """Solve L x = b by forward substitution, leaving out directions with a zero pivot."""
    x: list[Any] = []
    for i in range(len(factor)):
        entry = b[i]
        for k in range(i):
            entry = entry - factor[i][k] * x[k]
        x.append(_divide(entry, factor[i][i]))
    return tuple(x)


def solve_lower_transposed(factor: Lower, b: Sequence[Any]) -> tuple[Any, ...]:
    """Solve L^T x = b by back substitution, leaving out directions with a zero pivot."""
    n = len(factor)
    x: list[Any] = [None] * n
    for i in reversed(range(n)):
        entry = b[i]
        for k in range(i + 1, n):
            entry = entry - factor[k][i] * x[k]
        x[i] = _divide(entry, factor[i][i])
    return tuple(x)


def log_det(factor: Lower) -> Any:
    """Log-determinant of L L^T from its factor."""
    total = jnp.log(factor[0][0])
    for i in range(1, len(factor)):
        total = total + jnp.log(factor[i][i])
    return 2.0 * total


def rows_of(factor: Lower) -> tuple[Array, ...]:
    """Rows of a triangular factor as arrays with the columns on a leading axis [n, ...]."""
    n = len(factor)
    zero = jnp.zeros_like(factor[0][0])
    return tuple(jnp.stack([factor[i][j] if j <= i else zero for j in range(n)]) for i in range(n))
