"""Fixed-lag smoothing is the fixed-interval smoother on the record cut at the last sample."""

from functools import lru_cache
from typing import Any, NamedTuple

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from models import COV, MEAN, Sensors, Track, dense_posterior, linear_model, sample

from wheelhop.filtering import (
    InteractingParams,
    LinearGaussian,
    drive,
    extended,
    extended_smoother,
    gaussian,
    interacting,
    unscented,
    unscented_smoother,
)
from wheelhop.filtering.fixed_lag import fixed_lag
from wheelhop.filtering.interacting_smoothing import interacting_extended_smoother
from wheelhop.filtering.kalman import linear_model as linear_model_of_matrices

LAG, STEPS = 4, 11
FACTORS = jnp.linspace(0.5, 2.0, STEPS)


def plain_params(scale):
    return scale


def imm_params(scale):
    return InteractingParams(
        scale * jnp.array([0.4, 2.0]), jnp.array([[0.9, 0.1], [0.2, 0.8]]), jnp.array([0.5, 0.5])
    )


def bind(params, factor):
    if isinstance(params, InteractingParams):
        return InteractingParams(factor * params.members, params.transition, params.initial)
    return factor * params


CASES = {
    "extended": (extended(linear_model()), extended_smoother(linear_model()), plain_params),
    "unscented": (unscented(linear_model()), unscented_smoother(linear_model()), plain_params),
    "interacting": (
        interacting(extended(linear_model())),
        interacting_extended_smoother(linear_model()),
        imm_params,
    ),
}
BOTH = pytest.mark.parametrize("name", ["unscented", "interacting"])


def prior():
    return gaussian(Track(*MEAN), jnp.asarray(COV))


def measurements(seed, steps=STEPS):
    _, ys = sample(seed, steps)
    ys[3] = np.nan
    ys[6, 0] = np.nan
    return Sensors(jnp.asarray(ys[:, 0]), jnp.asarray(ys[:, 1]))


@lru_cache
def program(name, lag):
    """One compiled run of (filter, fixed-lag smoother) for all tests of one shape."""
    filter, smoother, params = CASES[name]
    online = fixed_lag(filter, smoother, lag)

    @jax.jit
    def run(start, ys, scale, factors):
        p = params(scale)
        options = {"inputs": factors, "bind": bind}
        plain = drive.run(filter, filter.init(start, p), ys, p, **options)
        return plain, drive.run(online, online.init(start, p), ys, p, **options)

    return run


def run(name, ys, lag=LAG, scale=1.0, factors=None):
    factors = jnp.ones(len(ys.a)) if factors is None else factors
    return program(name, lag)(prior(), ys, jnp.asarray(scale), factors)


def assert_close(found, expected, atol=1e-12):
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        np.testing.assert_allclose(a, b, atol=atol)


def at(tree, k):
    return jax.tree.map(lambda leaf: leaf[k], tree)


@BOTH
@pytest.mark.parametrize("seen", [LAG + 1, 8, STEPS])
def test_equals_the_fixed_interval_smoother_of_the_record_so_far(name, seen):
    """With missing samples and with parameters that vary in time."""
    _, smoother, params = CASES[name]
    plain, online = run(name, measurements(0), factors=FACTORS)
    so_far = jax.tree.map(lambda leaf: leaf[:seen], plain.state)
    expected = smoother(so_far, params(1.0), inputs=FACTORS[:seen], bind=bind)
    assert_close(at(online.state.smoothed, seen - 1), at(expected, seen - 1 - LAG))


@BOTH
def test_parameters_of_another_time_would_show(name):
    """Equality under parameters that vary means something only if they matter."""
    ys = measurements(0)
    _, varying = run(name, ys, factors=FACTORS)
    _, constant = run(name, ys)
    gap = jax.tree.leaves(varying.state.smoothed)[0] - jax.tree.leaves(constant.state.smoothed)[0]
    assert float(jnp.max(jnp.abs(gap))) > 1e-3


@BOTH
def test_before_the_lag_is_filled_it_is_the_state_before_the_first_sample(name):
    filter, smoother, params = CASES[name]
    plain, online = run(name, measurements(1))
    start = filter.init(prior(), params(1.0))
    seen = LAG - 1
    so_far = jax.tree.map(lambda a, b: jnp.concatenate([a[None], b[:seen]]), start, plain.state)
    assert_close(at(online.state.smoothed, seen - 1), at(smoother(so_far, params(1.0)), 0))


def test_linear_model_equals_one_dense_solve():
    _, ys = sample(2, STEPS)
    _, online = run("extended", Sensors(jnp.asarray(ys[:, 0]), jnp.asarray(ys[:, 1])))
    found = online.state.smoothed
    for seen in (LAG + 1, 8, STEPS):
        posterior, spread, _ = dense_posterior(ys[:seen])
        block = slice(3 * (seen - 1 - LAG), 3 * (seen - LAG))
        np.testing.assert_allclose(np.array(found.mean)[:, seen - 1], posterior[block], atol=1e-10)
        variance = [found.cov[i][i][seen - 1] for i in range(3)]
        np.testing.assert_allclose(variance, np.diag(spread)[block], atol=1e-10)


@BOTH
def test_no_lag_is_the_filter(name):
    plain, online = run(name, measurements(3), lag=0)
    assert_close(online.state.smoothed, plain.state, atol=0.0)


