"""Joint recursive maximum likelihood against NumPy, `sensitivity` and hand-made mixing."""

from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import wheelhop.filtering as wf
from wheelhop.filtering import drive, smallmat
from wheelhop.filtering.joint_sensitivity import joint_sensitivity
from wheelhop.filtering.sensitivity import (
    SensitivityParams,
    SensitivityPrior,
    SensitivityState,
    sensitivity,
)


class Track(NamedTuple):
    position: Any
    velocity: Any


class Sensors(NamedTuple):
    a: Any
    b: Any


class Local(NamedTuple):
    """Log of the process noise's scale, and the velocity's own coefficient."""

    ln_q: Any
    damping: Any


class Both(NamedTuple):
    """Noise scales of two filters, and the coefficient that they share."""

    ln_q_1: Any
    ln_q_2: Any
    damping: Any


class Apart(NamedTuple):
    ln_q_1: Any
    damping_1: Any
    ln_q_2: Any
    damping_2: Any


SHARED = ((0, 2), (1, 2))
STEPS = 40
WHERE = np.diag([0.0, 1.0])
MEAN, COV = np.array([0.3, -0.2]), np.array([[1.0, 0.2], [0.2, 0.5]])
FS = np.array([[[1.0, 0.1], [-0.2, 0.97]], [[0.9, 0.3], [-0.1, 0.8]]])
H = np.array([[1.0, 0.3], [0.2, -1.0]])
QS = np.array([[[0.01, 0.03], [0.03, 0.09]], [[0.2, 0.0], [0.0, 0.1]]])
RS = np.array([[[0.5, 0.1], [0.1, 0.4]], [[0.2, 0.0], [0.0, 0.9]]])
MATRICES = wf.LinearGaussian(*map(jnp.asarray, (FS, np.stack([H, H]), QS, RS)))
WALK = np.array([[4e-4, 1e-4, 0.0], [1e-4, 2e-4, 0.0], [0.0, 0.0, 1e-6]])
START, SD = np.array([0.3, -0.2, 0.01]), np.array([0.4, 0.3, 0.02])
FREE = 1e9
"""A limit that never acts: it sees the move of all of theta, and would couple the filters."""


def bind(matrices, theta):
    lanes = (1,) * theta.ln_q.ndim

    def matrix(entries):
        entries = jnp.asarray(entries, theta.ln_q.dtype)
        return entries.reshape(*entries.shape, *lanes)

    ln_q, damping = (x[None, None] for x in theta)
    return replace(
        matrices,
        transition=matrix(matrices.transition) + damping * matrix(WHERE),
        observation=matrix(matrices.observation),
        process_cov=jnp.exp(ln_q) * matrix(matrices.process_cov),
        observation_cov=matrix(matrices.observation_cov),
    )


@lru_cache
def both_filter(limit=FREE):
    return joint_sensitivity(wf.kalman(Sensors), bind, Local, SHARED, limit)


@lru_cache
def runner(filter):
    """One compilation for every record, prior and parameter."""

    @jax.jit
    def run(ys, params, prior):
        return drive.run(filter, filter.init(prior, params), ys, params)

    return run


def lower(matrix):
    return tuple(tuple(jnp.asarray(matrix[i, j]) for j in range(i + 1)) for i in range(len(matrix)))


def records(seed):
    """Measurements of two filters with gaps, [time, filter, entry]."""
    rng, x = np.random.default_rng(seed), np.tile(MEAN, (2, 1))
    ys = np.empty((STEPS, 2, 2))
    for t in range(STEPS):
        for k in range(2):
            x[k] = FS[k] @ x[k] + rng.multivariate_normal(np.zeros(2), QS[k])
            ys[t, k] = H @ x[k] + rng.multivariate_normal(np.zeros(2), RS[k])
    ys[2, 0] = ys[3, 0, 0] = ys[4, 1, 1] = ys[5] = np.nan
    return ys


def measured(ys):
    return Sensors(jnp.asarray(ys[..., 0]), jnp.asarray(ys[..., 1]))


def state_prior(n=2):
    one = wf.gaussian(Track(*MEAN), jnp.asarray(COV))
    return jax.tree.map(lambda a: jnp.stack([a] * n), one) if n else one


def prior_of(kind, mean, sd, n=2):
    theta = wf.independent(kind(*map(jnp.asarray, mean)), kind(*map(jnp.asarray, sd)))
    return SensitivityPrior(state_prior(n), theta)


