"""Figures of tracking runs against arrays worked out by hand."""

import numpy as np
import pytest
from scipy.stats import chi2

from wheelhop.errors import InputError
from wheelhop.evaluation.errors import error_statistics
from wheelhop.evaluation.tracking import (
    TOLERANCE,
    convergence_times,
    moving_average,
    rms_interval,
    tracking,
)

STEP = 0.25
T = STEP * np.arange(1, 17)
"""Four seconds."""


@pytest.mark.parametrize("seed", range(3))
def test_statistics_are_eq_23_to_25(seed):
    rng = np.random.default_rng(seed)
    runs, samples = 7, 5
    truth, estimate = rng.normal(2e5, 1e4, (2, runs, samples))
    variance = rng.uniform(1e6, 1e8, (runs, samples))
    found = error_statistics(estimate - truth, np.sqrt(variance))
    for k in range(samples):
        mean = sum(truth[j, k] - estimate[j, k] for j in range(runs)) / runs
        square = sum((truth[j, k] - estimate[j, k] - mean) ** 2 for j in range(runs))
        # the paper's error is truth minus estimate
        assert found.mean[k] == pytest.approx(-mean, rel=1e-12)
        assert found.std[k] == pytest.approx((square / (runs - 1)) ** 0.5, rel=1e-12)
        bound = sum(variance[j, k] ** 0.5 for j in range(runs)) / runs
        assert found.sigma[k] == pytest.approx(bound, rel=1e-12)


def hand_made():
    """Errors in N/m of two runs: one ends 1 kN/m off, the other 3 kN/m."""
    error = np.array([[9e3] * 8 + [1e3] * 8, [-9e3] * 12 + [-3e3] * 4])
    truth = np.array([[2e5] * 16, [1.8e5] * 8 + [1.7e5] * 8])
    sigma = np.array([[2e3] * 16, [4e3] * 16])
    return truth + error, sigma, truth


def test_tracking_of_two_runs_by_hand():
    found = tracking(T, *hand_made(), slope=2.0, settling=2.0)
    # late samples: eight of 1e3 against 2e3, and four of 9e3 and of 3e3 against 4e3
    assert found.inside == pytest.approx(12 / 16)
    assert found.inside_by_run == pytest.approx(1 / 2)
    np.testing.assert_allclose(found.statistics.mean, [0.0] * 8 + [-4e3] * 4 + [-1e3] * 4)
    np.testing.assert_allclose(found.statistics.sigma, 3e3)
    early, late = (4.5**2 + 2.25**2) / 2, (0.5**2 + 2.25**2) / 2
    last = (0.5**2 + 0.75**2) / 2
    np.testing.assert_allclose(found.nees, [early] * 8 + [late] * 4 + [last] * 4)
    assert found.final_rmse.value == pytest.approx(((2e3**2 + 6e3**2) / 2) ** 0.5)
    assert found.final_bias == pytest.approx((2e3 - 6e3) / 2)
    # 18 kPa off is out of tolerance: the averages of two samples are 18, 10, 2 and 18, 12, 6 kPa
    assert found.converged == 1.0
    assert found.convergence_time == pytest.approx((T[8] + T[12]) / 2)


def test_only_runs_that_end_within_tolerance_count_for_the_time():
    estimate, sigma, truth = hand_made()
    estimate[1, 12:] = truth[1, 12:] - 9e3
    found = tracking(T, estimate, sigma, truth, slope=2.0)
    assert found.converged == 0.5
    assert found.convergence_time == pytest.approx(T[8])
    estimate[0, 12:] = truth[0, 12:] + 9e3
    found = tracking(T, estimate, sigma, truth, slope=2.0)
    assert found.converged == 0.0
    assert np.isnan(found.convergence_time)


def test_tracking_that_cannot_be_judged_is_refused():
    with pytest.raises(InputError, match=r"settling: 4 s leave nothing"):
        tracking(T, *hand_made(), slope=2.0, settling=4.0)
    with pytest.raises(InputError, match=r"runs: 1 run has no spread"):
        tracking(T, *(a[:1] for a in hand_made()), slope=2.0)


@pytest.mark.parametrize("seed", range(3))
def test_nees_of_honest_runs_lies_in_its_band(seed):
    """In 95 % of the times; runs that state half their sigma lie above it."""
    rng = np.random.default_rng(seed)
    runs, t = 50, 0.01 * np.arange(1, 1001)
    sigma = rng.uniform(1e3, 3e3, (runs, 1000))
    truth = np.full((runs, 1000), 2e5)
    estimate = truth + sigma * rng.normal(size=sigma.shape)
    found = tracking(t, estimate, sigma, truth, slope=0.5)
    low, high = found.nees_band
    assert (low, high) == pytest.approx(tuple(chi2.ppf([0.025, 0.975], runs) / runs))
    assert np.mean((found.nees > low) & (found.nees < high)) == pytest.approx(0.95, abs=0.03)
    assert found.inside == pytest.approx(0.6827, abs=0.01)
    assert np.all(tracking(t, estimate, 0.5 * sigma, truth, slope=0.5).nees > high)


