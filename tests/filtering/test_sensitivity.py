"""Recursive maximum likelihood against finite differences in NumPy, batch ML and Monte Carlo."""

from dataclasses import replace
from typing import Any, NamedTuple

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize
import scipy.stats
from models import COV, MEAN, F, H, Q, R, Sensors, Track, kalman, sample

import wheelhop.filtering as wf
from wheelhop.filtering import drive
from wheelhop.filtering.sensitivity import (
    SensitivityParams,
    SensitivityPrior,
    SensitivityState,
    information_columns,
    newton_step,
    sensitivity,
)


class Theta(NamedTuple):
    """Log of both noise scales, and the velocity's own coefficient, from their true values."""

    ln_q: Any
    ln_r: Any
    damping: Any


SD = np.array([0.4, 0.3, 0.02])
WALK = np.array([[4e-4, 1e-4, 0.0], [1e-4, 2e-4, 0.0], [0.0, 0.0, 1e-6]])
MATRICES = wf.LinearGaussian(*map(jnp.asarray, (F, H, Q, R)))
WHERE = np.zeros((3, 3))
WHERE[1, 1] = 1.0


def bind(matrices, theta):
    """Matrices [rows, columns] or, where theta has lanes, [rows, columns, lanes]."""
    lanes = (1,) * theta.ln_q.ndim

    def matrix(entries):
        entries = jnp.asarray(entries, theta.ln_q.dtype)
        return entries.reshape(*entries.shape, *lanes)

    ln_q, ln_r, damping = (x[None, None] for x in theta)
    return replace(
        matrices,
        transition=matrix(matrices.transition) + damping * matrix(WHERE),
        process_cov=jnp.exp(ln_q) * matrix(matrices.process_cov),
        observation_cov=jnp.exp(ln_r) * matrix(matrices.observation_cov),
    )


def lower(matrix):
    return tuple(tuple(matrix[i, j] for j in range(i + 1)) for i in range(len(matrix)))


def measurements(ys):
    return Sensors(jnp.asarray(ys[..., 0]), jnp.asarray(ys[..., 1]))


def track_prior(sd=SD, mean=(0.0, 0.0, 0.0)):
    state = wf.gaussian(Track(*MEAN), jnp.asarray(COV))
    return SensitivityPrior(state, wf.independent(Theta(*mean), Theta(*sd)))


def record(seed, steps=60):
    _, ys = sample(seed, steps)
    ys[2] = ys[3, 0] = ys[4, 1] = np.nan
    return ys


def numpy_step(mean, cov, theta, y):
    """Textbook Kalman step: state after it, and r and S of the entries that are present."""
    f, q, r = F + theta[2] * WHERE, np.exp(theta[0]) * Q, np.exp(theta[1]) * R
    mean, cov = f @ mean, f @ cov @ f.T + q
    here = np.isfinite(y)
    h, r = H[here], r[np.ix_(here, here)]
    s = h @ cov @ h.T + r
    innovation = y[here] - h @ mean
    gain = cov @ h.T @ np.linalg.inv(s)
    keep = np.eye(3) - gain @ h
    return mean + gain @ innovation, keep @ cov @ keep.T + gain @ r @ gain.T, innovation, s


def numpy_rml(ys, theta, sigma, walk, h=1e-5):
    """The printed recursion with every derivative a central difference of one NumPy step."""
    mean, cov = MEAN.copy(), COV.copy()
    tangents = [(np.zeros(3), np.zeros((3, 3))) for _ in range(3)]
    thetas, sigmas = [], []
    for y in ys:
        slopes = []
        for (dm, dp), unit in zip(tangents, np.eye(3), strict=True):
            above = numpy_step(mean + h * dm, cov + h * dp, theta + h * unit, y)
            below = numpy_step(mean - h * dm, cov - h * dp, theta - h * unit, y)
            slopes.append([(a - b) / (2 * h) for a, b in zip(above, below, strict=True)])
        mean, cov, r, s = numpy_step(mean, cov, theta, y)
        tangents = [(d[0], d[1]) for d in slopes]
        inverse = np.linalg.inv(s)
        score, info = np.zeros(3), np.zeros((3, 3))
        for i, (_, _, ri, si) in enumerate(slopes):
            score[i] = -ri @ inverse @ r + 0.5 * r @ inverse @ si @ inverse @ r
            score[i] -= 0.5 * np.trace(inverse @ si)
            for j, (_, _, rj, sj) in enumerate(slopes):
                info[i, j] = ri @ inverse @ rj + 0.5 * np.trace(inverse @ si @ inverse @ sj)
        sigma = np.linalg.inv(np.linalg.inv(sigma + walk) + info)
        theta = theta + sigma @ score
        thetas.append(theta)
        sigmas.append(sigma)
    return np.array(thetas), np.array(sigmas)


