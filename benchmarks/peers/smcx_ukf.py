"""smcx: four unscented filters, one per road class, vmapped; no mixing, a fixed noise."""

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
        Unavailable: if smcx cannot be imported.
    """
    try:
        from smcx import unscented_kalman_filter
    except ImportError as error:
        raise Unavailable(f"not installed ({error}); pip install smcx") from None

    def member(cov, ys):
        posterior = unscented_kalman_filter(
            jnp.asarray(problem.PRIOR_MEAN, dtype),
            jnp.asarray(problem.PRIOR_COV, dtype),
            dense_model.transition,
            cov,
            dense_model.accelerations,
            car.NOISE**2 * jnp.eye(2, dtype=dtype),
            ys,
            alpha=1.0,
            beta=0.0,
            kappa=0.0,
        )
        return posterior.filtered_means[:, 4], posterior.filtered_covariances[:, 4, 4]

    def one(ys):
        covs = [car.process_cov(problem.PRIOR_MEAN, level) for level in problem.LEVELS]
        return jax.vmap(member, (0, None))(jnp.asarray(np.array(covs), dtype), ys)

    return compile_batch(one, runs, samples, dtype)
