"""The filter parallel in time: the dense joint Gaussian, the sequential filter, and gradients."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from models import COV, MEAN, F, H, Q, R, Sensors, Track, dense_posterior, sample
from models import kalman as numpy_kalman

from wheelhop.filtering import LinearGaussian, dense, drive, gaussian, kalman
from wheelhop.filtering.parallel import (
    parallel_filter,
    parallel_log_likelihood,
    parallel_smoother,
)

STEPS = 13  # four blocks of four samples, the last one incomplete
DRIVE = np.array([0.1, 0.3, 0.0])  # Q is its outer product with itself
PARAMS = LinearGaussian(jnp.asarray(F), jnp.asarray(H), jnp.asarray(Q), jnp.asarray(R))
ZERO_BIAS = COV * np.outer([1, 1, 0], [1, 1, 0])

run_parallel = jax.jit(parallel_filter, static_argnames="blocks")
smooth_parallel = jax.jit(parallel_smoother, static_argnames="blocks")


def prior(cov=COV):
    return gaussian(Track(*MEAN), jnp.asarray(cov))


def measurements(ys):
    return Sensors(jnp.asarray(ys[:, 0]), jnp.asarray(ys[:, 1]))


def record(seed=0, steps=STEPS):
    """A record with a missing row, and rows of which one entry is missing."""
    _, ys = sample(seed, steps)
    ys[4 % steps], ys[6 % steps, 1], ys[-1, 0] = np.nan, np.nan, np.nan
    return ys


def varying(seed):
    """A model whose matrices differ from step to step; the process noise has rank one."""
    rng = np.random.default_rng(seed)
    scale = rng.uniform(0.5, 2.0, (4, STEPS, 1, 1))
    drives = DRIVE + 0.1 * rng.normal(size=(STEPS, 3))
    return LinearGaussian(
        jnp.asarray(F + 0.05 * rng.normal(size=(STEPS, 3, 3))),
        jnp.asarray(H * scale[0]),
        jnp.asarray(drives[:, :, None] * drives[:, None]),
        jnp.asarray(R * scale[1]),
    )


def sequential(start, ys, params):
    if params.transition.ndim == 2:
        return drive.run(kalman(Sensors), start, ys, params)
    return drive.run(kalman(Sensors), start, ys, None, inputs=params, bind=lambda _, u: u)


def sequential_evidence(params, start, ys):
    return drive.log_likelihood(kalman(Sensors), start, ys, params)


def parallel_evidence(params, start, ys):
    return parallel_log_likelihood(start, ys, params)


parallel_slope = jax.jit(jax.grad(parallel_evidence, (0, 1, 2)))
sequential_slope = jax.jit(jax.grad(sequential_evidence, (0, 1)))


def dense_record(ys, f=F, h=H, q=Q, r=R, cov=COV):
    """Log-evidence, smoothed means and covariances by one solve with the joint Gaussian."""
    steps = len(ys)
    powers = [np.linalg.matrix_power(f, k) for k in range(steps + 1)]
    # states as a map of the prior and of every step's noise
    reach = np.zeros((3 * steps, 3 * (steps + 1)))
    for a in range(steps):
        for b in range(a + 2):
            reach[3 * a : 3 * a + 3, 3 * b : 3 * b + 3] = powers[a + 1 - b]
    reach[:, :3] = np.concatenate(powers[1:])
    joint = reach @ np.block(
        [[cov, np.zeros((3, 3 * steps))], [np.zeros((3 * steps, 3)), np.kron(np.eye(steps), q)]]
    )
    joint = joint @ reach.T
    here = np.isfinite(ys.ravel())
    big_h = np.kron(np.eye(steps), h)[here]
    s = big_h @ joint @ big_h.T + np.kron(np.eye(steps), r)[np.ix_(here, here)]
    mean = reach[:, :3] @ MEAN
    residual = ys.ravel()[here] - big_h @ mean
    weight = np.linalg.solve(s, residual)
    evidence = -0.5 * (residual @ weight + np.linalg.slogdet(2 * np.pi * s)[1])
    smoothed = mean + joint @ big_h.T @ weight
    spread = joint - joint @ big_h.T @ np.linalg.solve(s, big_h @ joint)
    blocks = [spread[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] for k in range(steps)]
    return evidence, smoothed.reshape(steps, 3), np.array(blocks)


def assert_same(found, expected, tolerance=1e-10):
    """Equal reports and states; the pivot guard may act on either side of rounding."""
    assert jax.tree.structure(found) == jax.tree.structure(expected)
    for trajectory in (found, expected):
        assert trajectory.info.flags.guarded.shape == trajectory.info.nis.shape
    plain = [
        t._replace(info=t.info._replace(flags=t.info.flags._replace(guarded=0)))
        for t in (found, expected)
    ]
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=0, atol=tolerance), *plain)


def test_equals_the_textbook_recursion_with_gaps():
    ys = record()
    found = run_parallel(prior(), measurements(ys), PARAMS)
    means, covs, log_likelihood = numpy_kalman(ys)
    np.testing.assert_allclose(dense(found.state)[0], means, atol=1e-10)
    np.testing.assert_allclose(dense(found.state)[1], covs, atol=1e-10)
    np.testing.assert_allclose(found.info.log_likelihood, log_likelihood, atol=1e-10)


def test_filter_and_smoother_equal_one_dense_solve_of_the_whole_record():
    _, ys = sample(1, STEPS)
    posterior, spread, evidence = dense_posterior(ys)
    found = run_parallel(prior(), measurements(ys), PARAMS)
    np.testing.assert_allclose(found.info.log_likelihood.sum(), evidence, atol=1e-10)
    mean, cov = dense(smooth_parallel(found.state, measurements(ys), PARAMS))
    np.testing.assert_allclose(np.ravel(mean), posterior, atol=1e-10)
    for k in range(STEPS):
        block = spread[3 * k : 3 * k + 3, 3 * k : 3 * k + 3]
        np.testing.assert_allclose(cov[k], block, atol=1e-10)


@pytest.mark.parametrize("q", [Q, 0 * Q], ids=["rank one", "no process noise"])
@pytest.mark.parametrize("cov", [COV, ZERO_BIAS, 0 * COV], ids=["full", "bias known", "known"])
def test_singular_covariances(q, cov):
    ys = record(2)
    params = replace(PARAMS, process_cov=jnp.asarray(q))
    found = run_parallel(prior(cov), measurements(ys), params)
    assert_same(found, sequential(prior(cov), measurements(ys), params))
    evidence, mean, covs = dense_record(ys, q=q, cov=cov)
    np.testing.assert_allclose(found.info.log_likelihood.sum(), evidence, atol=1e-10)
    smoothed = dense(smooth_parallel(found.state, measurements(ys), params))
    np.testing.assert_allclose(smoothed[0], mean, atol=1e-10)
    np.testing.assert_allclose(smoothed[1], covs, atol=1e-10)


@pytest.mark.parametrize("seed", range(3))
def test_matrices_that_vary_in_time(seed):
    ys = measurements(record(seed))
    params = varying(seed)
    assert_same(run_parallel(prior(), ys, params), sequential(prior(), ys, params))


@pytest.mark.parametrize(("steps", "blocks"), [(1, None), (STEPS, 5)])
def test_any_length_and_any_number_of_blocks(steps, blocks):
    _, ys = sample(3, steps)
    found = run_parallel(prior(), measurements(ys), PARAMS, blocks=blocks)
    assert_same(found, sequential(prior(), measurements(ys), PARAMS))


DIRECTIONS = ["transition", "observation", "process noise", "measurement noise", "prior"]


def along(direction, seed=4):
    """Derivative of all matrices along a direction that keeps the rank of Q."""
    rng = np.random.default_rng(seed)
    spread = rng.normal(size=(3, 3))
    g = rng.normal(size=3)
    return {
        "transition": {"f": rng.normal(size=(3, 3))},
        "observation": {"h": rng.normal(size=(2, 3))},
        "process noise": {"q": np.outer(g, DRIVE) + np.outer(DRIVE, g)},
        "measurement noise": {"r": spread[:2, :2] + spread[:2, :2].T},
        "prior": {"cov": spread + spread.T},
    }[direction]


def slope(gradients, d):
    """Derivative along a direction, from gradients that hold lower triangles of symmetric ones."""
    params, start = gradients[:2]
    pairs = {"f": params.transition, "h": params.observation}
    pairs |= {"q": params.process_cov, "r": params.observation_cov}
    pairs["cov"] = np.zeros((3, 3))
    for i in range(3):
        for j in range(i + 1):
            pairs["cov"][i, j] = start.cov[i][j]
    return sum(np.sum(np.asarray(pairs[name]) * value) for name, value in d.items())


def difference(ys, d, h=1e-5, **base):
    """Central difference of the dense evidence, of fourth order in h."""
    at = {"f": F, "h": H, "q": Q, "r": R, "cov": COV} | base

    def evidence(step):
        return dense_record(ys, **(at | {k: at[k] + step * v for k, v in d.items()}))[0]

    narrow, wide = (evidence(k * h) - evidence(-k * h) for k in (1, 2))
    return (8 * narrow - wide) / (12 * h)


@pytest.mark.parametrize("direction", DIRECTIONS)
def test_gradient_of_the_log_likelihood(direction):
    """Along directions that keep the rank of Q: central differences and the sequential filter."""
    ys, d = record(5), along(direction)
    found = slope(parallel_slope(PARAMS, prior(), measurements(ys)), d)
    np.testing.assert_allclose(found, difference(ys, d), rtol=1e-6)
    expected = slope(sequential_slope(PARAMS, prior(), measurements(ys)), d)
    np.testing.assert_allclose(found, expected, rtol=1e-6)


@pytest.mark.parametrize("cov", [COV, ZERO_BIAS, 0 * COV], ids=["full", "bias known", "known"])
@pytest.mark.parametrize("direction", DIRECTIONS)
def test_gradient_is_right_in_every_direction_where_covariances_are_singular(direction, cov):
    """Also in directions that raise the rank; the evidence is smooth there."""
    ys, d = record(6), along(direction)
    if direction == "process noise":
        d = {"q": along("prior")["cov"]}
    params = replace(PARAMS, process_cov=jnp.zeros((3, 3)))
    found = slope(parallel_slope(params, prior(cov), measurements(ys)), d)
    np.testing.assert_allclose(found, difference(ys, d, q=0 * Q, cov=cov), rtol=1e-6, atol=1e-7)


def test_derivative_of_the_smoother():
    ys = record(7)
    d = along("process noise") | along("transition") | along("prior")

    def smoothed(amount):
        params = replace(PARAMS, transition=F + amount * d["f"], process_cov=Q + amount * d["q"])
        lower = tuple(
            tuple(COV[i, j] + amount * d["cov"][i, j] for j in range(i + 1)) for i in range(3)
        )
        start = gaussian(Track(*MEAN), lower)
        beliefs = parallel_filter(start, measurements(ys), params).state
        return dense(parallel_smoother(beliefs, measurements(ys), params))

    tangent = jax.jit(lambda a: jax.jvp(smoothed, (a,), (1.0,))[1])(0.0)
    h = 1e-5
    up, down = (
        dense_record(ys, f=F + a * d["f"], q=Q + a * d["q"], cov=COV + a * d["cov"])
        for a in (h, -h)
    )
    for found, plus, minus in zip(tangent, up[1:], down[1:], strict=True):
        np.testing.assert_allclose(found, (plus - minus) / (2 * h), rtol=1e-6, atol=1e-7)


def test_missing_rows_leave_no_trace_in_gradients():
    ys = measurements(record(8))
    gradient = parallel_slope(PARAMS, prior(), ys)[2]
    for slopes, values in zip(gradient, ys, strict=True):
        missing = np.isnan(values)
        assert np.all(np.asarray(slopes)[missing] == 0)
        assert np.all(np.isfinite(slopes))
        assert np.all(np.asarray(slopes)[~missing] != 0)


def test_gradient_is_finite_and_close_in_single_precision(float32):
    ys = measurements(record(9).astype(np.float32))
    single = jax.tree.map(lambda a: jnp.asarray(a, jnp.float32), (PARAMS, prior()))
    assert single[0].transition.dtype == ys.a.dtype == jnp.float32
    found = jax.jit(jax.grad(parallel_evidence, (0, 1)))(*single, ys)
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(found))
    for direction in DIRECTIONS:
        d = along(direction)
        expected = difference(record(9), d)
        np.testing.assert_allclose(slope(found, d), expected, rtol=2e-3)


def test_a_singular_measurement_noise_is_not_passed_over_in_silence():
    params = replace(PARAMS, observation_cov=jnp.zeros((2, 2)))
    found = run_parallel(prior(), measurements(sample(10, STEPS)[1]), params)
    assert np.all(found.info.flags.nonfinite)


def test_bad_input_is_named():
    ys = measurements(record())
    with pytest.raises(ValueError, match=r"observation has shape \(3, 2\); give \(2, 3\)"):
        parallel_filter(prior(), ys, replace(PARAMS, observation=PARAMS.observation.T))
    with pytest.raises(ValueError, match=r"process_cov has shape \(5, 3, 3\)"):
        parallel_filter(prior(), ys, replace(PARAMS, process_cov=jnp.zeros((5, 3, 3))))
    with pytest.raises(ValueError, match="blocks=0"):
        parallel_filter(prior(), ys, PARAMS, blocks=0)
    with pytest.raises(ValueError, match="0 samples"):
        parallel_filter(prior(), Sensors(jnp.zeros(0), jnp.zeros(0)), PARAMS)