def run(filter, ys, params, prior):
    return drive.run(filter, filter.init(prior, params), ys, params)


@pytest.mark.parametrize(
    ("walk", "dense_walk"),
    [(lower(WALK), WALK), (Theta(*np.diag(WALK)), np.diag(np.diag(WALK)))],
    ids=["lower", "named"],
)
def test_recursion_equals_the_printed_formulas_by_finite_differences(walk, dense_walk):
    ys = record(0)
    thetas, sigmas = numpy_rml(ys, np.array([0.3, -0.2, 0.01]), np.diag(SD**2), dense_walk)
    filter = sensitivity(wf.kalman(Sensors), bind)
    found = run(
        filter,
        measurements(ys),
        SensitivityParams(MATRICES, walk),
        track_prior(mean=(0.3, -0.2, 0.01)),
    )
    mean, cov = wf.dense(found.state.theta)
    np.testing.assert_allclose(mean, thetas, atol=1e-8)
    np.testing.assert_allclose(cov, sigmas, atol=1e-9)
    assert not np.any(found.info.flags.nonfinite)


def test_summed_score_is_the_slope_of_the_records_likelihood():
    """A prior of variance 1e-14 holds theta while Sigma times the summed score still shows."""
    ys = record(1)
    params = SensitivityParams(MATRICES, Theta(0.0, 0.0, 0.0))
    found = run(
        sensitivity(wf.kalman(Sensors), bind), measurements(ys), params, track_prior([1e-7] * 3)
    )
    score = np.array(wf.dense(found.state.theta)[0][-1]) * 1e14

    def total(theta):
        mean, cov, log = MEAN, COV, 0.0
        for y in ys:
            mean, cov, r, s = numpy_step(mean, cov, theta, y)
            log -= 0.5 * (r @ np.linalg.solve(s, r) + np.linalg.slogdet(2 * np.pi * s)[1])
        return log

    h = 1e-5
    slope = [(total(h * unit) - total(-h * unit)) / (2 * h) for unit in np.eye(3)]
    np.testing.assert_allclose(score, slope, rtol=1e-6, atol=1e-6)
    # filters agree with the Kalman filter of the test models, so that oracle is anchored too
    assert total(np.zeros(3)) == pytest.approx(kalman(ys)[2].sum(), abs=1e-9)


class Level(NamedTuple):
    x: Any


class Noisy(NamedTuple):
    """x' = coefficient x + w, y = x + v."""

    coefficient: Any
    ln_q: Any
    ln_r: Any


class Shared(NamedTuple):
    """Log of the measurement noise, from what the parameters say."""

    ln_r: Any


NOISY = Noisy(0.9, 0.0, 0.0)


def autoregression():
    return wf.StateSpaceModel(
        transition=lambda x, p: Level(p.coefficient * x.x),
        observation=lambda x, p: x,
        process_cov=lambda x, p: ((jnp.exp(p.ln_q),),),
        observation_cov=lambda p: ((jnp.exp(p.ln_r),),),
    )


def bind_shared(params, theta):
    return params._replace(ln_r=params.ln_r + theta.ln_r)


def level_prior(sd, mean=0.0):
    return SensitivityPrior(
        wf.independent(Level(0.0), Level(1.0)), wf.independent(Shared(mean), Shared(sd))
    )


def imm_params(members):
    return wf.InteractingParams(members, jnp.array([[0.9, 0.1], [0.2, 0.8]]), jnp.array([0.5, 0.5]))


TWO_LEVELS = Noisy(jnp.array([0.9, 0.9]), jnp.array([-1.0, 1.0]), jnp.zeros(2))


def bind_imm(params, theta):
    lanes = (1,) * theta.ln_r.ndim
    ln_r = params.members.ln_r.reshape(2, *lanes) + theta.ln_r[None]
    return replace(params, members=params.members._replace(ln_r=ln_r))


