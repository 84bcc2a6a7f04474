"""The IMM smoother by enumeration of all mode sequences, where it is exact and where not."""

import itertools
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from models import COV, MEAN, F, H, Q, R, Sensors, Track

from wheelhop.filtering import (
    InteractingParams,
    LinearGaussian,
    dense,
    drive,
    extended,
    gaussian,
    interacting,
    smallmat,
    unscented,
)
from wheelhop.filtering.evidence import positive_part
from wheelhop.filtering.interacting_smoothing import (
    interacting_extended_smoother,
    interacting_unscented_smoother,
)
from wheelhop.filtering.kalman import linear_model

MODEL = linear_model(Sensors)
PAIRS = {
    "extended": (interacting(extended(MODEL)), interacting_extended_smoother(MODEL)),
    "unscented": (interacting(unscented(MODEL)), interacting_unscented_smoother(MODEL)),
}
STIFF = F + np.array([[0.0, 0.0, 0.0], [-0.6, 0.0, 0.0], [0.0, 0.0, 0.0]])
SOFT = (F, Q, 0.1 * R)
MODES = [SOFT, (STIFF, Q, 0.1 * R), (F, 4.0 * Q, 0.2 * R)]
PZ = np.array([[0.9, 0.08, 0.02], [0.05, 0.9, 0.05], [0.1, 0.2, 0.7]])
MU = np.array([0.5, 0.3, 0.2])


def simulate(seed, modes, pz, mu, steps):
    """Modes, states and measurements of a switching linear system; pz leads into a sample."""
    rng = np.random.default_rng(seed)
    x, mode = rng.multivariate_normal(MEAN, COV), rng.choice(len(mu), p=mu)
    kept = []
    for _ in range(steps):
        mode = rng.choice(len(mu), p=pz[mode])
        f, q, r = modes[mode]
        x = f @ x + rng.multivariate_normal(np.zeros(3), q, method="eigh")
        kept.append((mode, x, H @ x + rng.multivariate_normal(np.zeros(2), r)))
    return tuple(np.array(part) for part in zip(*kept, strict=True))


def params_of(modes, pz, mu):
    f, q, r = (jnp.asarray(np.array(part)) for part in zip(*modes, strict=True))
    h = jnp.asarray(np.array([H] * len(modes)))
    return InteractingParams(
        LinearGaussian(f, h, q, r), jnp.asarray(np.array(pz)), jnp.asarray(np.array(mu))
    )


@lru_cache
def program(pair):
    filter, smoother = PAIRS[pair]

    @jax.jit
    def run(ys, params, cov):
        y, prior = Sensors(ys[:, 0], ys[:, 1]), gaussian(Track(*MEAN), cov)
        states = drive.run(filter, filter.init(prior, params), y, params, keep=lambda s, i: s)
        return states, smoother(states, params)

    return run


def smooth(pair, ys, modes, pz, mu, cov=COV):
    return program(pair)(jnp.asarray(ys), params_of(modes, pz, mu), jnp.asarray(cov))


def probabilities(state):
    return np.exp(np.asarray(state.log_probabilities))


