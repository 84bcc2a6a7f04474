"""The multiple-model bank against Kalman filters by hand, and its probabilities by counting."""

from functools import cache, partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from wheelhop.filtering import (
    InteractingParams,
    MultipleModelParams,
    MultipleModelState,
    StateSpaceModel,
    dense,
    drive,
    extended,
    gaussian,
    interacting,
    multiple_model,
    run_batch,
)

STEPS = 40
MEAN = np.array([0.5, -0.3])
COV = np.array([[0.6, 0.1], [0.1, 0.4]])
Q = np.array([[0.02, 0.01], [0.01, 0.08]])
R = 0.3
STIFFNESS = np.array([0.1, 0.4, 0.8])
PRIOR = np.array([0.5, 0.2, 0.3])


class Mass(NamedTuple):
    """On a spring."""

    position: Any
    velocity: Any


class Seen(NamedTuple):
    position: Any


def model():
    """x' = F(k) x + w with the spring's stiffness k as hypothesis."""
    return StateSpaceModel(
        transition=lambda x, k: Mass(
            x.position + 0.4 * x.velocity, 0.6 * x.velocity - k * x.position
        ),
        observation=lambda x, k: Seen(x.position + 0.1 * x.velocity),
        process_cov=lambda x, k: tuple(
            tuple(Q[i, j] + 0.0 * k for j in range(i + 1)) for i in range(2)
        ),
        observation_cov=lambda k: ((R + 0.0 * k,),),
    )


MEMBER = extended(model())
BANK = multiple_model(MEMBER)


def transition_matrix(k):
    return np.array([[1.0, 0.4], [-k, 0.6]])


H = np.array([1.0, 0.1])


def by_hand(y, stiffness):
    """Kalman filter of one hypothesis: means, covariances, log p(y_k | past); NaN is missing."""
    f = transition_matrix(stiffness)
    mean, cov = MEAN, COV
    means, covs, logs = [], [], []
    for entry in y:
        mean, cov = f @ mean, f @ cov @ f.T + Q
        log = 0.0
        if np.isfinite(entry):
            s = H @ cov @ H + R
            error = entry - H @ mean
            gain = cov @ H / s
            mean, cov = mean + gain * error, cov - s * np.outer(gain, gain)
            log = -0.5 * (error**2 / s + np.log(2.0 * np.pi * s))
        means.append(mean)
        covs.append(cov)
        logs.append(log)
    return np.array(means), np.array(covs), np.array(logs)


def bank_by_hand(y, change, temper):
    """Probabilities, evidence and mixture after every sample, with probabilities not their logs."""
    filters = [by_hand(y, k) for k in STIFFNESS]
    means, covs, logs = (np.stack(each) for each in zip(*filters, strict=True))
    p, found = PRIOR, []
    for k in range(len(y)):
        before = (1.0 - change) * p + change * PRIOR
        evidence = before @ np.exp(logs[:, k])
        weighed = before * np.exp(temper * logs[:, k])
        p = weighed / weighed.sum()
        mean = p @ means[:, k]
        apart = means[:, k] - mean
        cov = np.einsum("m,mij->ij", p, covs[:, k]) + np.einsum("m,mi,mj->ij", p, apart, apart)
        found.append((p, np.log(evidence), mean, cov))
    return [np.array(each) for each in zip(*found, strict=True)]


def sample(rng, stiffness, steps=STEPS):
    """Positions that a mass on one spring shows."""
    x, y = rng.multivariate_normal(MEAN, COV), []
    for _ in range(steps):
        x = transition_matrix(stiffness) @ x + rng.multivariate_normal([0.0, 0.0], Q)
        y.append(H @ x + np.sqrt(R) * rng.normal())
    return np.array(y)


def record(seed=0, gap=True):
    y = sample(np.random.default_rng(seed), STIFFNESS[1])
    if gap:
        y[10:13] = np.nan
    return y


def belief():
    return gaussian(Mass(*MEAN), jnp.asarray(COV))


def params(stiffness=STIFFNESS, prior=PRIOR, change=0.0, temper=1.0):
    given = (stiffness, prior, change, temper)
    return MultipleModelParams(*(jnp.asarray(a, jnp.result_type(float)) for a in given))


def start(p):
    return BANK.init(belief(), p)


@cache
def compiled():
    return jax.jit(lambda s, y, p: drive.run(BANK, s, Seen(y), p))


