"""Cost of recursive maximum likelihood beside the filters it is built from, in one process.

    python -m benchmarks.stiffness [--quick] [--json FILE]

One step is one sample of one run (of four corners for the vehicle). Peers in the same run: the
inner extended filter with k_t and the road known, and the four-class IMM of unscented filters.
Forward-mode tangents should cost less than p + 1 inner filters for p parameters, and an IMM of
them less than modes times that. Rounds are interleaved, medians reported, compile time beside.
"""

from __future__ import annotations

import argparse
import platform
import statistics
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from rich.console import Console
from rich.table import Table

from wheelhop import __version__
from wheelhop.estimators import changing, four_corners, immuf, road_model, stiffness
from wheelhop.filtering import Filter, extended, run_batch
from wheelhop.io.results import write_json
from wheelhop.vehicle.parameters import brancati_suv
from wheelhop.vehicle.quarter_car import Accelerations

DT, SPEED = 1.0 / 500.0, 60.0 / 3.6
RUNS, SECONDS = 256, 10.0
ROUNDS = 5


class Case(NamedTuple):
    """A filter to time, with what it is compared to."""

    filter: Filter
    state: Any
    params: Any
    bind: Callable[[Any, Any], Any]
    wheels: int
    peer: str | None
    bound: str


def cases() -> dict[str, Case]:
    """Every filter by name; the peers first."""
    car = brancati_suv()
    cars = (car, car, brancati_suv("rear"), brancati_suv("rear"))
    found: dict[str, Case] = {}

    def add(name: str, filter: Filter, prior: Any, params: Any, bind: Any, *rest: Any) -> None:
        found[name] = Case(filter, filter.init(prior, params), params, bind, *rest)

    rml = stiffness.stiffness_params(car, SPEED, DT)
    start = stiffness.stiffness_prior(rml)
    known = stiffness.bind_theta(rml.inner, start.theta.mean)
    inner = extended(road_model.corner_on_road(False, 1))
    add("extended filter", inner, start.state, known, bind_road, 1, None, "")
    old = immuf.immuf_params(car, SPEED, DT)
    add("IMM of 4 UKF", immuf.immuf(DT), immuf.prior(car), old, immuf.bind_speed, 1, None, "")
    two = stiffness.stiffness_filter(DT)
    add("RML, 2 parameters", two, start, rml, stiffness.bind_speed, 1, "extended filter", "< 3")
    free = ("ln_sprung_mass", "ln_damping")
    four = stiffness.stiffness_params(car, SPEED, DT, free=free)
    add(
        "RML, 4 parameters",
        stiffness.stiffness_filter(DT, free),
        stiffness.stiffness_prior(four, free=free),
        four,
        stiffness.bind_speed,
        1,
        "extended filter",
        "< 5",
    )
    imm = changing.changing_params(car, SPEED, DT)
    add(
        "IMM of 3 RML",
        changing.changing_filter(DT),
        changing.changing_prior(imm),
        imm,
        changing.bind_speed,
        1,
        "IMM of 4 UKF",
        "",
    )
    vehicle = four_corners.changing_four_corner_params(cars, SPEED, DT)
    add(
        "IMM of 3 RML, 4 corners",
        four_corners.changing_four_corner_filter(DT),
        four_corners.changing_four_corner_prior(vehicle),
        vehicle,
        four_corners.bind_speed,
        4,
        "IMM of 3 RML",
        "< 4",
    )
    return found


def bind_road(params: Any, speed: Any) -> Any:
    """The inner filter's parameters at a speed."""
    return replace(params, speed=speed)


def keep(state: Any, info: Any) -> Any:
    """One number a step, so that storing costs nothing."""
    del state
    return info.log_likelihood


def work(case: Case, runs: int, samples: int) -> Callable[[], Any]:
    """Filtering of noise of the size of a class B road's accelerations."""
    rng = np.random.default_rng(0)
    shape = (runs, samples) if case.wheels == 1 else (runs, samples, case.wheels)
    dtype = jnp.result_type(float)
    ys = Accelerations(
        jnp.asarray(rng.normal(size=shape), dtype), jnp.asarray(6.0 * rng.normal(size=shape), dtype)
    )
    speed = jnp.full((runs, samples), SPEED, dtype)
    return lambda: run_batch(
        case.filter, case.state, ys, case.params, inputs=speed, bind=case.bind, keep=keep
    )


def seconds(call: Callable[[], Any]) -> float:
    begin = time.perf_counter()
    jax.block_until_ready(call())
    return time.perf_counter() - begin


def measure(runs: int, samples: int, rounds: int) -> dict[str, dict[str, float]]:
    """Steps per second and compile time [s] of every case."""
    chosen = cases()
    calls = {name: work(case, runs, samples) for name, case in chosen.items()}
    first = {name: seconds(call) for name, call in calls.items()}
    times: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(rounds):
        for name, call in calls.items():
            times[name].append(seconds(call))
    found = {}
    for name, case in chosen.items():
        median = statistics.median(times[name])
        row = {"steps_per_s": runs * samples / median, "compile_s": first[name] - median}
        if case.peer is not None:
            pairs = zip(times[name], times[case.peer], strict=True)
            row["cost_over_peer"] = statistics.median(a / b for a, b in pairs)
        found[name] = row
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="few short runs, one round")
    parser.add_argument("--json", type=Path, help="write the figures there too")
    options = parser.parse_args()
    runs, duration, rounds = (32, 1.0, 1) if options.quick else (RUNS, SECONDS, ROUNDS)
    everything: dict[str, Any] = {}
    for precision in ("float32", "float64"):
        with jax.enable_x64(precision == "float64"):
            found = everything[precision] = measure(runs, round(duration / DT), rounds)
            chosen = cases()
        table = Table(title=f"{runs} runs of {duration:g} s at 500 Hz, {precision}")
        for head in ("filter", "steps per s", "cost over peer", "aim", "peer", "compile [s]"):
            table.add_column(head, justify="left" if head in ("filter", "peer") else "right")
        for name, row in found.items():
            ratio = f"{row['cost_over_peer']:.2f}" if "cost_over_peer" in row else "-"
            case = chosen[name]
            table.add_row(
                name,
                f"{row['steps_per_s']:,.0f}",
                ratio,
                case.bound,
                case.peer or "-",
                f"{row['compile_s']:.1f}",
            )
        Console().print(table)
    if options.json:
        versions = {"wheelhop": __version__, "jax": jax.__version__}
        write_json(options.json, {**versions, "machine": platform.machine(), **everything})


if __name__ == "__main__":
    main()