def one_sequence(ys, steps, prior_cov=COV):
    """Posterior of all states and the evidence for one known sequence, by one dense solve.

    The states are affine in (x_0, w_1..w_T); the joint covariance is written down and
    conditioned on the samples that are present.
    """
    count = len(ys)
    rows = [np.eye(3)]
    for f, _, _ in steps:
        rows.append(np.hstack([f @ rows[-1], np.eye(3)]))
    design = np.vstack([np.pad(r, ((0, 0), (0, 3 * (count + 1) - r.shape[1]))) for r in rows[1:]])
    source = np.zeros((3 * (count + 1),) * 2)
    source[:3, :3] = prior_cov
    noise = np.zeros((2 * count,) * 2)
    for k, (_, q, r) in enumerate(steps):
        source[3 * k + 3 : 3 * k + 6, 3 * k + 3 : 3 * k + 6] = q
        noise[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = r
    mean, cov = design[:, :3] @ MEAN, design @ source @ design.T
    here = np.isfinite(ys.ravel())
    observe = np.kron(np.eye(count), H)[here]
    s = observe @ cov @ observe.T + noise[np.ix_(here, here)]
    residual = ys.ravel()[here] - observe @ mean
    gain = cov @ observe.T @ np.linalg.inv(s)
    nis = residual @ np.linalg.solve(s, residual)
    evidence = -0.5 * (nis + np.linalg.slogdet(2 * np.pi * s)[1])
    spread = cov - gain @ s @ gain.T
    blocks = [spread[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] for k in range(count)]
    return (mean + gain @ residual).reshape(count, 3), np.array(blocks), evidence


def mixture(weights, means, covs):
    mean = np.tensordot(weights, means, 1)
    spread = means - mean
    return mean, np.tensordot(weights, covs + spread[..., :, None] * spread[..., None, :], 1)


def enumerate_modes(ys, modes, pz, mu, prior_cov):
    """Exact P(m_k | record), E[x_k | record] and Cov[x_k | record] over all mode sequences."""
    logs, sequences, means, covs = [], [], [], []
    for sequence in itertools.product(range(len(modes)), repeat=len(ys)):
        switches = [pz[a, b] for a, b in itertools.pairwise(sequence)]
        chance = (mu @ pz)[sequence[0]] * np.prod(switches)
        if chance > 0:
            mean, cov, evidence = one_sequence(ys, [modes[m] for m in sequence], prior_cov)
            logs.append(np.log(chance) + evidence)
            sequences.append(sequence)
            means.append(mean)
            covs.append(cov)
    weights = np.exp(np.array(logs) - max(logs))
    weights /= weights.sum()
    here = np.array(sequences)[:, :, None] == np.arange(len(modes))
    return np.tensordot(weights, here, 1), *mixture(weights, np.array(means), np.array(covs))


def test_one_mode_is_the_dense_solve_of_the_record():
    _, _, ys = simulate(0, [SOFT], np.ones((1, 1)), np.ones(1), 12)
    ys[4], ys[7, 1] = np.nan, np.nan
    _, smoothed = smooth("extended", ys, [SOFT], [[1.0]], [1.0])
    means, covs, _ = one_sequence(ys, [SOFT] * 12)
    mean, cov = dense(smoothed.combined)
    np.testing.assert_allclose(mean, means, atol=1e-10)
    np.testing.assert_allclose(cov, covs, atol=1e-10)
    np.testing.assert_allclose(smoothed.log_probabilities, 0.0, atol=1e-12)


@pytest.mark.parametrize("pair", PAIRS)
def test_equal_modes_are_the_dense_solve_and_follow_the_markov_chain(pair):
    _, _, ys = simulate(1, [SOFT], np.ones((1, 1)), np.ones(1), 12)
    ys[5] = np.nan
    _, smoothed = smooth(pair, ys, [SOFT] * 3, PZ, MU)
    means, covs, _ = one_sequence(ys, [SOFT] * 12)
    for member in range(3):
        mean, cov = dense(jax.tree.map(lambda leaf, i=member: leaf[:, i], smoothed.members))
        np.testing.assert_allclose(mean, means, atol=1e-10)
        np.testing.assert_allclose(cov, covs, atol=1e-10)
    np.testing.assert_allclose(dense(smoothed.combined)[1], covs, atol=1e-10)
    chain = [MU @ np.linalg.matrix_power(PZ, k) for k in range(1, 13)]
    np.testing.assert_allclose(probabilities(smoothed), chain, atol=1e-12)


@pytest.mark.parametrize("pair", PAIRS)
def test_modes_that_never_switch_are_a_bayesian_mixture_of_dense_solves(pair):
    _, _, ys = simulate(2, MODES, np.eye(3), MU, 12)
    ys[6] = np.nan
    _, smoothed = smooth(pair, ys, MODES, np.eye(3), MU)
    solves = [one_sequence(ys, [mode] * 12) for mode in MODES]
    weights = MU * np.exp([evidence - solves[0][2] for _, _, evidence in solves])
    weights /= weights.sum()
    np.testing.assert_allclose(probabilities(smoothed), np.tile(weights, (12, 1)), atol=1e-10)
    mean, cov = dense(smoothed.members)
    np.testing.assert_allclose(mean, np.stack([s[0] for s in solves], 1), atol=1e-10)
    np.testing.assert_allclose(cov, np.stack([s[1] for s in solves], 1), atol=1e-10)
    expected = mixture(weights, *(np.array([s[k] for s in solves]) for k in (0, 1)))
    for found, value in zip(dense(smoothed.combined), expected, strict=True):
        np.testing.assert_allclose(found, value, atol=1e-10)


KNOWN_BIAS = COV * np.outer([1.0, 1.0, 0.0], [1.0, 1.0, 0.0])
TIE = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.5, -0.3, 0.0]])


