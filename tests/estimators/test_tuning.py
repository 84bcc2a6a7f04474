"""Tuning by gradient through the filter finds what made the records."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.estimators.level_candidate import (
    GAIN,
    LEVEL,
    NOISE,
    P0,
    WALK,
    level_candidate,
    level_records,
    params,
)
from wheelhop.errors import DivergenceError, InputError
from wheelhop.estimators.candidate import Records, as_float, track
from wheelhop.estimators.candidates import all_corrected, all_printed
from wheelhop.estimators.tuning import TuningSettings, objective_of, tune
from wheelhop.vehicle.parameters import brancati_suv
from wheelhop.vehicle.quarter_car import Accelerations

SAMPLES = 100
TRAINING = level_records(48, SAMPLES, 1)
TEST = level_records(48, SAMPLES, 2)
LATE = 0.0


def tuned(objective, iterations=60, **options):
    settings = TuningSettings(objective, iterations, 0.3, LATE, **options)
    return tune(level_candidate(), *TRAINING, test=TEST, settings=settings)


@pytest.fixture(scope="module")
def by_likelihood():
    return tuned("nll")


def kalman(truth, records, walk, p0):
    """The same filter by hand: errors, variances and log-likelihoods, each [runs, time]."""
    y = 0.5 * (np.asarray(records.measured.a_s) - np.asarray(records.measured.a_u)) / GAIN
    other = np.asarray(records.measured.a_s) + np.asarray(records.measured.a_u)
    r = (NOISE / GAIN) ** 2 / 2.0
    m, p = np.full(len(y), LEVEL), p0**2
    errors, variances, evidence = [], [], []
    for k in range(y.shape[1]):
        p = p + walk**2
        s = p + r
        nu = y[:, k] + LEVEL - m
        # the sum of both sensors is noise alone; the Jacobian of (a_s, a_u) -> (mean, sum) is GAIN
        sum_part = -0.5 * (other[:, k] ** 2 / (2 * NOISE**2) + np.log(2 * np.pi * 2 * NOISE**2))
        mean_part = -0.5 * (nu**2 / s + np.log(2 * np.pi * s)) - np.log(GAIN)
        evidence.append(sum_part + mean_part)
        m, p = m + p / s * nu, p - p * p / s
        errors.append(m - truth[:, k])
        variances.append(np.full(len(y), p))
    return (np.stack(a, axis=1) for a in (errors, variances, evidence))


@pytest.mark.parametrize("objective", ["mse", "nll", "log_score"])
def test_objectives_are_those_of_a_kalman_filter_by_hand(objective):
    records, truth, _ = TRAINING
    settings = TuningSettings(objective, 0, 0.3, LATE)
    found = tune(level_candidate(), *TRAINING, settings=settings).start_train
    errors, variances, evidence = kalman(truth, records, 3e3, 2e4)
    expected = {
        "mse": np.mean((1e-3 * errors) ** 2),
        "nll": -np.mean(evidence),
        "log_score": np.mean(0.5 * errors**2 / variances + 0.5 * np.log(1e-6 * variances)),
    }
    np.testing.assert_allclose(found, expected[objective], rtol=1e-9)


def central_difference(value, logs, name, step=1e-4):
    ends = [float(value(logs | {name: logs[name] + d})) for d in (step, -step)]
    return (ends[0] - ends[1]) / (2 * step)


def test_the_gradient_is_the_central_difference():
    candidate = level_candidate()
    value, slope = objective_of(candidate, *TRAINING, TuningSettings("nll", settling=LATE))
    logs = {name: jnp.log(as_float(v)) for name, v in candidate.default.items()}
    found, gradient = slope(logs)
    assert float(found) == pytest.approx(float(value(logs)), rel=1e-12)
    for name in logs:
        assert float(gradient[name]) == pytest.approx(
            central_difference(value, logs, name), rel=1e-6
        )


@pytest.mark.slow
@pytest.mark.parametrize("make", [all_printed, all_corrected])
def test_the_gradient_through_the_papers_filters_is_the_central_difference(make):
    candidate = make(dict.fromkeys("ABCD", brancati_suv()), 0.002, "iso8608")
    rng = np.random.default_rng(0)
    shape = (8, 200)
    measured = Accelerations(rng.normal(size=shape), 6.0 * rng.normal(size=shape))
    keys = jax.vmap(jax.random.key)(jnp.arange(shape[0]))
    logs = Records(measured, np.full(shape, 16.7), 0.002), np.full(shape, 2.1e5), keys
    value, slope = objective_of(candidate, *logs, TuningSettings("mse", settling=0.0))
    at = {name: jnp.log(as_float(v)) for name, v in candidate.default.items()}
    _, gradient = slope(at)
    largest = max(abs(float(g)) for g in gradient.values())
    for name in at:
        difference = central_difference(value, at, name)
        assert float(gradient[name]) == pytest.approx(difference, rel=1e-4, abs=1e-6 * largest)


def test_the_likelihood_finds_the_noise_that_made_the_records(by_likelihood):
    assert by_likelihood.tuning["walk"] == pytest.approx(WALK, rel=0.1)
    assert by_likelihood.tuning["p0"] == pytest.approx(P0, rel=0.3)


@pytest.mark.parametrize("objective", ["mse", "log_score"])
def test_other_objectives_find_it_too(objective):
    assert tuned(objective).tuning["walk"] == pytest.approx(WALK, rel=0.15)


def test_tuned_for_the_score_the_stated_sigma_is_honest():
    found = tuned("log_score")
    records, truth, keys = TEST
    tracked = track(level_candidate(), records, keys, found.tuning)
    nees = np.mean(((tracked.stiffness - truth) / tracked.sigma) ** 2)
    assert nees == pytest.approx(1.0, abs=0.1)


def test_the_result_is_the_best_met_and_carries_to_other_runs(by_likelihood):
    assert by_likelihood.train == np.nanmin(by_likelihood.history)
    assert by_likelihood.history[0] == by_likelihood.start_train
    assert len(by_likelihood.history) == 61
    assert by_likelihood.test < by_likelihood.start_test
    assert by_likelihood.test == pytest.approx(by_likelihood.train, abs=0.1)


def test_test_runs_do_not_take_part():
    settings = TuningSettings("nll", 5, 0.3, LATE)
    alone = tune(level_candidate(), *TRAINING, settings=settings)
    both = tune(level_candidate(), *TRAINING, test=TEST, settings=settings)
    assert alone.tuning == both.tuning
    assert np.isnan(alone.test)


def test_what_is_held_stays_and_the_start_is_told():
    found = tuned("nll", iterations=5, held=("p0",))
    assert found.tuning["p0"] == found.start["p0"] == 2e4
    assert found.tuning["walk"] != found.start["walk"]


def test_progress_reaches_its_end_and_the_best_never_rises():
    told = []
    tune(
        level_candidate(),
        *TRAINING,
        settings=TuningSettings("nll", 5, 0.3, LATE),
        on_progress=lambda *a: told.append(a),
    )
    assert [k for k, _, _ in told] == list(range(6))
    assert all(most == 5 for _, most, _ in told)
    best = [b for _, _, b in told]
    assert best == sorted(best, reverse=True)


def test_the_settling_time_is_not_judged():
    records, truth, keys = TRAINING
    settings = TuningSettings("mse", 0, 0.3, settling=0.5)
    found = tune(level_candidate(), records, truth, keys, settings=settings).start_train
    errors, _, _ = kalman(truth, records, 3e3, 2e4)
    np.testing.assert_allclose(found, np.mean((1e-3 * errors[:, 50:]) ** 2), rtol=1e-9)


def brittle_params(tuning, setting):
    """As the level's, but not finite below 200 N/m."""
    given = params(tuning, setting)
    return given._replace(walk=jnp.where(given.walk < 200.0, jnp.nan, given.walk))


