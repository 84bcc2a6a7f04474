"""Cost of the lateral estimators beside a plain NumPy loop over samples, in one process.

    python -m benchmarks.lateral [--quick] [--json FILE]

One model-step is one sample of one hypothesis: of the switched bank two evaluations of the
two-track model and its cost, of the Bayesian bank a step of an extended filter with seven states.
The peer is the switched bank as a user of Matlab would write it, vectorised over the hypotheses
(`peers.switched_numpy`), for as many of them. Rounds are interleaved, medians reported, compile
time beside.
"""

from __future__ import annotations

import argparse
import platform
import statistics
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.peers import switched_numpy
from benchmarks.stiffness import keep, seconds
from wheelhop import __version__
from wheelhop.estimators.failure_modes import stacked_tires
from wheelhop.estimators.lateral import STEADY_TUNING, LateralSample, SwitchedParams, switched
from wheelhop.estimators.lateral_bank import (
    bank_prior,
    bind_drive,
    lateral_bank,
    lateral_params,
    readings_and_inputs,
)
from wheelhop.filtering import drive, run_batch
from wheelhop.io.results import write_json
from wheelhop.staging import native_jit
from wheelhop.vehicle.lateral_tire import NOMINAL_TIRE, SOFT_TIRE, ArctangentTire
from wheelhop.vehicle.two_track import SOLMAZ_CAR

DT, SPEED = 0.01, 80.0 / 3.6
ROUNDS = 5
SWITCHED = switched()
BANK = lateral_bank()


class Size(NamedTuple):
    """Levels of every tyre (their fourth power are the hypotheses), runs and samples."""

    levels: int
    runs: int
    samples: int

    @property
    def steps(self) -> int:
        return self.levels**4 * self.runs * self.samples


class Case(NamedTuple):
    """What to time, and its peer by name."""

    size: Size
    call: Callable[[], Any]
    peer: str


def tires(levels: int) -> list[ArctangentTire]:
    """From soft to sound."""
    shares = np.linspace(0.0, 1.0, levels)
    ends = np.array([(t.k1, t.k2, t.k3) for t in (SOFT_TIRE, NOMINAL_TIRE)])
    return [ArctangentTire(*((1.0 - s) * ends[0] + s * ends[1]).tolist()) for s in shares]


def record(runs: int, samples: int) -> LateralSample:
    """Slalom of a sound car with the sensors' noise, [runs, time]."""
    rng, dtype = np.random.default_rng(0), jnp.result_type(float)
    steer = 0.012 * np.sin(2.0 * np.pi * DT * np.arange(samples) / 2.5) + np.zeros((runs, 1))
    rate = 8.5 * steer + 0.002 * rng.normal(size=steer.shape)
    acceleration = SPEED * 8.5 * steer + 0.05 * rng.normal(size=steer.shape)
    entries = (steer, np.full(steer.shape, SPEED), acceleration, rate)
    return LateralSample(*(jnp.asarray(entry, dtype) for entry in entries))


def switched_params(levels: int) -> SwitchedParams:
    return SwitchedParams(SOLMAZ_CAR, stacked_tires(tires(levels)), DT, STEADY_TUNING)


def selected(state: Any, info: Any) -> Any:
    """One number a step, so that storing costs nothing."""
    del state
    return info.selected


def believed(ys: LateralSample, params: SwitchedParams) -> Any:
    return drive.run(SWITCHED, SWITCHED.init(params), ys, params, keep=selected)


def loop(size: Size) -> Callable[[], Any]:
    """The peer, one run."""
    run = switched_numpy.build(switched_params(size.levels))
    ys = jax.tree.map(lambda a: np.asarray(a[0]), record(1, size.samples))
    return lambda: run(ys)


def switching(size: Size, compile: Callable[[Any], Any]) -> Callable[[], Any]:
    """The switched bank, its runs vmapped."""
    run = compile(jax.vmap(believed, (0, None)))
    ys, params = record(size.runs, size.samples), switched_params(size.levels)
    params = jax.tree.map(jnp.asarray, params)
    return lambda: run(ys, params)


