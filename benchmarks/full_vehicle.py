"""Speed of the 14-degree-of-freedom vehicle against MuJoCo, in one process.

    python -m benchmarks.full_vehicle [--quick] [--json FILE]

Straight ahead at 90 km/h on an ISO 8608 road of class C, Runge-Kutta steps of 1 ms, in simulated
seconds per second of wall clock. The peers are the model of tests/oracles/mujoco_vehicle.py, one
vehicle on one core: with its force laws in NumPy and a simpler slip law (with the same one it gives
the same motion, tests/vehicle/test_full_vehicle_oracle.py), and `mj_step` alone without any force,
which bounds what MuJoCo could do with force laws that cost nothing. Rounds are interleaved and
medians reported, because machines drift; "a core" is one device, "all" every core as a device.
MuJoCo computes in double precision.
"""

from __future__ import annotations

import os

CORES = os.cpu_count() or 1
_FLAG = "--xla_force_host_platform_device_count"
if _FLAG not in os.environ.get("XLA_FLAGS", ""):
    os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {_FLAG}={CORES}".strip()

import argparse  # noqa: E402
import platform  # noqa: E402
import statistics  # noqa: E402
import time  # noqa: E402
from collections.abc import Callable  # noqa: E402
from pathlib import Path  # noqa: E402
from typing import Any, NamedTuple  # noqa: E402

import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import mujoco  # noqa: E402
import numpy as np  # noqa: E402
from rich.console import Console  # noqa: E402
from rich.table import Table  # noqa: E402

from tests.oracles import mujoco_vehicle  # noqa: E402
from wheelhop import __version__, staging  # noqa: E402
from wheelhop.io.results import write_json  # noqa: E402
from wheelhop.staging import native_jit  # noqa: E402
from wheelhop.vehicle.fleet import fleet_simulator  # noqa: E402
from wheelhop.vehicle.full_vehicle_parameters import suv  # noqa: E402
from wheelhop.vehicle.full_vehicle_state import Surroundings, VehicleState  # noqa: E402
from wheelhop.vehicle.maneuver import straight  # noqa: E402
from wheelhop.vehicle.pressure_course import held  # noqa: E402
from wheelhop.vehicle.road.build import (  # noqa: E402
    SPACING,
    START,
    build_surface,
    lines_of,
    random_tracks,
)
from wheelhop.vehicle.simulation import simulate_vehicle  # noqa: E402
from wheelhop.vehicle.vehicle_design import as_arrays  # noqa: E402

SPEED = 25.0
STEP = 1e-3
SUBSTEPS = 10
ROAD_LEVEL = 16e-6
ROAD_LENGTH = 300.0
PRESSURE = 250e3
RUNS = (1, 100, 1000)
SECONDS = {1: 2.0, 100: 0.5, 1000: 0.2}
"""Simulated by each run in one call."""


class Contender(NamedTuple):
    """A call, the seconds it simulates in all, and those it took to compile."""

    call: Callable[[], Any]
    simulated: float
    compile_seconds: float


def tracks() -> np.ndarray:
    """Elevation under the four wheels [m], the same for all contenders."""
    with jax.enable_x64(True):
        key = jax.random.key(0)
        return np.asarray(random_tracks(key, ROAD_LEVEL, ROAD_LENGTH, lines_of(suv())))


def initial(runs: int) -> VehicleState:
    """Cars that roll at the design height, spread over the first 50 m, [runs, ...]."""
    zero = np.zeros(4)
    height = float(np.mean(suv().chassis.hub_drop)) + 0.34
    one = VehicleState(
        0.0, 0.0, height, 0.0, 0.0, 0.0, SPEED, 0.0, 0.0, 0.0, 0.0, 0.0,
        zero, zero, zero + SPEED / 0.35, zero, zero,
    )  # fmt: skip
    many = jax.tree.map(lambda a: np.repeat(np.asarray(a)[None], runs, 0), one)
    return many._replace(x=np.linspace(0.0, 50.0, runs))


def ours(runs: int, dtype: str, z: np.ndarray, devices: Any) -> Contender:
    """The plant: one native function for one run, a fleet shared among the devices for more."""
    double = dtype == "float64"
    samples = round(SECONDS[runs] / (STEP * SUBSTEPS))
    rate = 1.0 / (STEP * SUBSTEPS)

    def floats(tree: Any) -> Any:
        return jax.tree.map(lambda a: jnp.asarray(a, dtype), tree)

    with jax.enable_x64(double):
        start = floats(initial(runs))
        fixed = (
            as_arrays(suv()),
            floats(straight(SPEED)),
            build_surface(z),
            floats(held(jnp.full(4, PRESSURE))),
            floats(Surroundings()),
        )
        if runs == 1:
            start = jax.tree.map(lambda a: a[0], start)
            compiled = native_jit(lambda *a: simulate_vehicle(*a, samples, rate, SUBSTEPS)[1])
        else:
            compiled = fleet_simulator(samples, rate, SUBSTEPS, devices=devices)
        begin = time.perf_counter()
        jax.block_until_ready(compiled(start, *fixed))
        first = time.perf_counter() - begin

    def call() -> Any:
        with jax.enable_x64(double):
            return jax.block_until_ready(compiled(start, *fixed))

    begin = time.perf_counter()
    loads = np.asarray(call().load)
    seconds = time.perf_counter() - begin
    if not (np.isfinite(loads).all() and 4000 < loads.mean() < 6000):
        raise RuntimeError(f"{runs} runs in {dtype}: mean wheel load {loads.mean():.0f} N")
    return Contender(call, runs * SECONDS[runs], first - seconds)