def test_a_step_beyond_the_finite_numbers_is_taken_back():
    settings = TuningSettings("nll", 12, 2.0, LATE)
    brittle = replace(level_candidate(), params=brittle_params)
    found = tune(brittle, *TRAINING, settings=settings)
    assert np.isnan(found.history).any()
    assert np.isfinite(found.train)
    assert all(np.isfinite(v) and v > 0 for v in found.tuning.values())


def test_a_start_that_is_not_finite_is_refused():
    with pytest.raises(DivergenceError, match="level leaves the finite numbers"):
        tune(level_candidate(walk=1e200), *TRAINING, settings=TuningSettings("nll", 2, 0.3, LATE))


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (TuningSettings("rms"), "objective: 'rms' is unknown"),
        (TuningSettings(iterations=-1), "iterations"),
        (TuningSettings(rate=0.0), "rate"),
        (TuningSettings(held=("q",)), "held: 'q' is no knob of level"),
        (TuningSettings(settling=1e3), "settling"),
    ],
)
def test_bad_settings_are_refused_by_name(settings, words):
    with pytest.raises(InputError, match=words):
        tune(level_candidate(), *TRAINING, settings=settings)


def test_a_truth_of_another_shape_is_refused():
    records, truth, keys = TRAINING
    with pytest.raises(InputError, match="stiffness: its shape"):
        tune(level_candidate(), records, truth[:, :-1], keys)
