"""The axle pair against a Kalman filter of the two corners in NumPy, and against lone corners."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg

import wheelhop.filtering as wf
from wheelhop.errors import InputError
from wheelhop.estimators.axle_pair import GROUP_DELAY, axle_pair
from wheelhop.estimators.axle_pair_model import PairSample
from wheelhop.estimators.axle_pair_settings import (
    AxlePairTuning,
    PairTheta,
    axle_pair_params,
    axle_pair_prior,
    read_pair,
    read_pair_theta,
)
from wheelhop.estimators.road_model import RoadModelParams, corner_on_road, prior
from wheelhop.estimators.stiffness import StiffnessTuning
from wheelhop.filtering import drive
from wheelhop.vehicle.parameters import brancati_suv
from wheelhop.vehicle.quarter_car import Accelerations

DT, SPEED, SAMPLES = 0.002, 20.0, 600
WHEELBASE = 0.65
LEVEL = 8e-6
NOISE = 0.5
CARS = [
    replace(c, suspension=replace(c.suspension, cubic_stiffness=0.0, quadratic_damping=0.0))
    for c in (brancati_suv("front"), brancati_suv("rear"))
]
LN_K = np.log([210e3, 235e3])
REST = np.array([0.02, 0.01, 0.3, 1.0])
FROZEN = AxlePairTuning(
    corner=StiffnessTuning(stiffness_walk=0.0),
    bandwidth=40.0,
    speed_sigma=0.0,
    speed_forgetting=0.0,
)
SIGMA = PairTheta(1e-5, 1e-5, 1e-5, 1e-7, 1e-5)
FILTER = axle_pair(DT, 0.05)


def corner(car, k_t):
    """A, direction of the road's velocity and C of a linear corner: d, e, v_s, v_u."""
    m_s, m_u = car.sprung_mass, car.unsprung_mass
    k, c = car.suspension.stiffness, car.suspension.damping
    force = np.array([k, 0.0, c, -c])
    a_s, a_u = -force / m_s, (force - np.array([0.0, k_t, 0.0, 0.0])) / m_u
    a = np.array([[0, 0, 1, -1], [0, 0, 0, 1], a_s, a_u])
    return a, np.array([0.0, -1.0, 0.0, 0.0]), np.array([a_s, a_u])


def discrete(a, b, dt):
    """Transition and noise covariance after dt, noise of unit intensity (Van Loan 1978)."""
    n = len(a)
    block = scipy.linalg.expm(np.block([[-a, b @ b.T], [np.zeros((n, n)), a.T]]) * dt)
    f = block[n:, n:].T
    return f, f @ block[:n, n:]


def oracle(front, rear, theta, coherence, tuning):
    """log-likelihood of both records, one sample after the other in the clock of the road."""
    level = tuning.corner.prior_level * np.exp(theta[2])
    q = np.pi * level * SPEED
    odds = (1 - coherence**2) * np.exp(theta[4])
    whole = np.sqrt(coherence**2 + odds)
    gamma, own, band = coherence / whole, np.sqrt(odds) / whole, 2 * np.pi * tuning.bandwidth
    (a_f, d_f, c_f), (a_r, d_r, c_r) = (
        corner(car, np.exp(k)) for car, k in zip(CARS, theta[:2], strict=True)
    )
    a = scipy.linalg.block_diag(a_f, a_r, -band)
    a[4:8, 8] = d_r
    b = np.zeros((9, 2))
    b[:4, 0], b[8, 0] = d_f, gamma * band
    b[4:8, 1], b[8, 1] = d_r, -band * (1.0 - own)
    reach = WHEELBASE * np.exp(-theta[3]) - SPEED * GROUP_DELAY / band
    late = int(np.ceil(reach / (SPEED * DT)))
    part = (reach / (SPEED * DT) - (late - 1)) * DT
    pieces = [discrete(a, np.sqrt(q) * b, dt) for dt in (part, DT - part)]
    alone = discrete(a_r, np.sqrt(q) * d_r[:, None], DT)
    c = np.zeros((4, 9))
    c[:2, :4], c[2:, 4:8] = c_f, c_r
    mean, cov, total = np.zeros(9), np.diag(np.r_[REST, REST, 0.0] ** 2), 0.0

    def update(mean, cov, rows, y):
        here = np.isfinite(y)
        rows, y = rows[here], y[here]
        if not len(y):
            return mean, cov, 0.0
        s = rows @ cov @ rows.T + NOISE**2 * np.eye(len(y))
        r = y - rows @ mean
        gain = np.linalg.solve(s, rows @ cov).T
        fit = -0.5 * (r @ np.linalg.solve(s, r) + np.linalg.slogdet(2 * np.pi * s)[1])
        return mean + gain @ r, cov - gain @ rows @ cov, fit

    for n in range(len(rear)):
        if n < late:
            f, noise = alone
            mean[4:8] = f @ mean[4:8]
            cov[4:8, 4:8] = f @ cov[4:8, 4:8] @ f.T + noise
        else:
            f, noise = pieces[0]
            mean, cov, fit = update(f @ mean, f @ cov @ f.T + noise, c[:2], front[n - late])
            total += fit
            f, noise = pieces[1]
            mean, cov = f @ mean, f @ cov @ f.T + noise
        mean, cov, fit = update(mean, cov, c[2:], rear[n])
        total += fit
    return total


