"""Bijections: round trips, slopes, extremes; and noise learned through them."""

from dataclasses import replace
from typing import Any, NamedTuple

import chex
import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from wheelhop.filtering import (
    InteractingParams,
    LinearGaussian,
    drive,
    gaussian,
    interacting,
    kalman,
)
from wheelhop.filtering.parameterisation import (
    bounded,
    constrain,
    fixed,
    positive,
    positive_definite,
    row_stochastic,
    simplex,
    softplus,
    unconstrain,
)

number = st.floats(-6.0, 6.0)


def triangle(numbers):
    numbers = iter(numbers)
    return tuple(tuple(jnp.asarray(next(numbers)) for _ in range(i + 1)) for i in range(3))


def matrix(rows):
    return lambda numbers: jnp.asarray(numbers).reshape(rows, -1)


CASES = {
    "positive": (positive(), 1, lambda v: jnp.asarray(v[0])),
    "softplus": (softplus(), 1, lambda v: jnp.asarray(v[0])),
    "bounded": (bounded(-3.0, 5.0), 1, lambda v: jnp.asarray(v[0])),
    "covariance": (positive_definite(), 6, triangle),
    "dense covariance": (positive_definite(dense=True), 6, triangle),
    "simplex": (simplex(), 3, jnp.asarray),
    "row stochastic": (row_stochastic(), 6, matrix(3)),
}


@pytest.mark.parametrize("name", CASES)
@settings(max_examples=25, deadline=None)
@given(numbers=st.lists(number, min_size=6, max_size=6))
def test_round_trip(name, numbers):
    bijection, size, build = CASES[name]
    free = build(numbers[:size])
    value = bijection.constrain(free)
    again = bijection.unconstrain(value)
    assert jax.tree.structure(again) == jax.tree.structure(free)
    once_more = bijection.constrain(again)
    for a, b in zip(jax.tree.leaves(once_more), jax.tree.leaves(value), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-12 * float(jnp.max(jnp.abs(b))))
    if "covariance" not in name:  # a covariance of condition 1e10 keeps 1e-12 only in its value
        for a, b in zip(jax.tree.leaves(again), jax.tree.leaves(free), strict=True):
            np.testing.assert_allclose(a, b, atol=1e-12)


@pytest.mark.parametrize("name", CASES)
def test_slopes_equal_finite_differences_also_at_zero(name):
    bijection, size, build = CASES[name]

    def constrained(numbers):
        return bijection.constrain(build(numbers))

    @jax.jit
    def total(numbers):
        values = jnp.concatenate([v.ravel() for v in jax.tree.leaves(constrained(numbers))])
        return jnp.sum(jnp.sin(values * jnp.arange(1.0, 1.0 + values.size)))

    for at in (np.zeros(size), np.linspace(-1.0, 1.2, size)):
        slope = jax.grad(total)(jnp.asarray(at))
        for k, step in enumerate(1e-6 * np.eye(size)):
            up, down = total(jnp.asarray(at + step)), total(jnp.asarray(at - step))
            assert float(slope[k]) == pytest.approx(float(up - down) / 2e-6, rel=1e-7, abs=1e-7)


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("extreme", [-1e4, -60.0, 60.0, 1e4])
def test_extremes_are_finite_in_float32(name, extreme, float32):
    bijection, size, build = CASES[name]
    free = build([np.float32(extreme)] * size)
    value = bijection.constrain(free)
    slope = jax.grad(lambda f: sum(jnp.sum(v) for v in jax.tree.leaves(bijection.constrain(f))))
    back = bijection.unconstrain(value) if "covariance" not in name else ()
    for leaf in jax.tree.leaves((value, slope(free), back)):
        assert leaf.dtype == jnp.float32
        assert np.all(np.isfinite(leaf))
    if name in ("positive", "softplus", "simplex", "row stochastic"):
        assert np.all(np.asarray(value) > 0)


def test_domains():
    chain = np.asarray(row_stochastic().constrain(jnp.array([[1.0, -2.0], [0.0, 3.0], [5.0, 0.1]])))
    np.testing.assert_allclose(chain.sum(1), 1.0, atol=1e-15)
    assert np.all(chain > 0)
    assert chain[1, 2] / chain[1, 1] == pytest.approx(np.exp(3.0))
    assert float(simplex().constrain(jnp.array([0.3, -1.0])).sum()) == pytest.approx(1.0)
    cov = np.asarray(
        positive_definite(dense=True).constrain(triangle([-3.0, 40.0, 2.0, -9.0, 7.0, 0.1]))
    )
    np.testing.assert_array_equal(cov, cov.T)
    assert np.linalg.eigvalsh(cov / np.sqrt(np.outer(np.diag(cov), np.diag(cov)))).min() > 0


def test_free_numbers_have_no_unit():
    """Metres to millimetres shifts the log-diagonals and leaves the rest."""
    cov = np.array([[2.0, 0.3, 0.1], [0.3, 1.0, -0.2], [0.1, -0.2, 0.5]])
    unit = np.array([1.0, 1e3, 1e-2])
    a = positive_definite(dense=True).unconstrain(cov)
    b = positive_definite(dense=True).unconstrain(cov * np.outer(unit, unit))
    for i in range(3):
        assert float(b[i][i] - a[i][i]) == pytest.approx(np.log(unit[i]))
        for j in range(i):
            assert float(b[i][j]) == pytest.approx(float(a[i][j]), rel=1e-12)