PRIORS = {
    "full": (COV, [0.025, 0.025, 0.015]),
    "known bias": (KNOWN_BIAS, [0.03, 0.015, 0.02]),
    "tied": (TIE @ COV @ TIE.T, [0.01, 0.055, 0.05]),
}


@pytest.mark.parametrize("prior", PRIORS)
def test_switching_modes_are_close_to_the_full_enumeration(prior):
    """The IMM merges histories, so this is an approximation; its gaps are those measured.

    Largest over the records: mode probability 0.024, 0.026, 0.007 (the filter: 0.54 to 0.61),
    mean 0.022, 0.012, 0.052 of the exact posterior's sigma (1.4 to 3.1), sigma 1.3 to 4.6 %.
    """
    cov, limits = PRIORS[prior]
    gaps = []
    for seed in (13, 14, 15):
        _, _, ys = simulate(seed, MODES, PZ, MU, 5)
        exact = enumerate_modes(ys, MODES, PZ, MU, cov)
        gaps.append([gap(state, exact) for state in smooth("extended", ys, MODES, PZ, MU, cov)])
    filtered, smoothed = np.max(gaps, 0)
    assert np.all(smoothed < limits)
    assert np.all(smoothed < 0.1 * filtered)


def gap(state, exact):
    """Largest gaps of mode probability, mean and standard deviation, the latter in sigmas."""
    chance, mean, cov = exact
    found, spread = (np.asarray(part) for part in dense(state.combined))
    sigma = np.sqrt(np.einsum("kii->ki", cov))
    sigma = np.where(sigma > 1e-9, sigma, np.inf)  # of an exactly known component: no gap
    ratio = np.where(np.isfinite(sigma), np.sqrt(np.einsum("kii->ki", spread)) / sigma, 1.0)
    return (
        np.abs(probabilities(state) - chance).max(),
        (np.abs(found - mean) / sigma).max(),
        np.abs(ratio - 1.0).max(),
    )


@lru_cache
def monte_carlo():
    """200 runs of 60 samples of a switching system, in one batch."""
    runs = [simulate(100 + run, MODES, PZ, MU, 60) for run in range(200)]
    modes, xs, ys = (np.array(part) for part in zip(*runs, strict=True))
    batch = jax.vmap(program("extended"), in_axes=(0, None, None))
    filtered, smoothed = batch(jnp.asarray(ys), params_of(MODES, PZ, MU), jnp.asarray(COV))
    return modes, xs, filtered, smoothed


def test_smoothing_lowers_the_error_of_state_and_mode_over_200_runs():
    modes, xs, filtered, smoothed = monte_carlo()
    truth = modes[..., None] == np.arange(3)
    square, brier, wrong = [], [], []
    for state in (filtered, smoothed):
        square.append(np.mean((np.asarray(dense(state.combined)[0]) - xs) ** 2, axis=(0, 1)))
        brier.append(np.mean((probabilities(state) - truth) ** 2))
        wrong.append(np.mean(np.argmax(probabilities(state), -1) != modes))
    # measured: mean squares 0.37, 0.48 and 0.29 of the filter's; Brier score 0.72; wrong 0.71
    assert np.all(square[1] < [0.4, 0.52, 0.32] * square[0])
    assert brier[1] < 0.78 * brier[0]
    assert wrong[1] < 0.78 * wrong[0]


def test_smoothed_covariance_and_probabilities_are_honest_over_200_runs():
    """E[e^T P^-1 e] = 3 for a posterior of any shape; a probability is a frequency."""
    modes, xs, _, smoothed = monte_carlo()
    mean, cov = (np.asarray(part) for part in dense(smoothed.combined))
    error = xs - mean
    nees = np.einsum("rki,rki->rk", error, np.linalg.solve(cov, error[..., None])[..., 0])
    per_run = nees.mean(1)
    assert abs(per_run.mean() - 3.0) < 4 * per_run.std() / np.sqrt(200)
    chance, truth = probabilities(smoothed), modes[..., None] == np.arange(3)
    for low in np.arange(0.0, 1.0, 0.2):
        here = (chance >= low) & (chance < low + 0.2)
        assert abs(chance[here].mean() - truth[here].mean()) < 0.03