def records(seed, coherence, level=LEVEL, delay=WHEELBASE / SPEED, fine=10):
    """Accelerations [time, 2] of both corners on one road, rear `delay` [s] later."""
    rng = np.random.default_rng(seed)
    step, shift = DT / fine, round(delay / DT * fine)
    warm = SAMPLES * fine
    count = 2 * warm + shift
    road, other = rng.standard_normal((2, count)) * np.sqrt(np.pi * level * SPEED / step)
    under = (road, coherence * np.roll(road, shift) + np.sqrt(1 - coherence**2) * other)
    ys = []
    for car, k, velocity in zip(CARS, LN_K, under, strict=True):
        a, d, c = corner(car, np.exp(k))
        block = scipy.linalg.expm(np.block([[a, d[:, None]], [np.zeros((1, 5))]]) * step)
        x, out = np.zeros(4), []
        for i in range(shift, count):
            x = block[:4, :4] @ x + block[:4, 4] * velocity[i]
            if (i - shift) % fine == fine - 1:
                out.append(c @ x)
        ys.append(np.array(out)[-SAMPLES:] + NOISE * rng.standard_normal((SAMPLES, 2)))
    return ys


def sample(front, rear, dtype=float):
    return PairSample(
        *(Accelerations(*(jnp.asarray(y[:, i], dtype) for i in range(2))) for y in (front, rear))
    )


def params_of(coherence, tuning=FROZEN, cars=CARS, wheelbase=WHEELBASE, speed=SPEED):
    return axle_pair_params(*cars, wheelbase, speed, coherence, DT, tuning)


def frozen_prior(params, theta):
    """theta known but for so little that its move is the score times the variance."""
    start = axle_pair_prior(params, FROZEN)
    return start._replace(theta=wf.independent(PairTheta(*theta), SIGMA))


@jax.jit
def filtered(priors, ys, params):
    def one(prior, y, p):
        return drive.scan(
            FILTER,
            FILTER.init(prior, p),
            y,
            p,
            keep=lambda state, info: (info.log_likelihood, info.flags),
        )

    return jax.vmap(one)(priors, ys, params)


def stacked(*trees):
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *trees)


THETA = np.array([*LN_K, 0.1, 0.0, 0.2])
COHERENCE = 0.95


@pytest.fixture(scope="module")
def runs():
    """Final state, log-likelihoods and flags of all cases, filtered together: one compilation."""
    front, rear = records(0, COHERENCE)
    gaps = [y.copy() for y in (front, rear)]
    for seed, y in enumerate(gaps):
        y[np.random.default_rng(seed).random(y.shape) < 0.1] = np.nan
    gaps[0][200:230] = gaps[1][215] = gaps[1][220] = np.nan
    known = params_of(COHERENCE)
    cars = (brancati_suv("front"), brancati_suv("rear"))
    # the front's samples fall on the rear's
    aligned = SPEED * (16 * DT - 1e-7 + GROUP_DELAY / (2 * np.pi * FROZEN.bandwidth))
    apart = params_of(0.0, cars=cars, wheelbase=aligned)
    free = AxlePairTuning()
    fast = params_of(COHERENCE, free, speed=SPEED * 1.02)
    cases = {
        "known": (frozen_prior(known, THETA), sample(front, rear), known),
        "gaps": (frozen_prior(known, THETA), sample(*gaps), known),
        "apart": (frozen_prior(apart, [*LN_K, 0.0, 0.0, 0.0]), sample(front, rear), apart),
        "free": (axle_pair_prior(fast, free), sample(front, rear), fast),
    }
    found = filtered(*(stacked(*trees) for trees in zip(*cases.values(), strict=True)))
    results = {name: jax.tree.map(lambda leaf, i=i: leaf[i], found) for i, name in enumerate(cases)}
    return results, (front, rear), gaps