def run(y, p, state=None):
    return compiled()(start(p) if state is None else state, jnp.asarray(y), p)


def probabilities(trajectory):
    return np.exp(trajectory.state.log_probabilities)


@pytest.mark.parametrize("temper", [1.0, 0.4])
@pytest.mark.parametrize("change", [0.0, 0.05])
def test_bank_equals_hand_written_kalman_filters(change, temper):
    y = record()
    found = run(y, params(change=change, temper=temper))
    p, evidence, mean, cov = bank_by_hand(y, change, temper)
    assert np.all(np.ptp(p, axis=0) > 0.1)  # the record tells something
    np.testing.assert_allclose(probabilities(found), p, atol=1e-12, rtol=1e-10)
    np.testing.assert_allclose(found.info.log_likelihood, evidence, atol=1e-11)
    combined = dense(found.state.combined)
    np.testing.assert_allclose(combined[0], mean, atol=1e-11)
    np.testing.assert_allclose(combined[1], cov, atol=1e-11)
    assert not np.any(found.info.flags.nonfinite)


def test_without_changes_it_is_the_imm_that_never_mixes():
    """Pz = I: each member stays by itself in both."""
    y, imm = record(), interacting(MEMBER)
    same = InteractingParams(jnp.asarray(STIFFNESS), jnp.eye(3), jnp.asarray(PRIOR))
    expected = jax.jit(lambda y: drive.run(imm, imm.init(belief(), same), Seen(y), same))(y)
    found = run(y, params())
    np.testing.assert_allclose(
        found.state.log_probabilities, expected.state.log_probabilities, atol=1e-11
    )
    for a, b in zip(
        jax.tree.leaves((found.state.members, found.state.combined, found.info)),
        jax.tree.leaves((expected.state.members, expected.state.combined, expected.info)),
        strict=True,
    ):
        np.testing.assert_allclose(a, b, atol=1e-11)


def test_changes_restore_the_prior_at_their_rate_when_the_data_say_nothing():
    p = params(stiffness=np.full(3, 0.5), change=0.07)
    before = np.array([0.01, 0.98, 0.01])
    state = start(p)._replace(log_probabilities=jnp.log(before))
    left = (1.0 - 0.07) ** np.arange(1, STEPS + 1)
    expected = PRIOR + left[:, None] * (before - PRIOR)
    np.testing.assert_allclose(probabilities(run(record(), p, state)), expected, atol=1e-13)


def test_zero_temper_believes_the_prior_and_leaves_the_members_alone():
    y = record()
    deaf, told = run(y, params(temper=0.0)), run(y, params())
    np.testing.assert_allclose(probabilities(deaf), np.tile(PRIOR, (STEPS, 1)), atol=1e-13)
    for a, b in zip(
        jax.tree.leaves(deaf.state.members), jax.tree.leaves(told.state.members), strict=True
    ):
        np.testing.assert_array_equal(a, b)


def test_a_missing_sample_leaves_the_probabilities_but_for_the_change():
    y = record()
    for change in (0.0, 0.05):
        found = run(y, params(change=change))
        p = probabilities(found)
        expected = (1.0 - change) * p[9:12] + change * PRIOR
        np.testing.assert_allclose(p[10:13], expected, atol=1e-14)
        np.testing.assert_allclose(found.info.log_likelihood[10:13], 0.0, atol=1e-14)
        np.testing.assert_array_equal(found.info.flags.missing, ~np.isfinite(y))


def test_a_member_that_is_always_nonfinite_has_probability_zero():
    """The others share its probability as if it were not there."""
    y = record()
    found = run(y, params(stiffness=[STIFFNESS[0], np.nan, STIFFNESS[2]]))
    p = probabilities(found)
    np.testing.assert_array_equal(p[:, 1], 0.0)
    full = bank_by_hand(y, 0.0, 1.0)[0]
    np.testing.assert_allclose(p[:, 0] / p[:, 2], full[:, 0] / full[:, 2], rtol=1e-10)
    np.testing.assert_array_equal(found.info.flags.lost_members, 1)
    assert not np.any(found.info.flags.nonfinite)
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(found.state.members))


