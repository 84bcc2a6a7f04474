"""The filters against a second program and against a dense textbook IMM, on a quarter car."""

import json
from functools import cache, partial
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from tests.oracles import quarter_car_numpy as numpy_car
from tests.oracles.imm_numpy import imm
from wheelhop.estimators.immuf import (
    CornerState,
    Tuning,
    corner_model,
    immuf_params,
    member_params,
)
from wheelhop.filtering import (
    cubature,
    drive,
    gaussian,
    interacting,
    scaled,
    smallmat,
    unscented,
    unscented_smoother,
)
from wheelhop.filtering.interacting import InteractingParams
from wheelhop.filtering.square_root import (
    square_root_unscented,
    square_root_unscented_smoother,
)
from wheelhop.vehicle.parameters import PHYSICAL_SUSPENSION, QuarterCar
from wheelhop.vehicle.quarter_car import Accelerations
from wheelhop.vehicle.tire import Tire

ORACLE = json.loads((Path(__file__).parents[1] / "oracles" / "stonesoup.json").read_text())
CAR = QuarterCar(466.7, 61.14, PHYSICAL_SUSPENSION, Tire(264.7e3, 250e3, 0.7))
TUNING = Tuning(noise_a_s=0.5, noise_a_u=0.5, stiffness_walk=0.02, velocity_walk=0.01)
SPEED, DT = 60.0 / 3.6, 0.002
PAIRS = {
    "unscented": (unscented, unscented_smoother, lambda state: state),
    "square root": (
        square_root_unscented,
        square_root_unscented_smoother,
        lambda state: state.gaussian,
    ),
}


def rule_named(name):
    return cubature if name == "cubature" else scaled(*ORACLE["rules"][name])


def model_with_fixed_noise():
    """The corner with the oracle's process noise."""
    noise = smallmat.from_dense(jnp.array(ORACLE["process_cov"]))
    return corner_model()._replace(process_cov=lambda x, params: noise)


def measurements(rows):
    return Accelerations(jnp.asarray(rows[:, 0]), jnp.asarray(rows[:, 1]))


def prior():
    return gaussian(CornerState(*ORACLE["prior_mean"]), jnp.array(ORACLE["prior_cov"]))


def with_gaps():
    rows = np.array(ORACLE["measurements"])
    rows[ORACLE["missing"]] = np.nan
    return rows


def assert_same_belief(belief, mean, lower, atol=1e-10):
    """Means in standard deviations, covariances as correlations are compared."""
    mean, lower = np.array(mean), np.array(lower)
    sigma = np.sqrt(lower[:, [0, 2, 5, 9, 14]])
    found = np.stack([np.asarray(m) for m in belief.mean], axis=-1)
    np.testing.assert_allclose((found - mean) / sigma, 0.0, atol=atol)
    rows, columns = np.tril_indices(5)
    found = np.stack([np.asarray(entry) for row in belief.cov for entry in row], axis=-1)
    scale = sigma[:, rows] * sigma[:, columns]
    np.testing.assert_allclose((found - lower) / scale, 0.0, atol=atol)


@cache
def filtered_and_smoothed(form, rule):
    make, make_smoother, written_out = PAIRS[form]
    model, sigma_rule = model_with_fixed_noise(), rule_named(rule)
    filter = make(model, sigma_rule)
    params = member_params(CAR, 1e-6, SPEED, DT, TUNING)
    start = filter.init(prior(), params)
    trajectory = drive.run(filter, start, measurements(with_gaps()), params)
    smoothed = make_smoother(model, sigma_rule)(trajectory.state, params)
    return written_out(trajectory.state), trajectory.info.log_likelihood, written_out(smoothed)


CASES = [("unscented", rule) for rule in ORACLE["rules"]] + [("square root", "uneven")]


@pytest.mark.parametrize(("form", "rule"), CASES)
def test_filter_and_smoother_equal_stone_soup_to_1e_10(form, rule):
    belief, log_likelihood, smoothed = filtered_and_smoothed(form, rule)
    expected = ORACLE["unscented"][rule]
    filtered, smooth = expected["filtered"], expected["smoothed"]
    assert_same_belief(belief, filtered["mean"], filtered["cov"])
    assert_same_belief(smoothed, smooth["mean"], smooth["cov"])
    np.testing.assert_allclose(log_likelihood, filtered["log_likelihood"], rtol=1e-10, atol=1e-10)


def test_cubature_filter_equals_stone_soups_own():
    """Its covariance is E[x x^T] - m m^T, which costs it the digits of (m / sigma)^2."""
    belief, log_likelihood, _ = filtered_and_smoothed("unscented", "cubature")
    expected = ORACLE["cubature_kalman"]
    assert_same_belief(belief, expected["mean"], expected["cov"], atol=2e-10)
    np.testing.assert_allclose(log_likelihood, expected["log_likelihood"], rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("form", PAIRS)
def test_imm_with_gaps_equals_a_dense_textbook_imm_to_1e_10(form):
    make, _, written_out = PAIRS[form]
    rule = ORACLE["rules"]["uneven"]
    rows = with_gaps()
    rows[20, 0] = rows[21, 1] = np.nan
    built = immuf_params(CAR, SPEED, DT, TUNING)
    levels = np.asarray(built.members.road_level)
    markov = np.array(
        [
            [0.95, 0.02, 0.02, 0.01],
            [0.03, 0.92, 0.03, 0.02],
            [0.01, 0.04, 0.9, 0.05],
            [0.0, 0.02, 0.08, 0.9],
        ]
    )
    initial = np.array([0.1, 0.4, 0.3, 0.2])
    mean, cov, probabilities, log_likelihood = imm(
        rows,
        np.array(ORACLE["prior_mean"]),
        np.array(ORACLE["prior_cov"]),
        markov,
        initial,
        [(numpy_car.transition, partial(numpy_car.process_cov, level=g)) for g in levels],
        numpy_car.observation,
        np.eye(2) * numpy_car.NOISE**2,
        rule,
    )
    filter = interacting(make(corner_model(), scaled(*rule)))
    params = InteractingParams(built.members, jnp.asarray(markov), jnp.asarray(initial))
    trajectory = drive.run(filter, filter.init(prior(), params), measurements(rows), params)
    assert_same_belief(written_out(trajectory.state.combined), mean, cov[:, *np.tril_indices(5)])
    found = np.exp(trajectory.state.log_probabilities)
    np.testing.assert_allclose(found, probabilities, atol=1e-10)
    np.testing.assert_allclose(
        trajectory.info.log_likelihood, log_likelihood, rtol=1e-10, atol=1e-10
    )
