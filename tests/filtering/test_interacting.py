"""The IMM by its invariants and by exact enumeration where it is exact."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from models import COV, MEAN, F, H, Q, R, Sensors, Track, kalman, linear_model, sample

from wheelhop.filtering import (
    InteractingParams,
    dense,
    drive,
    gaussian,
    interacting,
    unscented,
)
from wheelhop.filtering.interacting import correct, mixing

PZ = np.array([[0.9, 0.08, 0.02], [0.05, 0.9, 0.05], [0.1, 0.2, 0.7]])
MU = np.array([0.5, 0.3, 0.2])


def prior():
    return gaussian(Track(*MEAN), jnp.asarray(COV))


def measurements(ys):
    return Sensors(jnp.asarray(ys[:, 0]), jnp.asarray(ys[:, 1]))


def run(scales, pz, mu, ys):
    filter = interacting(unscented(linear_model()))
    params = InteractingParams(
        jnp.asarray(scales, float), jnp.asarray(pz, float), jnp.asarray(mu, float)
    )
    return drive.run(filter, filter.init(prior(), params), measurements(ys), params)


def test_one_mode_is_the_member_itself():
    _, ys = sample(0, 40)
    trajectory = run([1.0], [[1.0]], [1.0], ys)
    means, covs, log_likelihood = kalman(ys)
    mean, cov = dense(trajectory.state.combined)
    np.testing.assert_allclose(mean, means, atol=1e-12)
    np.testing.assert_allclose(cov, covs, atol=1e-12)
    np.testing.assert_allclose(trajectory.info.log_likelihood, log_likelihood, atol=1e-12)


def test_identical_members_follow_the_markov_chain():
    _, ys = sample(1, 30)
    trajectory = run([1.0, 1.0, 1.0], PZ, MU, ys)
    expected = MU
    for k in range(30):
        expected = expected @ PZ
        np.testing.assert_allclose(
            np.exp(trajectory.state.log_probabilities[k]), expected, atol=1e-12
        )
    np.testing.assert_allclose(dense(trajectory.state.combined)[0], kalman(ys)[0], atol=1e-12)


def test_modes_that_never_switch_are_a_bayesian_mixture_of_kalman_filters():
    _, ys = sample(2, 25)
    scales = np.array([0.5, 1.0, 3.0])
    trajectory = run(scales, np.eye(3), MU, ys)
    logs = np.log(MU) + np.array([kalman(ys, s)[2].sum() for s in scales])
    posterior = np.exp(logs - logs.max())
    posterior /= posterior.sum()
    np.testing.assert_allclose(
        np.exp(trajectory.state.log_probabilities[-1]), posterior, atol=1e-10
    )
    means = np.array([kalman(ys, s)[0][-1] for s in scales])
    np.testing.assert_allclose(
        dense(trajectory.state.combined)[0][-1], posterior @ means, atol=1e-10
    )
    evidence = np.log(np.exp(logs - logs.max()).sum()) + logs.max()
    assert float(trajectory.info.log_likelihood.sum()) == pytest.approx(evidence, abs=1e-10)


def exact_switching_posterior(ys, scales, pz, mu):
    """Mean and evidence by enumerating every mode sequence, each a Kalman filter in NumPy."""
    logs, means = [], []
    modes = range(len(scales))
    for sequence in itertools.product(modes, repeat=len(ys)):
        mean, cov = MEAN.copy(), COV.copy()
        log = np.log((mu @ pz)[sequence[0]])
        for k, (mode, y) in enumerate(zip(sequence, ys, strict=True)):
            if k:
                log += np.log(pz[sequence[k - 1], mode])
            mean, cov = F @ mean, F @ cov @ F.T + scales[mode] * Q
            s = H @ cov @ H.T + scales[mode] * R
            r = y - H @ mean
            gain = cov @ H.T @ np.linalg.inv(s)
            mean, cov = mean + gain @ r, cov - gain @ s @ gain.T
            log += -0.5 * (r @ np.linalg.solve(s, r) + np.linalg.slogdet(2 * np.pi * s)[1])
        logs.append(log)
        means.append(mean)
    logs = np.array(logs)
    weights = np.exp(logs - logs.max())
    evidence = np.log(weights.sum()) + logs.max()
    return (weights / weights.sum()) @ np.array(means), evidence


def test_first_step_is_exact_and_later_ones_are_close_to_the_full_enumeration():
    """The IMM merges histories, so it is exact for one step and an approximation after."""
    _, ys = sample(3, 5)
    scales = np.array([0.3, 1.0, 4.0])
    one = run(scales, PZ, MU, ys[:1])
    mean, evidence = exact_switching_posterior(ys[:1], scales, PZ, MU)
    np.testing.assert_allclose(dense(one.state.combined)[0][-1], mean, atol=1e-12)
    assert float(one.info.log_likelihood.sum()) == pytest.approx(evidence, abs=1e-12)

    five = run(scales, PZ, MU, ys)
    mean, evidence = exact_switching_posterior(ys, scales, PZ, MU)
    found, cov = dense(five.state.combined)
    sigma = np.sqrt(np.diag(np.asarray(cov)[-1]))
    assert np.max(np.abs(found[-1] - mean) / sigma) < 0.05
    # measured: 0.126 nats over five steps, with noise variances a factor 13 apart
    assert float(five.info.log_likelihood.sum()) == pytest.approx(evidence, abs=0.15)


def test_a_dead_member_is_restarted_from_the_others():
    _, ys = sample(4, 20)
    trajectory = run([1.0, np.nan, 2.0], PZ, MU, ys)
    probabilities = np.exp(trajectory.state.log_probabilities)
    assert np.all(probabilities[:, 1] == 0.0)
    assert np.all(trajectory.info.flags.lost_members == 1)
    assert not np.any(trajectory.info.flags.nonfinite)
    assert np.isfinite(dense(trajectory.state.combined)[0]).all()


def test_all_members_dead_is_flagged():
    _, ys = sample(4, 3)
    assert np.all(run([np.nan, np.nan], np.eye(2), [0.5, 0.5], ys).info.flags.nonfinite)


def test_probabilities_survive_likelihoods_that_underflow():
    predicted, _ = mixing(jnp.log(jnp.asarray(MU)), jnp.asarray(PZ))
    posterior, total = correct(predicted, jnp.array([-5000.0, -4000.0, -4001.0]))
    assert np.isfinite(total)
    np.testing.assert_allclose(np.exp(posterior).sum(), 1.0)
    assert np.argmax(posterior) == 1


def test_mixing_weights_are_bayes_rule():
    predicted, weights = mixing(jnp.log(jnp.asarray(MU)), jnp.asarray(PZ))
    joint = PZ * MU[:, None]
    np.testing.assert_allclose(np.exp(predicted), joint.sum(axis=0), atol=1e-15)
    np.testing.assert_allclose(weights, joint / joint.sum(axis=0), atol=1e-14)


def test_members_of_the_imm_may_be_imms():
    """An IMM is a Filter, so it can be a member: identical copies change nothing."""
    _, ys = sample(5, 15)
    inner = interacting(unscented(linear_model()))
    outer = interacting(inner)
    one = InteractingParams(
        jnp.array([0.5, 2.0]),
        jnp.asarray(PZ[:2, :2] / PZ[:2, :2].sum(1, keepdims=True)),
        jnp.array([0.5, 0.5]),
    )
    both = InteractingParams(
        jax.tree.map(lambda a: jnp.stack([a, a]), one), jnp.eye(2), jnp.array([0.5, 0.5])
    )
    plain = drive.run(inner, inner.init(prior(), one), measurements(ys), one)
    nested = drive.run(outer, outer.init(prior(), both), measurements(ys), both)
    np.testing.assert_allclose(nested.info.log_likelihood, plain.info.log_likelihood, atol=1e-10)
    np.testing.assert_allclose(
        dense(nested.state.combined.combined)[0], dense(plain.state.combined)[0], atol=1e-10
    )


def test_gradient_past_modes_that_cannot_be_reached_is_finite():
    _, ys = sample(6, 10)
    filter = interacting(unscented(linear_model()))

    def total(u):
        params = InteractingParams(
            u * jnp.array([0.5, 1.0, 2.0]), u * jnp.eye(3), jnp.array([1.0, 0.0, 0.0])
        )
        state = filter.init(prior(), params)
        return drive.log_likelihood(filter, state, measurements(ys), params)

    assert np.isfinite(jax.jit(jax.grad(total))(1.0))
