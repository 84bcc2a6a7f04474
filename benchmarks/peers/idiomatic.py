"""Idiomatic JAX: the IMM of unscented filters with dense matrices, vmap, scan and one jit.

jnp.linalg.cholesky and einsum over vectors, vmapped over points, modes and runs: what a good
JAX user writes first, and what most filter libraries in JAX do inside.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.linalg import solve_triangular
from jax.scipy.special import logsumexp

from benchmarks.peers import dense_model, problem
from benchmarks.peers.batch import compile_batch
from benchmarks.peers.problem import Peer
from tests.oracles import quarter_car_numpy as car


class Estimate(NamedTuple):
    """One record's estimate.

    Attributes:
        mean: of the mixture, [samples, 5]; the last is ln k_t.
        log_probabilities: of the modes, [samples, 4].
        log_likelihood: log p(y | past) of the mixture, [samples].
    """

    mean: Any
    log_probabilities: Any
    log_likelihood: Any


def build(runs: int, samples: int, dtype: str) -> Peer:
    """The IMM of a batch, compiled; its calls return an `Estimate` with a leading axis [runs]."""
    return compile_batch(filter_record, runs, samples, dtype)


def build_gradient(runs: int, samples: int, dtype: str, knobs: Any) -> Peer:
    """Reverse-mode gradient, by the knobs, of the batch's log-likelihood; checkpointed steps.

    Args:
        runs, samples, dtype: as `build`.
        knobs: log_level [4], prior_mean [5] and log_noise [], as in `benchmarks.work`.
    """
    with jax.enable_x64(dtype == "float64"):

        def one(ys):
            def total(values):
                return jnp.sum(filter_record(ys, values).log_likelihood)

            return jax.grad(total)(jax.tree.map(lambda a: jnp.asarray(a, ys.dtype), knobs))

        return compile_batch(one, runs, samples, dtype)


def filter_record(ys, knobs=None):
    """IMM of one record [samples, 2], with the knobs in place of the problem's numbers."""
    dtype = ys.dtype
    if knobs is None:
        levels = jnp.asarray(problem.LEVELS, dtype)
        prior_mean = jnp.asarray(problem.PRIOR_MEAN, dtype)
        noise = jnp.asarray(car.NOISE, dtype)
    else:
        levels, prior_mean = jnp.exp(knobs["log_level"]), knobs["prior_mean"]
        noise = jnp.exp(knobs["log_noise"])
    log_transition = jnp.asarray(np.log(problem.TRANSITION), dtype)
    modes = len(levels)
    start = (
        jnp.asarray(np.log(problem.INITIAL), dtype),
        jnp.tile(prior_mean, (modes, 1)),
        jnp.tile(jnp.asarray(problem.PRIOR_COV, dtype), (modes, 1, 1)),
    )

    def step(carry, y):
        log_probabilities, means, covs = carry
        joint = log_transition + log_probabilities[:, None]
        predicted = logsumexp(joint, axis=0)
        weights = jnp.exp(joint - predicted[None])
        mixed, mixed_cov = jax.vmap(mixture, (1, None, None))(weights, means, covs)
        means, covs, log_likelihoods = jax.vmap(unscented_step, (0, 0, 0, None, None))(
            mixed, mixed_cov, levels, y, noise
        )
        joint = predicted + log_likelihoods
        log_likelihood = logsumexp(joint)
        log_probabilities = joint - log_likelihood
        mean = jnp.exp(log_probabilities) @ means
        return (log_probabilities, means, covs), Estimate(mean, log_probabilities, log_likelihood)

    return jax.lax.scan(step if knobs is None else jax.checkpoint(step), start, ys)[1]


def mixture(weights, means, covs):
    """Mean and covariance of a Gaussian mixture."""
    mean = weights @ means
    spread = means - mean[None]
    cov = jnp.einsum("i,iab->ab", weights, covs)
    return mean, cov + jnp.einsum("i,ia,ib->ab", weights, spread, spread)


def cubature_points(mean, cov):
    """The 2n points [2n, n], all of weight 1 / 2n."""
    offsets = len(mean) ** 0.5 * jnp.linalg.cholesky(cov).T
    return mean[None] + jnp.concatenate([offsets, -offsets])


def unscented_step(mean, cov, level, y, noise):
    """Predict and update one mode; returns mean, covariance and log p(y | past)."""
    points = jax.vmap(dense_model.transition)(cubature_points(mean, cov))
    predicted = jnp.mean(points, 0)
    deviation = points - predicted[None]
    count = len(points)
    cov = deviation.T @ deviation / count + dense_model.process_cov(mean, level)

    points = cubature_points(predicted, cov)
    outputs = jax.vmap(dense_model.accelerations)(points)
    expected = jnp.mean(outputs, 0)
    deviation, output = points - predicted[None], outputs - expected[None]
    innovation_cov = output.T @ output / count + noise**2 * jnp.eye(len(y), dtype=y.dtype)
    cross = deviation.T @ output / count
    root = jnp.linalg.cholesky(innovation_cov)
    sides = jnp.concatenate([cross.T, (y - expected)[:, None]], axis=1)
    white = solve_triangular(root, sides, lower=True)
    white_cross, white_innovation = white[:, :-1], white[:, -1]
    log_likelihood = (
        -0.5 * white_innovation @ white_innovation
        - jnp.sum(jnp.log(jnp.diag(root)))
        - 0.5 * len(y) * np.log(2 * np.pi)
    )
    mean = predicted + white_innovation @ white_cross
    return mean, cov - white_cross.T @ white_cross, log_likelihood