def test_moving_average_by_hand():
    values = np.array([[1.0, 3.0, 5.0, 1.0, -6.0], [2.0, 2.0, 2.0, 2.0, 2.0]])
    found = moving_average(values, 3)
    np.testing.assert_allclose(found[0], [1.0, 2.0, 3.0, 3.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(found[1], 2.0)
    np.testing.assert_allclose(moving_average(values, 1), values)
    running = [1.0, 2.0, 3.0, 2.5, 0.8]
    for width in (5, 9):
        np.testing.assert_allclose(moving_average(values, width)[0], running)


@pytest.mark.parametrize("width", [1, 2, 7, 40])
def test_moving_average_is_the_mean_of_what_there_is(width):
    values = np.random.default_rng(width).normal(size=(3, 40))
    found = moving_average(values, width)
    for k in range(40):
        expected = values[:, max(0, k + 1 - width) : k + 1].mean(axis=1)
        np.testing.assert_allclose(found[:, k], expected, atol=1e-13)


def test_convergence_times_by_hand():
    t = np.arange(1.0, 9.0)
    runs = {
        "from the start": ([9, 8, 7, 6, 5, 4, 3, 2], 1.0),
        "once and for all": ([20, 20, 20, 5, 5, 5, 5, 5], 4.0),
        "below as well as above": ([-20, 20, -20, 20, -20, 5, 5, 5], 6.0),
        "after a relapse": ([20, 5, 5, 5, 20, 5, 5, 5], 6.0),
        "at the last sample": ([20, 20, 20, 20, 20, 20, 20, 9], 8.0),
        "not at the end": ([5, 5, 5, 5, 5, 5, 5, 11], np.nan),
        "never": ([20] * 8, np.nan),
        "lost": ([5, 5, 5, 5, 5, np.nan, np.nan, np.nan], np.nan),
        "on the bound": ([20, 10, 10, 10, 10, 10, 10, 10], 2.0),
    }
    error = np.array([e for e, _ in runs.values()], float)
    found = convergence_times(t, error, tolerance=10.0, window=1.0)
    np.testing.assert_array_equal(found, [time for _, time in runs.values()])


def test_convergence_is_judged_on_the_average_of_a_window():
    t = np.arange(1.0, 9.0)
    error = np.array([[30.0, 30.0, 0.0, 0.0, 0.0, 24.0, 0.0, 0.0]])
    # averages of two: 30, 30, 15, 0, 0, 12, 12, 0
    assert convergence_times(t, error, tolerance=10.0, window=2.0) == 8.0
    assert convergence_times(t, error, tolerance=14.0, window=2.0) == 4.0
    assert convergence_times(t, error, tolerance=14.0, window=0.1) == 7.0
    assert TOLERANCE == 15e3
    assert convergence_times(t, 1100 * error, window=2.0) == 4.0


def test_interval_of_equal_runs_is_a_point_and_of_lost_ones_none():
    found = rms_interval(np.array([[3.0, -4.0], [4.0, 3.0]]))
    assert tuple(found) == (12.5**0.5,) * 3
    assert np.isnan(rms_interval(np.array([[3.0, -4.0], [np.nan, 3.0]]))).all()


def test_interval_is_the_same_for_the_same_seed():
    error = np.random.default_rng(0).normal(size=(20, 10))
    assert rms_interval(error, 1) == rms_interval(error, 1)
    assert rms_interval(error, 1) != rms_interval(error, 2)
    found = rms_interval(error, 1)
    assert found.low < found.value < found.high
    assert found.value == pytest.approx(np.sqrt(np.mean(error**2)))


@pytest.mark.parametrize("runs", [2, 3])
def test_few_runs_have_an_interval_too(runs):
    found = rms_interval(np.random.default_rng(runs).normal(size=(runs, 4)))
    assert found.low <= found.value <= found.high


def test_interval_covers_the_truth_and_shrinks_with_the_square_root_of_the_runs():
    """Runs whose samples hang together entirely, so that only the number of runs counts."""
    rng = np.random.default_rng(0)
    width = {}
    for runs in (25, 100):
        drawn = [rms_interval(np.repeat(rng.normal(size=(runs, 1)), 9, axis=1)) for _ in range(60)]
        covered = np.mean([low < 1.0 < high for _, low, high in drawn])
        assert covered > 0.8
        width[runs] = np.mean([high - low for _, low, high in drawn])
        # sigma of a root mean square of n normal numbers: 1 / sqrt(2 n)
        assert width[runs] == pytest.approx(2 * 1.96 / np.sqrt(2 * runs), rel=0.15)
    assert width[25] / width[100] == pytest.approx(2.0, rel=0.1)
