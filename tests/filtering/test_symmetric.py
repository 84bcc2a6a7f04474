"""Small symmetric matrices against LAPACK by NumPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from wheelhop.filtering.smallmat import rows_of
from wheelhop.filtering.symmetric import eigh, factor_of, inverse, solved, whitened

eigh_of_all = jax.jit(jax.vmap(eigh))


def symmetric(seed, n, count=50):
    a = np.random.default_rng(seed).normal(size=(count, n, n)) * np.logspace(-3, 3, n)
    return a + np.swapaxes(a, 1, 2)


def positive(seed, n):
    a = np.random.default_rng(seed).normal(size=(n, n + 2)) * np.logspace(-2, 2, n)[:, None]
    return a @ a.T


@pytest.mark.parametrize("n", [1, 2, 4, 8])
def test_eigenvalues_are_those_of_lapack(n):
    a = symmetric(n, n)
    values, vectors = map(np.asarray, eigh_of_all(jnp.asarray(a)))
    expected = np.linalg.eigvalsh(a)
    scale = np.abs(expected).max(1, keepdims=True)
    np.testing.assert_allclose(np.sort(values) / scale, expected / scale, atol=1e-14)
    again = np.einsum("bik,bk,bjk->bij", vectors, values, vectors)
    np.testing.assert_allclose(again / scale[..., None], a / scale[..., None], atol=1e-14)
    one = np.swapaxes(vectors, 1, 2) @ vectors
    np.testing.assert_allclose(one, np.broadcast_to(np.eye(n), one.shape), atol=1e-14)


def test_singular_equal_and_single_precision():
    for a in (np.ones((4, 4)), 3.0 * np.eye(4), np.zeros((4, 4)), np.diag([1.0, 1e-30, 0, 0])):
        for dtype, atol in ((np.float64, 1e-15), (np.float32, 1e-6)):
            values, vectors = eigh(jnp.asarray(a, dtype))
            assert values.dtype == vectors.dtype == dtype
            np.testing.assert_allclose(np.sort(values), np.linalg.eigvalsh(a), atol=atol * 4)
            np.testing.assert_allclose((vectors * values[None]) @ vectors.T, a, atol=atol * 4)


def test_gradient_of_a_function_of_the_matrix():
    """d tr f(A) = tr(f'(A) dA), equal eigenvalues or not."""

    def total(matrix):
        return jnp.sum(jnp.exp(eigh(matrix)[0]))

    for a in (symmetric(7, 4, 1)[0] / 1e3, np.eye(4), np.zeros((4, 4))):
        values, vectors = np.linalg.eigh(a)
        expected = (vectors * np.exp(values)) @ vectors.T
        found = np.asarray(jax.grad(total)(jnp.asarray(a)))
        found = 0.5 * (found + found.T)
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * expected.max())


@pytest.mark.parametrize("n", [1, 4, 6])
def test_systems(n):
    a = positive(n, n)
    b = np.random.default_rng(0).normal(size=(n, 3))
    factor = factor_of(jnp.asarray(a))
    lower = np.linalg.cholesky(a)
    np.testing.assert_allclose(whitened(factor, jnp.asarray(b)), np.linalg.solve(lower, b), 1e-8)
    np.testing.assert_allclose(solved(factor, jnp.asarray(b)), np.linalg.solve(a, b), 1e-6)
    one = solved(factor, jnp.asarray(b[:, 0]))
    np.testing.assert_allclose(one, np.linalg.solve(a, b)[:, 0], 1e-6)
    found = np.asarray(inverse(jnp.asarray(a)))
    np.testing.assert_allclose(found @ a, np.eye(n), atol=1e-6)
    np.testing.assert_array_equal(found, found.T)


def test_gradient_of_a_factor_in_the_axes():
    """A = V (V' A V) V', equal eigenvalues or not: of sum(C A) it is C."""
    weight = np.random.default_rng(5).normal(size=(4, 4))
    weight = weight + weight.T

    def total(matrix):
        axes = eigh(matrix)[1]
        lower = jnp.stack(rows_of(factor_of(axes.T @ matrix @ axes)))
        half = axes @ lower
        return jnp.sum(weight * (half @ half.T))

    for a in (np.eye(4), positive(9, 4), np.diag([1.0, 1.0, 2.0, 2.0])):
        found = np.asarray(jax.grad(total)(jnp.asarray(a)))
        np.testing.assert_allclose(0.5 * (found + found.T), weight, rtol=1e-6, atol=1e-8)


def test_no_lapack_call_is_left_in_a_batch():
    """Batched decompositions of one program can wait for each other."""
    for function in (eigh, inverse, lambda a: solved(factor_of(a), a)):
        text = jax.jit(jax.vmap(function)).lower(jnp.ones((8, 4, 4))).as_text()
        assert "custom_call" not in text