def levels(seed, steps):
    """A record of `NOISY` with its noise twice as strong, and gaps."""
    rng = np.random.default_rng(seed)
    x, ys = 0.0, np.empty(steps)
    for t in range(steps):
        x = 0.9 * x + rng.normal()
        ys[t] = x + 2.0 * rng.normal()
    ys[3] = np.nan
    return Level(jnp.asarray(ys))


def test_score_of_a_mixture_is_the_slope_of_the_mixtures_likelihood():
    ys = levels(2, 60)
    inner = wf.interacting(wf.extended(autoregression()))
    params = SensitivityParams(imm_params(TWO_LEVELS), Shared(0.0))
    found = run(sensitivity(inner, bind_imm), ys, params, level_prior(1e-7))

    def total(ln_r):
        shifted = bind_imm(params.inner, Shared(jnp.asarray(ln_r)))
        state = inner.init(level_prior(1.0).state, shifted)
        return float(drive.log_likelihood(inner, state, ys, shifted))

    slope = (total(1e-5) - total(-1e-5)) / 2e-5
    assert float(found.state.theta.mean.ln_r[-1]) * 1e14 == pytest.approx(slope, rel=1e-6)


def test_information_is_the_fisher_information_of_a_gaussian():
    rng = np.random.default_rng(3)
    root = rng.normal(size=(3, 3))
    s = root @ root.T + np.eye(3)
    ri = rng.normal(size=(2, 3))
    si = rng.normal(size=(2, 3, 3))
    si = si + np.swapaxes(si, 1, 2)
    columns = np.array(
        information_columns(
            lower(jnp.asarray(s)),
            Track(*jnp.asarray(ri.T)),
            lower(jnp.asarray(np.moveaxis(si, 0, -1))),
        )
    )
    white = np.linalg.inv(s)
    expected = ri @ white @ ri.T + 0.5 * np.einsum("ab,ibc,cd,jda->ij", white, si, white, si)
    np.testing.assert_allclose(columns.T @ columns, expected, atol=1e-12)


def test_newton_step_is_stable_where_information_dwarfs_the_prior():
    columns = [jnp.array([1e9, 1e9]), jnp.array([0.0, 1.0])]
    belief = wf.gaussian(Sensors(1.0, 2.0), jnp.diag(jnp.array([4.0, 1.0])))
    moved, finite, _ = newton_step(belief, tuple(jnp.zeros(2)), columns)
    cov = np.asarray(wf.dense(moved)[1])
    assert finite
    assert np.linalg.eigvalsh(cov).min() >= 0.0
    # all but the direction (1, -1) is known; along it 1/4 + 1 + 1 of precision
    np.testing.assert_allclose(cov, np.array([[1, -1], [-1, 1]]) / 2.25, rtol=1e-6)


def test_a_wide_prior_does_not_overshoot():
    """A noise e^5 times the expected one: full steps leave the range of numbers."""
    rng = np.random.default_rng(27)
    x, ys = 0.0, np.empty(400)
    for t in range(400):
        x = 0.9 * x + rng.normal()
        ys[t] = x + np.exp(2.5) * rng.normal()
    prior, params = level_prior(2.5), SensitivityParams(NOISY, Shared(0.0))
    ends = {}
    for limit in (2.0, 1e9):
        filter = sensitivity(wf.extended(autoregression()), bind_shared, limit)
        ends[limit] = run(filter, Level(jnp.asarray(ys)), params, prior)
    belief = jax.tree.map(lambda a: float(a[-1]), ends[2.0].state.theta)
    assert not np.any(ends[2.0].info.flags.nonfinite)
    assert abs(belief.mean.ln_r - 5.0) < 3.0 * np.sqrt(belief.cov[0][0])
    overshot = float(ends[1e9].state.theta.mean.ln_r[-1])
    assert not abs(overshot - 5.0) < 1.0


