"""The Kalman filter against NumPy and against the dense joint Gaussian of the whole record."""

import jax
import jax.numpy as jnp
import numpy as np
from models import COV, MEAN, F, H, Q, R, Sensors, Track, dense_posterior, sample
from models import kalman as numpy_kalman

from wheelhop.filtering import LinearGaussian, dense, drive, gaussian, kalman

PARAMS = LinearGaussian(jnp.asarray(F), jnp.asarray(H), jnp.asarray(Q), jnp.asarray(R))


def prior():
    return gaussian(Track(*MEAN), jnp.asarray(COV))


def measurements(ys):
    return Sensors(jnp.asarray(ys[:, 0]), jnp.asarray(ys[:, 1]))


def test_equals_the_textbook_recursion_with_gaps():
    _, ys = sample(0, 50)
    ys[4] = np.nan
    ys[9, 1] = np.nan
    trajectory = drive.run(kalman(Sensors), prior(), measurements(ys), PARAMS)
    means, covs, log_likelihood = numpy_kalman(ys)
    np.testing.assert_allclose(dense(trajectory.state)[0], means, atol=1e-12)
    np.testing.assert_allclose(dense(trajectory.state)[1], covs, atol=1e-12)
    np.testing.assert_allclose(trajectory.info.log_likelihood, log_likelihood, atol=1e-12)


def test_equals_one_dense_gaussian_solve_of_the_whole_record():
    steps = 12
    _, ys = sample(1, steps)
    posterior, spread, evidence = dense_posterior(ys)
    trajectory = drive.run(kalman(Sensors), prior(), measurements(ys), PARAMS)
    found_mean, found_cov = dense(trajectory.state)
    np.testing.assert_allclose(found_mean[-1], posterior[-3:], atol=1e-10)
    np.testing.assert_allclose(found_cov[-1], spread[-3:, -3:], atol=1e-10)
    np.testing.assert_allclose(trajectory.info.log_likelihood.sum(), evidence, atol=1e-10)


def test_gradient_with_a_rank_deficient_process_noise():
    _, ys = sample(2, 20)

    def total(q):
        params = LinearGaussian(PARAMS.transition, PARAMS.observation, q, PARAMS.observation_cov)
        return drive.log_likelihood(kalman(Sensors), prior(), measurements(ys), params)

    gradient = jax.jit(jax.grad(total))(PARAMS.process_cov)
    h = 1e-6
    for i, j in ((0, 0), (1, 0), (1, 1), (2, 2)):
        step = np.zeros((3, 3))
        step[i, j] = h
        forward, backward = (numpy_free(ys, Q + sign * (step + step.T) / 2) for sign in (1, -1))
        # only the lower triangle is read, so its entry carries both symmetric ones
        factor = 1.0 if i == j else 0.5
        difference = (forward - backward) / (2 * h)
        np.testing.assert_allclose(factor * gradient[i, j], difference, rtol=1e-5, atol=1e-6)


def numpy_free(ys, q):
    """Log-likelihood of the textbook recursion for any process noise."""
    mean, cov, total = MEAN.copy(), COV.copy(), 0.0
    for y in ys:
        mean, cov = F @ mean, F @ cov @ F.T + q
        s = H @ cov @ H.T + R
        r = y - H @ mean
        gain = cov @ H.T @ np.linalg.inv(s)
        mean, cov = mean + gain @ r, cov - gain @ s @ gain.T
        total += -0.5 * (r @ np.linalg.solve(s, r) + np.linalg.slogdet(2 * np.pi * s)[1])
    return total
