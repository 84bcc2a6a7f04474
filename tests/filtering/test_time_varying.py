"""What varies in time: irregular sampling, and switching probabilities of an IMM."""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
import pytest
from models import COV, MEAN, Sensors, Track, kalman, linear_model, sample

from wheelhop.filtering import (
    InteractingParams,
    StateSpaceModel,
    drive,
    extended,
    extended_smoother,
    gaussian,
    independent,
    interacting,
    square_root_unscented,
    unscented,
)


class Motion(NamedTuple):
    position: Any
    velocity: Any


class Seen(NamedTuple):
    position: Any


def motion():
    """White acceleration of intensity 0.5; params are the sampling interval [s]."""
    return StateSpaceModel(
        lambda x, dt: Motion(x.position + dt * x.velocity, x.velocity),
        lambda x, dt: Seen(x.position),
        lambda x, dt: ((0.5 * dt**3 / 3,), (0.5 * dt**2 / 2, 0.5 * dt)),
        lambda dt: ((0.04,),),
    )


@pytest.mark.parametrize("make", [extended, unscented, square_root_unscented])
def test_irregular_sampling_equals_a_dense_gaussian_process(make):
    """The position is a Gaussian process with a closed covariance; no recursion is shared."""
    rng = np.random.default_rng(0)
    times = np.cumsum(rng.uniform(0.01, 1.0, 25))
    y = rng.normal(size=25)
    model, dts = motion(), np.diff(times, prepend=0.0)
    options = {"inputs": jnp.asarray(dts), "bind": lambda params, dt: dt}
    filter = make(model)
    state = filter.init(independent(Motion(0.3, -0.1), Motion(0.7, 0.4)), 1.0)
    run = drive.run(filter, state, Seen(jnp.asarray(y)), 1.0, **options)

    s, t = np.minimum.outer(times, times), np.maximum.outer(times, times)
    cov = 0.49 + 0.16 * s * t + 0.5 * s**2 * (3 * t - s) / 6
    noisy, mean = cov + 0.04 * np.eye(25), 0.3 - 0.1 * times
    weight = np.linalg.solve(noisy, y - mean)
    evidence = -0.5 * ((y - mean) @ weight + np.linalg.slogdet(2 * np.pi * noisy)[1])
    assert float(run.info.log_likelihood.sum()) == pytest.approx(evidence, abs=1e-10)
    assert float(run.state.mean.position[-1]) == pytest.approx(
        mean[-1] + cov[-1] @ weight, abs=1e-10
    )
    if make is extended:
        smoothed = extended_smoother(model)(run.state, 1.0, **options)
        np.testing.assert_allclose(smoothed.mean.position, mean + cov @ weight, atol=1e-10)


def test_an_imm_follows_switching_probabilities_that_vary_in_time():
    """Identical members: the modes follow the inhomogeneous Markov chain, the states Kalman's."""
    rng = np.random.default_rng(1)
    pz = rng.dirichlet(np.ones(3), size=(20, 3))
    _, ys = sample(1, 20)
    filter = interacting(unscented(linear_model()))
    params = InteractingParams(jnp.ones(3), jnp.eye(3), jnp.array([0.5, 0.3, 0.2]))
    run = drive.run(
        filter,
        filter.init(gaussian(Track(*MEAN), jnp.asarray(COV)), params),
        Sensors(*jnp.asarray(ys.T)),
        params,
        inputs=jnp.asarray(pz),
        bind=lambda p, now: InteractingParams(p.members, now, p.initial),
    )
    expected = np.array([0.5, 0.3, 0.2])
    for k in range(20):
        expected = expected @ pz[k]
        np.testing.assert_allclose(np.exp(run.state.log_probabilities[k]), expected, atol=1e-12)
    np.testing.assert_allclose(np.stack(run.state.combined.mean, axis=1), kalman(ys)[0], atol=1e-12)
