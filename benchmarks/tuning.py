"""Speed of tuning: the gradient through the filters against central differences, in one process.

    python -m benchmarks.tuning [--quick] [--json FILE]

The objective is the mean-square error of the stiffness over runs and time, as
`wheelhop.estimators.tuning` descends on it, of the printed and the corrected filter over four road
classes. The peer evaluates the same compiled objective twice for every knob, which is what a tuning
without derivatives pays for one direction. Rounds are interleaved and medians reported.
"""

from __future__ import annotations

import argparse
import platform
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from rich.console import Console
from rich.table import Table

from wheelhop import __version__
from wheelhop.estimators.candidate import Candidate, Records, as_float
from wheelhop.estimators.candidates import all_corrected, all_printed
from wheelhop.estimators.tuning import TuningSettings, objective_of
from wheelhop.io.results import write_json
from wheelhop.vehicle.parameters import brancati_suv
from wheelhop.vehicle.quarter_car import Accelerations

DT = 1.0 / 500.0
RUNS, SECONDS = 48, 10.0
ROUNDS = 5


def records(runs: int, samples: int) -> tuple[Records, np.ndarray, Any]:
    """Noise of the size of a class B road's accelerations; a filter costs the same on any."""
    rng = np.random.default_rng(0)
    measured = Accelerations(
        1.0 * rng.normal(size=(runs, samples)), 6.0 * rng.normal(size=(runs, samples))
    )
    keys = jax.vmap(jax.random.key)(jnp.arange(runs))
    speed = np.full((runs, samples), 60 / 3.6)
    return Records(measured, speed, DT), np.full((runs, samples), 212.8e3), keys


def seconds(call: Callable[[], Any]) -> float:
    begin = time.perf_counter()
    jax.block_until_ready(call())
    return time.perf_counter() - begin


def measure(candidate: Candidate, runs: int, samples: int, rounds: int) -> dict[str, float]:
    """Compile times, a forward pass, a gradient and central differences [s]."""
    data = records(runs, samples)
    settings = TuningSettings("mse", settling=0.0)
    value, slope = objective_of(candidate, *data, settings)
    logs = {name: jnp.log(as_float(knob)) for name, knob in candidate.default.items()}

    def differences() -> float:
        total = 0.0
        for name in logs:
            for step in (1e-3, -1e-3):
                total += float(value(logs | {name: logs[name] + step}))
        return total

    first = {"forward": seconds(lambda: value(logs)), "gradient": seconds(lambda: slope(logs))}
    times: dict[str, list[float]] = {"forward": [], "gradient": [], "differences": []}
    for _ in range(rounds):
        times["forward"].append(seconds(lambda: value(logs)))
        times["gradient"].append(seconds(lambda: slope(logs)))
        times["differences"].append(seconds(differences))
    found = {name: statistics.median(found) for name, found in times.items()}
    compiling = {f"compile_{n}": max(0.0, first[n] - found[n]) for n in first}
    return {**found, **compiling, "knobs": float(len(logs))}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="few short runs, one round")
    parser.add_argument("--json", type=Path, help="write the figures there too")
    options = parser.parse_args()
    runs, duration, rounds = (8, 1.0, 1) if options.quick else (RUNS, SECONDS, ROUNDS)
    samples = round(duration / DT)
    cars = dict.fromkeys("ABCD", brancati_suv())
    found = {}
    table = Table(title=f"{runs} runs of {duration:g} s at 500 Hz, float64 [s]")
    for head in (
        "filter",
        "knobs",
        "forward",
        "gradient",
        "central differences",
        "ratio",
        "compile",
    ):
        table.add_column(head, justify="left" if head == "filter" else "right")
    with jax.enable_x64(True):
        for make in (all_printed, all_corrected):
            candidate = make(cars, DT, "iso8608")
            m = found[candidate.name] = measure(candidate, runs, samples, rounds)
            table.add_row(
                candidate.name,
                f"{m['knobs']:.0f}",
                f"{m['forward']:.2f}",
                f"{m['gradient']:.2f} ({m['gradient'] / m['forward']:.1f} forward)",
                f"{m['differences']:.2f}",
                f"{m['differences'] / m['gradient']:.1f}",
                f"{m['compile_forward']:.0f} + {m['compile_gradient']:.0f}",
            )
    Console().print(table)
    if options.json:
        versions = {"wheelhop": __version__, "jax": jax.__version__}
        write_json(options.json, {**versions, "machine": platform.machine(), "filters": found})


if __name__ == "__main__":
    main()
