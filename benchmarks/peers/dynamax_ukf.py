"""dynamax: four unscented filters, one per road class, vmapped; no mixing, a fixed noise."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.peers import dense_model, problem
from benchmarks.peers.batch import compile_batch
from benchmarks.peers.problem import Peer, Unavailable
from tests.oracles import quarter_car_numpy as car


def build(runs: int, samples: int, dtype: str) -> Peer:
    """Four filters of a batch; calls return ln k_t and its variance, [runs, 4, samples].

    Raises:
        Unavailable: if dynamax cannot be imported.
    """
    try:
        from dynamax.nonlinear_gaussian_ssm import (
            ParamsNLGSSM,
            UKFHyperParams,
            unscented_kalman_filter,
        )
    except ImportError as error:
        raise Unavailable(f"not installed ({error}); pip install dynamax") from None
    cubature = UKFHyperParams(alpha=1.0, beta=0.0, kappa=0.0)

    def member(cov, ys):
        params = ParamsNLGSSM(
            initial_mean=jnp.asarray(problem.PRIOR_MEAN, dtype),
            initial_covariance=jnp.asarray(problem.PRIOR_COV, dtype),
            dynamics_function=dense_model.transition,
            dynamics_covariance=cov,
            emission_function=dense_model.accelerations,
            emission_covariance=car.NOISE**2 * jnp.eye(2, dtype=dtype),
        )
        fields = ["filtered_means", "filtered_covariances"]
        posterior = unscented_kalman_filter(params, ys, cubature, output_fields=fields)
        return posterior.filtered_means[:, 4], posterior.filtered_covariances[:, 4, 4]

    def one(ys):
        covs = [car.process_cov(problem.PRIOR_MEAN, level) for level in problem.LEVELS]
        return jax.vmap(member, (0, None))(jnp.asarray(np.array(covs), dtype), ys)

    return compile_batch(one, runs, samples, dtype)
