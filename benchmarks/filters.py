"""Speed of the 4-mode IMM of unscented filters against its peers, in one process.

    python -m benchmarks.filters [--quick] [--json FILE]

Peers: filterpy's IMM (a Python loop), the same IMM in idiomatic JAX, four unscented filters of
dynamax and of smcx (no mixing, fixed noise: less work), and a C++ kernel of the same IMM built
here from source, the practical limit. All solve the problem of tests/oracles/filterpy.json and
agree with it (tests/test_benchmark_peers.py). Rounds are interleaved and medians reported,
because machines drift; "a core" is one device, "all" every core as a device.
"""

from __future__ import annotations

import os

CORES = os.cpu_count() or 1
_FLAG = "--xla_force_host_platform_device_count"
if _FLAG not in os.environ.get("XLA_FLAGS", ""):
    os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {_FLAG}={CORES}".strip()

import argparse  # noqa: E402
import json  # noqa: E402
import platform  # noqa: E402
import statistics  # noqa: E402
import subprocess  # noqa: E402
import sys  # noqa: E402
import time  # noqa: E402
from collections.abc import Callable  # noqa: E402
from pathlib import Path  # noqa: E402
from typing import Any  # noqa: E402

import jax  # noqa: E402
import numpy as np  # noqa: E402
from rich.console import Console  # noqa: E402
from rich.table import Table  # noqa: E402

from benchmarks import work  # noqa: E402
from benchmarks.peers import compiled, dynamax_ukf, idiomatic, problem, smcx_ukf  # noqa: E402
from benchmarks.peers.problem import Unavailable  # noqa: E402
from tests.oracles.generate_filterpy import make_imm  # noqa: E402
from wheelhop import __version__, staging  # noqa: E402
from wheelhop.io.results import write_json  # noqa: E402

SAMPLES = 500
RUNS = (1, 100, 1000, 10_000)
LIBRARIES = {"dynamax": dynamax_ukf, "smcx": smcx_ukf}


def filterpy_rate(steps: int) -> float:
    """Filter steps per second of filterpy's IMM."""
    imm = make_imm("cubature")
    ys = problem.records(1, steps, "float64")[0]
    start = time.perf_counter()
    for y in ys:
        imm.predict()
        imm.update(y)
    return steps / (time.perf_counter() - start)


def contenders(
    runs: int, samples: int, dtype: str, quick: bool
) -> tuple[dict[str, Callable[[], Any]], dict[str, float], dict[str, str], dict[str, float]]:
    """What to call, its seconds to compile, why others are missing, and MiB of temporaries."""
    calls: dict[str, Callable[[], Any]] = {}
    compile_seconds: dict[str, float] = {}
    missing: dict[str, str] = {}
    memory: dict[str, float] = {}

    def add(name: str, build: Callable[[], Any]) -> None:
        try:
            peer = build()
        except Unavailable as reason:
            missing[name] = str(reason)
            return
        calls[name] = lambda: peer.call(peer.ys)
        compile_seconds[name] = peer.compile_seconds
        if hasattr(peer.call, "memory"):
            memory[name] = peer.call.memory / 2**20

    first = jax.devices()[:1]
    add("wheelhop, a core", lambda: work.build(runs, samples, dtype, first))
    if runs > 1 and len(jax.devices()) > 1:
        add("wheelhop, all", lambda: work.build(runs, samples, dtype))
    if runs <= 1000:
        add("idiomatic JAX", lambda: idiomatic.build(runs, samples, dtype))
        if not quick and dtype == "float32":
            for name, library in LIBRARIES.items():
                add(name, lambda library=library: library.build(runs, samples, dtype))
    for threads, name in ((1, "C++, a core"), (CORES, "C++, all")):
        if threads == 1 or runs > 1:
            try:
                kernel = compiled.build(dtype, threads)
            except Unavailable as reason:
                missing[name] = str(reason)
                continue
            ys = problem.records(runs, samples, dtype)
            calls[name] = lambda kernel=kernel, ys=ys: kernel(ys)
            compile_seconds[name] = compiled.library()[1]
    return calls, compile_seconds, missing, memory


def measure(runs: int, dtype: str, rounds: int, quick: bool) -> dict[str, Any]:
    """Medians over interleaved rounds: steps per second of every contender."""
    samples = SAMPLES if runs <= 1000 else 100
    calls, compile_seconds, missing, memory = contenders(runs, samples, dtype, quick)
    for name, call in calls.items():
        result = call()
        if not all(np.isfinite(np.asarray(leaf)).all() for leaf in jax.tree.leaves(result)):
            raise RuntimeError(f"{name}: the result is not finite")
    seconds: dict[str, list[float]] = {name: [] for name in calls}
    python_rates = []
    for _ in range(rounds):
        python_rates.append(filterpy_rate(50))
        for name, call in calls.items():
            repeats = 5 if runs == 1 else 1
            start = time.perf_counter()
            for _ in range(repeats):
                call()
            seconds[name].append((time.perf_counter() - start) / repeats)
    rates = {name: runs * samples / statistics.median(s) for name, s in seconds.items()}
    rates["filterpy"] = statistics.median(python_rates)
    return {
        "precision": dtype,
        "runs": runs,
        "samples": samples,
        "steps_per_second": rates,
        "compile_seconds": compile_seconds,
        "missing": missing,
        "temporary_MiB": memory,
    }


