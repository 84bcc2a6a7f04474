"""The unscented filter and the IMM against filterpy, on a nonlinear quarter car."""

import json
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from wheelhop.estimators.immuf import (
    CornerState,
    Tuning,
    corner_model,
    immuf_params,
    member_params,
)
from wheelhop.filtering import (
    SquareRootGaussian,
    cubature,
    drive,
    gaussian,
    interacting,
    scaled,
    square_root_unscented,
    square_root_unscented_smoother,
    unscented,
    unscented_smoother,
)
from wheelhop.filtering.interacting import InteractingParams
from wheelhop.vehicle.parameters import PHYSICAL_SUSPENSION, QuarterCar
from wheelhop.vehicle.quarter_car import Accelerations
from wheelhop.vehicle.tire import Tire

ORACLE = json.loads((Path(__file__).parents[1] / "oracles" / "filterpy.json").read_text())
CAR = QuarterCar(466.7, 61.14, PHYSICAL_SUSPENSION, Tire(264.7e3, 250e3, 0.7))
TUNING = Tuning(noise_a_s=0.5, noise_a_u=0.5, stiffness_walk=0.02, velocity_walk=0.01)
SPEED, DT = 60.0 / 3.6, 0.002


def rule_named(name):
    return cubature if name == "cubature" else scaled(*ORACLE["rules"][name])


def measurements(missing=()):
    ys = np.array(ORACLE["measurements"])
    ys[list(missing)] = np.nan
    return Accelerations(jnp.asarray(ys[:, 0]), jnp.asarray(ys[:, 1]))


def prior():
    return gaussian(CornerState(*ORACLE["prior_mean"]), jnp.array(ORACLE["prior_cov"]))


def triangle(cov):
    return np.stack([np.asarray(entry) for row in cov for entry in row], axis=-1)


def assert_same_belief(belief, expected, rtol=1e-10):
    mean = np.stack([np.asarray(m) for m in belief.mean], axis=-1)
    sigma = np.sqrt(np.array(expected["cov"])[:, [0, 2, 5, 9, 14]])
    np.testing.assert_allclose(mean / sigma, np.array(expected["mean"]) / sigma, atol=rtol, rtol=0)
    rows, columns = np.tril_indices(5)
    scale = sigma[:, rows] * sigma[:, columns]
    np.testing.assert_allclose(
        triangle(belief.cov) / scale, np.array(expected["cov"]) / scale, atol=rtol, rtol=0
    )


MAKERS = {"covariance": unscented, "square root": square_root_unscented}


def written_out(belief):
    return belief.gaussian if isinstance(belief, SquareRootGaussian) else belief


@pytest.mark.parametrize("make", MAKERS)
@pytest.mark.parametrize("rule", ORACLE["rules"])
def test_unscented_filter_and_smoother_equal_filterpy_to_1e_10(rule, make):
    filter = MAKERS[make](corner_model(), rule_named(rule))
    params = member_params(CAR, ORACLE["levels"][1], SPEED, DT, TUNING)
    start = filter.init(prior(), params)
    trajectory = drive.run(filter, start, measurements(ORACLE["missing"]), params)
    expected = ORACLE["ukf"][rule]
    assert_same_belief(jax.vmap(written_out)(trajectory.state), expected)
    np.testing.assert_allclose(
        trajectory.info.log_likelihood, expected["log_likelihood"], rtol=1e-10, atol=1e-10
    )
    smoother = unscented_smoother if make == "covariance" else square_root_unscented_smoother
    smoothed = smoother(corner_model(), rule_named(rule))(trajectory.state, params)
    assert_same_belief(
        jax.vmap(written_out)(smoothed),
        {"mean": expected["smoothed_mean"], "cov": expected["smoothed_cov"]},
    )


@pytest.mark.parametrize(
    ("rule", "make"),
    [*((rule, "covariance") for rule in ORACLE["rules"]), ("uneven", "square root")],
)
def test_imm_equals_filterpy_to_1e_10(rule, make):
    filter = interacting(MAKERS[make](corner_model(), rule_named(rule)))
    built = immuf_params(CAR, SPEED, DT, TUNING)
    params = InteractingParams(
        built.members, jnp.array(ORACLE["transition_matrix"]), jnp.array(ORACLE["initial"])
    )
    trajectory = drive.run(filter, filter.init(prior(), params), measurements(), params)
    expected = ORACLE["imm"][rule]
    assert_same_belief(jax.vmap(written_out)(trajectory.state.combined), expected)
    np.testing.assert_allclose(
        np.exp(trajectory.state.log_probabilities), expected["probabilities"], atol=1e-10
    )
    np.testing.assert_allclose(
        trajectory.info.log_likelihood, expected["log_likelihood"], rtol=1e-10
    )
