"""Gradient descent against genetic algorithms and finite differences, on one task, in one process.

    python -m benchmarks.identification [--quick] [--json FILE] [--figure FILE]

The task is that of Brancati & Tufano 2022, section 5.2: damping, quadratic damping, stiffness and
cubic stiffness of a quarter car from nine drives (40, 60, 80 km/h at 130, 180, 230 kPa) of the full
vehicle on class C roads, 12 s at 1 kHz, by the norm of 18 acceleration errors. All contenders
search the same box through the same compiled simulator: ours from starts drawn evenly in it, and
from the default corner; NSGA-II and NSGA-III on the 18 objectives
with the point nearest to the origin, binary chromosomes with one-point crossover and bit flips, as
the paper describes; a single-objective genetic algorithm on their norm with the same chromosomes,
and one with real ones (pymoo's default operators); SciPy's least squares with finite differences.
A simulation is one candidate on all nine records. Compile time is told apart.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.optimize import least_squares

from benchmarks.peers.genetic import nearest_by_nsga, single_objective
from wheelhop import __version__
from wheelhop.errors import InputWarning
from wheelhop.identification import SearchSpace, Settings, search_space
from wheelhop.identification.descent import descend
from wheelhop.identification.drives import Prepared, prepare
from wheelhop.identification.identify import STARTS
from wheelhop.identification.objective import Task, mean_squares, task_of
from wheelhop.identification.parameters import SUSPENSION
from wheelhop.identification.replay import driven
from wheelhop.io.results import write_figure, write_json
from wheelhop.plots.style import new_figure
from wheelhop.staging import staged_jit
from wheelhop.studies.brancati.records import DriveSettings, drive_classes
from wheelhop.vehicle.parameters import brancati_suv

GENERATIONS = 1000
POPULATION = 100
NEAR = 1e-3
"""How close to the lowest loss found counts as near it, relative."""

BOX = {
    "suspension.damping": (0.0, 2e4),
    "suspension.quadratic_damping": (0.0, 2e4),
    "suspension.stiffness": (1e3, 2e5),
    "suspension.cubic_stiffness": (0.0, 1e7),
}
"""Where all contenders search; the paper's own sets lie inside."""


class Way(NamedTuple):
    """How the best loss [m/s^2], the norm of all errors, fell; arrays of one length.

    Attributes:
        seconds: since the contender began.
        simulations: by then.
        loss: the best so far.
        compile_seconds: beside it.
        values: of the best candidate.
    """

    seconds: np.ndarray
    simulations: np.ndarray
    loss: np.ndarray
    compile_seconds: float
    values: np.ndarray


class Problem(NamedTuple):
    """The task, and the simulator that all contenders call."""

    prepared: Prepared
    task: Task
    space: SearchSpace
    squares: Callable[..., Any]
    measured: float
    """Norm of the measured accelerations [m/s^2]."""

    def rmse(self, shares: np.ndarray) -> np.ndarray:
        """Errors [candidates, 18] of places in the unit box [candidates, n]."""
        inside = np.clip(shares, 1e-9, 1 - 1e-9)
        free = jnp.asarray(np.log(inside) - np.log1p(-inside))
        squares = np.asarray(self.squares(free, self.task))
        return np.sqrt(np.nan_to_num(squares, nan=1e12)).reshape(len(shares), -1)

    def values(self, shares: np.ndarray) -> np.ndarray:
        """Parameters of a place in the unit box."""
        low, high = np.array(self.space.lower), np.array(self.space.upper)
        return low + (high - low) * shares


def problem(quick: bool) -> Problem:
    """Drive the full vehicle and prepare its records."""
    settings = DriveSettings(duration=4.0 if quick else 12.0)
    records = drive_classes(settings, ("C",))["C"]
    prepared = prepare(records)
    space = search_space(SUSPENSION, BOX)
    task = task_of(brancati_suv(), prepared.drives)
    squares = staged_jit(lambda free, task: mean_squares(free, task, space))
    measured = float(
        np.sqrt(
            sum(
                np.mean(a[np.asarray(c, bool)] ** 2)
                for values, counts in (
                    (prepared.drives.a_s, prepared.drives.count_s),
                    (prepared.drives.a_u, prepared.drives.count_u),
                )
                for a, c in zip(np.asarray(values), np.asarray(counts), strict=True)
            )
        )
    )
    return Problem(prepared, task, space, squares, measured)


