"""The benchmark's work through wheelhop's own interface: the problem of `peers.problem`.

One filter step is one full IMM cycle of one run: four unscented filters (cubature), five states,
two measurements, the RK4 quarter car and the road noise integrated over the interval.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.peers import problem
from benchmarks.peers.problem import Peer
from tests.oracles import quarter_car_numpy as car
from wheelhop.estimators.immuf import CornerState, Tuning, immuf, immuf_params
from wheelhop.filtering import drive, gaussian
from wheelhop.filtering.batch import log_likelihood_batch, run_batch
from wheelhop.filtering.stream import packed
from wheelhop.staging import stage, staged_jit
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.quarter_car import Accelerations
from wheelhop.vehicle.suspension import Suspension
from wheelhop.vehicle.tire import Tire


class Problem(NamedTuple):
    """Filter, its state before the first sample, and its parameters."""

    filter: Any
    start: Any
    params: Any


def the_problem() -> Problem:
    """The frozen problem in JAX's current precision."""
    corner = QuarterCar(
        car.M_S,
        car.M_U,
        Suspension(car.K_S, car.K_NL, car.C_S, car.C_NL),
        Tire(264.7e3, 250e3, 0.7),
    )
    tuning = Tuning(
        noise_a_s=car.NOISE,
        noise_a_u=car.NOISE,
        stiffness_walk=car.STIFFNESS_WALK,
        velocity_walk=car.VELOCITY_WALK,
    )
    filter = immuf(car.DT)
    params = immuf_params(corner, car.SPEED, car.DT, tuning)
    params = replace(
        params,
        members=replace(params.members, road_level=jnp.asarray(problem.LEVELS, float)),
        transition=jnp.asarray(problem.TRANSITION, float),
        initial=jnp.asarray(problem.INITIAL, float),
    )
    belief = gaussian(CornerState(*problem.PRIOR_MEAN), jnp.asarray(problem.PRIOR_COV, float))
    return Problem(filter, filter.init(belief, params), params)


def keep(state: Any, info: Any) -> Any:
    """What a pressure estimate needs of a step."""
    return state.combined.mean.ln_k_t, state.log_probabilities


def measurements(ys: Any) -> Accelerations:
    """Records [..., 2] as named entries."""
    return Accelerations(ys[..., 0], ys[..., 1])


def build(runs: int, samples: int, dtype: str, devices: Any = None) -> Peer:
    """The batch compiled; one run is scanned, more go through `run_batch`."""
    double = dtype == "float64"
    with jax.enable_x64(double):
        filter, start, params = the_problem()
        ys = jnp.asarray(problem.records(runs, samples, dtype))

        def batch(ys: Any) -> Any:
            if runs == 1:
                one = measurements(ys[0])  # what `drive.run_compiled` compiles
                return stage(drive.run)(filter, start, one, params, keep=keep)
            return run_batch(filter, start, measurements(ys), params, keep=keep, devices=devices)

        return timed(batch, (ys,), double)


def timed(function: Callable[..., Any], arguments: tuple, double: bool) -> Peer:
    """`function` compiled for its arguments, and the seconds that took."""
    start = time.perf_counter()
    compiled = staged_jit(function).lower(*arguments).compile()
    seconds = time.perf_counter() - start

    def call(*arguments: Any) -> Any:
        with jax.enable_x64(double):
            return jax.block_until_ready(compiled(*arguments))

    call.memory = compiled.memory_analysis().temp_size_in_bytes  # type: ignore[attr-defined]
    return Peer(call, arguments[0], seconds)


def knobs() -> Any:
    """Ten parameters: four road levels, the five prior means, the sensor noise."""
    return {
        "log_level": jnp.log(jnp.asarray(problem.LEVELS, float)),
        "prior_mean": jnp.asarray(problem.PRIOR_MEAN, float),
        "log_noise": jnp.log(jnp.asarray(car.NOISE, float)),
    }


def log_likelihood(values: Any, ys: Any, devices: Any = None, segment: int | None = None) -> Any:
    """Sum over runs of log p(record | knobs)."""
    filter, start, params = the_problem()
    noise = jnp.exp(values["log_noise"]) * jnp.ones((len(problem.LEVELS),))
    members = replace(
        params.members,
        road_level=jnp.exp(values["log_level"]),
        noise_a_s=noise,
        noise_a_u=noise,
    )
    params = replace(params, members=members)
    belief = gaussian(CornerState(*values["prior_mean"]), jnp.asarray(problem.PRIOR_COV, float))
    start = filter.init(belief, params)
    return log_likelihood_batch(
        filter, start, measurements(ys), params, devices=devices, segment=segment
    ).sum()


def build_likelihood(
    runs: int, samples: int, dtype: str, gradient: bool, devices: Any = None
) -> Peer:
    """The log-likelihood of a batch, or its reverse-mode gradient by the ten knobs."""
    double = dtype == "float64"
    with jax.enable_x64(double):
        ys = jnp.asarray(problem.records(runs, samples, dtype))

        def value(values: Any) -> Any:
            return log_likelihood(values, ys, devices)

        return timed(jax.grad(value) if gradient else value, (knobs(),), double)


def streaming_latency(samples: int = 3000) -> float:
    """Median seconds of one packed step on one sample, float32."""
    filter, start, params = the_problem()
    stream = packed(filter, start, params, Accelerations, keep)
    ys = np.asarray(problem.records(1, samples, "float32")[0])
    vector, times = stream.state, []
    for y in ys:
        begin = time.perf_counter()
        vector, result = stream.step(vector, y, stream.params)
        result.block_until_ready()
        times.append(time.perf_counter() - begin)
    if not np.isfinite(np.asarray(vector)).all():
        raise RuntimeError("the streamed state is not finite")
    return float(np.median(times[samples // 10 :]))
