"""Projection into a box against a quadratic programme, and the filter that uses it."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from models import COV, MEAN, Sensors, Track, linear_model, sample
from scipy.optimize import lsq_linear

from wheelhop.filtering import (
    Gaussian,
    InteractingParams,
    drive,
    extended,
    gaussian,
    interacting,
    smallmat,
)
from wheelhop.filtering.constrained import ConstrainedParams, constrained, project

FREE = Track(-jnp.inf, -jnp.inf, -jnp.inf)
PLAIN = extended(linear_model())


class Four(NamedTuple):
    a: Any
    b: Any
    c: Any
    d: Any


def programme(mean, root, low, high):
    """The same minimum over the factor's coordinates, P = L L^T of any rank, by its dual."""
    # min |w|^2 s.t. low <= m + L w <= high: multipliers of both sides by nonnegative least squares
    rows = np.vstack([root, -root])
    need = np.concatenate([low - mean, mean - high])
    finite = np.isfinite(need)
    rows, need = rows[finite], need[finite]
    # Lawson & Hanson's least-distance programming
    stacked = np.vstack([rows.T, need[None]])
    target = np.zeros(len(stacked))
    target[-1] = 1.0
    u = lsq_linear(stacked, target, (0, np.inf), method="bvls", tol=1e-14, max_iter=1000).x
    residual = stacked @ u - target
    return mean - root @ (residual[:-1] / residual[-1])


def hard_problem(seed, rank=4):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(4, rank)) * 10 ** rng.uniform(-1.0, 0.0, rank)
    sd = np.sqrt(np.sum(root**2, 1))
    inside = root @ rng.normal(size=rank) * 0.3
    mean = inside + root @ rng.normal(size=rank) * 2.0
    width = sd * rng.uniform(0.05, 1.0, (2, 4))
    low, high = inside - width[0], inside + width[1]
    low[rng.integers(4)], high[rng.integers(4)] = -np.inf, np.inf
    return mean, root, low, high


def projected(problems):
    def one(mean, root, low, high):
        belief = Gaussian(Four(*mean), smallmat.from_dense(root @ root.T))
        return jnp.stack(tuple(project(belief, Four(*low), Four(*high)).mean))

    return jax.jit(jax.vmap(one))(
        *(jnp.asarray(np.array(side)) for side in zip(*problems, strict=True))
    )


@pytest.mark.parametrize(("rank", "tolerance"), [(4, 1e-8), (3, 1e-6), (2, 1e-6)])
def test_projection_solves_the_quadratic_programme(rank, tolerance):
    problems = [hard_problem(seed, rank) for seed in range(200)]
    found = np.asarray(projected(problems))
    expected = np.array([programme(*problem) for problem in problems])
    held = [
        np.sum(np.isclose(x, p[2], atol=1e-9) | np.isclose(x, p[3], atol=1e-9))
        for x, p in zip(expected, problems, strict=True)
    ]
    assert max(held) >= min(rank, 3)  # several bounds at once do occur
    assert min(held) == 0
    np.testing.assert_allclose(found, expected, atol=tolerance)


def test_one_bound_is_the_closed_form_and_the_interior_is_untouched():
    belief = gaussian(Track(*MEAN), jnp.asarray(COV))
    inside = project(belief, Track(0.0, -1.0, -jnp.inf), Track(1.0, jnp.inf, 0.2))
    np.testing.assert_array_equal(jax.tree.leaves(inside), jax.tree.leaves(belief))
    found = project(belief, FREE, Track(jnp.inf, -0.6, jnp.inf))
    expected = MEAN + COV[:, 1] / COV[1, 1] * (-0.6 - MEAN[1])
    np.testing.assert_allclose(np.stack(tuple(found.mean)), expected, atol=1e-15)
    np.testing.assert_array_equal(jax.tree.leaves(found.cov), jax.tree.leaves(belief.cov))


def test_a_component_without_variance_goes_to_its_bound_alone():
    cov = COV.copy()
    cov[1] = cov[:, 1] = 0.0
    found = project(gaussian(Track(*MEAN), jnp.asarray(cov)), Track(0.0, 0.1, 0.0), Track(1, 1, 1))
    np.testing.assert_array_equal(np.stack(tuple(found.mean)), [MEAN[0], 0.1, MEAN[2]])


def test_gradient_is_that_of_the_formula():
    @jax.jit
    def total(knobs):
        mean, cov = MEAN + 0.1 * knobs[0], jnp.asarray(COV) * knobs[1]
        cov = cov.at[0, 1].add(knobs[2] * 0.1).at[1, 0].add(knobs[2] * 0.1)
        low = Track(0.5 * knobs[3], -jnp.inf, -jnp.inf)
        high = Track(jnp.inf, -0.4 * knobs[4], jnp.inf)
        found = project(gaussian(Track(*mean), cov), low, high)
        return found.mean.bias + 2.0 * found.mean.velocity + 3.0 * found.mean.position

    at = jnp.ones(5)
    slope = jax.jit(jax.grad(total))(at)
    assert np.count_nonzero(np.abs(slope) > 1e-3) >= 4
    for k, step in enumerate(1e-6 * np.eye(5)):
        difference = float((total(at + step) - total(at - step)) / 2e-6)
        assert float(slope[k]) == pytest.approx(difference, abs=1e-8)
    forward = jax.jvp(total, (at,), (jnp.arange(1.0, 6.0),))[1]
    assert float(forward) == pytest.approx(float(slope @ jnp.arange(1.0, 6.0)), rel=1e-12)


def record(seed=0, steps=30):
    _, ys = sample(seed, steps)
    ys[9] = np.nan
    return ys


def measurements(ys):
    return Sensors(jnp.asarray(ys[..., 0]), jnp.asarray(ys[..., 1]))


