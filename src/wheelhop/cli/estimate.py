"""`wheelhop estimate` and `wheelhop demo`: pressure from a log, and from a simulated leak."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.table import Table

from wheelhop.cli.session import (
    OutDirectory,
    Precision,
    Seed,
    command,
    computing,
    console,
    progress_bar,
    provenance,
    say_files,
)
from wheelhop.cli.vehicle import DEFAULT_VEHICLE, VehicleFile, load_vehicle
from wheelhop.errors import InputError
from wheelhop.estimators.estimate import PressureEstimate, estimate_pressure
from wheelhop.estimators.immuf import ROAD_CLASSES, Tuning, validate_tuning
from wheelhop.evaluation.summary import summarise_estimate
from wheelhop.io.logs import read_log, write_log
from wheelhop.io.results import output_directory, write_figure, write_json, write_table
from wheelhop.plots import plot_estimate
from wheelhop.studies.first_light import FirstLight, run_first_light
from wheelhop.vehicle.parameters import QuarterCar, brancati_suv
from wheelhop.vehicle.record import CornerRecord
from wheelhop.vehicle.road import class_level

_TABLE_ROWS = 10
_MODE_WINDOW = 0.5
_WORST_NIS_RATIO = 1.2
_PLAUSIBLE_PRESSURE = (0.2, 1.6)


@command
def estimate(
    log: Annotated[Path, typer.Argument(help="CSV or Parquet: t, a_s, a_u, v with units.")],
    vehicle: VehicleFile = None,
    classes: Annotated[
        str, typer.Option(help="ISO 8608 classes of the members, as letters.")
    ] = "".join(ROAD_CLASSES),
    units: Annotated[
        Path | None,
        typer.Option(help="TOML with [units] and [columns]; default LOG.toml if there."),
    ] = None,
    noise: Annotated[float, typer.Option(help="Accelerometer noise [m/s^2].")] = 0.5,
    walk: Annotated[
        float, typer.Option(help="Random walk of the stiffness, relative per root second.")
    ] = Tuning.stiffness_walk,
    out: OutDirectory = Path("wheelhop-estimate"),
    seed: Seed = 0,
    precision: Precision = "float64",
) -> None:
    """Estimate tyre pressure over time from a log of two accelerometers.

    The estimator is an IMM of four unscented filters, one per ISO 8608 class A to D. On a
    road between the classes it can be wrong by tens of kPa: see the README's limits.

    Example: wheelhop estimate drive.csv --vehicle front.toml --out result
    """
    members = road_classes(classes)
    with computing(precision):
        record = read_log(log, units)
        car, name = load_vehicle(vehicle)
        tuning = validate_tuning(Tuning(noise_a_s=noise, noise_a_u=noise, stiffness_walk=walk))
        with progress_bar("filtering", "samples") as advance:
            result = estimate_pressure(
                record, car, tuning=tuning, classes=members, on_progress=advance
            )
    settings = {
        "log": str(log),
        "vehicle": name,
        "classes": members,
        "tuning": asdict(tuning),
        "seed": seed,
    }
    made_by = provenance("estimate", precision, **settings)
    _report(result, record, car, tuning, out, made_by, Path(log).name)


@command
def demo(
    out: OutDirectory = Path("wheelhop-demo"),
    road: Annotated[str, typer.Option(help="ISO 8608 class of the true road.")] = "B",
    seed: Seed = 0,
    precision: Precision = "float64",
) -> None:
    """Simulate an SUV's corner at 60 km/h whose tyre leaks from 230 to 180 kPa, and see it.

    Example: wheelhop demo --road C --seed 3 --out demo
    """
    settings = FirstLight(road_class=road, seed=seed)
    tuning = Tuning()
    console.print(f"vehicle: {DEFAULT_VEHICLE}; road: ISO class {road}; 60 km/h; 500 Hz")
    with computing(precision), progress_bar("filtering", "samples") as advance:
        record, result = run_first_light(settings, tuning, on_progress=advance)
    made_by = provenance(
        "demo", precision, study=asdict(settings), tuning=asdict(tuning), vehicle=DEFAULT_VEHICLE
    )
    title = f"A tyre that leaks from 230 to 180 kPa, class {road} road, 60 km/h"
    _report(result, record, brancati_suv(), tuning, out, made_by, title, log_too=True)


def road_classes(letters: str) -> tuple[str, ...]:
    """Classes of the members, from letters as "ABCD".

    Raises:
        InputError: if one is unknown or given twice, or none is given.
    """
    members = tuple(letters.replace(",", "").upper())
    if not members or len(set(members)) != len(members):
        raise InputError("--classes", f"{letters!r}", "Give each class once, as ABCD.")
    for member in members:
        class_level(member)
    return members


def _report(
    result: PressureEstimate,
    record: CornerRecord,
    car: QuarterCar,
    tuning: Tuning,
    out: Path,
    made_by: dict[str, Any],
    title: str,
    log_too: bool = False,
) -> None:
    """Print the table, write data, summary and figure."""
    summary = summarise_estimate(result, record, tuning.prior_pressure)
    console.print(_result_table(result, record))
    for line in _verdict(summary, float(car.tire.nominal_pressure)):
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
    columns |= {"nis": result.nis, "missing": result.missing.astype(np.int32)}
    write_table(path, columns, units)


def _result_table(result: PressureEstimate, record: CornerRecord) -> Table:
    known = record.pressure is not None
    table = Table("time [s]", *(["true [kPa]"] if known else []), title="tyre pressure")
    for heading in ("estimate [kPa]", "sigma [kPa]", "most probable road class"):
        table.add_column(heading)
    for column in table.columns:
        column.justify = "right"
    window = max(1, round(_MODE_WINDOW / record.dt))
    rows = np.unique(np.linspace(0, len(result.t) - 1, _TABLE_ROWS + 1).round().astype(int)[1:])
    for k in rows:
        share = result.mode_probabilities[max(0, k + 1 - window) : k + 1].mean(axis=0)
        true = [f"{record.pressure[k] / 1e3:.1f}"] if record.pressure is not None else []
        table.add_row(
            f"{result.t[k]:.2f}",
            *true,
            f"{result.pressure[k] / 1e3:.1f}",
            f"{result.pressure_sigma[k] / 1e3:.1f}",
            f"{result.modes[int(np.argmax(share))]} ({share.max():.0%})",
        )
    return table


def _verdict(summary: dict[str, Any], nominal_pressure: float) -> list[str]:
    """What the estimate is worth, in plain words."""
    low, high = summary["nis_95_percent_band_if_consistent"]
    lines = [
        f"innovations: mean NIS {summary['mean_nis']:.2f} "
        f"(a filter whose model fits: {low:.2f} to {high:.2f})"
    ]
    if summary["mean_nis"] > _WORST_NIS_RATIO * high:
        lines.append(
            "the innovations are larger than any member expects: the road is rougher than the "
            "classes (see --classes), or the vehicle's parameters are wrong"
        )
    low_p, high_p = (factor * nominal_pressure for factor in _PLAUSIBLE_PRESSURE)
    if not low_p < summary["final_pressure_Pa"] < high_p:
        lines.append(
            f"{summary['final_pressure_Pa'] / 1e3:.0f} kPa is no plausible pressure of a tyre of "
            f"{nominal_pressure / 1e3:.0f} kPa: do not use this estimate"
        )
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
    if truth["share_within_2_sigma"] < 0.8:
        lines.append(
            "the stated sigma is too small here: this filter is overconfident (README, limits)"
        )
    return lines
