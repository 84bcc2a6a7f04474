"""What `estimate` and `demo` print and write of an estimate."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from wheelhop.cli.session import console, headed_table, say_files
from wheelhop.estimators.pressure_estimate import PressureEstimate
from wheelhop.evaluation.summary import summarise_estimate
from wheelhop.io.logs import write_log
from wheelhop.io.results import output_directory, write_figure, write_json, write_table
from wheelhop.plots import plot_estimate
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.record import CornerRecord

_HONEST_SHARE = 0.8


def report(
    result: PressureEstimate,
    record: CornerRecord,
    car: QuarterCar,
    guess: float,
    out: Path,
    made_by: dict[str, Any],
    title: str,
    log_too: bool = False,
) -> None:
    """Print the table and what it is worth; write data, summary and figure."""
    summary = summarise_estimate(result, record, guess, float(car.tire.nominal_pressure))
    console.print(_table(summary["over_time"]))
    for line in _verdict(summary):
        console.print(line)
    directory = output_directory(out)
    files = ["estimate.parquet", "estimate.png", "summary.json"]
    _write_estimate(directory / files[0], result)
    write_figure(directory / files[1], plot_estimate(result, record, title))
    if log_too:
        write_log(directory / "log.parquet", record)
        files.append("log.parquet")
    write_json(directory / files[2], {**made_by, "results": summary})
    say_files(directory, *files)


def _write_estimate(path: Path, result: PressureEstimate) -> None:
    columns: dict[str, Any] = {
        "t": result.t,
        "pressure": result.pressure,
        "pressure_sigma": result.pressure_sigma,
        "stiffness": result.stiffness,
        "stiffness_sigma": result.stiffness_sigma,
    }
    units = {"t": "s", "pressure": "Pa", "pressure_sigma": "Pa"}
    units |= {"stiffness": "N/m", "stiffness_sigma": "N/m", "nis": "1", "missing": "1"}
    for k, mode in enumerate(result.modes):
        columns[f"probability_{mode}"] = result.mode_probabilities[:, k]
        units[f"probability_{mode}"] = "1"
    if result.level is not None:
        columns |= {"level": result.level, "level_sigma": result.level_sigma}
        units |= {"level": "m^3/rad", "level_sigma": "1"}
    columns |= {"nis": result.nis, "missing": result.missing.astype(np.int32)}
    write_table(path, columns, units)


def _table(rows: list[dict[str, Any]]) -> Table:
    known = "true_pressure_Pa" in rows[0]
    truth = ["true [kPa]"] if known else []
    estimated = ("estimate [kPa]", "sigma [kPa]", "road class")
    table = headed_table("time [s]", *truth, *estimated, title="tyre pressure")
    for column in table.columns:
        column.justify = "right"
    for row in rows:
        true = [f"{row['true_pressure_Pa'] / 1e3:.1f}"] if known else []
        table.add_row(
            f"{row['t_s']:.2f}",
            *true,
            f"{row['pressure_Pa'] / 1e3:.1f}",
            f"{row['pressure_sigma_Pa'] / 1e3:.1f}",
            _road(row),
        )
    return table


def _road(row: dict[str, Any]) -> str:
    if "road_class_probability" in row:
        return f"{row['road_class']} ({row['road_class_probability']:.0%})"
    return f"{row['road_class']} (Gd = {row['road_level_m3_per_rad']:.2g} m^3/rad)"


def _verdict(summary: dict[str, Any]) -> list[str]:
    """What the estimate is worth, in plain words."""
    lines = [
        f"innovations: mean NIS {summary['mean_nis']:.2f} (2 for a single filter whose model "
        "fits, somewhat less for an IMM)",
        *summary["doubts"],
    ]
    truth = summary.get("against_truth")
    if truth is None:
        lines.append("the log holds no true pressure, so the error is not known")
        return lines
    lines.append(
        f"against the truth after {truth['judged_from_s']:.1f} s: rms error "
        f"{truth['rms_error_Pa'] / 1e3:.1f} kPa (always guessing the prior: "
        f"{truth['rms_error_of_the_prior_Pa'] / 1e3:.1f} kPa), "
        f"{truth['share_within_2_sigma']:.0%} of the time within the stated 2 sigma"
    )
    if truth["share_within_2_sigma"] < _HONEST_SHARE:
        lines.append(
            "the stated sigma is too small here: this filter is overconfident (README, limits)"
        )
    return lines
