"""Speed of the 4-mode IMM of unscented filters against filterpy, in one process.

    python -m benchmarks.filters [--quick] [--json FILE]

One filter step is one full IMM cycle of one run: four unscented filters with five states, two
measurements and the RK4 quarter car. filterpy runs the same model in NumPy; its outputs agree
with ours to 1e-10 (tests/filtering/test_oracles.py). Rounds of the two are interleaved and the
median is reported, because machines drift.
"""

from __future__ import annotations

import argparse
import platform
import statistics
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from rich.console import Console
from rich.table import Table

from tests.oracles import quarter_car_numpy
from tests.oracles.generate_filterpy import make_imm
from wheelhop import __version__
from wheelhop.estimators.immuf import Tuning, immuf, immuf_params, prior
from wheelhop.filtering import drive
from wheelhop.io.results import write_json
from wheelhop.vehicle.parameters import brancati_suv
from wheelhop.vehicle.quarter_car import Accelerations

SAMPLES = 500
CHUNK = 100
RUNS = (1, 100, 1000)


def filterpy_rate(ys: np.ndarray, steps: int) -> float:
    """Filter steps per second of filterpy's IMM."""
    imm = make_imm("cubature")
    start = time.perf_counter()
    for y in ys[:steps]:
        imm.predict()
        imm.update(y)
    return steps / (time.perf_counter() - start)


def build(runs: int):
    """The compiled batch of `runs` records, its input, and the seconds the compiler took."""
    car = brancati_suv()
    dt = quarter_car_numpy.DT
    filter = immuf(dt)
    params = immuf_params(car, quarter_car_numpy.SPEED, dt, Tuning())
    belief = prior(car)

    def one(ys):
        return drive.run(
            filter,
            filter.init(belief, params),
            ys,
            params,
            keep=lambda state, info: (state.combined.mean.ln_k_t, state.log_probabilities),
        )

    def batch(ys):
        if runs <= CHUNK:
            return jax.vmap(one)(ys)
        return jax.lax.map(one, ys, batch_size=CHUNK)

    rng = np.random.default_rng(0)
    record = quarter_car_numpy.simulate(rng, 4e-6, SAMPLES, np.log(200e3), substeps=1)
    noise = rng.normal(size=(runs, SAMPLES, 2)) * quarter_car_numpy.NOISE
    values = jnp.asarray(record + noise, float)
    ys = Accelerations(values[..., 0], values[..., 1])
    start = time.perf_counter()
    compiled = jax.jit(batch).lower(ys).compile()
    return compiled, ys, record, time.perf_counter() - start


def measure(runs: int, rounds: int, peer_steps: int) -> dict[str, float]:
    """Rates and ratio for one batch size in JAX's current precision."""
    compiled, ys, record, compile_time = build(runs)
    jax.block_until_ready(compiled(ys))
    rates, peer, ratios = [], [], []
    for _ in range(rounds):
        peer.append(filterpy_rate(record, peer_steps))
        start = time.perf_counter()
        result = jax.block_until_ready(compiled(ys))
        rates.append(runs * SAMPLES / (time.perf_counter() - start))
        ratios.append(rates[-1] / peer[-1])
    if not all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(result)):
        raise RuntimeError("the benchmark's estimate is not finite")
    return {
        "runs": runs,
        "steps_per_second": statistics.median(rates),
        "compile_seconds": compile_time,
        "filterpy_steps_per_second": statistics.median(peer),
        "ratio": statistics.median(ratios),
    }


def measure_gradient(runs: int, rounds: int) -> dict[str, float]:
    """Reverse-mode gradient of the log-likelihood with respect to every leaf of the parameters."""
    dt = quarter_car_numpy.DT
    filter = immuf(dt)
    car = brancati_suv()
    params = immuf_params(car, quarter_car_numpy.SPEED, dt, Tuning())
    belief = prior(car)
    noise = np.random.default_rng(0).normal(size=(2, runs, SAMPLES))
    ys = Accelerations(*jnp.asarray(noise, float))

    def total(params):
        def one(ys):
            return drive.log_likelihood(filter, filter.init(belief, params), ys, params)

        return jnp.sum(jax.vmap(one)(ys))

    seconds = {}
    compile_seconds = {}
    for name, function in (("forward", total), ("gradient", jax.grad(total))):
        start = time.perf_counter()
        compiled = jax.jit(function).lower(params).compile()
        compile_seconds[name] = time.perf_counter() - start
        jax.block_until_ready(compiled(params))
        times = []
        for _ in range(rounds):
            start = time.perf_counter()
            result = jax.block_until_ready(compiled(params))
            times.append(time.perf_counter() - start)
        seconds[name] = statistics.median(times)
    if not all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(result)):
        raise RuntimeError("the gradient is not finite")
    return {
        "runs": runs,
        "gradient_compile_seconds": compile_seconds["gradient"],
        "gradient_to_forward": seconds["gradient"] / seconds["forward"],
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--quick", action="store_true", help="fewer rounds, no 1,000 runs, no gradient"
    )
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    options = parser.parse_args()
    rounds, peer_steps = (2, 50) if options.quick else (7, 200)
    rows = []
    table = Table("precision", "runs", "steps/s", "compile [s]", "filterpy steps/s", "ratio")
    for precision in ("float32", "float64"):
        with jax.enable_x64(precision == "float64"):
            for runs in RUNS[:2] if options.quick else RUNS:
                row = {"precision": precision, **measure(runs, rounds, peer_steps)}
                rows.append(row)
                table.add_row(
                    precision,
                    f"{runs}",
                    f"{row['steps_per_second']:,.0f}",
                    f"{row['compile_seconds']:.1f}",
                    f"{row['filterpy_steps_per_second']:,.0f}",
                    f"{row['ratio']:,.0f}",
                )
    Console().print(table)
    gradient = None
    if not options.quick:
        gradient = {"precision": "float32", **measure_gradient(100, 3)}
        Console().print(
            f"gradient of the log-likelihood, float32, 100 runs: compile "
            f"{gradient['gradient_compile_seconds']:.0f} s, "
            f"{gradient['gradient_to_forward']:.1f} forward passes"
        )
    if options.json:
        write_json(
            options.json,
            {
                "benchmark": "4-mode IMM of unscented filters, 5 states, RK4, one device",
                "wheelhop_version": __version__,
                "jax_version": jax.__version__,
                "machine": f"{platform.machine()}, {len(jax.devices())} device(s)",
                "samples_per_run": SAMPLES,
                "runs_per_chunk": CHUNK,
                "rows": rows,
                "gradient": gradient,
            },
        )


if __name__ == "__main__":
    main()