def gradient(p: Problem, starts: int, seed: int) -> Way:
    """wheelhop's descent: from the default corner alone, or from places drawn evenly in the box."""
    if starts == 1:
        points = p.space.free(brancati_suv())[None]
    else:
        shares = np.random.default_rng(seed).uniform(size=(starts, len(p.space.names)))
        points = np.log(shares) - np.log1p(-shares)
    began = time.perf_counter()
    descend(points, p.task, p.space, "forward", Settings(warm_up=1, iterations=1))
    compiling = time.perf_counter() - began
    found = descend(points, p.task, p.space, "forward")
    best = int(np.argmin(found.loss))
    values = np.asarray(p.space.values(jnp.asarray(found.free[best])))
    way = np.sqrt(found.history.min(axis=1)) * p.measured
    return Way(found.seconds, found.evaluations, way, compiling, values)


def finite_differences(p: Problem, seed: int) -> Way:
    """SciPy's trust-region least squares on all residuals, from one start."""
    del seed
    simulate = driven()
    drives = p.prepared.drives
    counts = [np.asarray(c) for c in (drives.count_s, drives.count_u)]
    weights = [np.sqrt(1.0 / c.sum((1, 2)))[:, None] for c in counts]
    cars_of = jax.jit(lambda free: jax.tree.map(lambda a: a[None], p.space.car(free, p.task.base)))
    rows: list[tuple[float, int, float]] = []

    def residuals(free: np.ndarray) -> np.ndarray:
        a = simulate(cars_of(jnp.asarray(free)), drives)[0]
        parts = []
        for values, measured, c, w in zip(
            (a.a_s, a.a_u), (drives.a_s, drives.a_u), counts, weights, strict=True
        ):
            error = np.asarray(values)[..., 0].reshape(c.shape) - np.asarray(measured)
            parts.append(((error * c).reshape(len(c), -1) * w).ravel())
        r = np.nan_to_num(np.concatenate(parts), nan=1e6)
        best = min(rows[-1][2] if rows else np.inf, float(np.linalg.norm(r)))
        rows.append((time.perf_counter() - began, len(rows) + 1, best))
        return r

    start = p.space.free(brancati_suv())
    began = time.perf_counter()
    residuals(start)
    compiling = time.perf_counter() - began
    rows.clear()
    began = time.perf_counter()
    found = least_squares(residuals, start, x_scale="jac", ftol=1e-10, xtol=1e-10, gtol=1e-12)
    seconds, simulations, loss = (np.array(c) for c in zip(*rows, strict=True))
    return Way(
        seconds, simulations, loss, compiling, np.asarray(p.space.values(jnp.asarray(found.x)))
    )


def measure(quick: bool, only: str, console: Console) -> tuple[Problem, dict[str, Way]]:
    """The way down of every contender whose name holds the text."""
    p = problem(quick)
    generations = 20 if quick else GENERATIONS
    n = len(p.space.names)
    contenders: dict[str, Callable[[], Way]] = {
        f"wheelhop, {STARTS} random starts": lambda: gradient(p, STARTS, 0),
        "wheelhop, default corner": lambda: gradient(p, 1, 0),
        "SciPy least squares, differences": lambda: finite_differences(p, 0),
    }
    for name, run in (
        ("GA, real chromosomes", lambda: single_objective(p.rmse, n, POPULATION, generations, 0)),
        ("GA, binary", lambda: single_objective(p.rmse, n, POPULATION, generations, 0, True)),
        (
            "NSGA-II, 18 objectives",
            lambda: nearest_by_nsga(2, p.rmse, n, POPULATION, generations, 0),
        ),
        (
            "NSGA-III, 18 objectives",
            lambda: nearest_by_nsga(3, p.rmse, n, POPULATION, generations, 0),
        ),
    ):
        contenders[name] = lambda run=run: _way(p, run())
    ways = {}
    for name, run in contenders.items():
        if only.lower() not in name.lower():
            continue
        ways[name] = run()
        w = ways[name]
        console.print(
            f"{name}: {w.loss[-1]:.4f} m/s^2 after {w.seconds[-1]:.1f} s, "
            f"{w.simulations[-1]:,} simulations"
        )
    return p, ways


def _way(p: Problem, found: Any) -> Way:
    return Way(
        found.seconds, found.simulations, found.loss, found.compile_seconds, p.values(found.best)
    )


