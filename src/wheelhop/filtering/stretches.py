"""Stretches of a record and how two neighbours combine: the algebra of `parallel`.

Sarkka & Garcia-Fernandez 2021. Values are sums of squares; derivatives are those of the textbook
formulas, which are smooth where a covariance is singular. Matrices are arrays
[rows, columns, lanes].
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from wheelhop.filtering.columns import gram, times, transposed
from wheelhop.filtering.interface import Lower


class Stretch(NamedTuple):
    """What a stretch of the record says of the states x before it and z at its end.

    p(z | x, its samples) = N(A x + b, C) and p(its samples | x) ~ exp(e'x - x'J x / 2).
    Matrices are arrays [rows, columns, lanes]; b and e are columns.
    """

    transition: Any
    shift: Any
    cov: Any
    information_mean: Any
    information: Any


def believed(mean: Any, cov: Any) -> Stretch:
    """A belief as a stretch that forgets what was before it."""
    none, column = jnp.zeros_like(cov), jnp.zeros_like(mean)
    return Stretch(none, mean, cov, column, none)


def informed(information_mean: Any, information: Any) -> Stretch:
    """Likelihood of all later samples as a stretch whose end does not matter."""
    none, column = jnp.zeros_like(information), jnp.zeros_like(information_mean)
    return Stretch(none, column, none, information_mean, information)


def _with_tangent_of(smooth: Callable) -> Callable[[Callable], Callable]:
    """Decorator: the value of the decorated function with the derivative of `smooth`."""

    def decorate(stable: Callable) -> Callable:
        function = jax.custom_jvp(stable)
        function.defjvp(lambda x, dx: (function(*x), jax.jvp(smooth, x, dx)[1]))
        return function

    return decorate


@jax.custom_jvp
def gains(cov: Any, information: Any) -> tuple[Any, Any, Any]:
    """(I + C J)^-1, (C^-1 + J)^-1 and (J^-1 + C)^-1, for C and J of any rank."""
    kept, p, q = _gain_roots(cov, information)
    return kept, gram(p), gram(q)


@gains.defjvp
def _gains_tangent(primals: Any, tangents: Any) -> tuple[Any, Any]:
    e, m, n = gains(*primals)
    dc, dj = tangents
    left, right = times(e, dc), times(m, dj)
    de = -(times(left, n) + times(right, e))
    dm = times(left, transposed(e)) - times(right, m)
    dn = times(transposed(e), times(dj, e)) - times(n, times(dc, n))
    return (e, m, n), (de, dm, dn)


def _gain_roots(cov: Any, information: Any) -> tuple[Any, Any, Any]:
    """`gains` with square roots of its last two: with C = L L', J = Z Z' and W = Z'L they are
    L (I + W'W)^-1/2 and Z (I + W W')^-1/2, whose matrices to invert have no eigenvalue below 1.
    """
    roots = _cholesky(jnp.stack([cov, information], axis=2))
    w = times(transposed(roots[:, :, 1]), roots[:, :, 0])
    inner = jnp.stack([gram(transposed(w)), gram(w)], axis=2)
    white = whiten(identity_like(inner) + inner, transposed(roots))
    p, q = transposed(white[:, :, 0]), transposed(white[:, :, 1])
    z = roots[:, :, 1]
    kept = identity_like(cov) - times(p, times(times(transposed(p), z), transposed(z)))
    return kept, p, q


def _textbook_combine(i: Stretch, j: Stretch) -> Stretch:
    """Sarkka & Garcia-Fernandez 2021, filtering operator, of stretch i followed by j."""
    kept, cov, information = gains(i.cov, j.information)
    onward, back = j.transition, transposed(i.transition)
    return Stretch(
        times(onward, times(kept, i.transition)),
        times(onward, times(kept, i.shift) + times(cov, j.information_mean)) + j.shift,
        times(onward, times(cov, transposed(onward))) + j.cov,
        times(back, times(transposed(kept), j.information_mean) - times(information, i.shift))
        + i.information_mean,
        times(back, times(information, i.transition)) + i.information,
    )


@_with_tangent_of(_textbook_combine)
def combine(i: Stretch, j: Stretch) -> Stretch:
    """Stretch i followed by stretch j, its covariance and information as sums of squares."""
    kept, p, q = _gain_roots(i.cov, j.information)
    onward, back = j.transition, transposed(i.transition)
    onward_kept, onward_p, back_q = times(onward, kept), times(onward, p), times(back, q)
    return Stretch(
        times(onward_kept, i.transition),
        times(onward_kept, i.shift)
        + times(onward_p, times(transposed(p), j.information_mean))
        + j.shift,
        gram(onward_p) + j.cov,
        times(back, times(transposed(kept), j.information_mean))
        - times(back_q, times(transposed(q), i.shift))
        + i.information_mean,
        gram(back_q) + i.information,
    )


@_with_tangent_of(lambda a, c: times(a, times(c, transposed(a))))
def congruence(a: Any, c: Any) -> Any:
    """A C A^T as a sum of squares."""
    return gram(times(a, _cholesky(c)))


def identity_like(a: Any) -> Any:
    """Identity of the shape and type of a square matrix."""
    n = a.shape[0]
    eye = jnp.eye(n, dtype=a.dtype).reshape((n, n) + (1,) * (a.ndim - 2))
    return jnp.broadcast_to(eye, a.shape)


def symmetric(lower: Lower) -> Any:
    """Dense symmetric matrix of a lower triangle."""
    n = len(lower)
    return jnp.stack([jnp.stack([lower[max(i, j)][min(i, j)] for j in range(n)]) for i in range(n)])


def _cholesky(a: Any) -> Any:
    """Lower Cholesky factor of positive semidefinite arrays [n, n, ...], zero pivots left out.

    Stretches are singular as a rule, so the relative pivot guard is below rounding: the one of
    `smallmat.cholesky` would add information in every null direction of every stretch.
    """
    n = a.shape[0]
    guard = 0.125 * float(jnp.finfo(a.dtype).eps)
    rest, columns = a, []
    for j in range(n):
        pivot = jnp.maximum(rest[0, 0], guard * a[j, j])
        positive = pivot > 0
        inverse = jnp.where(positive, jax.lax.rsqrt(jnp.where(positive, pivot, 1.0)), 0.0)
        below = rest[1:, 0] * inverse[None]
        columns.append(jnp.concatenate([jnp.zeros_like(a[:j, 0]), (pivot * inverse)[None], below]))
        rest = rest[1:, 1:] - below[:, None] * below[None]
    return jnp.stack(columns, axis=1)


def whiten(cov: Any, columns: Any) -> Any:
    """V^-1 times the columns, with cov = V V^T positive definite."""
    rest, rows = jnp.concatenate([cov, columns], axis=1), []
    for _ in range(cov.shape[0]):
        row = rest[0] * jax.lax.rsqrt(rest[0, 0])[None]
        rows.append(row[-columns.shape[1] :])
        rest = rest[1:, 1:] - row[1 : rest.shape[0], None] * row[None, 1:]
    return jnp.stack(rows)