@pytest.mark.parametrize(
    ("act", "text"),
    [
        (lambda: bounded(2.0, 1.0), "lower=2.0"),
        (lambda: bounded(0.0, float("inf")), "upper=inf"),
        (lambda: bounded(0.0, 1.0).unconstrain(1.5), "bounded: 1.5"),
        (lambda: positive().unconstrain(-1.0), "positive: -1.0"),
        (lambda: positive_definite().unconstrain(((0.0,),)), "deficient rank"),
        (lambda: positive_definite(True).unconstrain(np.ones((2, 2))), "deficient rank"),
        (lambda: simplex().unconstrain(jnp.array([1.5, -0.5])), "simplex"),
    ],
)
def test_values_outside_the_domain_are_named(act, text):
    with pytest.raises(ValueError, match=text):
        act()


def test_free_numbers_of_python_numbers_do_not_compile_anew():
    how = (positive(), positive_definite(), bounded(0.0, 1.0))
    free = unconstrain((2, ((1.0,), (0.2, 3)), 0.3), how)
    assert not any(leaf.weak_type for leaf in jax.tree.leaves(free))
    again = jax.tree.map(lambda leaf: leaf - 0.1, free)
    step = jax.jit(chex.assert_max_traces(n=1)(lambda f: constrain(f, (2.0, ((1.0,),), 0.3), how)))
    chex.clear_trace_counter()
    step(free)
    step(again)


class Pair(NamedTuple):
    x: Any
    v: Any


class Sensed(NamedTuple):
    a: Any
    b: Any


F = np.array([[0.95, 0.3], [-0.3, 0.9]])
H = np.array([[1.0, 0.0], [0.5, 1.0]])
TRUE_Q = np.array([[0.4, 0.15], [0.15, 0.3]])
TRUE_R = np.array([[0.5, -0.2], [-0.2, 0.8]])
PRIOR = gaussian(Pair(0.0, 0.0), jnp.eye(2))


def linear_params(q, r):
    return LinearGaussian(*map(jnp.asarray, (F, H, q, r)))


COVARIANCES = LinearGaussian(
    fixed, fixed, positive_definite(dense=True), positive_definite(dense=True)
)


def test_only_the_marked_leaves_are_learned():
    params = linear_params(TRUE_Q, TRUE_R)
    free = unconstrain(params, COVARIANCES)
    assert len(jax.tree.leaves(free)) == 6
    back = constrain(free, params, COVARIANCES)
    np.testing.assert_array_equal(back.transition, F)
    np.testing.assert_allclose(back.process_cov, TRUE_Q, atol=1e-14)
    other = constrain(free, replace(params, transition=2.0 * params.transition), COVARIANCES)
    np.testing.assert_array_equal(other.transition, 2.0 * F)
    everything = constrain(
        unconstrain((1.0, (2.0, 3.0)), positive()), (0.0, (0.0, 0.0)), positive()
    )
    np.testing.assert_allclose(jax.tree.leaves(everything), [1.0, 2.0, 3.0])


def learn(loss, free, steps, rate):
    """Adam with a rate that falls to zero, one compiled scan."""
    optimiser = optax.adam(optax.cosine_decay_schedule(rate, steps))

    def body(carry, _):
        free, state = carry
        value, slope = jax.value_and_grad(loss)(free)
        change, state = optimiser.update(slope, state)
        return (optax.apply_updates(free, change), state), value

    run = jax.jit(lambda free: jax.lax.scan(body, (free, optimiser.init(free)), None, steps))
    with jax.numpy_dtype_promotion("standard"):  # optax raises a float to an integer power
        (free, _), history = run(free)
    return free, np.asarray(history)


def linear_records(runs=24, steps=25):
    rng = np.random.default_rng(3)
    x = rng.normal(size=(runs, 2))
    ys = []
    for _ in range(steps):
        x = x @ F.T + rng.multivariate_normal(np.zeros(2), TRUE_Q, runs)
        ys.append(x @ H.T + rng.multivariate_normal(np.zeros(2), TRUE_R, runs))
    return np.stack(ys, axis=1)


def numpy_negative_log_likelihood(numbers, ys):
    """Textbook filter, all runs at once; covariances by their plain Cholesky factors."""
    a, b = np.zeros((2, 2)), np.zeros((2, 2))
    a[np.tril_indices(2)], b[np.tril_indices(2)] = numbers[:3], numbers[3:]
    q, r = a @ a.T, b @ b.T
    mean, cov, total = np.zeros((len(ys), 2)), np.eye(2), 0.0
    for k in range(ys.shape[1]):
        mean, cov = mean @ F.T, F @ cov @ F.T + q
        s = H @ cov @ H.T + r
        innovation = ys[:, k] - mean @ H.T
        gain = np.linalg.solve(s, H @ cov).T
        total += 0.5 * np.einsum("ri,ri->", innovation, np.linalg.solve(s, innovation.T).T)
        total += 0.5 * len(ys) * np.linalg.slogdet(2 * np.pi * s)[1]
        mean, cov = mean + innovation @ gain.T, cov - gain @ s @ gain.T
    return total / ys[..., 0].size