@lru_cache
def run_three():
    """A run over three records and priors, by `vmap`."""
    return jax.jit(jax.vmap(runner(both_filter()), in_axes=(0, None, 0)))


PARAMS = SensitivityParams(MATRICES, lower(WALK))
PRIOR = prior_of(Both, START, SD)
SEEDS = (0, 4, 5)


@pytest.fixture(scope="module")
def three():
    """Results on three records, leaves [record, time, ...]."""
    ys = measured(np.stack([records(seed) for seed in SEEDS]))
    return run_three()(ys, PARAMS, jax.tree.map(lambda a: jnp.stack([a] * 3), PRIOR))


def numpy_step(k, mean, cov, ln_q, damping, y):
    """Textbook Kalman step of filter k: its state, and r and S of the entries present."""
    f = FS[k] + damping * WHERE
    mean, cov = f @ mean, f @ cov @ f.T + np.exp(ln_q) * QS[k]
    here = np.isfinite(y)
    h, r = H[here], RS[k][np.ix_(here, here)]
    s = h @ cov @ h.T + r
    innovation = y[here] - h @ mean
    gain = cov @ h.T @ np.linalg.inv(s)
    keep = np.eye(2) - gain @ h
    return mean + gain @ innovation, keep @ cov @ keep.T + gain @ r @ gain.T, innovation, s


def numpy_rml(ys, theta, sigma, walk, h=1e-5):
    """RML over both filters: every derivative a central difference of one NumPy step."""
    states = [(MEAN, COV), (MEAN, COV)]
    tangents = [[(np.zeros(2), np.zeros((2, 2)))] * 3 for _ in states]
    thetas, sigmas = [], []
    for y in ys:
        score, info = np.zeros(3), np.zeros((3, 3))
        for k in range(2):
            slopes = []
            for (dm, dp), unit in zip(tangents[k], np.eye(3), strict=True):
                sides = []
                for step in (h, -h):
                    shifted = theta + step * unit
                    at = (states[k][0] + step * dm, states[k][1] + step * dp)
                    sides.append(numpy_step(k, *at, shifted[k], shifted[2], y[k]))
                slopes.append([(a - b) / (2 * h) for a, b in zip(*sides, strict=True)])
            *states[k], r, s = numpy_step(k, *states[k], theta[k], theta[2], y[k])
            tangents[k] = [(d[0], d[1]) for d in slopes]
            inverse = np.linalg.inv(s)
            for i, (_, _, ri, si) in enumerate(slopes):
                score[i] += -ri @ inverse @ r + 0.5 * r @ inverse @ si @ inverse @ r
                score[i] -= 0.5 * np.trace(inverse @ si)
                for j, (_, _, rj, sj) in enumerate(slopes):
                    info[i, j] += ri @ inverse @ rj
                    info[i, j] += 0.5 * np.trace(inverse @ si @ inverse @ sj)
        sigma = np.linalg.inv(np.linalg.inv(sigma + walk) + info)
        theta = theta + sigma @ score
        thetas.append(theta)
        sigmas.append(sigma)
    return np.array(thetas), np.array(sigmas)


def test_recursion_equals_the_formulas_by_finite_differences(three):
    """On every record of a batch, so that `vmap` is a loop too."""
    for k, seed in enumerate(SEEDS):
        ys = records(seed)
        thetas, sigmas = numpy_rml(ys, START, np.diag(SD**2), WALK)
        mean, cov = (np.asarray(a[k]) for a in wf.dense(three.state.theta))
        np.testing.assert_allclose(mean, thetas, atol=1e-8)
        np.testing.assert_allclose(cov, sigmas, atol=1e-9)
        np.testing.assert_array_equal(three.info.flags.missing[k], np.isnan(ys).sum((1, 2)))
        # nothing is learnt where everything is missing, and the walk goes on
        np.testing.assert_array_equal(mean[5], mean[4])
        np.testing.assert_allclose(cov[5], cov[4] + WALK, rtol=0, atol=1e-15)
    assert not np.any(three.info.flags.nonfinite)


