"""Eigenvalues of small symmetric matrices, and systems with small positive definite ones.

Dense arrays [n, n] without LAPACK: batched LAPACK calls of one XLA program can wait for ever for
each other's threads on two processors (jaxlib 0.10.2). Elementwise, so `jax.vmap` keeps a batch in
SIMD lanes; meant for n <= 8.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from wheelhop.filtering import smallmat
from wheelhop.filtering.interface import Lower
from wheelhop.filtering.triangular import root

_SWEEPS = 8


def eigh(matrix: Float[Array, "n n"]) -> tuple[Array, Array]:
    """Eigenvalues [n], in no order, and eigenvectors [n, n] in columns, of a symmetric matrix.

    Cyclic Jacobi rotations (Golub and Van Loan 2013, section 8.5): eight sweeps, of which four to
    six suffice for n <= 8 in double precision. The eigenvectors carry no gradient, since those of
    equal eigenvalues have none; that of the eigenvalues is right for sums over equal ones. A
    function of the matrix that needs more is a factor of V' A V, which is diagonal only in value.
    NaN entries make NaN eigenvalues.
    """
    n = matrix.shape[0]
    pairs = [(p, q) for p in range(n) for q in range(p + 1, n)]

    def sweep(_: Any, found: tuple[Any, Any]) -> tuple[Any, Any]:
        for p, q in pairs:
            found = _rotated(*found, p, q)
        return found

    still = jax.lax.stop_gradient(matrix)
    # of order one, so that no square underflows
    largest = jnp.max(jnp.abs(still))
    size = jnp.where(largest > 0, largest, 1.0)
    eye = jnp.eye(n, dtype=matrix.dtype)
    vectors = jax.lax.fori_loop(0, _SWEEPS, sweep, (still / size, eye))[1]
    return jnp.sum(vectors * (matrix @ vectors), 0), vectors


def factor_of(matrix: Float[Array, "n n"]) -> Lower:
    """Cholesky factor of a positive definite matrix; a pivot that is not positive counts as 0."""
    return smallmat.cholesky(smallmat.from_dense(matrix), 0.0)[0]


def whitened(factor: Lower, columns: Float[Array, "n *k"]) -> Array:
    """L^-1 times the columns [n, k], or times a vector [n]."""
    return jnp.stack(smallmat.solve_lower(factor, list(columns)))


def solved(factor: Lower, columns: Float[Array, "n *k"]) -> Array:
    """(L L^T)^-1 times the columns [n, k], or times a vector [n]."""
    half = smallmat.solve_lower(factor, list(columns))
    return jnp.stack(smallmat.solve_lower_transposed(factor, half))


def inverse(matrix: Float[Array, "n n"]) -> Array:
    """Inverse [n, n] of a positive definite matrix, symmetric to the last digit.

    Of one that is not, the directions whose pivot is not positive are left out.
    """
    half = whitened(factor_of(matrix), jnp.eye(matrix.shape[0], dtype=matrix.dtype))
    return half.T @ half


def _rotated(a: Any, v: Any, p: int, q: int) -> tuple[Any, Any]:
    """A rotation in the plane of p and q that makes a[p, q] zero."""
    apart, twice = a[q, q] - a[p, p], 2.0 * a[p, q]
    long = root(apart * apart + twice * twice) + jnp.abs(apart)
    there = long > 0
    tangent = jnp.where(there, twice / jnp.where(there, long, 1.0), 0.0)
    tangent = jnp.where(apart < 0, -tangent, tangent)
    cosine = jax.lax.rsqrt(tangent * tangent + 1.0)
    sine = tangent * cosine
    a = _turned(a.T, p, q, cosine, sine)
    a = _turned(a.T, p, q, cosine, sine)
    return a.at[p, q].set(0.0).at[q, p].set(0.0), _turned(v, p, q, cosine, sine)


def _turned(m: Any, p: int, q: int, cosine: Any, sine: Any) -> Any:
    """Columns p and q after the rotation."""
    left, right = m[:, p], m[:, q]
    return m.at[:, p].set(cosine * left - sine * right).at[:, q].set(sine * left + cosine * right)
