"""Small matrices as arrays [rows, columns, ...], elementwise over the trailing axes.

For algorithms whose matrices are not square; all matrices of one expression have the same
trailing axes.
"""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp

from wheelhop.filtering import smallmat
from wheelhop.filtering.gaussian import trailing
from wheelhop.filtering.interface import Lower


def orthonormal(a: Any) -> tuple[Any, Any, Any]:
    """Gram-Schmidt of the columns: basis, upper factor, and which depend on those before.

    A dependent column gets the basis vector 0 and the pivot 1.
    """
    p = a.shape[1]
    basis, upper, lost = zeros(len(a), 0, a), [], []
    for j in range(p):
        column = a[:, j : j + 1]
        rest, found = project(column, basis)
        square, whole = (jnp.sum(x * x, (0, 1)) for x in (rest, column))
        gone = square <= (64.0 * float(jnp.finfo(a.dtype).eps)) ** 2 * whole
        pivot = jnp.sqrt(jnp.where(gone, 1.0, square))[None, None]
        basis = jnp.concatenate([basis, jnp.where(gone[None, None], 0.0, rest / pivot)], 1)
        upper.append(jnp.concatenate([found, pivot, zeros(p - j - 1, 1, a)]))
        lost.append(gone)
    if not p:
        return basis, zeros(0, 0, a), jnp.zeros((1, *a.shape[2:]), bool)
    return basis, jnp.concatenate(upper, 1), jnp.stack(lost)


def project(vectors: Any, basis: Any) -> tuple[Any, Any]:
    """What orthonormal columns leave of vectors, and the coefficients, one after the other."""
    found = [zeros(0, vectors.shape[1], vectors)]
    for j in range(basis.shape[1]):
        direction = basis[:, j : j + 1]
        found.append(times(transposed(direction), vectors))
        vectors = vectors - times(direction, found[-1])
    return vectors, jnp.concatenate(found)


def back_substitute(upper: Any, b: Any) -> Any:
    """X with U X = B."""
    x = zeros(0, b.shape[1], b)
    for j in reversed(range(len(b))):
        known = times(upper[j : j + 1, j + 1 :], x)
        x = jnp.concatenate([(b[j : j + 1] - known) / upper[j, j][None, None], x])
    return x


def pivots(upper: Any) -> Any:
    """Diagonal [p, ...]."""
    return jnp.sum(upper * identity(len(upper), upper), 1)


def times(a: Any, b: Any) -> Any:
    """Product A B."""
    return jnp.sum(a[:, :, None] * b[None], 1)


def transposed(a: Any) -> Any:
    """A^T."""
    return jnp.swapaxes(a, 0, 1)


def gram(a: Any) -> Any:
    """A A^T."""
    return times(a, transposed(a))


def zeros(rows: int, columns: int, like: Any) -> Any:
    """Zeros [rows, columns, ...] with the trailing axes and type of another."""
    return jnp.zeros((rows, columns, *like.shape[2:]), like.dtype)


def identity(size: int, like: Any) -> Any:
    """Identity [size, size, ...] with the trailing axes and type of another."""
    return broadcast(jnp.eye(size, dtype=like.dtype), 2, like.shape[2:])


def blocks(rows: list[list[Any]]) -> Any:
    """One matrix from rows of blocks."""
    return jnp.concatenate([jnp.concatenate(row, 1) for row in rows])


def of_factor(factor: Lower) -> Any:
    """A triangular factor as an array, zeros above."""
    return jnp.stack(smallmat.rows_of(factor))


def lower_triangle(matrix: Any) -> Lower:
    """Lower triangle of a matrix, entry by entry."""
    return tuple(tuple(row[: i + 1]) for i, row in enumerate(matrix))


def broadcast(array: Any, axes: int, lanes: tuple) -> Any:
    """The array with its trailing axes broadcast to the lanes."""
    array = jnp.asarray(array)
    return jnp.broadcast_to(trailing(array, axes + len(lanes)), array.shape[:axes] + lanes)