def test_zero_prior_variance_keeps_theta():
    ys = record(4)
    params = SensitivityParams(MATRICES, Theta(0.0, 0.0, 0.0))
    filter = sensitivity(wf.kalman(Sensors), bind)
    found = run(filter, measurements(ys), params, track_prior([0.4, 0.0, 0.02], (0.1, 0.2, 0.0)))
    assert np.all(found.state.theta.mean.ln_r == 0.2)
    assert np.all(found.state.theta.cov[1][1] == 0.0)
    assert abs(float(found.state.theta.mean.ln_q[-1]) - 0.1) > 1e-3

    fixed = run(filter, measurements(ys), params, track_prior([0.0, 0.0, 0.0], (0.1, 0.2, 0.0)))
    plain = wf.kalman(Sensors)
    expected = run(
        plain,
        measurements(ys),
        bind(MATRICES, Theta(*jnp.array([0.1, 0.2, 0.0]))),
        track_prior().state,
    )
    chex.assert_trees_all_close(fixed.state.inner, expected.state, atol=1e-12)
    chex.assert_trees_all_close(fixed.info.innovation_cov, expected.info.innovation_cov, atol=1e-12)


def test_missing_rows_add_no_information():
    ys = record(5, 20)
    ys[10:] = np.nan
    params = SensitivityParams(MATRICES, Theta(1e-3, 0.0, 0.0))
    found = run(sensitivity(wf.kalman(Sensors), bind), measurements(ys), params, track_prior())
    mean, cov = map(np.asarray, wf.dense(found.state.theta))
    np.testing.assert_array_equal(mean[9:], np.broadcast_to(mean[9], (11, 3)))
    grown = cov[9] + 10 * np.diag([1e-3, 0.0, 0.0])
    np.testing.assert_allclose(cov[-1], grown, rtol=0, atol=1e-14)


NOISY_MEAN, NOISY_SD = np.array([0.85, 0.0, 0.0]), np.array([0.05, 0.5, 0.5])


def autoregressive_runs(seed, theta, steps):
    rng = np.random.default_rng(seed)
    x, ys = rng.normal(size=len(theta)), np.empty((len(theta), steps))
    for t in range(steps):
        x = theta[:, 0] * x + np.exp(theta[:, 1] / 2) * rng.normal(size=len(theta))
        ys[:, t] = x + np.exp(theta[:, 2] / 2) * rng.normal(size=len(theta))
    return ys


def estimate(filter, ys, params, prior, at):
    """Gaussians of theta of every run at some samples, and whether anything was flagged."""

    @jax.jit
    @jax.vmap
    def one(y):
        def keep(state, info):
            return state.theta, info.flags.nonfinite

        theta, flagged = drive.run(filter, filter.init(prior, params), Level(y), params, keep=keep)
        return jax.tree.map(lambda a: a[jnp.asarray(at)], theta), jnp.any(flagged)

    theta, flagged = one(jnp.asarray(ys))
    return *map(np.asarray, wf.dense(theta)), np.asarray(flagged)


def noisy_case():
    prior = SensitivityPrior(
        wf.independent(Level(0.0), Level(1.0)),
        wf.independent(Noisy(*NOISY_MEAN), Noisy(*NOISY_SD)),
    )
    filter = sensitivity(wf.extended(autoregression()), lambda params, theta: theta)
    return filter, SensitivityParams(None, Noisy(0.0, 0.0, 0.0)), prior


def negative_log_posterior(theta, y):
    """Of a scalar Kalman filter in NumPy, and the Gaussian prior of theta."""
    mean, var, total = 0.0, 1.0, 0.5 * np.sum(((theta - NOISY_MEAN) / NOISY_SD) ** 2)
    q, r = np.exp(theta[1:])
    for value in y:
        mean, var = theta[0] * mean, theta[0] ** 2 * var + q
        s, innovation = var + r, value - mean
        total += 0.5 * (innovation**2 / s + np.log(s))
        mean, var = mean + var / s * innovation, var * r / s
    return total


def test_it_converges_to_the_batch_estimate():
    truth = np.array([[0.9, 0.4, -0.3], [0.8, -0.3, 0.5], [0.88, 0.6, 0.6]])
    ys = autoregressive_runs(6, truth, 4000)
    mean, cov, flagged = estimate(*(noisy_case()[0], ys), *noisy_case()[1:], at=[-1])
    assert not flagged.any()
    for y, m, c in zip(ys, mean[:, 0], cov[:, 0], strict=True):
        batch = scipy.optimize.minimize(
            negative_log_posterior, m, args=(y,), method="BFGS", options={"gtol": 1e-3}
        )
        off = (m - batch.x) / np.sqrt(np.diag(c))
        assert np.max(np.abs(off)) < 0.5, off


