"""Calibration at a known pressure."""

import json

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import chi2

from wheelhop.errors import InputError
from wheelhop.estimators.calibration import (
    bias_cov,
    calibrate,
    calibrated,
    from_dict,
    to_dict,
)
from wheelhop.estimators.pressure import StiffnessBelief
from wheelhop.vehicle.tire import Tire

TIRE = Tire(264.7e3, 250e3, 0.7)
PLACARD = 230e3
LN_PLACARD = np.log(264.7e3 * (1 + 0.7 * (PLACARD - 250e3) / 250e3))
AT_10_S = 0.022**2 * np.ones((4, 4)) + 0.0092**2 * np.eye(4)
DT = 0.5


def drives(runs, steps, walk, offset, seed, shared_noise=None):
    """Kalman filters of a random walk that measure a constant: means, and one covariance."""
    rng = np.random.default_rng(seed)
    noise = AT_10_S * 10.0 / DT
    root = np.linalg.cholesky(noise)
    cov, mean = 0.09 * np.eye(4), np.full((runs, 4), LN_PLACARD)
    means, covs = [], []
    for _ in range(steps):
        cov = cov + walk**2 * DT * np.eye(4)
        gain = np.linalg.solve(cov + noise, cov).T
        measured = LN_PLACARD + offset + rng.standard_normal((runs, 4)) @ root.T
        mean = mean + (measured - mean) @ gain.T
        cov = cov - gain @ cov
        cov = 0.5 * (cov + cov.T)
        means.append(mean)
        covs.append(cov)
    return np.stack(means, 1), np.stack(covs)


def times(steps):
    return DT * np.arange(1, steps + 1)


@pytest.mark.parametrize("walk", [0.03, 0.003])
def test_a_common_bias_is_removed_and_the_covariance_covers_the_rest(walk):
    runs, steps = 150, 160
    offset = np.random.default_rng(5).multivariate_normal(np.zeros(4), 0.05**2 * np.ones((4, 4)), 1)
    before, cov = drives(runs, steps, walk, offset, seed=1)
    after, _ = drives(runs, steps, walk, offset, seed=2)
    squares, last = [], []
    for b, a in zip(before, after, strict=True):
        found = calibrate(times(steps), b, cov, TIRE, PLACARD, belief_walk=walk)
        belief = calibrated(StiffnessBelief(jnp.asarray(a[-1]), jnp.asarray(cov[-1])), found)
        error = np.asarray(belief.mean) - LN_PLACARD
        squares.append(error @ np.linalg.solve(np.asarray(belief.cov), error))
        last.append(found.offset - offset[0])
    # a random walk that the truth does not make leaves the stated covariance up to twice too wide
    low, high = chi2.ppf(0.005, 4 * runs) / runs / 4, chi2.ppf(0.995, 4 * runs) / runs / 4
    assert 0.5 * low < np.mean(squares) / 4 < high
    own = [e @ np.linalg.solve(found.cov, e) for e in last]
    assert 0.5 * low < np.mean(own) / 4 < high
    assert np.sqrt(np.mean(np.square(last))) < 0.012


def test_the_window_is_averaged_where_the_estimator_forgets():
    steps = 240
    before, cov = drives(1, steps, 0.03, 0.0, seed=3)
    found = calibrate(times(steps), before[0], cov, TIRE, PLACARD, belief_walk=0.03)
    assert np.sqrt(np.trace(found.cov)) < 0.5 * np.sqrt(np.trace(cov[-1]))
    # no data can give more than the information that they hold
    information = np.linalg.inv(AT_10_S / steps / DT * 10.0)
    excess = np.linalg.eigvalsh(information - np.linalg.inv(found.cov))
    assert excess.min() > -1e-6 * np.trace(information)


def test_what_is_shared_before_and_after_cancels():
    steps = 100
    before, cov = drives(1, steps, 0.03, 0.0, seed=4)
    common = 0.004**2 * np.ones((4, 4))
    options = {"belief_walk": 0.03}
    plain = calibrate(times(steps), before[0], cov, TIRE, PLACARD, **options)
    shared = calibrate(times(steps), before[0], cov, TIRE, PLACARD, shared=common, **options)
    later = StiffnessBelief(jnp.asarray(before[0, -1]), jnp.asarray(cov[-1]))
    narrower = calibrated(later, plain).cov - calibrated(later, shared).cov
    np.testing.assert_allclose(narrower, 2.0 * common, rtol=1e-9)
    drift = bias_cov(shared, common_sd=0.02, single_sd=0.005)
    expected = plain.cov - 2.0 * common + 4e-4 * np.ones((4, 4)) + 25e-6 * np.eye(4)
    np.testing.assert_allclose(drift, expected, rtol=1e-12)


def test_a_file_of_plain_numbers_keeps_it():
    before, cov = drives(1, 80, 0.03, 0.03, seed=6)
    pressures = np.array([230e3, 230e3, 250e3, 250e3])
    found = calibrate(times(80), before[0], cov, TIRE, pressures, belief_walk=0.03)
    again = from_dict(json.loads(json.dumps(to_dict(found))))
    for name in ("offset", "cov", "shared", "pressure", "duration"):
        np.testing.assert_array_equal(getattr(found, name), getattr(again, name))


def test_missing_beliefs_are_left_out():
    before, cov = drives(1, 120, 0.03, 0.02, seed=7)
    mean, covs = before[0].copy(), cov.copy()
    mean[10:40] = np.nan
    covs[60:70, 1, 1] = np.nan
    found = calibrate(times(120), mean, covs, TIRE, PLACARD, belief_walk=0.03)
    assert found.duration == pytest.approx(80 * DT)
    np.testing.assert_allclose(found.offset, 0.02, atol=0.06)


def test_what_cannot_be_calibrated_is_refused():
    before, cov = drives(1, 80, 0.03, 0.0, seed=8)
    t, mean = times(80), before[0]

    def attempt(mean=mean, cov=cov, pressure=PLACARD, walk=0.03, **options):
        return calibrate(
            t[: len(mean)], mean, cov[: len(mean)], TIRE, pressure, belief_walk=walk, **options
        )

    with pytest.raises(InputError, match=r"fewer than 20 s"):
        attempt(mean=mean[:30])
    with pytest.raises(InputError, match="not known"):
        attempt(pressure=None)
    with pytest.raises(InputError, match="not known"):
        attempt(pressure=float("nan"))
    with pytest.raises(InputError, match="outside"):
        attempt(pressure=2.3)
    with pytest.raises(InputError, match="one a wheel"):
        attempt(pressure=[230e3, 230e3])
    with pytest.raises(InputError, match="none of the 80 beliefs"):
        attempt(mean=mean * np.nan)
    with pytest.raises(InputError, match="positive definite"):
        attempt(cov=-cov)
    with pytest.raises(InputError, match="belief_walk"):
        attempt(walk=0.0)
    with pytest.raises(InputError, match="exceeds"):
        attempt(shared=np.ones((4, 4)))
    entries = to_dict(attempt())
    with pytest.raises(InputError, match=r"calibration\.offset"):
        from_dict(entries | {"offset": [0.0, float("nan"), 0.0, 0.0]})
    with pytest.raises(InputError, match="shape"):
        from_dict(entries | {"cov": [[1.0]]})
    with pytest.raises(InputError, match="missing"):
        from_dict({k: v for k, v in entries.items() if k != "cov"})