def track_road(z: np.ndarray) -> Callable[[np.ndarray, np.ndarray], Any]:
    """Elevation and slope of each wheel's own track, linear between the points."""
    slope, wheel, last = np.gradient(z, SPACING, axis=1), np.arange(4), z.shape[1] - 2

    def road(x: np.ndarray, y: np.ndarray) -> Any:
        place = (x - START) / SPACING
        k = np.clip(place.astype(int), 0, last)
        part = place - k
        here = (1 - part) * z[wheel, k] + part * z[wheel, k + 1]
        return here, (1 - part) * slope[wheel, k] + part * slope[wheel, k + 1], np.zeros(4)

    return road


def python_forces(z: np.ndarray, seconds: float) -> Contender:
    """MuJoCo with the oracle's force laws, and its simpler slip law, in a callback."""
    car = mujoco_vehicle.CAR
    vehicle = mujoco_vehicle.Vehicle(car, road=track_road(z), dt=STEP)
    start = mujoco_vehicle.at_rest(car, SPEED)

    def call() -> Any:
        return vehicle.run(start, round(seconds / STEP), SUBSTEPS)

    loads = call()["wheel_load"]
    if not 4000 < loads.mean() < 6000:
        raise RuntimeError(f"MuJoCo: mean wheel load {loads.mean():.0f} N")
    return Contender(call, seconds, 0.0)


def no_forces(seconds: float) -> Contender:
    """MuJoCo's own step: kinematics, inertia and integration of the falling car."""
    specification = mujoco.MjSpec.from_string(mujoco_vehicle.xml(mujoco_vehicle.CAR, STEP))
    for part in (*specification.actuators, *specification.sensors):
        specification.delete(part)
    model = specification.compile()
    data = mujoco.MjData(model)

    def call() -> None:
        mujoco.mj_resetData(model, data)
        mujoco.mj_step(model, data, round(seconds / STEP))

    return Contender(call, seconds, 0.0)


def measure(runs: int, dtype: str, rounds: int, z: np.ndarray) -> dict[str, Any]:
    """Medians over interleaved rounds: simulated seconds per second of every contender."""
    contenders = {"wheelhop, a core": ours(runs, dtype, z, jax.devices()[:1])}
    if runs > 1 and len(jax.devices()) > 1:
        contenders["wheelhop, all"] = ours(runs, dtype, z, jax.devices())
    contenders["MuJoCo, forces in NumPy"] = python_forces(z, 0.5)
    contenders["MuJoCo, no forces"] = no_forces(20.0)
    seconds: dict[str, list[float]] = {name: [] for name in contenders}
    for _ in range(rounds):
        for name, contender in contenders.items():
            begin = time.perf_counter()
            contender.call()
            seconds[name].append(time.perf_counter() - begin)
    return {
        "precision": dtype,
        "runs": runs,
        "simulated_per_second": {
            name: contenders[name].simulated / statistics.median(s) for name, s in seconds.items()
        },
        "compile_seconds": {
            name: c.compile_seconds for name, c in contenders.items() if c.compile_seconds
        },
    }


def show(console: Console, row: dict[str, Any]) -> None:
    """One table: a contender a line, with our rate over its."""
    rates = row["simulated_per_second"]
    core = rates["wheelhop, a core"]
    table = Table(
        "",
        "simulated s / s",
        "ours, a core / it",
        r"compile \[s]",
        title=f"{row['precision']}, {row['runs']:,} vehicles",
    )
    for name, rate in sorted(rates.items(), key=lambda item: item[1]):
        compiling = row["compile_seconds"].get(name)
        text = "" if compiling is None else f"{compiling:.1f}"
        table.add_row(name, f"{rate:,.1f}", f"{core / rate:,.2f}", text)
    console.print(table)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="100 vehicles, float32, few rounds")
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    options = parser.parse_args()
    console = Console()
    z = tracks()
    content: dict[str, Any] = {
        "benchmark": "14-degree-of-freedom vehicle, RK4, 1 ms",
        "wheelhop_version": __version__,
        "jax_version": jax.__version__,
        "mujoco_version": mujoco.__version__,
        "machine": f"{platform.machine()}, {len(jax.devices())} devices",
        "stages": staging.available(),
        "rows": [],
    }
    console.print(f"native stages: {'in use' if content['stages'] else 'NOT available, plain JAX'}")
    for precision in ("float32",) if options.quick else ("float32", "float64"):
        for runs in (100,) if options.quick else RUNS:
            row = measure(runs, precision, 3 if options.quick else 7, z)
            content["rows"].append(row)
            show(console, row)
    if options.json:
        write_json(options.json, content)


if __name__ == "__main__":
    main()