def test_covariance_is_honest_over_300_runs():
    rng = np.random.default_rng(7)
    truth = NOISY_MEAN + NOISY_SD * rng.normal(size=(300, 3))
    ys = autoregressive_runs(8, truth, 4000)
    filter, params, prior = noisy_case()
    mean, cov, flagged = estimate(filter, ys, params, prior, at=[299, 3999])
    assert not flagged.any()
    error = mean - truth[:, None]
    white = np.linalg.solve(cov, error[..., None])[..., 0]
    nees = np.einsum("rki,rki->k", error, white) / (3 * 300)
    assert np.all((nees > 0.9) & (nees < 1.35)), nees
    rms, sigma = np.sqrt(np.mean(error**2, 0)), np.sqrt(np.mean(np.einsum("rkii->rki", cov), 0))
    assert np.all(rms[1] < 0.3 * np.array([0.05, 0.5, 0.5]))
    assert np.all(rms < 1.3 * sigma)


def test_identical_members_equal_one_filter():
    ys = levels(9, 60)
    member = sensitivity(wf.unscented(autoregression()), bind_shared)
    params = jax.tree.map(jnp.asarray, SensitivityParams(NOISY, Shared(1e-4)))
    both = imm_params(jax.tree.map(lambda a: jnp.stack([a, a]), params))
    one = run(member, ys, params, level_prior(0.5, 0.3))
    many = run(wf.interacting(member), ys, both, level_prior(0.5, 0.3))
    np.testing.assert_allclose(many.info.log_likelihood, one.info.log_likelihood, atol=1e-9)
    chex.assert_trees_all_close(many.state.combined, one.state, atol=1e-9)


def test_tangent_of_a_mixture_is_its_slope_at_fixed_weights():
    rng = np.random.default_rng(10)
    weights = np.array([0.3, 0.7, 0.0])
    x, var, ln_r = rng.normal(size=3), rng.uniform(1.0, 2.0, 3), rng.normal(size=3)
    dx, dvar = rng.normal(size=(2, 3, 2))
    x[2] = np.nan  # a member that is dead has weight zero
    dvar[2] = np.nan
    stacked = SensitivityState(
        inner=wf.Gaussian(Level(jnp.asarray(x)), ((jnp.asarray(var),),)),
        tangents=wf.Gaussian(Level(jnp.asarray(dx)), ((jnp.asarray(dvar),),)),
        theta=wf.Gaussian(Shared(jnp.asarray(ln_r)), ((jnp.full(3, 0.2),),)),
    )
    filter = sensitivity(wf.extended(autoregression()), bind_shared)
    mixed = filter.mix(jnp.asarray(weights), stacked)

    def moments(h):
        w, m, v = weights[:2], (x[:, None] + h * dx)[:2], (var[:, None] + h * dvar)[:2]
        return np.array([w @ m, w @ (v + (m - w @ m) ** 2)])

    slope = (moments(1e-5) - moments(-1e-5)) / 2e-5
    found = np.array([mixed.tangents.mean.x, mixed.tangents.cov[0][0]])
    np.testing.assert_allclose(found, slope, atol=1e-9)
    mean = 0.3 * ln_r[0] + 0.7 * ln_r[1]
    spread = 0.2 + 0.3 * (ln_r[0] - mean) ** 2 + 0.7 * (ln_r[1] - mean) ** 2
    assert float(mixed.theta.mean.ln_r) == pytest.approx(mean, abs=1e-12)
    assert float(mixed.theta.cov[0][0]) == pytest.approx(spread, abs=1e-12)


