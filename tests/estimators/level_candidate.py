"""A filter whose best tuning is known: a level that walks at random, measured twice."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.estimators.candidate import Candidate, Knob, Reading, Records
from wheelhop.filtering import StateSpaceModel, independent, unscented
from wheelhop.vehicle.quarter_car import Accelerations

WALK, NOISE, P0, LEVEL = 400.0, 0.5, 3e3, 2e5
"""Truth: steps [N/m], sensors [m/s^2], spread [N/m] about the level [N/m] at the start."""

GAIN = 1e-3


class Level(NamedTuple):
    k_t: Any


class Params(NamedTuple):
    walk: Any
    noise: Any


def prior(tuning, setting, normal):
    return independent(Level(setting + 0.0 * normal[0]), Level(tuning["p0"]))


def params(tuning, setting):
    return Params(tuning["walk"], NOISE + jnp.zeros_like(setting))


def inputs(key, speed, setting):
    del key, setting
    return speed


def bind(params, speed):
    del speed
    return params


def read(belief):
    k_t = belief.mean.k_t
    return Reading(k_t, jnp.sqrt(belief.cov[0][0]), jnp.ones_like(k_t)[None], k_t[None])


def observed(x, p):
    del p
    y = GAIN * (x.k_t - LEVEL)
    return Accelerations(y, -y)


FILTER = unscented(
    StateSpaceModel(
        lambda x, p: x,
        observed,
        lambda x, p: ((p.walk**2,),),
        lambda p: ((p.noise**2,), (0.0, p.noise**2)),
    )
)


def level_candidate(walk=3e3, p0=2e4):
    """The candidate with a tuning to start from."""
    knobs = {"walk": Knob(walk, "N/m", "Q"), "p0": Knob(p0, "N/m", "P0")}
    return Candidate(
        "level", ("one",), knobs, FILTER, jnp.asarray(LEVEL), prior, params, inputs, bind, read, 1
    )


def level_records(runs, samples, seed):
    """Records, the true level [runs, time] and keys of the runs."""
    rng = np.random.default_rng(seed)
    steps = WALK * rng.normal(size=(runs, samples))
    truth = LEVEL + P0 * rng.normal(size=(runs, 1)) + np.cumsum(steps, axis=1)
    y = GAIN * (truth - LEVEL)
    noise = NOISE * rng.normal(size=(2, runs, samples))
    measured = Accelerations(y + noise[0], -y + noise[1])
    keys = jax.vmap(jax.random.key)(jnp.arange(runs))
    return Records(measured, np.full((runs, samples), 20.0), 0.01), truth, keys
