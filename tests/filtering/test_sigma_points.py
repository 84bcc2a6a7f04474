"""Sigma-point rules against the closed moments of linear, quadratic and cubic functions."""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wheelhop.filtering import cubature, gauss_hermite, scaled
from wheelhop.filtering.sigma_points import transform
from wheelhop.filtering.smallmat import cholesky, from_dense, rows_of, to_dense

RULES = {
    "cubature": cubature,
    "scaled": scaled(),
    "uneven": scaled(0.5, 2.0, 1.0),
    "Gauss-Hermite 2": gauss_hermite(2),
    "Gauss-Hermite 3": gauss_hermite(3),
    "Gauss-Hermite 4": gauss_hermite(4),
}


class Point(NamedTuple):
    x: Any
    y: Any
    z: Any


class Pair(NamedTuple):
    u: Any
    v: Any


def random_gaussian(rng, scale=1.0, rank=3):
    root = scale * rng.normal(size=(3, rank))
    return rng.normal(size=3) * scale, root @ root.T


def moments(function, mean, cov, rule):
    factor, _ = cholesky(from_dense(jnp.asarray(cov)))
    found = transform(function, Point(*jnp.asarray(mean)), factor, rule(3))
    odd = jnp.stack(found.odd)
    cross = jnp.stack(rows_of(factor)) @ odd.T
    return np.array(found.mean), np.asarray(odd @ odd.T + to_dense(found.even)), np.asarray(cross)


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 2**31),
    rank=st.integers(0, 3),
    exponent=st.integers(-6, 6),
    rule=st.sampled_from(sorted(RULES)),
)
def test_linear_functions_are_exact_at_any_rank_and_scale(seed, rank, exponent, rule):
    rng = np.random.default_rng(seed)
    scale = 10.0**exponent
    mean, cov = random_gaussian(rng, scale, rank)
    a, b = rng.normal(size=(2, 3)), rng.normal(size=2) * scale
    found, spread, cross = moments(
        lambda p: Pair(*(sum(a[i, j] * p[j] for j in range(3)) + b[i] for i in range(2))),
        mean,
        cov,
        RULES[rule],
    )
    np.testing.assert_allclose(found, a @ mean + b, atol=1e-12 * scale * 10)
    # a singular matrix keeps the guard's 1e-14 of its diagonal, so the root of that in the cross
    np.testing.assert_allclose(spread, a @ cov @ a.T, atol=1e-11 * scale**2 * 10)
    np.testing.assert_allclose(cross, cov @ a.T, atol=1e-11 * scale**2 * 10)


@pytest.mark.parametrize("rule", RULES)
def test_the_mean_of_a_quadratic_is_exact_for_every_rule(rule):
    rng = np.random.default_rng(1)
    mean, cov = random_gaussian(rng)
    a = rng.normal(size=(3, 3))
    a = a + a.T
    found, _, cross = moments(quadratic(a), mean, cov, RULES[rule])
    assert found[0] == pytest.approx(mean @ a @ mean + np.trace(a @ cov), rel=1e-12)
    np.testing.assert_allclose(cross[:, 0], 2 * cov @ a @ mean, rtol=1e-11)


@pytest.mark.parametrize("order", [3, 4])
def test_gauss_hermite_has_the_covariance_of_quadratics_exactly(order):
    """cov(x'Ax, x'Bx) = 2 tr(APBP) + 4 m'APBm, a fourth moment."""
    rng = np.random.default_rng(2)
    mean, cov = random_gaussian(rng)
    a, b = (s + s.T for s in rng.normal(size=(2, 3, 3)))
    _, spread, _ = moments(
        lambda p: Pair(quadratic(a)(p).u, quadratic(b)(p).u), mean, cov, gauss_hermite(order)
    )
    for i, m in enumerate((a, b)):
        for j, n in enumerate((a, b)):
            exact = 2 * np.trace(m @ cov @ n @ cov) + 4 * mean @ m @ cov @ n @ mean
            assert spread[i, j] == pytest.approx(exact, rel=1e-11)


def quadratic(a):
    def function(p):
        value = sum(a[i, j] * p[i] * p[j] for i in range(3) for j in range(3))
        return Pair(value, value)

    return function


def test_gauss_hermite_of_an_exponential_converges_to_the_closed_form():
    cov = np.diag([0.3, 0.2, 0.1])
    exact = np.exp(0.5 * cov.trace())
    errors = []
    for order in (2, 3, 5):
        found, _, _ = moments(
            lambda p: Pair(jnp.exp(p.x + p.y + p.z), p.x), np.zeros(3), cov, gauss_hermite(order)
        )
        errors.append(abs(found[0] - exact))
    assert errors[0] > 10 * errors[1] > 100 * errors[2]
    assert errors[2] < 1e-5


def test_points_move_smoothly_so_gradients_equal_differences():
    mean, root = np.array([0.2, -0.1, 0.4]), np.array([[1.0, 0, 0], [0.3, 0.5, 0], [0.1, 0, 0.0]])

    def total(scale, rule):
        factor, _ = cholesky(from_dense(jnp.asarray(root @ root.T) * scale))
        found = transform(
            lambda p: Pair(jnp.sin(p.x) * p.y, p.z**3), Point(*jnp.asarray(mean)), factor, rule(3)
        )
        return found.mean.u + found.even[0][0] + jnp.sum(found.odd[1] ** 2)

    for rule in RULES.values():
        of = jax.jit(partial(total, rule=rule))
        slope = jax.jit(jax.grad(of))(1.3)
        difference = (of(1.3 + 1e-5) - of(1.3 - 1e-5)) / 2e-5
        assert float(slope) == pytest.approx(float(difference), rel=1e-6)


def test_rules_that_cannot_work_are_refused():
    with pytest.raises(ValueError, match="order=1"):
        gauss_hermite(1)
    with pytest.raises(ValueError, match=r"3\^12 = 531441 points"):
        gauss_hermite(3)(12)
