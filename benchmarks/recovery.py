"""Does identification find the truth, and does it know how well? Many random corners.

    python -m benchmarks.recovery [--quick] [--trials 100] [--json FILE]

Each trial draws a suspension and nine roads (40, 60, 80 km/h at 130, 180, 230 kPa, class C to D,
smoothed as by a contact patch of 12 cm), simulates a quarter car in steps ten times finer than the
log (6 s at 1 kHz) and fits damping, quadratic damping, stiffness and cubic stiffness from the
default corner: once without noise, once with 0.5 m/s^2 on both accelerometers.
"""

from __future__ import annotations

import argparse
import time
import warnings
from pathlib import Path
from typing import Any

import jax
import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table
from scipy.stats import chi2

from wheelhop import __version__
from wheelhop.errors import InputWarning
from wheelhop.identification import SUSPENSION, identify
from wheelhop.identification.parameters import with_values
from wheelhop.io.results import write_json
from wheelhop.vehicle.parameters import brancati_suv
from wheelhop.vehicle.record import CornerRecord, checked_record
from wheelhop.vehicle.road import class_level
from wheelhop.vehicle.scenario import (
    constant_pressure,
    constant_travel,
    drive,
    road_rise_of_class,
)
from wheelhop.vehicle.sensors import Sensor

RATE = 1000.0
SECONDS = 6.0
SUBSTEPS = 10
PATCH = 0.12
"""Contact length [m] over which the tyre averages the road."""

RANGES = {
    "suspension.damping": (1200.0, 4500.0),
    "suspension.quadratic_damping": (200.0, 1500.0),
    "suspension.stiffness": (2e4, 6e4),
    "suspension.cubic_stiffness": (5e5, 5e6),
}
"""True parameters are drawn from these, evenly in their logarithm."""


def draw(seed: int) -> np.ndarray:
    """True parameters of a trial, in the order of `SUSPENSION`."""
    rng = np.random.default_rng(seed)
    return np.array([np.exp(rng.uniform(*np.log(RANGES[name]))) for name in SUSPENSION])


def records_of(seed: int, true: np.ndarray, noise: float) -> list[CornerRecord]:
    """Nine records of a trial."""
    car = with_values(brancati_suv(), dict(zip(SUSPENSION, true.tolist(), strict=True)))
    rng = np.random.default_rng((seed, 1))
    records = []
    for speed in (40.0, 60.0, 80.0):
        for pressure in (130e3, 180e3, 230e3):
            road, sensors = jax.random.split(jax.random.key(int(rng.integers(2**31))))
            level = class_level("C") * 4.0 ** rng.uniform(0.0, 1.0)
            travel = constant_travel(speed / 3.6, round(SECONDS * RATE), RATE, SUBSTEPS)
            rise = np.asarray(road_rise_of_class(road, level, travel))
            both = (Sensor(noise=noise), Sensor(noise=noise))
            log, _ = drive(
                sensors,
                car,
                _smoothed(rise, speed / 3.6),
                constant_pressure(pressure),
                speed / 3.6,
                RATE,
                both,
            )
            records.append(checked_record(log))
    return records


def _smoothed(rise: np.ndarray, speed: float) -> np.ndarray:
    """The road averaged over the contact patch, twice: a log at 1 kHz then holds all of it."""
    count = max(1, round(PATCH * RATE * SUBSTEPS / speed))
    window = np.full(count, 1.0 / count)
    flat = np.convolve(np.convolve(rise.ravel(), window), window)[: rise.size]
    return flat.reshape(rise.shape)


def trial(seed: int, noise: float) -> dict[str, Any]:
    """Errors of one fit, relative and in stated standard errors."""
    true = draw(seed)
    found = identify(records_of(seed, true, noise), brancati_suv(), starts=4, seed=seed)
    error = found.values - true
    sigma = found.uncertainty.standard_errors
    # a parameter at its bound has no standard error, and counts as missed
    scaled = np.where(np.isfinite(sigma), error / sigma, np.inf)
    spread = found.uncertainty.correlation * np.outer(sigma, sigma)
    inside = np.isfinite(sigma)
    error, spread = error[inside], spread[np.ix_(inside, inside)]
    return {
        "relative": (found.values - true) / true,
        "at_bound": int(np.sum(~inside)),
        "scaled": scaled,
        "robust_ratio": found.uncertainty.robust_errors / sigma,
        "nees": float(error @ np.linalg.solve(spread, error)),
        "converged": bool(found.descent.converged[np.argmin(found.descent.loss)]),
        "problems": found.problems,
    }


def summarise(exact: list[dict[str, Any]], noisy: list[dict[str, Any]]) -> dict[str, Any]:
    """Shares and bands over all trials."""
    n = len(noisy)
    relative = np.abs(np.stack([t["relative"] for t in exact]))
    scaled = np.abs(np.stack([t["scaled"] for t in noisy]))
    whole = [t for t in noisy if t["at_bound"] == 0]
    nees = np.array([t["nees"] for t in whole])
    k = len(SUSPENSION)
    return {
        "trials": n,
        "share_exact_within_half_percent": (relative < 5e-3).all(1).mean(),
        "share_by_parameter_within_half_percent": dict(
            zip(SUSPENSION, (relative < 5e-3).mean(0).tolist(), strict=True)
        ),
        "worst_exact_relative_error": dict(zip(SUSPENSION, relative.max(0).tolist(), strict=True)),
        "share_within_2_sigma": dict(zip(SUSPENSION, (scaled < 2).mean(0).tolist(), strict=True)),
        "mean_nees": nees.mean(),
        "trials_with_a_parameter_at_its_bound": n - len(whole),
        "nees_expected": k,
        "nees_band_95_percent": (chi2.ppf([0.025, 0.975], len(whole) * k) / len(whole)).tolist(),
        "share_nees_within_95_percent": (nees < chi2.ppf(0.95, k)).mean(),
        "converged": np.mean([t["converged"] for t in (*exact, *noisy)]),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="3 trials")
    parser.add_argument("--trials", type=int, default=100, help="number of random corners")
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    warnings.simplefilter("ignore", InputWarning)
    console = Console()
    trials = range(3 if options.quick else options.trials)
    began = time.perf_counter()
    exact = [trial(k, 0.0) for k in track(trials, "without noise", console=console)]
    noisy = [trial(k, 0.5) for k in track(trials, "noise 0.5 m/s^2", console=console)]
    found = summarise(exact, noisy)
    found["seconds"] = time.perf_counter() - began
    table = Table("", "within 0.5 %, exact data", "worst, exact data", "within 2 sigma, noisy")
    for name in SUSPENSION:
        table.add_row(
            name,
            f"{found['share_by_parameter_within_half_percent'][name]:.0%}",
            f"{found['worst_exact_relative_error'][name]:.2%}",
            f"{found['share_within_2_sigma'][name]:.0%}",
        )
    console.print(table)
    low, high = found["nees_band_95_percent"]
    console.print(
        f"{found['trials']} trials in {found['seconds']:.0f} s: all four within 0.5 % in "
        f"{found['share_exact_within_half_percent']:.0%}; NEES {found['mean_nees']:.2f} "
        f"(4 expected, band {low:.2f} to {high:.2f}), "
        f"{found['share_nees_within_95_percent']:.0%} inside the 95 % ellipsoid"
    )
    if options.json:
        about = {"benchmark": "recovery of four parameters", "wheelhop_version": __version__}
        rows = {"exact": exact, "noisy": noisy}
        write_json(options.json, {**about, "results": found, "trials": rows})


if __name__ == "__main__":
    main()