def test_summed_score_is_the_slope_of_the_summed_log_likelihood():
    """A variance of 1e-14 holds theta while Sigma times the summed score still shows."""
    ys = records(1)
    sharp = prior_of(Both, np.zeros(3), np.full(3, 1e-7))
    found = run_three()(
        measured(np.stack([ys] * 3)),
        SensitivityParams(MATRICES, lower(np.zeros((3, 3)))),
        jax.tree.map(lambda a: jnp.stack([a] * 3), sharp),
    )
    score = np.asarray(wf.dense(found.state.theta)[0][0, -1]) * 1e14

    def total(theta):
        log = 0.0
        for k in range(2):
            mean, cov = MEAN, COV
            for y in ys[:, k]:
                mean, cov, r, s = numpy_step(k, mean, cov, theta[k], theta[2], y)
                log -= 0.5 * (r @ np.linalg.solve(s, r) + np.linalg.slogdet(2 * np.pi * s)[1])
        return log

    h = 1e-5
    slope = [(total(h * unit) - total(-h * unit)) / (2 * h) for unit in np.eye(3)]
    np.testing.assert_allclose(score, slope, rtol=1e-6, atol=1e-6)
    assert float(jnp.sum(found.info.log_likelihood[0])) == pytest.approx(
        total(np.zeros(3)), abs=1e-8
    )


def test_filters_that_share_nothing_are_filters_on_their_own():
    ys = records(2)
    starts, sds = np.array([[0.3, 0.01], [-0.2, 0.0]]), np.array([[0.4, 0.02], [0.3, 0.03]])
    walk = [Local(1e-4, 1e-6), Local(2e-4, 0.0)]
    filter = joint_sensitivity(wf.kalman(Sensors), bind, Local, ((0, 1), (2, 3)), FREE)
    joint = runner(filter)(
        measured(ys),
        SensitivityParams(MATRICES, Apart(*walk[0], *walk[1])),
        prior_of(Apart, starts.ravel(), sds.ravel()),
    )
    mean, cov = map(np.asarray, wf.dense(joint.state.theta))
    alone = sensitivity(wf.kalman(Sensors), bind, FREE)
    innovation_cov = np.array(smallmat.to_dense(joint.info.innovation_cov))
    log_likelihood, nis = 0.0, 0.0
    for k in range(2):
        own = jax.tree.map(lambda a, k=k: a[k], MATRICES)
        one = runner(alone)(
            measured(ys[:, k]),
            SensitivityParams(own, walk[k]),
            prior_of(Local, starts[k], sds[k], n=0),
        )
        expected_mean, expected_cov = wf.dense(one.state.theta)
        at = slice(2 * k, 2 * k + 2)
        np.testing.assert_allclose(mean[:, at], expected_mean, rtol=0, atol=1e-10)
        np.testing.assert_allclose(cov[:, at, at], expected_cov, rtol=0, atol=1e-10)
        state = (joint.state.inner, joint.state.tangents)
        state = jax.tree.map(lambda a, k=k: a[:, k], state)
        chex.assert_trees_all_close(state, (one.state.inner, one.state.tangents), atol=1e-10)
        log_likelihood, nis = log_likelihood + one.info.log_likelihood, nis + one.info.nis
        own_entries = tuple(joint.info.innovation)[at]
        chex.assert_trees_all_close(own_entries, tuple(one.info.innovation), atol=1e-10)
        innovation_cov[:, at, at] -= smallmat.to_dense(one.info.innovation_cov)
    np.testing.assert_allclose(innovation_cov, 0.0, atol=1e-10)
    np.testing.assert_array_equal(cov[:, :2, 2:], 0.0)
    np.testing.assert_allclose(joint.info.log_likelihood, log_likelihood, atol=1e-10)
    np.testing.assert_allclose(joint.info.nis, nis, atol=1e-10)


def test_lanes_equal_vmap(three):
    filter = both_filter()
    ys = measured(np.stack([records(seed) for seed in SEEDS]))
    lanes = wf.run_batch(filter, filter.init(PRIOR, PARAMS), ys, PARAMS)
    chex.assert_trees_all_close(lanes, three, atol=1e-10)