def test_modes_with_their_own_level_share_one_theta_through_a_jump():
    """The level of a mode lies in its parameters, so that mixing theta does not merge modes."""
    rng = np.random.default_rng(11)
    jump, steps, runs, truth = 400, 800, 40, 0.5
    ln_q = np.where(np.arange(steps) < jump, -2.0, 4.0)
    x, ys = np.zeros(runs), np.empty((runs, steps))
    for t in range(steps):
        x = 0.9 * x + np.exp(ln_q[t] / 2) * rng.normal(size=runs)
        ys[:, t] = x + np.exp(truth / 2) * rng.normal(size=runs)

    filter = wf.interacting(sensitivity(wf.extended(autoregression()), bind_shared))
    members = Noisy(jnp.full(2, 0.9), jnp.array([-2.0, 4.0]), jnp.zeros(2))
    params = wf.InteractingParams(
        SensitivityParams(members, Shared(jnp.zeros(2))),
        jnp.array([[0.995, 0.005], [0.005, 0.995]]),
        jnp.array([0.5, 0.5]),
    )
    prior = level_prior(0.5)

    @jax.jit
    @jax.vmap
    def one(y):
        return drive.run(
            filter,
            filter.init(prior, params),
            Level(y),
            params,
            keep=lambda s, i: (s.log_probabilities, s.combined.theta),
        )

    log_probabilities, theta = one(jnp.asarray(ys))
    probability = np.exp(np.asarray(log_probabilities)).mean(0)
    assert probability[jump - 1, 0] > 0.95
    assert probability[jump + 50, 1] > 0.95
    mean, cov = map(np.asarray, wf.dense(theta))
    low, high = scipy.stats.chi2.ppf([0.0005, 0.9995], runs) / runs
    for k in (jump - 1, jump + 50, steps - 1):
        nees = np.mean((mean[:, k, 0] - truth) ** 2 / cov[:, k, 0, 0])
        assert low < nees < high, (k, nees)
    assert np.sqrt(np.mean((mean[:, jump + 50, 0] - truth) ** 2)) < 0.15


PLAIN = SensitivityParams(NOISY, Shared(1e-4))
MEMBERS = SensitivityParams(TWO_LEVELS, Shared(jnp.full(2, 1e-4)))
SCALAR = level_prior(0.3), lambda seed: levels(seed, 8)
CASES = {
    "kalman": (
        sensitivity(wf.kalman(Sensors), bind),
        SensitivityParams(MATRICES, Theta(1e-4, 0.0, 0.0)),
        track_prior(),
        lambda seed: measurements(record(seed, 8)),
    ),
    "unscented": (sensitivity(wf.unscented(autoregression()), bind_shared), PLAIN, *SCALAR),
    "of an IMM": (
        sensitivity(wf.interacting(wf.unscented(autoregression())), bind_imm),
        SensitivityParams(imm_params(TWO_LEVELS), Shared(1e-4)),
        *SCALAR,
    ),
    "in an IMM": (
        wf.interacting(sensitivity(wf.unscented(autoregression()), bind_shared)),
        imm_params(MEMBERS),
        *SCALAR,
    ),
}


@pytest.fixture(params=CASES)
def case(request):
    filter, params, prior, measure = CASES[request.param]
    params, prior = jax.tree.map(lambda a: jnp.asarray(np.asarray(a), float), (params, prior))
    return filter, params, prior, measure


def test_one_trace_serves_every_parameter_value(case):
    filter, params, prior, measure = case
    y = jax.tree.map(lambda a: a[0], measure(20))

    @jax.jit
    @chex.assert_max_traces(n=1)
    def step(state, p):
        return filter.step(state, y, p)

    chex.clear_trace_counter()
    state = filter.init(prior, params)
    for factor in (1.0, 1.1, 0.9):
        scaled = jax.tree.map(lambda a, f=factor: a * f, params)
        before, (state, _) = state, step(state, scaled)
        chex.assert_trees_all_equal_shapes_and_dtypes(before, state)


def test_lanes_equal_vmap(case):
    filter, params, prior, measure = case
    ys = jax.tree.map(lambda *a: jnp.stack(a, axis=-1), *(measure(20 + k) for k in range(3)))

    def one(y):
        found = run(filter, y, params, prior)
        return found.info, found.state

    expected = jax.jit(jax.vmap(one, in_axes=-1, out_axes=-1))(ys)
    state = jax.tree.map(
        lambda a: jnp.broadcast_to(a[..., None], (*a.shape, 3)), filter.init(prior, params)
    )
    found = jax.jit(lambda y: drive.run(filter, state, y, params))(ys)
    chex.assert_trees_all_close((found.info, found.state), expected, atol=1e-10)


