"""Gaussians and mixtures against sampling-free closed forms."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from wheelhop.filtering import (
    Gaussian,
    dense,
    gaussian,
    independent,
    moment_match,
    normalised_square,
    standard_deviation,
)


class Point(NamedTuple):
    x: Any
    y: Any


def mixture(seed, m=3):
    rng = np.random.default_rng(seed)
    means = rng.normal(size=(m, 2))
    factors = rng.normal(size=(m, 2, 2))
    covs = factors @ factors.transpose(0, 2, 1)
    weights = rng.dirichlet(np.ones(m))
    parts = [
        gaussian(Point(*mean), jnp.asarray(cov)) for mean, cov in zip(means, covs, strict=True)
    ]
    return weights, means, covs, jax.tree.map(lambda *a: jnp.stack(a), *parts)


def test_moment_match_equals_the_law_of_total_covariance():
    weights, means, covs, stacked = mixture(0)
    mean = weights @ means
    cov = np.einsum("m,mij->ij", weights, covs)
    cov += np.einsum("m,mi,mj->ij", weights, means - mean, means - mean)
    found_mean, found_cov = dense(moment_match(jnp.asarray(weights), stacked))
    np.testing.assert_allclose(found_mean, mean, rtol=1e-13)
    np.testing.assert_allclose(found_cov, cov, rtol=1e-13)


def test_a_component_of_weight_zero_may_be_nan():
    _, means, covs, stacked = mixture(1)
    poisoned = jax.tree.map(lambda a: a.at[1].set(jnp.nan), stacked)
    matched = moment_match(jnp.array([1.0, 0.0, 0.0]), poisoned)
    np.testing.assert_allclose(dense(matched)[0], means[0])
    np.testing.assert_allclose(dense(matched)[1], covs[0])

    def total(weights):
        return jnp.sum(dense(moment_match(weights, poisoned))[1])

    assert np.isfinite(jax.grad(total)(jnp.array([0.5, 0.0, 0.5]))).all()


def test_independent_and_standard_deviation_are_inverse():
    sigma = standard_deviation(independent(Point(1.0, 2.0), Point(0.3, 4.0)))
    np.testing.assert_allclose(tuple(sigma), (0.3, 4.0))


def test_normalised_square_equals_the_dense_formula():
    _, means, covs, _ = mixture(2, m=1)
    belief = gaussian(Point(0.0, 0.0), jnp.asarray(covs[0]))
    expected = means[0] @ np.linalg.solve(covs[0], means[0])
    assert float(normalised_square(Point(*means[0]), belief.cov)) == pytest.approx(expected)


def test_wrong_covariance_size_is_told():
    with pytest.raises(ValueError, match="3 rows for the 2 components"):
        gaussian(Point(0.0, 0.0), jnp.eye(3))


def test_a_gaussian_is_a_pytree():
    belief = independent(Point(1.0, 2.0), Point(1.0, 1.0))
    assert isinstance(jax.tree.map(lambda a: 2 * a, belief), Gaussian)