def test_log_likelihood_is_that_of_the_joint_kalman_filter(runs):
    results, (front, rear), _ = runs
    expected = oracle(front, rear, THETA, COHERENCE, FROZEN)
    assert np.sum(results["known"][1][0]) == pytest.approx(expected, abs=0.05)
    # the tolerance is much less than what the likelihood tells
    off = THETA + np.array([0.05, -0.05, 0.0, 0.0, 0.0])
    assert abs(oracle(front, rear, off, COHERENCE, FROZEN) - expected) > 2.0


def test_score_is_the_slope_of_that_likelihood(runs):
    results, (front, rear), _ = runs
    state = results["known"][0]
    moved = np.array(read_pair_theta(state).mean) - THETA
    for i, h in enumerate((1e-3, 1e-3, 1e-3, 1e-5, 1e-3)):
        above, below = (
            oracle(front, rear, THETA + s * h * np.eye(5)[i], COHERENCE, FROZEN) for s in (1, -1)
        )
        expected = (above - below) / (2 * h)
        assert moved[i] / SIGMA[i] ** 2 == pytest.approx(expected, rel=0.02, abs=0.3), i


def test_missing_samples_are_left_out_of_the_likelihood(runs):
    results, _, gaps = runs
    _, (found, flags) = results["gaps"]
    assert np.sum(found) == pytest.approx(oracle(*gaps, THETA, COHERENCE, FROZEN), abs=0.05)
    assert int(np.max(flags.missing)) == 4
    assert not np.any(flags.nonfinite)


def test_without_coherence_it_is_two_lone_corners(runs):
    results, (front, rear), _ = runs
    lone = wf.extended(corner_on_road(False))
    total = 0.0
    for axle, ln_k, y in (("front", LN_K[0], front[:-16]), ("rear", LN_K[1], rear)):
        car = brancati_suv(axle)
        car = replace(car, tire=replace(car.tire, stiffness=float(np.exp(ln_k))))
        p = RoadModelParams(car, LEVEL, 2.0, NOISE, NOISE, SPEED, car.tire.nominal_pressure, DT)
        p = jax.tree.map(lambda a: jnp.asarray(a, float), p)
        padded = np.full((SAMPLES, 2), np.nan)
        padded[: len(y)] = y
        ys = Accelerations(jnp.asarray(padded[:, 0]), jnp.asarray(padded[:, 1]))
        total += float(_lone_likelihood(lone, prior(p, False), ys, p))
    assert float(np.sum(results["apart"][1][0])) == pytest.approx(total, abs=0.1)


def _lone_likelihood(filter, start, ys, params):
    return jax.jit(lambda s, y, p: drive.log_likelihood(filter, s, y, p))(start, ys, params)


def test_finds_delay_and_stiffness_from_a_wrong_speed(runs):
    results, _, _ = runs
    theta = read_pair_theta(results["free"][0])
    sigma = [float(np.sqrt(row[-1])) for row in theta.cov]
    assert sigma[3] < 0.004
    assert abs(float(theta.mean.ln_speed) + np.log(1.02)) < 4.0 * sigma[3]
    pair = read_pair(results["free"][0])
    for found, truth, row in zip(pair.mean, LN_K, pair.cov, strict=True):
        assert abs(float(found) - truth) < 4.0 * float(np.sqrt(row[-1]))


@pytest.mark.slow
def test_single_precision_follows_double(runs):
    results, (front, rear), _ = runs
    free = AxlePairTuning()
    params = params_of(COHERENCE, free, speed=SPEED * 1.02)
    single = [
        jax.tree.map(lambda a: a.astype(jnp.float32)[None], tree)
        for tree in (axle_pair_prior(params, free), sample(front, rear), params)
    ]
    state, (likelihood, flags) = filtered(*single)
    assert likelihood.dtype == jnp.float32
    assert not np.any(flags.nonfinite)
    double = read_pair(results["free"][0])
    for found, expected, row in zip(read_pair(state).mean, double.mean, double.cov, strict=True):
        assert abs(float(found[0]) - float(expected)) < 0.2 * float(np.sqrt(row[-1]))


@pytest.mark.parametrize(
    ("build", "field"),
    [
        (lambda: axle_pair(0.01), "dt"),
        (lambda: axle_pair(DT, 0.001), "longest_delay"),
        (lambda: params_of(1.2), "coherence"),
        (lambda: params_of(0.9, wheelbase=0.0), "wheelbase"),
        (lambda: params_of(0.9, AxlePairTuning(bandwidth=0.0)), "tuning.bandwidth"),
    ],
)
def test_refuses_what_cannot_be(build, field):
    with pytest.raises(InputError) as error:
        build()
    assert error.value.field == field


def test_is_no_member_of_a_mixture():
    params = params_of(0.9)
    state = FILTER.init(axle_pair_prior(params, FROZEN), params)
    with pytest.raises(ValueError, match="member of an IMM"):
        FILTER.mix(jnp.ones(2), state)
