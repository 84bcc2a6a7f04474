"""The extended filter against NumPy, and the iterated one against the posterior's own maximum."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from models import COV, MEAN, Sensors, Track, kalman, linear_model, sample
from scipy.optimize import minimize

from wheelhop.filtering import StateSpaceModel, dense, drive, extended, gaussian


class Point(NamedTuple):
    x: Any
    y: Any


class Range(NamedTuple):
    r: Any


R_VAR = 0.01


def radar():
    """Random walk in the plane seen by its distance: strongly nonlinear close to the origin."""
    return StateSpaceModel(
        transition=lambda s, p: Point(s.x + 0.1 * jnp.sin(s.y), s.y),
        observation=lambda s, p: Range(jnp.sqrt(s.x * s.x + s.y * s.y)),
        process_cov=lambda s, p: ((0.02,), (0.0, 0.03)),
        observation_cov=lambda p: ((R_VAR * p,),),
    )


PRIOR_MEAN = np.array([0.8, 0.5])
PRIOR_COV = np.array([[0.3, 0.05], [0.05, 0.2]])


def prior():
    return gaussian(Point(*PRIOR_MEAN), jnp.asarray(PRIOR_COV))


def numpy_prediction():
    x, y = PRIOR_MEAN
    jacobian = np.array([[1.0, 0.1 * np.cos(y)], [0.0, 1.0]])
    mean = np.array([x + 0.1 * np.sin(y), y])
    return mean, jacobian @ PRIOR_COV @ jacobian.T + np.diag([0.02, 0.03])


@pytest.mark.parametrize("iterations", [1, 3])
def test_linear_model_gives_the_exact_kalman_filter(iterations):
    _, ys = sample(0, 60)
    ys[5] = np.nan
    ys[20, 0] = np.nan
    belief = gaussian(Track(*MEAN), jnp.asarray(COV))
    measured = Sensors(jnp.asarray(ys[:, 0]), jnp.asarray(ys[:, 1]))
    trajectory = drive.run(extended(linear_model(), iterations), belief, measured, 1.0)
    means, covs, log_likelihood = kalman(ys)
    np.testing.assert_allclose(dense(trajectory.state)[0], means, atol=1e-12)
    np.testing.assert_allclose(dense(trajectory.state)[1], covs, atol=1e-12)
    np.testing.assert_allclose(trajectory.info.log_likelihood, log_likelihood, atol=1e-12)


def test_one_step_equals_the_textbook_with_analytic_jacobians():
    mean, cov = numpy_prediction()
    r = np.hypot(*mean)
    h = (mean / r)[None]
    s = h @ cov @ h.T + R_VAR
    gain = cov @ h.T / s
    y = 1.3
    belief, info = extended(radar()).step(prior(), Range(jnp.asarray(y)), 1.0)
    found_mean, found_cov = dense(belief)
    np.testing.assert_allclose(found_mean, mean + gain[:, 0] * (y - r), atol=1e-13)
    np.testing.assert_allclose(found_cov, (np.eye(2) - gain @ h) @ cov, atol=1e-13)
    assert float(info.innovation.r) == pytest.approx(y - r)
    assert float(info.innovation_cov[0][0]) == pytest.approx(s.item())


def test_iterated_update_finds_the_maximum_of_the_posterior_and_its_curvature():
    """The measurement counts once: the covariance is the Gauss-Newton inverse at the maximum."""
    mean, cov = numpy_prediction()
    y = 0.4

    def cost(p):
        d = p - mean
        return 0.5 * d @ np.linalg.solve(cov, d) + 0.5 * (y - np.hypot(*p)) ** 2 / R_VAR

    best = minimize(cost, mean, method="BFGS", options={"gtol": 1e-9}).x
    found_mean, found_cov = dense(
        extended(radar(), iterations=60).step(prior(), Range(jnp.asarray(y)), 1.0)[0]
    )
    np.testing.assert_allclose(found_mean, best, atol=1e-6)
    h = (best / np.hypot(*best))[None]
    curvature = np.linalg.inv(cov) + h.T @ h / R_VAR
    np.testing.assert_allclose(found_cov, np.linalg.inv(curvature), atol=1e-6)
    plain, _ = dense(extended(radar()).step(prior(), Range(jnp.asarray(y)), 1.0)[0])
    assert cost(np.asarray(found_mean)) < cost(np.asarray(plain))


def test_gradient_of_the_iterated_filter_equals_finite_differences():
    filter = extended(radar(), iterations=3)
    ys = Range(jnp.array([1.1, 0.9, np.nan, 1.2]))

    @jax.jit
    def total(scale):
        return drive.log_likelihood(filter, prior(), ys, scale)

    h = 1e-5
    difference = (total(1 + h) - total(1 - h)) / (2 * h)
    assert float(jax.jit(jax.grad(total))(1.0)) == pytest.approx(float(difference), rel=1e-6)


def test_no_iteration_is_refused():
    with pytest.raises(ValueError, match="iterations=0"):
        extended(radar(), iterations=0)
