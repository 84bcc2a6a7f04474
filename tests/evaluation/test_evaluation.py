"""Error statistics and consistency figures against their definitions."""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import chi2

from wheelhop.errors import InputError
from wheelhop.estimators.pressure_estimate import PressureEstimate
from wheelhop.evaluation.consistency import inside_fraction, mean_band, nees
from wheelhop.evaluation.errors import error_statistics
from wheelhop.evaluation.summary import summarise_estimate
from wheelhop.filtering import gaussian
from wheelhop.vehicle.record import CornerRecord


class Point(NamedTuple):
    x: Any
    y: Any


def test_statistics_are_eq_23_to_25():
    error = np.array([[1.0, 2.0], [3.0, -2.0], [5.0, 3.0]])
    sigma = np.array([[1.0, 1.0], [2.0, 1.0], [3.0, 4.0]])
    s = error_statistics(error, sigma)
    np.testing.assert_allclose(s.mean, [3.0, 1.0])
    np.testing.assert_allclose(s.std, [2.0, np.sqrt(7.0)])
    np.testing.assert_allclose(s.sigma, [2.0, 2.0])
    np.testing.assert_allclose(s.rms, [np.sqrt(35 / 3), np.sqrt(17 / 3)])
    with pytest.raises(InputError, match="1 run has no spread"):
        error_statistics(error[:1], sigma[:1])


def test_nees_of_draws_from_the_belief_is_chi_square():
    rng = np.random.default_rng(0)
    cov = np.array([[2.0, 0.6], [0.6, 0.5]])
    draws = rng.multivariate_normal([1.0, -1.0], cov, size=4000)
    belief = gaussian(Point(1.0, -1.0), jnp.asarray(cov))
    values = np.asarray(nees(belief, Point(jnp.asarray(draws[:, 0]), jnp.asarray(draws[:, 1]))))
    low, high = mean_band(2, 4000, 0.999)
    assert low < values.mean() < high
    assert np.mean(values < chi2.ppf(0.9, 2)) == pytest.approx(0.9, abs=0.02)


def test_band_of_one_run_is_the_chi_square_itself():
    assert mean_band(5, 1) == pytest.approx(tuple(chi2.ppf([0.025, 0.975], 5)))


def test_inside_fraction_counts():
    assert inside_fraction(np.array([0.5, -1.5, 2.5]), np.ones(3), 2.0) == pytest.approx(2 / 3)


def test_summary_compares_with_the_truth_and_the_prior():
    t = 0.01 * np.arange(1, 1001)
    ones = np.ones(1000)
    result = PressureEstimate(
        t,
        200e3 * ones,
        10e3 * ones,
        2e5 * ones,
        1e4 * ones,
        ("A", "B"),
        np.stack([0.3 * ones, 0.7 * ones], axis=1),
        2.0 * ones,
        np.zeros(1000, int),
        np.zeros(1000, bool),
        np.zeros(1000, int),
    )
    record = CornerRecord(t, ones, ones, 10 * ones, 215e3 * ones)
    summary = summarise_estimate(result, record, prior_pressure=180e3, nominal_pressure=250e3)
    assert summary["most_probable_road_class"] == "B"
    truth = summary["against_truth"]
    assert truth["rms_error_Pa"] == pytest.approx(15e3)
    assert truth["mean_error_Pa"] == pytest.approx(-15e3)
    assert truth["rms_error_of_the_prior_Pa"] == pytest.approx(35e3)
    assert truth["share_within_1_sigma"] == 0.0
    assert truth["share_within_2_sigma"] == 1.0
    assert truth["mean_nees"] == pytest.approx(2.25)
    assert "against_truth" not in summarise_estimate(
        result, CornerRecord(t, ones, ones, 10 * ones), 180e3, 250e3
    )
    assert summary["doubts"] == []
    assert [row["t_s"] for row in summary["over_time"]][-1] == pytest.approx(10.0)
    doubted = summarise_estimate(result, record, 180e3, nominal_pressure=100e3)["doubts"]
    assert "200 kPa is no plausible pressure of a tyre of 100 kPa" in doubted[0]
