"""Cost of the wheel-load estimators beside SciPy and NumPy, in one process.

    python -m benchmarks.wheel_load [--quick] [--json FILE]

One step is one sample of one corner; of the joint filter one sample of the vehicle by one filter of
its bank. Peers: SciPy's compiled `lfilter` for the Youla observer (which has the load alone, no
covariance and no lost samples), a NumPy loop for the unbiased filter, filterpy's unscented filter
on the same model for the joint one. Rounds are interleaved, medians reported, compile time beside.
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

from benchmarks.peers import load_filterpy, load_numpy
from benchmarks.stiffness import seconds
from wheelhop import __version__
from wheelhop.estimators.joint_load import wheel_loads
from wheelhop.estimators.joint_load_params import JointLoadTuning
from wheelhop.estimators.unbiased_load import unbiased, unbiased_params
from wheelhop.estimators.wheel_load import LoadObserver, LoadSample
from wheelhop.estimators.youla_load import unknown_before, youla, youla_params
from wheelhop.filtering import run_batch
from wheelhop.io.results import write_json
from wheelhop.vehicle.corner_suspension import CornerSuspension, corner_suspensions
from wheelhop.vehicle.full_vehicle_parameters import suv
from wheelhop.vehicle.load_record import VehicleLoadSample

DT, BANDWIDTH, RELATIVE_LAG = 1e-3, 30.0, 0.1
WALK = 3000.0
ROUNDS = 5
PEERS = ("SciPy lfilter", "NumPy loop", "filterpy")


class Case(NamedTuple):
    """What to time, how many steps it does, and its peer by name."""

    call: Callable[[], Any]
    steps: int
    peer: str


def corner() -> CornerSuspension:
    """The front left corner of the SUV."""
    return jax.tree.map(lambda leaf: leaf[0], corner_suspensions(suv()))


def record(runs: int, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Accelerations [m/s^2] and deflections [m] of a rolling road with noise, [runs, time]."""
    rng, t = np.random.default_rng(0), DT * np.arange(samples)
    phase = rng.uniform(0.0, 6.0, (runs, 1))
    acceleration = np.sin(8.0 * t + phase) + 0.5 * rng.normal(size=(runs, samples))
    return acceleration, 0.01 * np.sin(8.0 * t + phase) + 5e-4 * rng.normal(size=(runs, samples))


def normal_load(state: Any, info: Any) -> Any:
    """One number a step, so that storing costs nothing."""
    del info
    return state.load.mean.normal


def observing(observer: LoadObserver, params: Any, runs: int, samples: int) -> Callable[[], Any]:
    """An observer of a corner, its runs in lanes."""
    kind = jnp.result_type(float)
    ys = LoadSample(*(jnp.asarray(a, kind) for a in record(runs, samples)))
    start = observer.filter.init(unknown_before(), params)
    return lambda: run_batch(observer.filter, start, ys, params, keep=normal_load)


def vehicle_record(samples: int) -> np.ndarray:
    """A vehicle at rest with the noise of its sensors, [time, 12]."""
    noise = np.repeat([0.5, 5e-4, 0.5], 4)
    return noise * np.random.default_rng(0).normal(size=(samples, 12))


def joint(samples: int) -> Callable[[], Any]:
    """The joint filter of one walk on one record, results and covariances kept."""
    sample = VehicleLoadSample(*vehicle_record(samples).T)
    tuning, vehicle = JointLoadTuning(load_walks=(WALK,)), suv()
    return lambda: wheel_loads(sample, DT, vehicle, tuning)


def cases(quick: bool) -> dict[str, Case]:
    """Every case by name; the peers first."""
    short, many = (500, 20) if quick else (4000, 1000)
    whole = 200 if quick else 4096
    found: dict[str, Case] = {}
    params, free = youla_params(corner(), DT, BANDWIDTH), unbiased_params(corner(), DT, BANDWIDTH)
    filtered = load_numpy.youla(params, BANDWIDTH, RELATIVE_LAG)
    loop = load_numpy.unbiased(free)
    a, q = record(many, short)
    one = record(1, short)
    found["SciPy lfilter"] = Case(lambda: filtered(a, q), many * short, "SciPy lfilter")
    found["NumPy loop"] = Case(lambda: loop(one[0][0], one[1][0]), short, "NumPy loop")
    peer = load_filterpy.joint(suv(), DT, WALK, JointLoadTuning())
    still = vehicle_record(200)
    found["filterpy"] = Case(lambda: peer(still), len(still), "filterpy")
    for runs in (1, many):
        called = f", {runs:,} runs" if runs > 1 else ""
        work = observing(youla(), params, runs, short)
        found[f"Youla{called}"] = Case(work, runs * short, "SciPy lfilter")
        work = observing(unbiased(), free, runs, short)
        found[f"unbiased{called}"] = Case(work, runs * short, "NumPy loop")
    found["joint"] = Case(joint(whole), whole, "filterpy")
    return found


def measure(quick: bool, rounds: int) -> dict[str, dict[str, float]]:
    """Steps per second, their ratio to the peer's, and compile time [s], of every case."""
    chosen = cases(quick)
    first = {name: seconds(case.call) for name, case in chosen.items()}
    times: dict[str, list[float]] = {name: [] for name in chosen}
    for _ in range(rounds):
        for name, case in chosen.items():
            times[name].append(seconds(case.call))
    found = {}
    for name, case in chosen.items():
        median = statistics.median(times[name])
        peer_steps = chosen[case.peer].steps
        pairs = zip(times[name], times[case.peer], strict=True)
        found[name] = {
            "steps_per_s": case.steps / median,
            "peer_ratio": statistics.median((case.steps / a) / (peer_steps / b) for a, b in pairs),
            "compile_s": first[name] - median,
        }
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="short records, few runs, float32")
    parser.add_argument("--json", type=Path, help="write the figures there too")
    options = parser.parse_args()
    everything: dict[str, Any] = {}
    for precision in ("float32",) if options.quick else ("float32", "float64"):
        with jax.enable_x64(precision == "float64"):
            found = everything[precision] = measure(options.quick, 1 if options.quick else ROUNDS)
        table = Table(title=f"Wheel load, {precision}; peers in float64")
        for head in ("estimator", "steps per s", "over its peer", "compile, s"):
            table.add_column(head, justify="left" if head == "estimator" else "right")
        for name, row in found.items():
            compiled = "-" if name in PEERS else f"{row['compile_s']:.1f}"
            table.add_row(name, f"{row['steps_per_s']:,.0f}", f"{row['peer_ratio']:.2f}", compiled)
        Console().print(table)
    if options.json:
        versions = {"wheelhop": __version__, "jax": jax.__version__}
        write_json(options.json, {**versions, "machine": platform.machine(), **everything})


if __name__ == "__main__":
    main()