def test_a_permutation_of_the_modes_permutes_the_result():
    _, _, ys = simulate(3, MODES, PZ, MU, 12)
    order = np.array([2, 0, 1])
    _, plain = smooth("extended", ys, MODES, PZ, MU)
    shuffled = [MODES[i] for i in order]
    _, permuted = smooth("extended", ys, shuffled, PZ[np.ix_(order, order)], MU[order])
    np.testing.assert_allclose(probabilities(permuted), probabilities(plain)[:, order], atol=1e-12)
    for found, value in zip(dense(permuted.members), dense(plain.members), strict=True):
        np.testing.assert_allclose(found, value[:, order], atol=1e-12)
    for found, value in zip(dense(permuted.combined), dense(plain.combined), strict=True):
        np.testing.assert_allclose(found, value, atol=1e-12)


def test_impossible_switches_and_modes_keep_exact_zeros():
    """Mode 2 is never entered and mode 0 never left to 2: as the two other modes alone."""
    pz = np.array([[0.9, 0.1, 0.0], [0.0, 1.0, 0.0], [0.3, 0.3, 0.4]])
    _, _, ys = simulate(4, MODES[:2], pz[:2, :2], np.array([1.0, 0.0]), 12)
    _, smoothed = smooth("extended", ys, MODES, pz, [1.0, 0.0, 0.0])
    found = probabilities(smoothed)
    np.testing.assert_array_equal(found[:, 2], 0.0)
    assert np.all(np.diff(found[:, 1]) > -1e-9)  # what cannot be left only gains
    _, alone = smooth("extended", ys, MODES[:2], pz[:2, :2], [1.0, 0.0])
    np.testing.assert_allclose(found[:, :2], probabilities(alone), atol=1e-12)
    for value, expected in zip(dense(smoothed.combined), dense(alone.combined), strict=True):
        np.testing.assert_allclose(value, expected, atol=1e-12)
    assert np.isfinite(dense(smoothed.members)[0]).all()


def test_a_dead_member_is_as_if_it_were_not_there():
    _, _, ys = simulate(5, MODES, PZ, MU, 12)
    dead = (F, np.nan * Q, R)
    _, smoothed = smooth("extended", ys, [MODES[0], dead, MODES[1]], PZ, MU)
    np.testing.assert_array_equal(probabilities(smoothed)[:, 1], 0.0)
    np.testing.assert_allclose(probabilities(smoothed).sum(1), 1.0, atol=1e-12)
    assert all(np.isfinite(part).all() for part in dense(smoothed.combined))


def test_a_component_known_exactly_stays_known():
    """No variance and no noise on the bias: every prediction is singular."""
    cov = COV.copy()
    cov[2] = cov[:, 2] = 0.0
    _, _, ys = simulate(6, MODES, PZ, MU, 12)
    ys[3] = np.nan
    _, smoothed = smooth("extended", ys, MODES, PZ, MU, cov)
    assert np.all(np.asarray(smoothed.combined.cov[2][2]) < 1e-20)
    bias = MEAN[2] * 0.99 ** np.arange(1, 13)
    np.testing.assert_allclose(smoothed.combined.mean.bias, bias, atol=1e-12)
    np.testing.assert_allclose(probabilities(smoothed).sum(1), 1.0, atol=1e-12)


class Drift(NamedTuple):
    level: Any
    rate: Any


class Level(NamedTuple):
    level: Any


@pytest.mark.slow  # compiling the reverse mode of filter and smoother
def test_gradient_is_that_of_finite_differences_where_all_is_degenerate():
    """Singular prior and noise, a missing sample, impossible switches, a mode that cannot be."""
    model = linear_model(Level)
    filter, smoother = interacting(extended(model)), interacting_extended_smoother(model)
    start = gaussian(Drift(0.2, 0.3), jnp.array([[1.0, 0.0], [0.0, 0.0]]))
    ys = Level(jnp.asarray(np.random.default_rng(7).normal(size=10)).at[3].set(jnp.nan))
    pz = jnp.array([[0.9, 0.1, 0.0], [0.2, 0.8, 0.0], [0.3, 0.3, 0.4]])
    f = jnp.array([[[1.0, 0.1], [0.0, 0.9]], [[0.6, 0.1], [0.0, 0.9]], [[0.1, 0.0], [0.0, 1.0]]])
    h, r = jnp.array([[[1.0, 0.2]]] * 3), jnp.full((3, 1, 1), 0.1)
    q = jnp.zeros((3, 2, 2)).at[:, 0, 0].set(jnp.array([0.1, 0.4, 1.0]))

    @jax.jit
    def total(knobs):
        noise, stay = knobs
        switch = pz.at[0, 0].multiply(stay).at[0, 1].add(0.9 * (1.0 - stay))
        params = InteractingParams(
            LinearGaussian(f, h, noise * q, r), switch, jnp.array([1.0, 0.0, 0.0])
        )
        states = drive.run(filter, filter.init(start, params), ys, params, keep=lambda s, i: s)
        smoothed = smoother(states, params)
        mean, cov = dense(smoothed.combined)
        return jnp.sum(jnp.exp(smoothed.log_probabilities[:, 1])) + jnp.sum(mean) + jnp.sum(cov)

    gradient = jax.jit(jax.grad(total))(jnp.ones(2))
    for k, knob in enumerate(1e-5 * np.eye(2)):
        difference = float((total(1.0 + knob) - total(1.0 - knob)) / 2e-5)
        assert abs(difference) > 1e-3
        assert float(gradient[k]) == pytest.approx(difference, rel=1e-6)


