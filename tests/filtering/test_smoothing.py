"""Smoothers against one dense Gaussian solve, and by what smoothing must do."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from models import COV, MEAN, Sensors, Track, dense_posterior, linear_model, sample
from scipy.stats import chi2

from wheelhop.filtering import (
    dense,
    drive,
    extended,
    extended_smoother,
    gaussian,
    scaled,
    unscented,
    unscented_smoother,
)

PAIRS = {
    "extended": (extended(linear_model()), extended_smoother(linear_model())),
    "cubature": (unscented(linear_model()), unscented_smoother(linear_model())),
    "uneven": (
        unscented(linear_model(), scaled(0.5, 2.0, 1.0)),
        unscented_smoother(linear_model(), scaled(0.5, 2.0, 1.0)),
    ),
}


def measurements(ys):
    return Sensors(jnp.asarray(ys[:, 0]), jnp.asarray(ys[:, 1]))


def smooth(pair, ys, cov=COV):
    filter, smoother = PAIRS[pair]
    belief = gaussian(Track(*MEAN), jnp.asarray(cov))
    beliefs = drive.run(filter, belief, measurements(ys), 1.0, keep=lambda state, info: state)
    return beliefs, smoother(beliefs, 1.0)


@pytest.mark.parametrize("pair", PAIRS)
def test_linear_model_equals_one_dense_solve_of_the_whole_record(pair):
    _, ys = sample(0, 15)
    posterior, spread, _ = dense_posterior(ys)
    mean, cov = dense(smooth(pair, ys)[1])
    np.testing.assert_allclose(np.ravel(mean), posterior, atol=1e-10)
    for k in range(15):
        block = spread[3 * k : 3 * k + 3, 3 * k : 3 * k + 3]
        np.testing.assert_allclose(cov[k], block, atol=1e-10)


@pytest.mark.parametrize("pair", PAIRS)
def test_smoothing_never_widens_and_ends_at_the_filter(pair):
    _, ys = sample(1, 40)
    ys[10:14] = np.nan
    beliefs, smoothed = smooth(pair, ys)
    filtered_cov, smoothed_cov = np.asarray(dense(beliefs)[1]), np.asarray(dense(smoothed)[1])
    assert np.linalg.eigvalsh(filtered_cov - smoothed_cov).min() > -1e-9
    assert np.linalg.eigvalsh(smoothed_cov).min() > 0
    np.testing.assert_array_equal(dense(smoothed)[0][-1], dense(beliefs)[0][-1])


def test_smoothed_covariance_is_honest_over_500_runs():
    runs, steps = 500, 20
    xs, ys = zip(*(sample(2000 + k, steps) for k in range(runs)), strict=True)
    ys = np.array(ys)
    filter, smoother = PAIRS["cubature"]
    belief = gaussian(Track(*MEAN), jnp.asarray(COV))

    def one(a, b):
        beliefs = drive.run(filter, belief, Sensors(a, b), 1.0, keep=lambda s, info: s)
        return dense(smoother(beliefs, 1.0))

    mean, cov = jax.jit(jax.vmap(one))(jnp.asarray(ys[:, :, 0]), jnp.asarray(ys[:, :, 1]))
    error = np.array(xs)[:, 10] - np.asarray(mean)[:, 10]
    white = np.linalg.solve(np.asarray(cov)[:, 10], error[..., None])[..., 0]
    low, high = chi2.ppf([0.0005, 0.9995], 3 * runs) / runs
    assert low < np.einsum("ri,ri->r", error, white).mean() < high


def test_a_component_known_exactly_stays_known():
    """Zero variance and no noise on the bias: a singular prediction, finite in value and slope."""
    cov = COV.copy()
    cov[2] = cov[:, 2] = 0.0
    _, ys = sample(3, 12)
    _, smoothed = smooth("cubature", ys, cov)
    assert np.all(np.asarray(smoothed.cov[2][2]) < 1e-20)
    np.testing.assert_allclose(smoothed.mean.bias, MEAN[2] * 0.99 ** np.arange(1, 13), atol=1e-12)

    def total(a):
        filter, smoother = PAIRS["extended"]
        belief = gaussian(Track(*MEAN), jnp.asarray(cov))
        y = Sensors(a, jnp.asarray(ys[:, 1]))
        beliefs = drive.run(filter, belief, y, 1.0, keep=lambda s, info: s)
        return jnp.sum(smoother(beliefs, 1.0).mean.position)

    assert np.isfinite(jax.jit(jax.grad(total))(jnp.asarray(ys[:, 0]))).all()


def test_inputs_that_vary_in_time_are_those_of_the_filter():
    _, ys = sample(4, 10)
    factors = jnp.linspace(0.5, 2.0, 10)
    filter, smoother = PAIRS["extended"]
    belief = gaussian(Track(*MEAN), jnp.asarray(COV))
    options = {"inputs": factors, "bind": lambda p, u: p * u}
    beliefs = drive.run(filter, belief, measurements(ys), 1.0, keep=lambda s, info: s, **options)
    found = smoother(beliefs, 1.0, **options)
    # by hand: the step into the last sample, with its own factor
    before = jax.tree.map(lambda a: a[-2:], beliefs)
    by_hand = smoother(before, float(factors[-1]))
    np.testing.assert_allclose(dense(found)[0][-2], dense(by_hand)[0][0], atol=1e-13)