@BOTH
def test_the_filter_and_its_report_pass_through(name):
    plain, online = run(name, measurements(4))
    assert_close((online.state.current, online.info), (plain.state, plain.info), atol=1e-14)
    newest = jax.tree.map(lambda leaf: leaf[:, -1], online.state.window)
    assert_close(newest, plain.state, atol=1e-14)


def test_waiting_for_later_samples_narrows_the_belief():
    plain, online = run("extended", measurements(5))
    filtered = np.array(plain.state.cov[0][0])[: STEPS - LAG]
    assert np.all(np.array(online.state.smoothed.cov[0][0])[LAG:] < 0.95 * filtered)


@BOTH
def test_vmap_over_runs_equals_each_run(name):
    batch = [measurements(seed) for seed in (6, 7)]
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *batch)
    start, factors = prior(), jnp.ones(STEPS)
    together = jax.jit(
        jax.vmap(lambda ys: program(name, LAG)(start, ys, jnp.asarray(1.0), factors))
    )(stacked)
    for k, ys in enumerate(batch):
        assert_close(at(together[1].state.smoothed, k), run(name, ys)[1].state.smoothed)


@BOTH
def test_runs_in_trailing_lanes_equal_each_run(name):
    """Every operation is elementwise over trailing axes: no vmap, the runs last."""
    filter, smoother, params = CASES[name]
    online, p = fixed_lag(filter, smoother, LAG), params(1.0)
    batch = [measurements(seed) for seed in (6, 7)]
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves, -1), *batch)
    start = online.init(prior(), p)
    state = jax.tree.map(lambda leaf: jnp.stack([leaf] * 2, -1), start)
    state = state._replace(params=start.params)
    found = drive.run(online, state, stacked, p, keep=lambda s, i: s.smoothed)
    for k, ys in enumerate(batch):
        lane = jax.tree.map(lambda leaf, k=k: leaf[..., k], found)
        assert_close(lane, run(name, ys)[1].state.smoothed)


@BOTH
def test_one_trace_serves_a_stream_and_keeps_structure_and_types(name):
    filter, smoother, params = CASES[name]
    online = fixed_lag(filter, smoother, 2)
    step = jax.jit(chex.assert_max_traces(online.step, n=1))
    chex.clear_trace_counter()
    state = online.init(prior(), params(jnp.asarray(1.0)))
    ys = measurements(10)
    for k in range(3):
        new, _ = step(state, at(ys, k), params(jnp.asarray(1.0 + k)))
        assert jax.tree.structure(new) == jax.tree.structure(state)
        chex.assert_trees_all_equal_shapes_and_dtypes(new, state)
        state = new
    assert state.samples == 3


class Level(NamedTuple):
    level: Any


def test_gradient_is_that_of_finite_differences():
    model = linear_model_of_matrices(Level)
    online = fixed_lag(interacting(extended(model)), interacting_extended_smoother(model), 2)
    start = gaussian(Level(0.3), jnp.ones((1, 1)))
    ys = Level(jnp.asarray(np.random.default_rng(11).normal(size=8)).at[4].set(jnp.nan))
    one = jnp.ones((2, 1, 1))
    noise = jnp.array([0.1, 1.0]).reshape(2, 1, 1)

    @jax.jit
    def total(scale):
        members = LinearGaussian(0.9 * one, one, scale * noise, 0.2 * one)
        p = imm_params(1.0)
        p = InteractingParams(members, p.transition, p.initial)
        kept = drive.run(online, online.init(start, p), ys, p, keep=lambda s, i: s.smoothed)
        return sum(jnp.sum(leaf) for leaf in jax.tree.leaves(kept))

    slope = float(jax.jit(jax.grad(total))(1.0))
    difference = float((total(1.0 + 1e-5) - total(1.0 - 1e-5)) / 2e-5)
    assert abs(difference) > 1e-2
    assert slope == pytest.approx(difference, rel=1e-6)


@BOTH
def test_float32_runs_in_float32(name, float32):
    found = run(name, measurements(12))[1].state.smoothed
    assert {leaf.dtype for leaf in jax.tree.leaves(found)} == {jnp.dtype("float32")}
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(found))


def test_plain_numbers_as_parameters_take_the_type_of_the_state():
    filter, smoother, _ = CASES["unscented"]
    online = fixed_lag(filter, smoother, 2)
    single = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), prior())
    state = online.init(single, 1.0)
    y = Sensors(jnp.float32(0.1), jnp.float32(0.2))
    state, _ = online.step(state, y, 1.0)
    assert state.smoothed.cov[0][0].dtype == jnp.float32


def test_unusable_input_is_refused():
    filter, smoother, _ = CASES["extended"]
    with pytest.raises(ValueError, match="lag=-1"):
        fixed_lag(filter, smoother, -1)
    online = fixed_lag(filter, smoother, 2)
    state, y = online.init(prior(), {"scale": jnp.asarray(1.0)}), Sensors(0.0, 0.0)
    with pytest.raises(ValueError, match="structure"):
        online.step(state, y, jnp.asarray(1.0))
    with pytest.raises(ValueError, match=r"\['scale'\] is float64\(2,\)"):
        online.step(state, y, {"scale": jnp.ones(2)})
    with pytest.raises(ValueError, match="smooth the IMM instead"):
        online.mix(jnp.array([1.0]), state)