def reached(way: Way, loss: float) -> tuple[float, int] | None:
    """Seconds and simulations until a loss was reached, or None."""
    hits = np.flatnonzero(way.loss <= loss * (1 + 1e-9))
    return None if not hits.size else (float(way.seconds[hits[0]]), int(way.simulations[hits[0]]))


def compare(ways: dict[str, Way]) -> list[dict[str, Any]]:
    """Each contender, and how long our first one took to its final loss."""
    ours = next(iter(ways.values()))
    lowest = min(float(way.loss[-1]) for way in ways.values())
    rows = []
    for name, way in ways.items():
        row: dict[str, Any] = {
            "contender": name,
            "loss_m_per_s2": float(way.loss[-1]),
            "seconds": float(way.seconds[-1]),
            "simulations": int(way.simulations[-1]),
            "compile_seconds": way.compile_seconds,
            "values": way.values.tolist(),
        }
        near = reached(way, (1.0 + NEAR) * lowest)
        if near is not None:
            row["near_seconds"], row["near_simulations"] = near
        hit = reached(ours, float(way.loss[-1]))
        if way is not ours and hit is not None:
            row["ours_to_its_loss_seconds"], row["ours_to_its_loss_simulations"] = hit
            row["its_time_over_ours"] = row["seconds"] / hit[0]
            both = way.compile_seconds + row["seconds"], ours.compile_seconds + hit[0]
            row["its_time_over_ours_with_compiling"] = both[0] / both[1]
        rows.append(row)
    return rows


def show(console: Console, rows: list[dict[str, Any]]) -> None:
    """The comparison as a table."""
    table = Table(
        "",
        r"loss \[m/s^2]",
        "s (simulations)",
        "s (simulations)\nto 0.1 % of lowest",
        r"compile \[s]",
        "time over ours\n(with compiling)",
    )
    for row in rows:
        ratio = row.get("its_time_over_ours")
        whole = row.get("its_time_over_ours_with_compiling")
        near = row.get("near_seconds")
        table.add_row(
            row["contender"],
            f"{row['loss_m_per_s2']:.4f}",
            f"{row['seconds']:.1f} ({row['simulations']:,})",
            "never" if near is None else f"{near:.1f} ({row['near_simulations']:,})",
            f"{row['compile_seconds']:.1f}",
            "" if ratio is None else f"{ratio:,.1f} ({whole:,.1f})",
        )
    console.print(table)


def draw(ways: dict[str, Way]) -> Any:
    """Loss over time and over simulations."""
    figure, axes = new_figure(2, height=3.2)
    lowest = min(w.loss[-1] for w in ways.values())
    for k, (name, way) in enumerate(ways.items()):
        excess = np.maximum(way.loss / lowest - 1.0, 1e-9)
        for ax, x in zip(axes, (way.seconds, way.simulations), strict=True):
            ax.loglog(np.maximum(x, 1e-3), excess, color=f"C{k}", label=name)
    for ax, label in zip(
        axes, ("time [s], without compiling", "simulations of all records"), strict=True
    ):
        ax.set_xlabel(label)
        ax.set_ylabel("loss above the lowest\nfound [-]")
    axes[0].legend(fontsize=7, loc="upper right")
    axes[0].set_title(
        "Descent against genetic algorithms, the same simulator", loc="left", fontsize=11
    )
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="4 s records, 20 generations")
    parser.add_argument("--only", default="", help="contenders whose name holds this text")
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    parser.add_argument("--figure", type=Path, help="write a PNG of the ways down")
    options = parser.parse_args()
    console = Console()
    warnings.simplefilter("ignore", InputWarning)
    jax.config.update("jax_enable_x64", True)
    p, ways = measure(options.quick, options.only, console)
    rows = compare(ways)
    show(console, rows)
    if options.json:
        curves = {
            name: {"seconds": w.seconds, "simulations": w.simulations, "loss_m_per_s2": w.loss}
            for name, w in ways.items()
        }
        content = {
            "benchmark": "identification of four suspension parameters, nine records, float64",
            "wheelhop_version": __version__,
            "jax_version": jax.__version__,
            "parameters": p.space.names,
            "rows": rows,
            "curves": curves,
        }
        write_json(options.json, content)
    if options.figure:
        write_figure(options.figure, draw(ways))


if __name__ == "__main__":
    main()
