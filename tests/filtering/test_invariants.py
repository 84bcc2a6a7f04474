"""What must not change a filter: units, the order of modes, the rule where all are exact."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wheelhop.filtering import (
    InteractingParams,
    StateSpaceModel,
    cubature,
    drive,
    extended,
    gauss_hermite,
    gaussian,
    interacting,
    scaled,
    square_root_unscented,
    unscented,
)


class State(NamedTuple):
    a: Any
    b: Any


class Reading(NamedTuple):
    y: Any
    z: Any


def bent(state_units, reading_units):
    """A nonlinear model with rank-one noise, its components measured in units of one's choice."""
    u, v = state_units
    p, q = reading_units

    def transition(x, k):
        a, b = x.a / u, x.b / v
        return State(u * (a + 0.1 * b), v * (0.98 * b - 0.1 * jnp.sin(a)))

    def observation(x, k):
        a, b = x.a / u, x.b / v
        return Reading(p * a * jnp.cosh(0.3 * b), q * (b + 0.1 * a * a))

    def process_cov(x, k):
        return (k * 0.01 * u * u,), (k * 0.02 * u * v, k * 0.04 * v * v)

    return StateSpaceModel(
        transition, observation, process_cov, lambda k: ((0.1 * p * p,), (0.0, 0.2 * q * q))
    )


MAKE = {
    "extended": extended,
    "iterated": lambda model: extended(model, 3),
    "cubature": lambda model: unscented(model, cubature),
    "uneven": lambda model: unscented(model, scaled(0.7, 2.0, 0.5)),
    "Gauss-Hermite": lambda model: unscented(model, gauss_hermite(3)),
    "square root": square_root_unscented,
}


def start(state_units):
    u, v = state_units
    cov = jnp.array([[0.5 * u * u, 0.2 * u * v], [0.2 * u * v, 0.3 * v * v]])
    return gaussian(State(0.4 * u, -0.3 * v), cov)


YS = np.random.default_rng(7).normal(size=(12, 2))
YS[4] = np.nan
YS[7, 0] = np.nan


def estimate(make, state_units=(1.0, 1.0), reading_units=(1.0, 1.0)):
    filter = make(bent(state_units, reading_units))
    params = jnp.asarray(1.0)
    ys = Reading(*(jnp.asarray(YS.T) * jnp.asarray(reading_units)[:, None]))
    run = drive.run(filter, filter.init(start(state_units), params), ys, params)
    mean = np.stack(run.state.mean, axis=1) / np.asarray(state_units)
    present = np.isfinite(YS).sum(axis=0)
    shift = float(present @ np.log(reading_units))
    return mean, np.asarray(run.info.nis), float(run.info.log_likelihood.sum()) + shift


@pytest.mark.parametrize("name", MAKE)
@settings(max_examples=4, deadline=None)
@given(exponents=st.tuples(*[st.integers(-5, 5)] * 4))
def test_units_of_states_and_measurements_change_nothing(name, exponents):
    scales = [10.0**e for e in exponents]
    plain = estimate(MAKE[name])
    rescaled = estimate(MAKE[name], tuple(scales[:2]), tuple(scales[2:]))
    for a, b in zip(plain, rescaled, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-8, atol=1e-9)


@pytest.mark.parametrize("name", ["extended", "cubature", "square root"])
def test_the_order_of_modes_changes_nothing(name):
    filter = interacting(MAKE[name](bent((1.0, 1.0), (1.0, 1.0))))
    order = np.array([2, 0, 1])
    levels, initial = np.array([0.3, 1.0, 5.0]), np.array([0.5, 0.3, 0.2])
    pz = np.array([[0.9, 0.08, 0.02], [0.05, 0.9, 0.05], [0.1, 0.2, 0.7]])
    found = []
    for o in (np.arange(3), order):
        params = InteractingParams(*map(jnp.asarray, (levels[o], pz[np.ix_(o, o)], initial[o])))
        run = drive.run(
            filter, filter.init(start((1.0, 1.0)), params), Reading(*jnp.asarray(YS.T)), params
        )
        found.append((run.state.combined, run.info.log_likelihood, run.state.log_probabilities))
    for a, b in zip(jax.tree.leaves(found[0][:2]), jax.tree.leaves(found[1][:2]), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-12)
    np.testing.assert_allclose(found[0][2][:, order], found[1][2], atol=1e-12)


@pytest.mark.parametrize("name", MAKE)
def test_a_wholly_missing_sample_is_a_prediction(name):
    """Two steps of which the first sees nothing: the mean is the transition's own moments."""
    filter = MAKE[name](bent((1.0, 1.0), (1.0, 1.0)))
    params = jnp.asarray(1.0)
    nothing = Reading(jnp.asarray(jnp.nan), jnp.asarray(jnp.nan))
    state, info = filter.step(filter.init(start((1.0, 1.0)), params), nothing, params)
    assert int(info.flags.missing) == 2
    assert float(info.log_likelihood) == 0.0
    assert float(info.nis) == 0.0
    # an independent prediction: linearised, or a fine quadrature that all rules approach
    rng_free = np.polynomial.hermite_e.hermegauss(40)
    nodes, weights = rng_free[0], rng_free[1] / rng_free[1].sum()
    root = np.linalg.cholesky(np.array([[0.5, 0.2], [0.2, 0.3]]))
    grid = np.stack(np.meshgrid(nodes, nodes, indexing="ij")).reshape(2, -1)
    weight = np.outer(weights, weights).ravel()
    a, b = np.array([[0.4], [-0.3]]) + root @ grid
    exact = np.array([a + 0.1 * b, 0.98 * b - 0.1 * np.sin(a)]) @ weight
    if name in ("extended", "iterated"):
        exact = np.array([0.4 - 0.03, 0.98 * -0.3 - 0.1 * np.sin(0.4)])
    np.testing.assert_allclose(np.stack(state.mean), exact, atol=2e-3)
