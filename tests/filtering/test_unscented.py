"""The unscented filter where the exact answer is known, and its behaviour at the edges."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from models import COV, MEAN, Sensors, Track, kalman, linear_model, sample

from wheelhop.filtering import Gaussian, cubature, dense, drive, gaussian, scaled, unscented

RULES = {"cubature": cubature, "scaled": scaled(), "uneven": scaled(0.5, 2.0, 1.0)}


def prior():
    return gaussian(Track(*MEAN), jnp.asarray(COV))


def as_measurements(ys):
    return Sensors(jnp.asarray(ys[:, 0]), jnp.asarray(ys[:, 1]))


@pytest.mark.parametrize("rule", RULES)
def test_linear_model_gives_the_exact_kalman_filter(rule):
    _, ys = sample(0, 60)
    ys[5] = np.nan
    ys[20, 0] = np.nan
    ys[21, 1] = np.nan
    trajectory = drive.run(
        unscented(linear_model(), RULES[rule]), prior(), as_measurements(ys), 1.0
    )
    means, covs, log_likelihood = kalman(ys)
    found_mean, found_cov = dense(trajectory.state)
    np.testing.assert_allclose(found_mean, means, atol=1e-12)
    np.testing.assert_allclose(found_cov, covs, atol=1e-12)
    np.testing.assert_allclose(trajectory.info.log_likelihood, log_likelihood, atol=1e-12)


def test_missing_entries_are_counted_and_leave_no_trace_in_the_gradient():
    _, ys = sample(1, 30)
    gapped = ys.copy()
    gapped[3, 0] = np.nan
    gapped[7] = np.nan
    filter = unscented(linear_model())

    def total(a, scale):
        return drive.log_likelihood(filter, prior(), Sensors(a, jnp.asarray(gapped[:, 1])), scale)

    trajectory = drive.run(filter, prior(), as_measurements(gapped), 1.0)
    assert np.flatnonzero(trajectory.info.flags.missing).tolist() == [3, 7]
    assert trajectory.info.flags.missing[7] == 2
    assert np.asarray(trajectory.info.innovation.a)[3] == 0.0
    by_y, by_scale = jax.jit(jax.grad(total, argnums=(0, 1)))(jnp.asarray(gapped[:, 0]), 1.0)
    assert np.isfinite(by_y).all()
    assert float(by_y[3]) == 0.0
    assert abs(float(by_y[4])) > 0.0
    step = 1e-5
    difference = (kalman(gapped, 1 + step)[2].sum() - kalman(gapped, 1 - step)[2].sum()) / (
        2 * step
    )
    assert float(by_scale) == pytest.approx(difference, rel=1e-7)


def test_covariance_is_honest_over_1000_runs():
    """NEES and NIS of the matched linear model lie in their 99.9 % chi-square bands."""
    from scipy.stats import chi2

    runs, steps = 1000, 20
    xs, ys = zip(*(sample(100 + k, steps) for k in range(runs)), strict=True)
    xs, ys = np.array(xs), np.array(ys)
    filter = unscented(linear_model())
    run = jax.jit(jax.vmap(lambda a, b: drive.run(filter, prior(), Sensors(a, b), 1.0)))
    trajectory = run(jnp.asarray(ys[:, :, 0]), jnp.asarray(ys[:, :, 1]))
    mean, cov = map(np.asarray, dense(trajectory.state))
    error = xs[:, -1] - mean[:, -1]
    nees = np.einsum("ri,ri->r", error, np.linalg.solve(cov[:, -1], error[..., None])[..., 0])
    for values, dof in ((nees, 3), (np.asarray(trajectory.info.nis)[:, -1], 2)):
        low, high = chi2.ppf([0.0005, 0.9995], dof * runs) / runs
        assert low < values.mean() < high


def test_float32_stays_float32_and_agrees(float32):
    _, ys = sample(2, 200)
    belief = gaussian(Track(*MEAN), jnp.asarray(COV))
    trajectory = drive.run(unscented(linear_model()), belief, as_measurements(ys), 1.0)
    assert trajectory.state.mean.position.dtype == jnp.float32
    means, covs, _ = kalman(ys)
    sigma = np.sqrt(covs[:, 0, 0])
    assert np.max(np.abs(np.asarray(trajectory.state.mean.position) - means[:, 0]) / sigma) < 1e-4
    assert not np.any(trajectory.info.flags.nonfinite)


def test_small_alpha_is_refused_in_float32_only(float32):
    belief = gaussian(Track(*MEAN), jnp.asarray(COV))
    y = Sensors(jnp.asarray(0.0), jnp.asarray(0.0))
    with pytest.raises(ValueError, match=r"use alpha >= 0\.1 or run in float64"):
        unscented(linear_model(), scaled(alpha=1e-3)).step(belief, y, 1.0)


def test_a_rule_without_spread_is_refused():
    with pytest.raises(ValueError, match="must be positive"):
        scaled(kappa=-3.0)(3)


def test_a_known_state_and_noise_free_sensors_stay_finite():
    """Zero prior covariance: every pivot is zero, in value and gradient."""
    belief = gaussian(Track(*MEAN), jnp.zeros((3, 3)))
    y = Sensors(jnp.asarray(0.1), jnp.asarray(0.2))
    filter = unscented(linear_model())

    def total(mean):
        state, info = filter.step(Gaussian(mean, belief.cov), y, 1.0)
        return info.log_likelihood + state.mean.position

    assert np.isfinite(total(belief.mean))
    assert all(np.isfinite(g) for g in jax.jit(jax.grad(total))(belief.mean))


def test_divergence_is_flagged():
    belief = gaussian(Track(np.inf, 0.0, 0.0), jnp.asarray(COV))
    _, info = unscented(linear_model()).step(belief, Sensors(jnp.ones(()), jnp.ones(())), 1.0)
    assert bool(info.flags.nonfinite)