def test_float32_agrees_with_float64():
    _, _, ys = simulate(8, MODES, PZ, MU, 12)
    _, double = smooth("extended", ys, MODES, PZ, MU)
    with jax.enable_x64(False):
        _, single = smooth("extended", ys, MODES, PZ, MU)
    assert {leaf.dtype for leaf in jax.tree.leaves(single)} == {jnp.dtype("float32")}
    np.testing.assert_allclose(probabilities(single), probabilities(double), atol=1e-3)
    sigma = np.sqrt(np.einsum("kii->ki", np.asarray(dense(double.combined)[1])))
    gap = np.abs(np.asarray(dense(single.combined)[0]) - np.asarray(dense(double.combined)[0]))
    assert np.max(gap / sigma) < 1e-2


def test_runs_in_trailing_lanes_equal_each_run():
    """Every operation is elementwise over trailing axes: no vmap, the runs last."""
    _, smoother = PAIRS["extended"]
    each = []
    for seed in (9, 10):
        _, _, ys = simulate(seed, MODES, PZ, MU, 12)
        each.append(smooth("extended", ys, MODES, PZ, MU))
    lanes = jax.tree.map(lambda *leaves: jnp.stack(leaves, -1), *[states for states, _ in each])
    found = smoother(lanes, params_of(MODES, PZ, MU))
    for k, (_, expected) in enumerate(each):
        lane = jax.tree.map(lambda leaf, k=k: leaf[..., k], found)
        for a, b in zip(jax.tree.leaves(lane), jax.tree.leaves(expected), strict=True):
            np.testing.assert_allclose(a, b, atol=1e-12)


def test_inputs_that_vary_in_time_are_those_of_the_filter():
    _, _, ys = simulate(11, MODES, PZ, MU, 12)
    states, _ = smooth("extended", ys, MODES, PZ, MU)
    _, smoother = PAIRS["extended"]
    factors = jnp.linspace(0.5, 2.0, 12)

    def bind(params, factor):
        f, h, q, r = (getattr(params.members, name) for name in LinearGaussian.__annotations__)
        return InteractingParams(
            LinearGaussian(f, h, factor * q, r), params.transition, params.initial
        )

    params = params_of(MODES, PZ, MU)
    found = smoother(states, params, inputs=factors, bind=bind)
    # by hand: the step into the last sample, with its own factor
    last_two = jax.tree.map(lambda leaf: leaf[-2:], states)
    by_hand = smoother(last_two, bind(params, factors[-1]))
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(by_hand), strict=True):
        np.testing.assert_allclose(a[-2:], b, atol=1e-13)


@pytest.mark.parametrize("seed", range(4))
def test_evidence_that_is_no_covariance_is_cut_to_one(seed):
    """A merged next state may be wider than its prediction: that is no information."""
    rng = np.random.default_rng(seed)
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    for values in ([0.9, 0.5, 0.1], [0.9, 0.3, -0.4], [0.5, -0.1, -2.0], [1e-3, -1e-3, 0.5]):
        matrix = axes @ np.diag(values) @ axes.T
        lower = smallmat.from_dense(jnp.asarray(matrix))
        factor = np.tril(smallmat.to_dense(positive_part(lower)))
        product = factor @ factor.T
        assert np.all(np.diag(product) <= np.maximum(np.diag(matrix), 0.0) + 1e-12)
        if min(values) > 0:
            np.testing.assert_allclose(product, matrix, atol=1e-12)
