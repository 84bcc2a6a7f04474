"""Compile a JAX function of one record into a peer over a batch of records."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from benchmarks.peers.problem import Peer, records


def compile_batch(one: Callable[[Any], Any], runs: int, samples: int, dtype: str) -> Peer:
    """One jitted program for all runs, compiled ahead of its first call.

    Args:
        one: filter of one record [samples, 2]; traced in the precision asked for.
        runs: number of records.
        samples: their length.
        dtype: "float32" or "float64".
    """
    double = dtype == "float64"
    with jax.enable_x64(double):
        ys = jnp.asarray(records(runs, samples, dtype))
        start = time.perf_counter()
        compiled = jax.jit(jax.vmap(one)).lower(ys).compile()
        seconds = time.perf_counter() - start

    def call(ys: Any) -> Any:
        with jax.enable_x64(double):
            return jax.block_until_ready(compiled(ys))

    return Peer(call, ys, seconds)