def test_mixing_matches_moments_and_their_slopes():
    """Three members of two filters; a dead one has weight zero."""
    rng = np.random.default_rng(7)
    weights = np.array([0.3, 0.7, 0.0])

    def symmetric(*shape):
        root = rng.normal(size=shape)
        return root + np.swapaxes(root, -1, -2)

    x, dx = rng.normal(size=(3, 2, 2)), rng.normal(size=(3, 2, 2, 2))
    p, dp = symmetric(3, 2, 2, 2) + 9.0 * np.eye(2), symmetric(3, 2, 2, 2, 2)
    theta, sigma = rng.normal(size=(3, 3)), symmetric(3, 3, 3) + 9.0 * np.eye(3)
    x[2], dx[2], p[2], theta[2] = np.nan, np.nan, np.nan, np.nan

    def belief(kind, mean, cov):
        return wf.Gaussian(
            kind(*jnp.asarray(np.moveaxis(mean, -1, 0))),
            lower(np.moveaxis(cov, (-2, -1), (0, 1))),
        )

    stacked = SensitivityState(
        belief(Track, x, p), belief(Track, dx, dp), belief(Both, theta, sigma)
    )
    mixed = both_filter().mix(jnp.asarray(weights), stacked)

    def moments(mean, cov):
        w = weights[:2]
        centre = np.tensordot(w, mean[:2], 1)
        off = mean[:2] - centre
        return centre, np.tensordot(w, cov[:2] + off[..., :, None] * off[..., None, :], 1)

    def close(found, expected, atol):
        np.testing.assert_allclose(wf.dense(found)[0], expected[0], atol=atol)
        np.testing.assert_allclose(wf.dense(found)[1], expected[1], atol=atol)

    close(mixed.inner, moments(x, p), 1e-12)
    close(mixed.theta, moments(theta, sigma), 1e-12)
    h = 1e-5
    for j in range(2):
        above = moments(x + h * dx[:, :, j], p + h * dp[:, :, j])
        below = moments(x - h * dx[:, :, j], p - h * dp[:, :, j])
        slope = [(a - b) / (2 * h) for a, b in zip(above, below, strict=True)]
        close(jax.tree.map(lambda a, j=j: a[:, j], mixed.tangents), slope, 1e-9)


def test_members_of_an_imm_that_are_alike_are_one_filter(three):
    one = jax.tree.map(lambda a: a[0], three)
    imm = wf.interacting(both_filter())
    both = wf.InteractingParams(
        jax.tree.map(lambda a: jnp.stack([a, a]), PARAMS),
        jnp.array([[0.9, 0.1], [0.2, 0.8]]),
        jnp.array([0.5, 0.5]),
    )
    many = runner(imm)(measured(records(SEEDS[0])), both, PRIOR)
    chex.assert_trees_all_close(many.state.combined, one.state, atol=1e-9)
    np.testing.assert_allclose(many.info.log_likelihood, one.info.log_likelihood, atol=1e-9)
    assert not np.any(many.info.flags.nonfinite)


def test_single_precision_follows_double(float32):
    params, prior, ys = jax.tree.map(
        lambda a: jnp.asarray(np.asarray(a), jnp.float32), (PARAMS, PRIOR, measured(records(0)))
    )
    found = runner(both_filter())(ys, params, prior)
    assert {a.dtype.name for a in jax.tree.leaves(found.state)} == {"float32"}
    thetas, sigmas = numpy_rml(records(0), START, np.diag(SD**2), WALK)
    mean, cov = wf.dense(found.state.theta)
    assert np.all(np.abs(np.asarray(mean) - thetas) < 1e-4 * SD)
    assert np.all(np.abs(np.asarray(cov) - sigmas) < 1e-4 * np.outer(SD, SD))


@pytest.mark.parametrize(
    "places", [(), ((0,), (1,)), ((0, 0), (1, 2)), ((0, 1, 2), (0, 1, 2))], ids=str
)
def test_places_must_fit_the_local_theta(places):
    with pytest.raises(ValueError, match="give every filter 2 different components"):
        joint_sensitivity(wf.kalman(Sensors), bind, Local, places)


def test_places_must_exist_in_theta():
    for places in (((0, 3), (1, 2)), ((0, -1), (1, 2))):
        filter = joint_sensitivity(wf.kalman(Sensors), bind, Local, places)
        with pytest.raises(ValueError, match="of theta, which has the 3 components"):
            filter.init(PRIOR, PARAMS)


def test_limit_prior_and_walk_are_checked():
    for limit in (0.0, -1.0, np.nan):
        with pytest.raises(ValueError, match="theta could not move"):
            joint_sensitivity(wf.kalman(Sensors), bind, Local, SHARED, limit)
    with pytest.raises(ValueError, match="give SensitivityPrior"):
        both_filter().init(state_prior(), PARAMS)
    with pytest.raises(ValueError, match="walk has 2 entries for the 3 components"):
        both_filter().init(PRIOR, SensitivityParams(MATRICES, Local(0.0, 0.0)))
