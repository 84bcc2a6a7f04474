"""Fusion of lateral and vertical estimators: brute force, limits, symmetry, calibration."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from wheelhop.errors import InputError
from wheelhop.estimators.failure_modes import level_table, mode_of
from wheelhop.estimators.lateral_fusion import fuse, fusion_params
from wheelhop.estimators.pressure import StiffnessBelief, ln_stiffness
from wheelhop.estimators.vertical_evidence import (
    VerticalEvidence,
    no_evidence,
    vertical_evidence,
    walked,
)
from wheelhop.vehicle.tire import Tire

K0, P0, C = 250e3, 230e3, 0.7
TIRE = Tire(K0, P0, C)
LEVELS = (150e3, 230e3)
PARAMS = fusion_params(LEVELS, TIRE, spread=15e3)
TABLE = level_table(2)
SOUND = np.log(K0)
ONES = np.ones((4, 4))
COV = 0.02**2 * np.eye(4) + 0.03**2 * ONES
PRIOR = StiffnessBelief(jnp.full(4, SOUND - 0.1), 0.15**2 * jnp.eye(4))

evidence_of = jax.jit(vertical_evidence)
fused_of = jax.jit(fuse)
evidence_of_all = jax.jit(jax.vmap(vertical_evidence, in_axes=(0, None)))
evidence_less_prior = jax.jit(jax.vmap(vertical_evidence, in_axes=(0, None, None)))
fused_of_all = jax.jit(jax.vmap(fuse, in_axes=(0, 0, None)))


def stiffness_at(pressure):
    """The law in plain NumPy."""
    return K0 * (1.0 + C * (np.asarray(pressure) / P0 - 1.0))


def pressure_at(ln_k):
    return P0 * (1.0 + (np.exp(ln_k) / K0 - 1.0) / C)


def belief_at(pressure, cov=COV):
    return StiffnessBelief(jnp.log(stiffness_at(pressure)), jnp.asarray(cov))


def random_modes(seed):
    return np.log(np.random.default_rng(seed).dirichlet(np.full(16, 0.5)))


def test_two_tyres_by_brute_force():
    """Riemann sums over ln k_t of the front tyres; the rear ones are exactly at their levels."""
    lateral, prior = random_modes(1), np.exp(random_modes(2))
    x = np.linspace(SOUND - 0.6, SOUND + 0.4, 201)
    # halfway between two points, so that no cell of the sums is cut
    low = float(pressure_at(0.5 * (x[92] + x[93])))
    params = fusion_params(LEVELS, TIRE, spread=15e3, prior=prior, low=low)
    params = replace(params, spread=params.spread.at[:, 2:].set(0.0))
    mean = np.log(stiffness_at([175e3, 215e3, 190e3, 225e3]))
    cov = COV + np.diag([0.0, 3e-4, 1e-4, 0.0])
    before = np.log(stiffness_at(200e3)), 0.2**2 * np.eye(4) + 0.1**2 * ONES

    spots = np.stack(np.meshgrid(x, x, indexing="ij"), -1).reshape(-1, 2)
    level = np.log(stiffness_at(LEVELS))
    spread = C * K0 / P0 * 15e3 / stiffness_at(LEVELS)
    weights, unfused = [], []
    for h, row in enumerate(TABLE):
        a, d = level[row[:2]], spread[row[:2]]
        at = np.concatenate([spots, np.tile(level[row[2:]], (len(spots), 1))], axis=1)
        density = np.exp(-0.5 * np.sum(((spots - a) / d) ** 2, 1)) / np.prod(d)
        likely = np.zeros(len(spots))
        for sign, m, p in ((-0.5, mean, cov), (0.5, before[0], before[1])):
            likely += sign * np.einsum("ni,ij,nj->n", at - m, np.linalg.inv(p), at - m)
        weights.append(np.exp(lateral[h]) * density * np.exp(likely))
        unfused.append(prior[h] * density * np.exp(likely))
    weights, unfused = np.array(weights), np.array(unfused)
    total = weights.sum()
    over = weights.sum(0) / total
    p = pressure_at(spots)
    expected = over @ p
    expected_sd = np.sqrt(over @ (p - expected) ** 2)

    evidence = vertical_evidence(
        StiffnessBelief(jnp.asarray(mean), jnp.asarray(cov)),
        params.reference,
        StiffnessBelief(jnp.full(4, before[0]), jnp.asarray(before[1])),
    )
    found = fused_of(jnp.asarray(lateral), evidence, params)
    np.testing.assert_allclose(np.exp(found.log_probabilities), weights.sum(1) / total, atol=1e-9)
    np.testing.assert_allclose(found.pressure[:2], expected, rtol=1e-9)
    np.testing.assert_allclose(found.pressure_sd[:2], expected_sd, rtol=1e-7)
    np.testing.assert_allclose(found.low[:2], over @ (p < low), atol=1e-3)
    assert 0.2 < found.low[0] < 0.95
    np.testing.assert_allclose(found.stiffness.mean[:2], over @ spots, rtol=1e-9)
    off = spots - over @ spots
    np.testing.assert_allclose(found.stiffness.cov[:2, :2], (off.T * over) @ off, rtol=1e-7)
    np.testing.assert_allclose(found.agreement, np.log(total / unfused.sum()), atol=1e-9)
    rear = weights.sum(1) / total @ pressure_at(level[TABLE[:, 2:]])
    np.testing.assert_allclose(found.pressure[2:], rear, rtol=1e-9)


def test_without_a_vertical_estimator_the_lateral_one_remains():
    """A smooth road: infinite variances, or beliefs that are no numbers."""
    lateral = random_modes(3)
    for cov, mean in ((np.inf, SOUND), (np.nan, SOUND), (1e-4, np.nan)):
        belief = StiffnessBelief(jnp.full(4, mean), jnp.full((4, 4), cov))
        evidence = evidence_of(belief, PARAMS.reference)
        found = fused_of(jnp.asarray(lateral), evidence, PARAMS)
        np.testing.assert_allclose(found.log_probabilities, lateral, rtol=1e-12)
        for entry in (found.agreement, found.distance, found.degrees, found.gap):
            np.testing.assert_allclose(entry, np.zeros_like(entry), atol=1e-12)
    np.testing.assert_array_equal(evidence.matrix, no_evidence(PARAMS.reference).matrix)
    soft = np.exp(lateral) @ (TABLE == 0)
    between = (pressure_at(SOUND) - 150e3) * soft
    # the mean of a lognormal lies a little above its median
    np.testing.assert_allclose(found.pressure, 230e3 - between, rtol=8e-3)
    assert (np.asarray(found.pressure) > 230e3 - between).all()


def test_straight_ahead_the_vertical_estimator_remains():
    """A lateral estimator that tells nothing, of levels that stand for any pressure."""
    wide = replace(PARAMS, spread=jnp.full((16, 4), 1e3))
    belief = belief_at([180e3, 230e3, 225e3, 200e3])
    evidence = evidence_of(belief, wide.reference)
    found = fused_of(wide.log_prior, evidence, wide)
    np.testing.assert_allclose(found.stiffness.mean, belief.mean, rtol=1e-6)
    np.testing.assert_allclose(found.stiffness.cov, belief.cov, rtol=1e-4)
    k = np.exp(np.asarray(belief.mean) + 0.5 * np.diagonal(COV))
    np.testing.assert_allclose(found.pressure, pressure_at(np.log(k)), rtol=1e-6)
    np.testing.assert_allclose(found.agreement, 0.0, atol=1e-12)
    np.testing.assert_allclose(found.log_probabilities, -np.log(16.0), rtol=1e-4)


def test_one_wheel_without_a_belief_leaves_the_others_theirs():
    belief = belief_at([180e3, 230e3, 225e3, 200e3])
    broken = belief._replace(mean=belief.mean.at[1].set(jnp.nan))
    ignorant = np.array(COV)
    ignorant[1, 1] += 1e8
    found, expected = (
        fused_of(PARAMS.log_prior, evidence_of(b, PARAMS.reference), PARAMS)
        for b in (broken, belief_at([180e3, 230e3, 225e3, 200e3], ignorant))
    )
    assert found.degrees == 3
    for name in ("pressure", "pressure_sd", "low", "log_probabilities", "agreement"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), atol=1e-5)


def test_an_unknown_bias_widens_the_evidence():
    bias = 0.04**2 * ONES + 0.01**2 * np.eye(4)
    evidence = vertical_evidence(belief_at(200e3 + np.zeros(4)), PARAMS.reference, None, bias)
    np.testing.assert_allclose(
        evidence.matrix.T @ evidence.matrix, np.linalg.inv(COV + bias), rtol=1e-9
    )
    mean = np.linalg.solve(np.asarray(evidence.matrix), np.asarray(evidence.value))
    np.testing.assert_allclose(mean, np.log(stiffness_at(200e3)) - SOUND, rtol=1e-9)


def test_what_is_left_of_a_prior_after_a_walk_is_taken_out():
    """p(y | x_T) of noisy readings of a random walk, from their joint Gaussian."""
    walk, noise, steps, dt = 0.03, 0.05, 20, 0.5
    before, sd = -0.1, 0.2
    times = dt * np.arange(1, steps + 1)
    states = sd**2 + walk**2 * np.minimum(times[:, None], times[None, :])
    y = np.random.default_rng(4).normal(-0.25, 0.1, steps)
    gain = np.linalg.solve(states + noise**2 * np.eye(steps), states[-1])
    posterior = before + gain @ (y - before), states[-1, -1] - gain @ states[-1]
    slope = states[-1] / states[-1, -1]
    given = states + noise**2 * np.eye(steps) - np.outer(slope, states[-1])
    information = slope @ np.linalg.solve(given, slope)
    expected = slope @ np.linalg.solve(given, y - before + slope * before) / information

    prior = StiffnessBelief(jnp.full(4, SOUND + before), sd**2 * jnp.eye(4))
    belief = StiffnessBelief(jnp.full(4, SOUND + posterior[0]), posterior[1] * jnp.eye(4))
    at_end = walked(prior, walk, steps * dt)
    found = vertical_evidence(belief, PARAMS.reference, at_end)
    np.testing.assert_allclose(found.matrix.T @ found.matrix, information * np.eye(4), atol=1e-6)
    likeliest = np.linalg.solve(np.asarray(found.matrix), np.asarray(found.value))
    np.testing.assert_allclose(likeliest, expected, rtol=1e-9)
    nothing = vertical_evidence(at_end, PARAMS.reference, at_end)
    np.testing.assert_array_equal(nothing.matrix, 0.0)


def test_left_and_right_are_alike():
    swap = [1, 0, 3, 2]
    mirrored = [mode_of([bool(row[k] == 0) for k in swap]) for row in TABLE]
    lateral = random_modes(5)
    p, spread = np.array([170e3, 225e3, 200e3, 240e3]), np.diag([1e-4, 2e-4, 5e-4, 1e-3])
    one, other = (
        fused_of(
            jnp.asarray(modes),
            evidence_of(belief_at(p[order], (COV + spread)[order][:, order]), PARAMS.reference),
            PARAMS,
        )
        for modes, order in ((lateral, [0, 1, 2, 3]), (lateral[mirrored], swap))
    )
    np.testing.assert_allclose(other.log_probabilities, one.log_probabilities[jnp.array(mirrored)])
    for name in ("pressure", "pressure_sd", "low", "gap"):
        np.testing.assert_allclose(getattr(other, name), np.asarray(getattr(one, name))[swap])
    np.testing.assert_allclose(other.distance, one.distance)


def test_a_contradiction_names_the_tyre():
    """The corners say front left, the wheels say that all are sound; and that both agree."""
    modes = np.full(16, 1e-4)
    modes[mode_of((True, False, False, False))] = 1.0
    lateral = jnp.log(modes)
    sound, soft = (
        fused_of(lateral, evidence_of(belief_at(p), PARAMS.reference), PARAMS)
        for p in (np.full(4, 230e3), np.array([150e3, 230e3, 230e3, 230e3]))
    )
    assert sound.agreement < -4.0 < 2.0 < soft.agreement
    # chi-square of four degrees exceeds 14.9 once in 200 times
    assert sound.distance > 14.9 > 4.0 > soft.distance
    gap = np.asarray(sound.gap)
    assert gap[0] > 3.0
    assert np.abs(gap[1:]).max() < 1.0
    assert np.abs(soft.gap).max() < 1.0
    # together more certain than one alone
    assert soft.low[0] > 0.999
    assert soft.pressure_sd[0] < 0.7 * np.sqrt(COV[0, 0]) * P0 / C


def draws(count=4000, seed=6):
    """Truths of the model, and what both estimators say of them, in plain NumPy."""
    rng = np.random.default_rng(seed)
    prior = np.full(16, 0.5 / 15)
    prior[-1] = 0.5
    level = np.log(stiffness_at(LEVELS))
    spread = C * K0 / P0 * 15e3 / stiffness_at(LEVELS)
    h = rng.choice(16, size=count, p=prior)
    x = level[TABLE[h]] + spread[TABLE[h]] * rng.standard_normal((count, 4))
    # three noisy contrasts of the soft tyres, as a drive through a bend gives
    shown = rng.normal(0.0, 2.0, (count, 3, 4)) @ (TABLE.T == 0)
    heard = np.take_along_axis(shown, h[:, None, None], 2) + rng.standard_normal((count, 3, 1))
    lateral = np.log(prior) - 0.5 * np.sum((heard - shown) ** 2, axis=1)
    lateral -= np.log(np.exp(lateral).sum(1, keepdims=True))
    sd = np.exp(rng.uniform(np.log(0.01), np.log(0.3), count))
    cov = sd[:, None, None] ** 2 * (np.eye(4) + 4.0 * ONES)
    estimate = x + np.einsum("nij,nj->ni", np.linalg.cholesky(cov), rng.standard_normal((count, 4)))
    told = np.linalg.inv(np.asarray(PRIOR.cov))
    both = np.linalg.inv(np.linalg.inv(cov) + told)
    mean = np.linalg.solve(cov, estimate[..., None])[..., 0] + told @ np.asarray(PRIOR.mean)
    return prior, h, x, lateral, np.einsum("nij,nj->ni", both, mean), both


@pytest.fixture(scope="module")
def drawn():
    prior, h, x, lateral, mean, cov = draws()
    params = fusion_params(LEVELS, TIRE, spread=15e3, prior=prior)
    belief = StiffnessBelief(jnp.asarray(mean), jnp.asarray(cov))
    evidence = evidence_less_prior(belief, params.reference, PRIOR)
    silent = VerticalEvidence(*(jnp.zeros_like(part) for part in evidence))
    lateral = jnp.asarray(lateral)
    ignorant = jnp.broadcast_to(params.log_prior, lateral.shape)
    return {
        "h": h,
        "x": x,
        "both": fused_of_all(lateral, evidence, params),
        "lateral": fused_of_all(lateral, silent, params),
        "vertical": fused_of_all(ignorant, evidence, params),
        "unrelated": fused_of_all(jnp.roll(lateral, 1, axis=0), evidence, params),
    }


def outside_bands(probability, happened, bins=10):
    """Largest deviation of what happened from what was said, in binomial standard deviations."""
    p, happened = np.ravel(probability), np.ravel(happened)
    where = np.minimum((p * bins).astype(int), bins - 1)
    worst = 0.0
    for k in range(bins):
        chosen = where == k
        if chosen.sum() < 30:
            continue
        sd = np.sqrt(np.sum(p[chosen] * (1 - p[chosen])))
        worst = max(worst, abs(np.sum(happened[chosen] - p[chosen])) / max(sd, 1e-12))
    return worst


@pytest.mark.parametrize("which", ["both", "lateral", "vertical"])
def test_probabilities_happen_as_often_as_they_say(drawn, which):
    found, x, h = drawn[which], drawn["x"], drawn["h"]
    low = x < np.log(stiffness_at(0.85 * 230e3))
    modes = np.arange(16) == h[:, None]
    probability = np.exp(found.log_probabilities)
    assert outside_bands(found.low, low) < 3.7
    assert outside_bands(probability, modes) < 3.7
    # the check would notice a probability that is somewhat too sure
    sure = np.clip(1.3 * (np.asarray(found.low) - 0.5) + 0.5, 1e-4, 1 - 1e-4)
    assert outside_bands(sure, low) > 3.7


@pytest.mark.parametrize("which", ["both", "lateral", "vertical"])
def test_covariance_is_that_of_the_errors(drawn, which):
    """Mean NEES of four components, and that of the pressure, within four standard errors."""
    found, x = drawn[which], drawn["x"]
    off = np.asarray(found.stiffness.mean) - x
    nees = np.einsum("ni,nij,nj->n", off, np.linalg.inv(found.stiffness.cov), off)
    assert abs(nees.mean() - 4.0) < 4.0 * nees.std() / np.sqrt(len(nees))
    each = ((np.asarray(found.pressure) - pressure_at(x)) / found.pressure_sd) ** 2
    assert abs(each.mean() - 1.0) < 4.0 * each.mean(1).std() / np.sqrt(len(each))


def test_together_they_err_less_than_each_alone(drawn):
    truth = pressure_at(drawn["x"])
    rms = {
        name: np.sqrt(np.mean((np.asarray(drawn[name].pressure) - truth) ** 2, axis=0))
        for name in ("both", "lateral", "vertical")
    }
    assert (rms["both"] < 0.95 * rms["lateral"]).all()
    assert (rms["both"] < 0.95 * rms["vertical"]).all()


def test_agreement_is_a_bayes_factor(drawn):
    """E exp(agreement) is one over estimates of unrelated tyres, E agreement > 0 over the same."""
    factor = np.exp(np.asarray(drawn["unrelated"].agreement))
    assert abs(factor.mean() - 1.0) < 4.0 * factor.std() / np.sqrt(len(factor))
    same = np.asarray(drawn["both"].agreement)
    assert same.mean() > 0.5 > np.log(factor).mean()
    distance = np.asarray(drawn["both"].distance)
    assert abs(distance.mean() - 4.0) < 4.0 * distance.std() / np.sqrt(len(distance))
    assert np.asarray(drawn["unrelated"].distance).mean() > 6.0
    gap = np.asarray(drawn["both"].gap)
    np.testing.assert_allclose(np.sqrt(np.mean(gap**2, axis=0)), 1.0, atol=0.06)


def test_single_precision_and_far_away_beliefs():
    """A belief ten times sharper than any level, and one 100 standard deviations off."""
    lateral = random_modes(7)
    cases = (([160e3, 226e3, 232e3, 190e3], 1e-2), ([120e3, 330e3, 230e3, 230e3], 1.0))
    beliefs = [belief_at(p, COV * size) for p, size in cases]
    expected = [
        fused_of(jnp.asarray(lateral), evidence_of(b, PARAMS.reference, PRIOR), PARAMS)
        for b in beliefs
    ]
    with jax.enable_x64(False):
        params = fusion_params(LEVELS, TIRE, spread=15e3)
        single = lambda tree: jax.tree.map(lambda a: jnp.asarray(np.asarray(a, np.float32)), tree)  # noqa: E731
        for belief, exact in zip(beliefs, expected, strict=True):
            evidence = evidence_of(single(belief), params.reference, single(PRIOR))
            found = fused_of(single(lateral), evidence, params)
            assert {leaf.dtype for leaf in jax.tree.leaves(found)} <= {
                jnp.dtype("float32"),
                jnp.dtype("int32"),
            }
            np.testing.assert_allclose(found.pressure, exact.pressure, rtol=2e-5)
            np.testing.assert_allclose(found.pressure_sd, exact.pressure_sd, rtol=1e-3)
            np.testing.assert_allclose(found.low, exact.low, atol=1e-3)
            np.testing.assert_allclose(found.agreement, exact.agreement, atol=2e-2, rtol=1e-3)


def test_a_lateral_estimator_that_excludes_modes():
    one = np.full(16, -np.inf)
    one[mode_of((False, False, True, False))] = 0.0
    found = fused_of(
        jnp.asarray(one), evidence_of(belief_at(np.full(4, 200e3)), PARAMS.reference), PARAMS
    )
    assert all(
        np.isfinite(leaf).all() for leaf in jax.tree.leaves(found._replace(log_probabilities=0.0))
    )
    np.testing.assert_array_equal(found.log_probabilities, one)


def test_parameters_are_what_the_law_says():
    pressures = np.array([[140e3, 145e3, 150e3, 155e3], [230e3, 230e3, 250e3, 250e3]])
    params = fusion_params(pressures, TIRE)
    expected = np.log(stiffness_at(pressures))[TABLE, np.arange(4)]
    level = np.asarray(params.reference) + np.asarray(params.level)
    np.testing.assert_allclose(level, expected, rtol=1e-12)
    np.testing.assert_allclose(params.reference, ln_stiffness(pressures[1], TIRE), rtol=1e-12)
    # the closest levels are 85 kPa apart
    np.testing.assert_allclose(
        params.spread[-1], C * K0 / P0 * 42.5e3 / stiffness_at(pressures[1]), rtol=1e-12
    )
    np.testing.assert_allclose(
        pressure_at(np.asarray(params.reference + params.low)), 0.85 * pressures[1]
    )
    for x in (-0.3, 0.1):
        p = params.at_zero + params.per_ratio * np.exp(x)
        np.testing.assert_allclose(p, pressure_at(np.asarray(params.reference) + x), rtol=1e-12)


@pytest.mark.parametrize(
    ("field", "change"),
    [
        ("pressures", {"pressures": (230e3, 150e3)}),
        ("pressures", {"pressures": (15.0, 23.0)}),
        ("pressures", {"pressures": np.full((2, 3), 1e5)}),
        ("levels", {"pressures": (230e3,)}),
        ("spread", {"spread": -1.0}),
        ("low", {"low": 200.0}),
        ("prior", {"prior": np.full(8, 0.125)}),
        ("prior", {"prior": np.full(16, 0.1)}),
        ("tire.pressure_coefficient", {"tire": Tire(K0, P0, 1.1), "pressures": (25e3, 230e3)}),
    ],
)
def test_bad_parameters_are_refused(field, change):
    arguments = {"pressures": LEVELS, "tire": TIRE} | change
    with pytest.raises(InputError, match=rf"^{field}: "):
        fusion_params(**arguments)
