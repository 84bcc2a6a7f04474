"""What every filter of the room must do: jit, vmap, grad, scan, float32, missing rows."""

from dataclasses import replace
from typing import Any, NamedTuple

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from models import (
    COV,
    MEAN,
    F,
    H,
    Q,
    R,
    Sensors,
    Track,
    augmented_linear_model,
    linear_model,
    sample,
)

from wheelhop.filtering import (
    ConstrainedParams,
    InteractingParams,
    LinearGaussian,
    MultipleModelParams,
    SensitivityParams,
    SensitivityPrior,
    UnknownInputModel,
    augmented,
    constrained,
    cubature,
    decoupled,
    drive,
    extended,
    gated,
    gauss_hermite,
    gaussian,
    independent,
    interacting,
    kalman,
    multiple_model,
    run_batch,
    sensitivity,
    square_root_unscented,
    unknown_input,
    unscented,
)


def imm_params(scale):
    return InteractingParams(
        scale * jnp.array([0.5, 2.0]), jnp.array([[0.9, 0.1], [0.2, 0.8]]), jnp.array([0.5, 0.5])
    )


def bank_params(scale):
    return MultipleModelParams(scale * jnp.array([0.5, 2.0]), jnp.array([0.4, 0.6]), 0.01, 0.9)


def matrices(scale):
    return LinearGaussian(*map(jnp.asarray, (F, H)), scale * jnp.asarray(Q), scale * jnp.asarray(R))


class Push(NamedTuple):
    value: Any


def pushed(scale):
    """An unknown input on the velocity; what depends on the scale is put in after preparing."""
    zero = np.zeros((2, 1))
    prepared = decoupled(UnknownInputModel(F, np.eye(3)[:, 1:2], H, zero, Q, R), np.eye(1))
    model = replace(
        prepared.model, process_cov=scale * jnp.asarray(Q), observation_cov=scale * jnp.asarray(R)
    )
    return replace(prepared, model=model)


class Theta(NamedTuple):
    log_scale: Any


def searched(scale):
    return SensitivityParams(scale, Theta(1e-4))


def search_prior():
    return SensitivityPrior(prior(), independent(Theta(0.0), Theta(0.3)))


def search(inner):
    return sensitivity(inner, lambda p, theta: p * jnp.exp(theta.log_scale))


def boxed(scale):
    wide = Track(jnp.inf, 0.4, 10.0)
    return ConstrainedParams(scale, Track(*(-b for b in wide)), wide)


FILTERS = {
    "gated": (unscented(linear_model(), measurement_update=gated(0.99)), lambda s: s),
    "constrained": (constrained(unscented(linear_model())), boxed),
    "Gauss-Hermite": (unscented(linear_model(), gauss_hermite(3)), lambda s: s),
    "augmented": (augmented(augmented_linear_model()), lambda s: s),
    "square root": (square_root_unscented(linear_model()), lambda s: s),
    "interacting square root": (interacting(square_root_unscented(linear_model())), imm_params),
    "unknown input": (unknown_input(Sensors, Push), pushed),
    "recursive maximum likelihood": (search(unscented(linear_model())), searched, search_prior),
    "kalman": (kalman(Sensors), matrices),
    "cubature": (unscented(linear_model(), cubature), lambda s: s),
    "extended": (extended(linear_model()), lambda s: s),
    "iterated": (extended(linear_model(), iterations=3), lambda s: s),
    "interacting": (interacting(unscented(linear_model())), imm_params),
    "multiple model": (multiple_model(extended(linear_model())), bank_params),
}


@pytest.fixture(params=FILTERS)
def case(request):
    filter, params, *rest = FILTERS[request.param]
    return filter, params, rest[0] if rest else prior


def measurements(seed, steps=15):
    _, ys = sample(seed, steps)
    ys[4] = np.nan
    return Sensors(jnp.asarray(ys[:, 0]), jnp.asarray(ys[:, 1]))


def prior():
    return gaussian(Track(*MEAN), jnp.asarray(COV))


def run(case, ys, scale=1.0):
    filter, params, belief = case
    p = params(scale)
    return drive.run(filter, filter.init(belief(), p), ys, p)


def test_step_keeps_the_structure_and_types_of_the_state(case):
    filter, params, belief = case
    p = params(1.0)
    before = filter.init(belief(), p)
    y = jax.tree.map(lambda a: a[0], measurements(0))
    after = jax.eval_shape(lambda s: filter.step(s, y, p)[0], before)
    assert jax.tree.structure(before) == jax.tree.structure(after)
    for old, new in zip(jax.tree.leaves(before), jax.tree.leaves(after), strict=True):
        assert old.shape == new.shape
        assert old.dtype == new.dtype


def test_one_trace_serves_every_parameter_value(case):
    filter, params, belief = case

    @jax.jit
    @chex.assert_max_traces(n=1)
    def step(state, y, p):
        return filter.step(state, y, p)

    chex.clear_trace_counter()
    state = filter.init(belief(), params(jnp.asarray(1.0)))
    for scale in (0.5, 1.0, 2.0):
        y = jax.tree.map(lambda a: a[0], measurements(0))
        state, _ = step(state, y, params(jnp.asarray(scale)))


def test_vmap_over_runs_equals_each_run(case):
    batch = [measurements(seed) for seed in range(3)]
    stacked = jax.tree.map(lambda *a: jnp.stack(a), *batch)
    together = jax.jit(jax.vmap(lambda ys: run(case, ys).info.log_likelihood))(stacked)
    for k, ys in enumerate(batch):
        np.testing.assert_allclose(together[k], run(case, ys).info.log_likelihood, atol=1e-12)


def test_runs_in_lanes_equal_each_run(case):
    filter, params, belief = case
    p = params(1.0)
    batch = [measurements(seed) for seed in range(3)]
    stacked = jax.tree.map(lambda *a: jnp.stack(a), *batch)
    together = run_batch(filter, filter.init(belief(), p), stacked, p)
    for k, ys in enumerate(batch):
        alone = run(case, ys)
        for a, b in zip(jax.tree.leaves(together), jax.tree.leaves(alone), strict=True):
            np.testing.assert_allclose(a[k], b, atol=1e-11, rtol=1e-11)


def test_a_missing_row_predicts_only(case):
    info = run(case, measurements(1)).info
    assert info.flags.missing[4] == 2
    assert float(info.log_likelihood[4]) == pytest.approx(0.0, abs=1e-12)
    assert float(info.nis[4]) == pytest.approx(0.0, abs=1e-12)


# their gradients are compared with differences in tests of their own
CHECKED_ELSEWHERE = (
    "multiple model",
    "recursive maximum likelihood",
    "interacting square root",
    "unknown input",
    "square root",
    "Gauss-Hermite",
    "augmented",
)


@pytest.mark.parametrize(
    "case",
    [pytest.param(f, marks=pytest.mark.slow if f in CHECKED_ELSEWHERE else ()) for f in FILTERS],
    indirect=True,
)
def test_gradient_is_finite(case):
    ys = measurements(2)
    slope = jax.jit(jax.grad(lambda s: run(case, ys, s).info.log_likelihood.sum()))(1.0)
    assert np.isfinite(slope)
    assert abs(float(slope)) > 0.0


def test_float32_runs_in_float32(case, float32):
    trajectory = run(case, measurements(3))
    assert {leaf.dtype for leaf in jax.tree.leaves(trajectory.state)} == {jnp.dtype("float32")}
    assert not np.any(trajectory.info.flags.nonfinite)