def measure_gradient(runs: int, rounds: int, dtype: str) -> dict[str, Any]:
    """Cost of the reverse-mode gradient by ten parameters, on one core."""
    first = jax.devices()[:1]
    with jax.enable_x64(dtype == "float64"):
        values = jax.tree.map(np.asarray, work.knobs())
    peers = {
        "value": work.build_likelihood(runs, SAMPLES, dtype, False, first),
        "gradient": work.build_likelihood(runs, SAMPLES, dtype, True, first),
        "idiomatic gradient": idiomatic.build_gradient(runs, SAMPLES, dtype, values),
    }
    calls = {
        "value": lambda: peers["value"].call(values),
        "gradient": lambda: peers["gradient"].call(values),
        "idiomatic gradient": lambda: peers["idiomatic gradient"].call(
            peers["idiomatic gradient"].ys
        ),
    }
    results = {name: call() for name, call in calls.items()}
    if not all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(results["gradient"])):
        raise RuntimeError("the gradient is not finite")
    seconds: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(rounds):
        for name, call in calls.items():
            start = time.perf_counter()
            call()
            seconds[name].append(time.perf_counter() - start)
    median = {name: statistics.median(s) for name, s in seconds.items()}
    ours = np.concatenate([np.ravel(a) for a in jax.tree.leaves(results["gradient"])])
    theirs = np.concatenate(
        [
            np.ravel(np.asarray(a).sum(axis=0))
            for a in jax.tree.leaves(results["idiomatic gradient"])
        ]
    )
    return {
        "precision": dtype,
        "runs": runs,
        "samples": SAMPLES,
        "seconds": median,
        "gradient_to_forward": median["gradient"] / median["value"],
        "idiomatic_to_ours": median["idiomatic gradient"] / median["gradient"],
        "compile_seconds": {name: peer.compile_seconds for name, peer in peers.items()},
        "temporary_MiB": {name: peers[name].call.memory / 2**20 for name in ("value", "gradient")},
        "difference_from_idiomatic": float(np.max(np.abs(ours - theirs)) / np.max(np.abs(theirs))),
        "gradient": ours.tolist(),
    }


def measure_long(samples: int, runs: int) -> dict[str, Any]:
    """Gradient through long records in a process of its own, so that its peak memory is its own."""
    command = [sys.executable, "-m", "benchmarks.memory", str(samples), str(runs)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1])


def show(console: Console, row: dict[str, Any]) -> None:
    """One table: a contender a line, with our rate over its."""
    rates = row["steps_per_second"]
    best = rates.get("wheelhop, all", rates["wheelhop, a core"])
    table = Table(
        "",
        "steps/s",
        "ours, a core / it",
        "ours, all / it",
        r"compile \[s]",
        title=f"{row['precision']}, {row['runs']:,} runs of {row['samples']} samples",
    )
    for name, rate in sorted(rates.items(), key=lambda item: item[1]):
        seconds = row["compile_seconds"].get(name)
        table.add_row(
            name,
            f"{rate:,.0f}",
            f"{rates['wheelhop, a core'] / rate:,.2f}",
            f"{best / rate:,.2f}",
            "" if seconds is None else f"{seconds:.1f}",
        )
    console.print(table)
    used = ", ".join(f"{name} {mib:.0f}" for name, mib in row["temporary_MiB"].items())
    console.print(f"temporary memory [MiB]: {used}", markup=False)
    for name, reason in row["missing"].items():
        console.print(f"{name}: {reason}", markup=False)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="one batch size, few rounds")
    parser.add_argument(
        "--runs", type=int, nargs="+", default=RUNS, help="batch sizes (default: 1 to 10,000)"
    )
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    options = parser.parse_args()
    console = Console()
    rounds = 2 if options.quick else 7
    content: dict[str, Any] = {
        "benchmark": "4-mode IMM of unscented filters, 5 states, RK4",
        "wheelhop_version": __version__,
        "jax_version": jax.__version__,
        "machine": f"{platform.machine()}, {len(jax.devices())} devices",
        "stages": staging.available(),
        "rows": [],
    }
    console.print(f"native stages: {'in use' if content['stages'] else 'NOT available, plain JAX'}")
    for precision in ("float32",) if options.quick else ("float32", "float64"):
        for runs in (100,) if options.quick else options.runs:
            row = measure(runs, precision, rounds, options.quick)
            content["rows"].append(row)
            show(console, row)
    content["streaming_microseconds"] = 1e6 * work.streaming_latency()
    console.print(f"streaming, one sample: {content['streaming_microseconds']:.1f} us (median)")
    if not options.quick:
        gradients = [measure_gradient(100, 5, dtype) for dtype in ("float32", "float64")]
        for g in gradients:
            console.print(
                f"gradient by 10 parameters, {g['precision']}, {g['runs']} runs, a core: "
                f"{g['gradient_to_forward']:.1f} forward passes, "
                f"{g['idiomatic_to_ours']:.1f} times idiomatic JAX's speed, "
                f"compile {g['compile_seconds']['gradient']:.0f} s "
                f"(idiomatic {g['compile_seconds']['idiomatic gradient']:.0f} s), "
                f"{g['temporary_MiB']['gradient']:.0f} MiB; "
                f"{g['difference_from_idiomatic']:.1e} from idiomatic JAX's"
            )
        single, double = (np.asarray(g["gradient"]) for g in gradients)
        content["gradient"] = gradients
        content["gradient_float32_error"] = float(np.max(np.abs(single / double - 1)))
        console.print(f"float32 gradient from float64: {content['gradient_float32_error']:.2%}")
        content["long"] = measure_long(100_000, 100)
        console.print(
            f"gradient through 100,000 samples x 100 runs: {content['long']['seconds']:.0f} s, "
            f"{content['long']['temporary_MiB']:.0f} MiB of temporaries, "
            f"{content['long']['peak_process_MiB']:.0f} MiB peak of the process"
        )
    if options.json:
        write_json(options.json, content)


if __name__ == "__main__":
    main()
