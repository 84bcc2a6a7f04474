"""Small-matrix algebra against NumPy's LAPACK."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wheelhop.filtering import smallmat


def random_spd(seed, n, scale=1.0):
    rng = np.random.default_rng(seed)
    a = rng.normal(size=(n, n))
    d = np.diag(10.0 ** rng.uniform(-3, 3, n)) * scale
    return d @ (a @ a.T + 0.1 * np.eye(n)) @ d


def dense_factor(lower):
    n = len(lower)
    return np.array([[float(lower[i][j]) if j <= i else 0.0 for j in range(n)] for i in range(n)])


@settings(deadline=None, max_examples=30)
@given(seed=st.integers(0, 10**6), n=st.integers(1, 7))
def test_cholesky_equals_lapack(seed, n):
    a = random_spd(seed, n)
    factor, guarded = smallmat.cholesky(smallmat.from_dense(jnp.asarray(a)))
    expected = np.linalg.cholesky(a)
    np.testing.assert_allclose(dense_factor(factor), expected, rtol=1e-8, atol=0)
    assert not guarded


@settings(deadline=None, max_examples=20)
@given(seed=st.integers(0, 10**6), n=st.integers(1, 6))
def test_solves_and_log_determinant_equal_numpy(seed, n):
    a = random_spd(seed, n)
    b = np.random.default_rng(seed + 1).normal(size=n)
    factor, _ = smallmat.cholesky(smallmat.from_dense(jnp.asarray(a)))
    half = smallmat.solve_lower(factor, tuple(jnp.asarray(b)))
    x = smallmat.solve_lower_transposed(factor, half)
    np.testing.assert_allclose(a @ np.array(x), b, rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(smallmat.log_det(factor), np.linalg.slogdet(a)[1], rtol=1e-9)


def test_dense_round_trip_and_sum():
    a, b = random_spd(1, 4), random_spd(2, 4)
    total = smallmat.add(smallmat.from_dense(jnp.asarray(a)), smallmat.from_dense(jnp.asarray(b)))
    np.testing.assert_allclose(smallmat.to_dense(total), a + b)


def test_gram_equals_matrix_product():
    rows = np.random.default_rng(0).normal(size=(3, 5))
    lower = smallmat.gram([jnp.asarray(r) for r in rows])
    np.testing.assert_allclose(smallmat.to_dense(lower), rows @ rows.T)


def test_a_zero_row_stays_zero_with_finite_gradient():
    def total(a):
        factor, _ = smallmat.cholesky(smallmat.from_dense(a))
        return sum(jnp.sum(entry) for row in factor for entry in row)

    a = jnp.diag(jnp.array([4.0, 0.0, 9.0]))
    assert float(total(a)) == pytest.approx(5.0)
    assert np.isfinite(jax.grad(total)(a)).all()


def test_guard_acts_on_an_indefinite_matrix_whatever_its_units():
    for scale in (1e-12, 1.0, 1e12):
        a = scale * jnp.array([[1.0, 1.1], [1.1, 1.0]])
        factor, guarded = smallmat.cholesky(smallmat.from_dense(a))
        assert bool(guarded)
        assert np.isfinite(dense_factor(factor)).all()


def test_batching_is_elementwise():
    """No LAPACK call and no dot in the compiled batch: the reason this module exists."""
    batch = jnp.stack([jnp.asarray(random_spd(s, 4)) for s in range(8)])

    def factor(a):
        return smallmat.cholesky(smallmat.from_dense(a))[0]

    text = jax.jit(jax.vmap(factor)).lower(batch).as_text()
    assert "custom_call" not in text
    assert "dot_general" not in text


def test_a_nan_is_never_taken_for_a_known_zero():
    factor, _ = smallmat.cholesky(smallmat.from_dense(jnp.array([[jnp.nan, 0.0], [0.0, 1.0]])))
    assert np.isnan(factor[0][0])
