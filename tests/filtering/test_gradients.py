"""Gradients through the whole IMM-UKF against central finite differences in float64."""

import json
from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from wheelhop.estimators.immuf import CornerState, Tuning, immuf, immuf_params
from wheelhop.filtering import Gaussian, drive, gaussian
from wheelhop.vehicle.parameters import brancati_suv
from wheelhop.vehicle.quarter_car import Accelerations

ORACLE = json.loads((Path(__file__).parents[1] / "oracles" / "filterpy.json").read_text())
FILTER = immuf(0.002)
PARAMS = immuf_params(brancati_suv(), 60 / 3.6, 0.002, Tuning())
PARAMS = replace(PARAMS, transition=jnp.array(ORACLE["transition_matrix"]))
PRIOR = gaussian(CornerState(*ORACLE["prior_mean"]), jnp.array(ORACLE["prior_cov"]))
ROWS = np.array(ORACLE["measurements"])[:40]
ROWS[7, 0] = np.nan
YS = Accelerations(jnp.asarray(ROWS[:, 0]), jnp.asarray(ROWS[:, 1]))

KNOBS = (
    "prior mean",
    "prior covariance",
    "process noise",
    "stiffness walk",
    "measurement noise",
    "transition matrix",
    "initial probabilities",
    "sprung mass",
    "unsprung mass",
    "suspension stiffness",
    "damping",
    "speed",
)


def total(factors):
    """Log-likelihood with every knob multiplied by its factor (the log-stiffness: shifted)."""
    u = dict(zip(KNOBS, factors, strict=True))
    mean = PRIOR.mean._replace(ln_k_t=PRIOR.mean.ln_k_t + u["prior mean"] - 1.0)
    prior = Gaussian(mean, jax.tree.map(lambda c: u["prior covariance"] * c, PRIOR.cov))
    members = PARAMS.members
    suspension = replace(
        members.car.suspension,
        stiffness=u["suspension stiffness"] * members.car.suspension.stiffness,
        damping=u["damping"] * members.car.suspension.damping,
    )
    car = replace(
        members.car,
        sprung_mass=u["sprung mass"] * members.car.sprung_mass,
        unsprung_mass=u["unsprung mass"] * members.car.unsprung_mass,
        suspension=suspension,
    )
    members = replace(
        members,
        car=car,
        road_level=u["process noise"] * members.road_level,
        stiffness_walk=u["stiffness walk"] * members.stiffness_walk,
        noise_a_u=u["measurement noise"] * members.noise_a_u,
        speed=u["speed"] * members.speed,
    )
    params = replace(
        PARAMS,
        members=members,
        transition=PARAMS.transition.at[0, 1].multiply(u["transition matrix"]),
        initial=PARAMS.initial.at[2].multiply(u["initial probabilities"]),
    )
    return drive.log_likelihood(FILTER, FILTER.init(prior, params), YS, params)


# one fused kernel of this size takes the compiler several times as long as its parts
UNFUSED = {"xla_disable_hlo_passes": "fusion", "xla_cpu_use_fusion_emitters": True}


@pytest.fixture(scope="module")
def compiled():
    gradient = jax.jit(jax.grad(total), compiler_options=UNFUSED)
    return jax.jit(total, compiler_options=UNFUSED), gradient(jnp.ones(len(KNOBS)))


@pytest.mark.parametrize("knob", KNOBS)
def test_gradient_equals_finite_differences(compiled, knob):
    value, gradient = compiled
    k = KNOBS.index(knob)
    step = np.zeros(len(KNOBS))
    step[k] = 1e-4
    difference = float((value(1.0 + step) - value(1.0 - step)) / 2e-4)
    assert abs(difference) > 1e-6
    assert float(gradient[k]) == pytest.approx(difference, rel=1e-5, abs=1e-7)


def test_forward_mode_agrees_with_reverse_mode(compiled):
    direction = jnp.linspace(-1.0, 1.0, len(KNOBS))
    compiled_jvp = jax.jit(
        lambda u: jax.jvp(total, (u,), (direction,))[1], compiler_options=UNFUSED
    )
    forward = compiled_jvp(jnp.ones(len(KNOBS)))
    assert float(forward) == pytest.approx(float(compiled[1] @ direction), rel=1e-8)
