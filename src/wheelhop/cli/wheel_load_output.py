"""What `wheelhop wheel-load` prints of loads, and the columns that it writes."""

from __future__ import annotations

from typing import Any

import numpy as np

from wheelhop.cli.session import console, headed_table
from wheelhop.estimators.load_methods import JOINT, LoadsFound
from wheelhop.vehicle.full_vehicle_parameters import CORNERS
from wheelhop.vehicle.load_record import LoadRecord


def describe(name: str, record: LoadRecord, method: str) -> str:
    """What the log holds, in a line."""
    speed = "" if record.speed is None else f", {3.6 * np.nanmean(record.speed):.4g} km/h"
    words = f"{name}: {record.t[-1] - record.t[0]:.4g} s at {1.0 / record.dt:.4g} Hz{speed}"
    if method != JOINT:
        return f"{words}; {method}"
    with_wheels = any(np.isfinite(entry).any() for entry in record.sample[-len(CORNERS) :])
    return f"{words}; {method}, {'with' if with_wheels else 'without'} wheel accelerometers"


def print_loads(results: dict[str, Any]) -> None:
    """A row for each wheel; errors where the log has the truth."""
    known = results["rmse_of_sum_N"] is not None
    headings = ["wheel", "rest [N]", "mean [N]", "lowest [N]", "at [s]", "top [N]", "sigma [N]"]
    headings += ["rms error [N]", "in 2 sigma [%]"] if known else []
    table = headed_table(*headings)
    for corner, r in results["wheels"].items():
        row = [f"{r[key]:,.0f}" for key in ("static_N", "mean_N", "lowest_N")]
        row += [f"{r['lowest_at_s']:.2f}", f"{r['highest_N']:,.0f}", _whole(r["mean_sigma_N"])]
        if known:
            share = r["share_within_2_sigma"]
            row += [f"{r['rmse_N']:,.0f}", "-" if share is None else f"{100 * share:.0f}"]
        table.add_row(corner, *row)
    console.print(table)
    if "body_mass_kg" in results:
        console.print(
            f"sprung mass {results['body_mass_kg']:,.0f} +- {results['body_mass_sigma_kg']:.0f} "
            f"kg; innovations: mean NIS {results['mean_nis']:.1f} (about "
            f"{results['mean_samples_at_once']:.0f} where the model fits)",
            soft_wrap=True,
        )
    for name in ("springs", "dampers"):
        if f"{name}_scale" in results:
            console.print(
                f"{name} {results[f'{name}_scale']:.3f} +- {results[f'{name}_scale_sigma']:.3f} "
                "times those of the vehicle",
                soft_wrap=True,
            )


def _whole(value: float | None) -> str:
    return "-" if value is None else f"{value:,.0f}"


def columns_of(
    found: LoadsFound, truth: np.ndarray | None
) -> tuple[dict[str, Any], dict[str, str]]:
    """Columns of the result by name, and their units."""
    columns: dict[str, Any] = {"t": found.t}
    for name, values in (("load", found.load), ("sigma", found.sigma), ("true_load", truth)):
        if values is not None:
            columns |= {f"{name}_{corner}": values[:, k] for k, corner in enumerate(CORNERS)}
    columns |= {"total": found.total, "sigma_total": found.total_sigma}
    return columns, {name: "s" if name == "t" else "N" for name in columns}