LOWER, UPPER = Track(-0.5, -0.3, -jnp.inf), Track(0.2, 0.4, jnp.inf)


def run(filter, params, ys=None):
    state = filter.init(gaussian(Track(*MEAN), jnp.asarray(COV)), params)
    return drive.run(filter, state, measurements(record() if ys is None else ys), params)


def test_filter_stays_inside_and_free_bounds_change_nothing(as_users_compile):
    def compiled(filter, params):
        return jax.jit(lambda: run(filter, params), compiler_options=as_users_compile)()

    plain = compiled(PLAIN, 1.0)
    wide = ConstrainedParams(1.0, FREE, jax.tree.map(lambda a: -a, FREE))
    same = compiled(constrained(PLAIN), wide)
    for a, b in zip(jax.tree.leaves(plain), jax.tree.leaves(same), strict=True):
        np.testing.assert_array_equal(a, b)
    tight = compiled(constrained(PLAIN), ConstrainedParams(1.0, LOWER, UPPER)).state.mean
    for name in ("position", "velocity"):
        values = np.asarray(getattr(tight, name))
        assert np.all(values >= getattr(LOWER, name))
        assert np.all(values <= getattr(UPPER, name))
        assert np.any(np.asarray(getattr(plain.state.mean, name)) > getattr(UPPER, name))


def test_knowing_the_sign_of_a_bias_helps():
    """Nearly half of the prior says bias < 0; who knows it is not, errs less."""
    filter = constrained(PLAIN)
    params = ConstrainedParams(
        1.0, Track(-jnp.inf, -jnp.inf, 0.0), Track(jnp.inf, jnp.inf, jnp.inf)
    )

    @jax.jit
    @jax.vmap
    def both(ys):
        return run(PLAIN, 1.0, ys).state.mean.bias, run(filter, params, ys).state.mean.bias

    truths, records = zip(*(sample(900 + k, 25) for k in range(300)), strict=True)
    positive = np.array([np.all(x[:, 2] > 0) for x in truths])
    truth = np.array(truths)[positive][:, :, 2]
    free, kept = both(jnp.asarray(np.array(records)[positive]))
    assert np.mean((kept - truth) ** 2) < 0.9 * np.mean((free - truth) ** 2)


def test_members_of_an_imm_keep_its_mixture_inside():
    params = InteractingParams(
        ConstrainedParams(
            jnp.array([0.5, 2.0]),
            *(jax.tree.map(lambda a: jnp.full(2, a), s) for s in (LOWER, UPPER)),
        ),
        jnp.array([[0.9, 0.1], [0.2, 0.8]]),
        jnp.array([0.5, 0.5]),
    )
    mean = run(interacting(constrained(PLAIN)), params).state.combined.mean
    assert np.all(np.asarray(mean.position) <= UPPER.position + 1e-12)
    assert np.all(np.asarray(mean.velocity) >= LOWER.velocity - 1e-12)


class Counted(NamedTuple):
    belief: Any
    steps: Any


def test_a_belief_inside_a_larger_state():
    inner = PLAIN._replace(
        init=lambda prior, params: Counted(prior, jnp.zeros(())),
        step=lambda state, y, params: (lambda new, info: (Counted(new, state.steps + 1.0), info))(
            *PLAIN.step(state.belief, y, params)
        ),
    )
    filter = constrained(inner, lambda s: s.belief, lambda s, belief: s._replace(belief=belief))
    params = ConstrainedParams(1.0, LOWER, UPPER)
    state = run(filter, params).state
    direct = run(constrained(PLAIN), params).state
    np.testing.assert_array_equal(state.belief.mean.bias, direct.mean.bias)
    assert float(state.steps[-1]) == 30.0


def test_lanes_equal_single_runs():
    filter, params = constrained(PLAIN), ConstrainedParams(1.0, LOWER, UPPER)
    ys = np.stack([record(seed) for seed in range(3)], axis=1)
    prior = gaussian(Track(*MEAN), jnp.asarray(COV))
    lanes = jax.tree.map(lambda a: jnp.full(3, a), prior)
    lanes = drive.run(filter, filter.init(lanes, params), measurements(ys), params)
    for k in range(3):
        alone = run(filter, params, ys[:, k])
        for a, b in zip(jax.tree.leaves(lanes), jax.tree.leaves(alone), strict=True):
            np.testing.assert_allclose(a[:, k], b, atol=1e-12)


def test_float32_stays_float32_and_inside(float32):
    params = ConstrainedParams(1.0, LOWER, UPPER)
    state = run(constrained(PLAIN), params, record().astype(np.float32)).state
    assert {leaf.dtype for leaf in jax.tree.leaves(state)} == {jnp.dtype("float32")}
    assert np.all(np.asarray(state.mean.position) <= np.float32(UPPER.position))


def test_an_empty_box_is_refused_or_flagged():
    filter = constrained(PLAIN)
    prior = gaussian(Track(*MEAN), jnp.asarray(COV))
    with pytest.raises(ValueError, match=r"velocity: the lower bound 1.0 exceeds"):
        filter.init(prior, ConstrainedParams(1.0, FREE._replace(velocity=1.0), UPPER))
    with pytest.raises(ValueError, match="upper has the fields"):
        project(prior, FREE, Sensors(1.0, 1.0))
    y = Sensors(jnp.asarray(0.1), jnp.asarray(0.2))

    @jax.jit
    def step(low):
        return filter.step(prior, y, ConstrainedParams(1.0, FREE._replace(velocity=low), UPPER))

    assert not step(jnp.asarray(0.0))[1].flags.nonfinite
    belief, info = step(jnp.asarray(1.0))
    assert info.flags.nonfinite
    assert np.isnan(belief.mean.velocity)