@pytest.mark.parametrize("change", [0.0, 0.02])
def test_a_member_lost_once_restarts_from_the_mixture(change):
    p = params(change=change)
    state = start(p)
    position = state.members.mean.position.at[2].set(jnp.nan)
    mean = state.members.mean._replace(position=position)
    found = run(record(), p, state._replace(members=state.members._replace(mean=mean)))
    lost = probabilities(found)[:, 2]
    np.testing.assert_array_equal(found.info.flags.lost_members, [1] + [0] * (STEPS - 1))
    members, combined = dense(found.state.members), dense(found.state.combined)
    for own, mixture in zip(members, combined, strict=True):
        np.testing.assert_array_equal(own[0, 2], mixture[0])
    assert lost[0] == 0.0
    assert np.all(lost[1:] > 0.0) if change else np.all(lost == 0.0)
    # from there on it is the filter of its own hypothesis
    x = transition_matrix(STIFFNESS[2]) @ combined[0][0]
    cov = transition_matrix(STIFFNESS[2]) @ combined[1][0] @ transition_matrix(STIFFNESS[2]).T + Q
    gain = cov @ H / (H @ cov @ H + R)
    np.testing.assert_allclose(members[0][1, 2], x + gain * (record()[1] - H @ x), atol=1e-12)


def test_when_every_member_is_lost_the_step_says_so():
    found = run(record(), params(stiffness=[np.nan] * 3))
    assert np.all(found.info.flags.nonfinite)
    assert np.all(found.info.flags.lost_members == 3)


def test_likelihoods_that_underflow_leave_probabilities():
    y = record(gap=False)
    y[20] = 500.0
    found = run(y, params())
    assert found.info.log_likelihood[20] < -1e4
    assert np.isfinite(found.info.log_likelihood).all()
    np.testing.assert_allclose(probabilities(found).sum(axis=1), 1.0, atol=1e-12)


def test_mixed_banks_have_the_moments_of_the_mixture():
    """What makes a bank a member of another: every hypothesis is mixed with its own kind."""
    p = params()
    final = [jax.tree.map(lambda a: a[-1], run(record(seed), p).state) for seed in (0, 1)]
    weights = np.array([0.3, 0.7])
    stacked = jax.tree.map(lambda *a: jnp.stack(a), *final)
    mixed = BANK.mix(jnp.asarray(weights), stacked)
    assert isinstance(mixed, MultipleModelState)
    each = np.exp(stacked.log_probabilities)
    np.testing.assert_allclose(np.exp(mixed.log_probabilities), weights @ each, atol=1e-14)
    means, covs = (np.asarray(a) for a in dense(stacked.members))
    mean = np.einsum("b,bmi->mi", weights, means)
    apart = means - mean
    cov = np.einsum("b,bmij->mij", weights, covs + apart[..., :, None] * apart[..., None, :])
    found = dense(mixed.members)
    np.testing.assert_allclose(found[0], mean, atol=1e-13)
    np.testing.assert_allclose(found[1], cov, atol=1e-13)
    np.testing.assert_allclose(
        dense(mixed.combined)[0], weights @ dense(stacked.combined)[0], atol=1e-13
    )


def test_posterior_probabilities_are_frequencies():
    """Truths drawn from the prior: of the cases told p, a share p is so, within binomial bands."""
    runs, steps = 1500, 20
    rng = np.random.default_rng(3)
    truth = rng.choice(3, size=runs, p=PRIOR)
    f = np.array([transition_matrix(k) for k in STIFFNESS])[truth]
    x = rng.multivariate_normal(MEAN, COV, size=runs)
    y = np.empty((runs, steps))
    for k in range(steps):
        x = np.einsum("rij,rj->ri", f, x) + rng.multivariate_normal([0.0, 0.0], Q, size=runs)
        y[:, k] = x @ H + np.sqrt(R) * rng.normal(size=runs)
    p = params()
    last = run_batch(BANK, start(p), Seen(jnp.asarray(y)), p, keep=keep_probabilities)[:, -1]
    told, so = np.exp(last), truth[:, None] == np.arange(3)
    assert np.mean(told.max(axis=1)) > 0.7  # neither sure nor ignorant
    assert np.mean(told.max(axis=1) > 0.99) < 0.5
    for hypothesis in range(3):
        bins = np.digitize(told[:, hypothesis], [0.05, 0.2, 0.4, 0.6, 0.8, 0.95])
        for one in np.unique(bins):
            q = told[bins == one, hypothesis]
            count = np.sum(so[bins == one, hypothesis])
            # 4 of 21 bands' standard deviations: one in 750 seeds fails
            assert abs(count - q.sum()) < 4.0 * np.sqrt(np.sum(q * (1.0 - q))) + 1.0
    # the mean log score against its own expectation and scatter
    score = np.log(told[np.arange(runs), truth])
    expected = np.sum(told * np.log(told), axis=1)
    spread = np.sqrt(np.sum(told * np.log(told) ** 2, axis=1) - expected**2)
    assert abs(np.sum(score - expected)) < 4.0 * np.sqrt(np.sum(spread**2))


