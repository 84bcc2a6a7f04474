"""Triangular square roots of sums of squares, without forming the sums.

Modified Gram-Schmidt, elementwise over trailing axes: a batch stays in SIMD lanes, and the
triangular factor is as good as Householder's (Bjorck 1967).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp

from wheelhop.filtering.interface import Lower
from wheelhop.staging import stage


@stage
def triangularise(rows: Sequence[Any]) -> tuple[Lower, Any]:
    """Lower triangular L with L L^T = A A^T and nonnegative diagonal, without forming A A^T.

    Modified Gram-Schmidt over the rows of A. A row that its predecessors explain but for
    eps^(3/4) of its length gets that length as its pivot and no column: rounding noise must
    not choose a direction. A zero row stays zero. The gradient is finite in both cases, and
    exact for changes of A that keep such rows explained.

    Args:
        rows: rows of A, columns on a leading axis [k, ...].

    Returns:
        L, and True where a row that is not zero was so explained.
    """
    n = len(rows)
    guard = float(jnp.finfo(rows[0].dtype).eps) ** 0.75
    left = list(rows)
    lower: list[list[Any]] = [[] for _ in range(n)]
    guarded = jnp.zeros(rows[0].shape[1:], dtype=bool)
    for i in range(n):
        floor = guard * root(jnp.sum(rows[i] * rows[i], 0))
        length = root(jnp.sum(left[i] * left[i], 0))
        own = length > floor
        guarded = guarded | ((length <= floor) & (floor > 0))
        lower[i].append(jnp.where(length <= floor, floor, length))
        direction = left[i] * jnp.where(own, 1.0 / jnp.where(own, length, 1.0), 0.0)[None]
        for j in range(i + 1, n):
            part = jnp.sum(left[j] * direction, 0)
            lower[j].append(part)
            left[j] = left[j] - part[None] * direction
    return tuple(tuple(row) for row in lower), guarded


def joint_root(
    odd: Sequence[Any], noise_root: Sequence[Any], rows: Sequence[Any]
) -> tuple[Lower, list[tuple[Any, ...]], Lower, Any]:
    """Triangularise [G C; L 0] and cut it: root of cov(f), cross block, factor of x given f."""
    m = len(odd)
    above = [jnp.concatenate(pair) for pair in zip(odd, noise_root, strict=True)]
    below = [jnp.concatenate([row, zeros(noise_root[0].shape[0], row)]) for row in rows]
    lower, guarded = triangularise(above + below)
    cross = [row[:m] for row in lower[m:]]
    return lower[:m], cross, tuple(row[m:] for row in lower[m:]), guarded


@stage
def semidefinite_root(a: Lower) -> tuple[Lower, Any]:
    """Cholesky factor whose columns of no pivot are left out, and whether `a` is indefinite.

    Unlike `smallmat.cholesky` it adds no variance to the directions a noise does not drive.
    """
    n = len(a)
    guard = 64.0 * float(jnp.finfo(jnp.result_type(a[0][0])).eps)
    rows: list[list[Any]] = [[] for _ in range(n)]
    indefinite = jnp.zeros(jnp.shape(a[0][0]), dtype=bool)
    for j in range(n):
        pivot = a[j][j] - sum(p * p for p in rows[j])
        floor = guard * jnp.abs(a[j][j])
        indefinite = indefinite | (pivot < -floor)
        dropped = pivot <= floor
        length = jnp.sqrt(jnp.where(dropped, 1.0, pivot))
        rows[j].append(jnp.where(dropped, 0.0, length))
        for i in range(j + 1, n):
            entry = a[i][j] - sum(p * q for p, q in zip(rows[i], rows[j][:j], strict=True))
            rows[i].append(jnp.where(dropped, 0.0, entry / length))
    return tuple(tuple(row) for row in rows), indefinite


def root(square: Any) -> Any:
    """Square root with gradient 0 at 0."""
    zero = square == 0
    return jnp.where(zero, 0.0, jnp.sqrt(jnp.where(zero, 1.0, square)))


def zeros(count: int, like: Any) -> Any:
    """Zeros [count, ...] of the trailing shape and type of a row."""
    return jnp.zeros((count, *like.shape[1:]), like.dtype)