@pytest.mark.parametrize(
    "case",
    ["unscented", *(pytest.param(c, marks=pytest.mark.slow) for c in ("of an IMM", "in an IMM"))],
    indirect=True,
)
def test_gradient_is_finite_and_right(case):
    filter, params, prior, measure = case
    ys = measure(23)

    @jax.jit
    def total(scale):
        def scaled(p):
            return replace(p, inner=jax.tree.map(lambda a: a * scale, p.inner))

        if isinstance(params, wf.InteractingParams):
            p = replace(params, members=scaled(params.members))
        elif isinstance(params.inner, wf.InteractingParams):
            members = jax.tree.map(lambda a: a * scale, params.inner.members)
            p = replace(params, inner=replace(params.inner, members=members))
        else:
            p = scaled(params)
        return drive.log_likelihood(filter, filter.init(prior, p), ys, p)

    slope = jax.jit(jax.grad(total))(1.0)
    expected = (total(1.0 + 1e-5) - total(1.0 - 1e-5)) / 2e-5
    assert abs(float(expected)) > 1e-3
    assert float(slope) == pytest.approx(float(expected), rel=1e-6)


def test_float32_runs_in_float32(float32, case):
    filter, params, prior, measure = case
    found = run(filter, measure(24), params, prior)
    assert {leaf.dtype for leaf in jax.tree.leaves(found.state)} == {jnp.dtype("float32")}
    assert not np.any(found.info.flags.nonfinite)


def test_a_state_may_hold_integers():
    """A counter in a filter's state has no tangent, and breaks nothing."""
    plain = wf.extended(autoregression())

    def step(state, y, params):
        belief, info = plain.step(state[0], y, params)
        return (belief, state[1] + 1), info

    counting = wf.Filter(
        init=lambda prior, params: (prior, jnp.asarray(0)),
        step=step,
        mix=lambda weights, stacked: (plain.mix(weights, stacked[0]), jnp.max(stacked[1], 0)),
    )
    ys = levels(25, 10)
    found = run(sensitivity(counting, bind_shared), ys, PLAIN, level_prior(0.3))
    expected = run(sensitivity(plain, bind_shared), ys, PLAIN, level_prior(0.3))
    np.testing.assert_array_equal(found.state.inner[1], np.arange(1, 11))
    chex.assert_trees_all_close(found.state.theta, expected.state.theta, atol=1e-14)
    two = jax.tree.map(lambda a: a[-2:], found.state)
    mixed = sensitivity(counting, bind_shared).mix(jnp.array([0.5, 0.5]), two)
    assert int(mixed.inner[1]) == 10


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_an_update_that_is_not_finite_is_skipped_and_flagged(value):
    """A tangent that overflows costs one update; theta and the next updates stand."""
    ys = levels(26, 6).x
    filter = sensitivity(wf.extended(autoregression()), bind_shared)
    state = filter.init(level_prior(0.3), PLAIN)
    lost = jax.tree.map(lambda t: jnp.full_like(t, value), state.tangents)
    after, info = filter.step(state._replace(tangents=lost), Level(ys[0]), PLAIN)
    assert info.flags.nonfinite
    assert float(after.theta.mean.ln_r) == 0.0
    assert float(after.theta.cov[0][0]) == pytest.approx(0.3**2 + 1e-4, rel=1e-12)
    again, info = filter.step(after, Level(ys[1]), PLAIN)
    assert not info.flags.nonfinite
    assert float(again.theta.cov[0][0]) < float(after.theta.cov[0][0])

    broken = state.theta._replace(cov=((jnp.asarray(np.nan),),))
    _, info = filter.step(state._replace(theta=broken), Level(ys[0]), PLAIN)
    assert info.flags.nonfinite


def test_bad_input_is_refused_before_anything_runs():
    with pytest.raises(ValueError, match=r"limit=0.0: theta could not move"):
        sensitivity(wf.kalman(Sensors), bind, limit=0.0)
    filter = sensitivity(wf.kalman(Sensors), bind)
    with pytest.raises(ValueError, match=r"walk has 2 entries .* 'damping'"):
        filter.init(track_prior(), SensitivityParams(MATRICES, (0.0, 0.0)))
    with pytest.raises(ValueError, match="prior is a Gaussian; give SensitivityPrior"):
        filter.init(track_prior().state, SensitivityParams(MATRICES, Theta(0.0, 0.0, 0.0)))