def keep_probabilities(state, info):
    del info
    return state.log_probabilities


def test_runs_in_lanes_equal_each_run_with_parameters_of_their_own():
    ys = jnp.asarray(np.stack([record(seed) for seed in range(4)]))
    change, temper = jnp.array([0.0, 0.02, 0.3, 1.0]), jnp.array([1.0, 0.5, 0.8, 0.0])
    many = jax.vmap(partial(params, STIFFNESS, PRIOR))(change, temper)
    found = run_batch(
        BANK, start(params()), Seen(ys), many, in_axes=(None, 0, 0, None), keep=keep_probabilities
    )
    for k in range(4):
        alone = run(ys[k], jax.tree.map(lambda a, k=k: a[k], many))
        np.testing.assert_allclose(found[k], alone.state.log_probabilities, atol=1e-11)


def test_float32_stays_float32(float32):
    p = params(change=0.01, temper=0.5)
    found = jax.jit(lambda y: drive.run(BANK, start(p), Seen(y), p))(
        jnp.asarray(record(), jnp.float32)
    )
    kinds = {leaf.dtype for leaf in jax.tree.leaves((found.state, found.info.log_likelihood))}
    assert kinds == {jnp.dtype("float32")}
    expected = bank_by_hand(record(), 0.01, 0.5)[0]
    np.testing.assert_allclose(probabilities(found), expected, atol=1e-4)


def test_gradients_equal_differences():
    y = record()

    def total(values):
        k, change, temper = values
        p = params(change=change, temper=temper)
        p = MultipleModelParams(k * jnp.asarray(STIFFNESS), p.prior, p.change, p.temper)
        return drive.run(BANK, start(p), Seen(jnp.asarray(y)), p).info.log_likelihood.sum()

    at = np.array([1.1, 0.05, 0.7])
    value = jax.jit(total)
    slope = jax.jit(jax.grad(total))(jnp.asarray(at))
    for k, step in enumerate(1e-5 * np.eye(3)):
        difference = (value(at + step) - value(at - step)) / 2e-5
        np.testing.assert_allclose(slope[k], difference, rtol=1e-6)


def test_gradients_past_impossible_hypotheses_are_finite():
    def total(scale):
        p = params(stiffness=scale * STIFFNESS, prior=[1.0, 0.0, 0.0])
        return drive.run(BANK, start(p), Seen(jnp.asarray(record())), p).info.log_likelihood.sum()

    assert np.isfinite(jax.jit(jax.grad(total))(1.0))


@pytest.mark.parametrize(
    ("given", "field"),
    [
        ({"prior": [0.5, 0.5, 0.1]}, "prior"),
        ({"prior": [1.2, -0.2, 0.0]}, "prior"),
        ({"prior": [np.nan, 0.5, 0.5]}, "prior"),
        ({"change": -0.1}, "change"),
        ({"change": 1.5}, "change"),
        ({"change": np.nan}, "change"),
        ({"temper": 2.0}, "temper"),
        ({"temper": -1.0}, "temper"),
    ],
)
def test_what_is_no_probability_is_refused(given, field):
    with pytest.raises(ValueError, match=rf"^{field}=.*does not hold probabilities"):
        start(params(**given))


@pytest.mark.parametrize("precision", [jnp.float32, jnp.float64])
def test_rounded_probabilities_are_accepted(precision):
    """0.1 + 0.2 + 0.7 is not one in float32."""
    given = MultipleModelParams(jnp.asarray(STIFFNESS), jnp.array([0.1, 0.2, 0.7]))
    coarse, rounded = jax.tree.map(lambda a: jnp.asarray(a, precision), (belief(), given))
    begun = BANK.init(coarse, rounded)
    np.testing.assert_allclose(np.exp(begun.log_probabilities), [0.1, 0.2, 0.7], rtol=1e-6)
