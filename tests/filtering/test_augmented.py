"""Noise among the sigma points: exact for additive noise, and for noise that multiplies."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from models import COV, MEAN, One, Q, Sensors, Track, augmented_linear_model, kalman, sample

from wheelhop.filtering import (
    AugmentedModel,
    augmented,
    cubature,
    dense,
    drive,
    gauss_hermite,
    gaussian,
    independent,
    scaled,
)

RULES = {"cubature": cubature, "uneven": scaled(0.5, 2.0, 1.0), "Gauss-Hermite": gauss_hermite(3)}


@pytest.mark.parametrize("rule", RULES)
def test_additive_noise_gives_the_kalman_filter(rule, as_users_compile):
    assert np.linalg.matrix_rank(Q) == 1
    _, ys = sample(0, 40)
    ys[7] = np.nan
    ys[9, 1] = np.nan
    filter = augmented(augmented_linear_model(), RULES[rule])
    prior = gaussian(Track(*MEAN), jnp.asarray(COV))
    run = jax.jit(lambda ys: drive.run(filter, prior, ys, 1.0), compiler_options=as_users_compile)
    trajectory = run(Sensors(*jnp.asarray(ys.T)))
    means, covs, log_likelihood = kalman(ys)
    mean, cov = dense(trajectory.state)
    np.testing.assert_allclose(mean, means, atol=1e-11)
    np.testing.assert_allclose(cov, covs, atol=1e-11)
    np.testing.assert_allclose(trajectory.info.log_likelihood, log_likelihood, atol=1e-11)
    assert not np.any(trajectory.info.flags.guarded)


def multiplicative():
    """x' = x w, y = x + v: the noise scales the state."""
    return AugmentedModel(
        lambda x, w, p: One(x.value * w.value),
        lambda x, v, p: One(x.value + v.value),
        lambda x, p: independent(One(p), One(0.2)),
        lambda p: independent(One(0.0), One(1e3)),
    )


def test_a_product_of_gaussians_has_its_exact_moments():
    """var(x w) = m_x^2 s_w^2 + m_w^2 s_x^2 + s_x^2 s_w^2; the sensor is too coarse to matter."""
    filter = augmented(multiplicative(), gauss_hermite(3))
    prior = independent(One(2.0), One(0.5))
    state, _ = filter.step(prior, One(jnp.asarray(jnp.nan)), 0.9)
    assert float(state.mean.value) == pytest.approx(1.8, rel=1e-12)
    exact = 4 * 0.04 + 0.81 * 0.25 + 0.25 * 0.04
    assert float(state.cov[0][0]) == pytest.approx(exact, rel=1e-12)


def test_gradient_through_the_noise_equals_differences():
    filter = augmented(multiplicative(), gauss_hermite(3))
    prior = independent(One(2.0), One(0.5))
    ys = One(jnp.array([1.5, jnp.nan, 1.2]))

    @jax.jit
    def total(p):
        return (
            drive.log_likelihood(filter, prior, ys, p)
            + drive.run(filter, prior, ys, p).state.mean.value.sum()
        )

    slope = (total(0.9 + 1e-5) - total(0.9 - 1e-5)) / 2e-5
    assert float(jax.jit(jax.grad(total))(0.9)) == pytest.approx(float(slope), rel=1e-7)