def bayesian(size: Size) -> Callable[[], Any]:
    """The bank of extended filters, its runs in lanes."""
    params = lateral_params(SOLMAZ_CAR, tires(size.levels), DT)
    start = BANK.init(bank_prior(params), params)
    y, u = readings_and_inputs(record(size.runs, size.samples))
    if size.runs > 1:
        return lambda: run_batch(BANK, start, y, params, inputs=u, bind=bind_drive, keep=keep)
    y, u = jax.tree.map(lambda a: a[0], (y, u))
    return lambda: drive.run_compiled(BANK, start, y, params, inputs=u, bind=bind_drive, keep=keep)


def cases(quick: bool) -> dict[str, Case]:
    """Every case by name; the peers first."""
    less = 20 if quick else 1
    found: dict[str, Case] = {}

    def add(kind: str, work: Callable[[Size], Any], *wanted: tuple[int, int, int]) -> None:
        for levels, runs, samples in wanted:
            size = Size(levels, runs, max(samples // less, 10))
            many = f" x {size.runs:,} runs" if size.runs > 1 else ""
            found[f"{kind}, {levels**4}{many}"] = Case(size, work(size), f"NumPy loop, {levels**4}")

    small = (2, 1, 2000)
    switches = (small,) if quick else (small, (4, 1, 2000), (2, 10_000, 50))
    banks = (small,) if quick else (small, (4, 1, 400), (2, 1000, 100), (2, 10_000, 20))
    add("NumPy loop", loop, *switches[:2])
    add("switched, jit", lambda size: switching(size, jax.jit), *switches)
    add("switched, native_jit", lambda size: switching(size, native_jit), *switches)
    add("Bayesian", bayesian, *banks)
    return found


def measure(quick: bool, rounds: int) -> dict[str, dict[str, float]]:
    """Model-steps per second, their ratio to the peer's, and compile time [s], of every case."""
    chosen = cases(quick)
    first = {name: seconds(case.call) for name, case in chosen.items()}
    times: dict[str, list[float]] = {name: [] for name in chosen}
    for _ in range(rounds):
        for name, case in chosen.items():
            times[name].append(seconds(case.call))
    found = {}
    for name, case in chosen.items():
        median, steps = statistics.median(times[name]), case.size.steps
        peer_steps = chosen[case.peer].size.steps
        pairs = zip(times[name], times[case.peer], strict=True)
        found[name] = {
            "model_steps_per_s": steps / median,
            "peer_ratio": statistics.median((steps / a) / (peer_steps / b) for a, b in pairs),
            "compile_s": first[name] - median,
        }
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--quick", action="store_true", help="16 hypotheses, one short run, float32"
    )
    parser.add_argument("--json", type=Path, help="write the figures there too")
    options = parser.parse_args()
    everything: dict[str, Any] = {}
    for precision in ("float32",) if options.quick else ("float32", "float64"):
        with jax.enable_x64(precision == "float64"):
            found = everything[precision] = measure(options.quick, 1 if options.quick else ROUNDS)
        table = Table(title=f"Hypotheses of soft tyres, {precision}; NumPy in float64")
        for head in ("estimator, hypotheses", "model-steps per s", "over NumPy", "compile [s]"):
            table.add_column(head, justify="left" if head.startswith("est") else "right")
        for name, row in found.items():
            compiled = "-" if name.startswith("NumPy") else f"{row['compile_s']:.1f}"
            cells = (f"{row['model_steps_per_s']:,.0f}", f"{row['peer_ratio']:.1f}", compiled)
            table.add_row(name, *cells)
        Console().print(table)
    if options.json:
        versions = {"wheelhop": __version__, "jax": jax.__version__}
        write_json(options.json, {**versions, "machine": platform.machine(), **everything})


if __name__ == "__main__":
    main()