def test_adam_learns_both_covariances_to_the_optimum_of_scipy():
    ys = linear_records()
    best = minimize(
        numpy_negative_log_likelihood, [1.0, 0, 1, 1, 0, 1], (ys,), "BFGS", options={"gtol": 1e-7}
    ).x
    a, b = np.zeros((2, 2)), np.zeros((2, 2))
    a[np.tril_indices(2)], b[np.tril_indices(2)] = best[:3], best[3:]

    wrong = linear_params(4.0 * np.eye(2), 0.1 * np.eye(2))
    filter = kalman(Sensed)
    records = Sensed(jnp.asarray(ys[:, :, 0]), jnp.asarray(ys[:, :, 1]))

    def loss(free):
        params = constrain(free, wrong, COVARIANCES)
        each = jax.vmap(lambda y: drive.log_likelihood(filter, PRIOR, y, params))(records)
        return -jnp.sum(each) / ys[..., 0].size

    free, history = learn(loss, unconstrain(wrong, COVARIANCES), 250, 0.15)
    found = constrain(free, wrong, COVARIANCES)
    assert history[-1] == pytest.approx(numpy_negative_log_likelihood(best, ys), abs=1e-8)
    np.testing.assert_allclose(found.process_cov, a @ a.T, atol=1e-3)
    np.testing.assert_allclose(found.observation_cov, b @ b.T, atol=1e-3)
    np.testing.assert_array_equal(found.transition, F)


class Level(NamedTuple):
    x: Any


def chain(rng, transition, runs, steps):
    mode = np.zeros(runs, int)
    modes = []
    for _ in range(steps):
        mode = (rng.random(runs) < transition[mode, 1]).astype(int)
        modes.append(mode)
    return np.stack(modes, axis=1)


def forward_negative_log_likelihood(numbers, ys, variances):
    """Hidden Markov model with Gaussian emissions, by the forward recursion."""
    stay = 1 / (1 + np.exp(-np.asarray(numbers)))
    transition = np.array([[stay[0], 1 - stay[0]], [1 - stay[1], stay[1]]])
    p, total = np.tile([1.0, 0.0], (len(ys), 1)), 0.0
    for y in ys.T:
        likelihood = np.exp(-0.5 * y[:, None] ** 2 / variances) / np.sqrt(2 * np.pi * variances)
        joint = (p @ transition) * likelihood
        total += np.sum(np.log(joint.sum(1)))
        p = joint / joint.sum(1, keepdims=True)
    return -total / ys.size


def test_adam_learns_the_transition_matrix_of_an_imm():
    """No memory in the state: the IMM is exact, and its likelihood that of a Markov chain."""
    true = np.array([[0.95, 0.05], [0.15, 0.85]])
    rng = np.random.default_rng(8)
    modes = chain(rng, true, 40, 60)
    q, r = np.array([0.1, 3.0]), 0.2
    ys = rng.normal(size=modes.shape) * np.sqrt(q[modes] + r)
    best = minimize(
        forward_negative_log_likelihood, [0.0, 0.0], (ys, q + r), "BFGS", options={"gtol": 1e-8}
    )
    stay = 1 / (1 + np.exp(-best.x))

    def per_mode(matrix):
        return jnp.broadcast_to(jnp.asarray(matrix), (2, 1, 1))

    members = LinearGaussian(
        per_mode(0.0), per_mode(1.0), jnp.asarray(q).reshape(2, 1, 1), per_mode(r)
    )
    start = InteractingParams(members, jnp.array([[0.5, 0.5], [0.5, 0.5]]), jnp.array([1.0, 0.0]))
    how = InteractingParams(fixed, row_stochastic(), fixed)
    filter = interacting(kalman(Level))
    prior = gaussian(Level(0.0), jnp.eye(1))

    def loss(free):
        params = constrain(free, start, how)
        state = filter.init(prior, params)
        each = jax.vmap(lambda y: drive.log_likelihood(filter, state, Level(y), params))
        return -jnp.sum(each(jnp.asarray(ys))) / ys.size

    free, history = learn(loss, unconstrain(start, how), 200, 0.3)
    found = np.asarray(constrain(free, start, how).transition)
    assert history[-1] == pytest.approx(best.fun, abs=1e-8)
    np.testing.assert_allclose(np.diag(found), stay, atol=1e-3)
    hessian = jax.jit(jax.hessian(lambda f: loss(InteractingParams(None, f, None))))
    information = ys.size * np.asarray(hessian(free.transition)).reshape(2, 2)
    sigma = np.sqrt(np.diag(np.linalg.inv(information)))
    expected = np.log([true[0, 1] / true[0, 0], true[1, 0] / true[1, 1]])
    assert np.all(np.abs(free.transition[:, 0] - expected) < 3 * sigma)
