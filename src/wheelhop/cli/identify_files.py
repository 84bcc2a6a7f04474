"""What `identify` writes of an identification: vehicle, data, summary and figures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from wheelhop.cli.session import say_files
from wheelhop.identification import Identification
from wheelhop.identification.descent import Descended
from wheelhop.identification.replay import Replay
from wheelhop.identification.summary import (
    AnyIdentification,
    descent_norms,
    parameter_note,
    summarise_identification,
)
from wheelhop.io.results import output_directory, write_figure, write_json, write_table
from wheelhop.io.vehicles import write_vehicle
from wheelhop.plots.identification_fit import plot_fit_overlay, plot_fit_spectra
from wheelhop.plots.identification_quality import plot_correlation, plot_descent


def write_identification(
    found: Identification,
    replays: Sequence[Replay],
    readings: dict[str, Any],
    out: Path,
    made_by: dict[str, Any],
) -> None:
    """Write the fitted vehicle, its summary, history, replay and figures; say so.

    Args:
        found: the identification.
        replays: its records with start and fit beside them.
        readings: physical meaning of start and fit.
        out: directory to write to.
        made_by: what made it.
    """
    figures = {
        "overlay.png": plot_fit_overlay(replays),
        "spectra.png": plot_fit_spectra(replays),
        "descent.png": plot_descent(found),
        "correlation.png": plot_correlation(found),
    }
    directory = output_directory(out)
    worth = f"norm of the rms errors {found.loss:.4g} m/s^2, {found.unexplained:.2%} unexplained"
    write_fitted_vehicle(directory / "vehicle.toml", found, worth, made_by)
    for name, figure in figures.items():
        write_figure(directory / name, figure)
    norms = descent_norms(found)
    write_history(directory / "history.parquet", found.descent, "loss", norms, "m/s^2")
    _write_replays(directory / "replay.parquet", replays)
    results = {**summarise_identification(found), "physical_reading": readings}
    write_json(directory / "summary.json", {**made_by, "results": results})
    say_files(
        directory, "vehicle.toml", *figures, "history.parquet", "replay.parquet", "summary.json"
    )


def write_fitted_vehicle(
    path: Path, found: AnyIdentification, worth: str, made_by: dict[str, Any]
) -> None:
    """Write the fitted vehicle, with where it comes from and how well it is known.

    Args:
        path: of the file.
        found: the identification.
        worth: how good the fit is, in one line.
        made_by: what made it.
    """
    settings = made_by["settings"]
    lines = [
        f"wheelhop {made_by['wheelhop_version']} identify, seed {settings['seed']}, "
        f"{settings['starts']} starts, {settings['precision']}",
        f"logs: {', '.join(settings['logs'])}",
        f"start: {settings['vehicle']}",
        f"{worth}; +- is a standard error, the larger of both; lines without a note were not "
        "fitted",
        *(f"problem: {problem}" for problem in found.problems),
    ]
    write_vehicle(path, found.car, "\n".join(lines), _notes(found))


def _notes(found: AnyIdentification) -> dict[str, str]:
    """Standard error of each fitted parameter, by its place in the vehicle's file."""
    known = found.uncertainty
    notes = {}
    for k, name in enumerate(found.space.names):
        key = name if "." in name else f"quarter_car.{name}"
        error = max(known.standard_errors[k], known.robust_errors[k])
        limit = parameter_note(found, k)
        size = f"+- {number(error, 3)}" if np.isfinite(error) else "fitted"
        notes[key] = f"{size}, {limit}" if limit else size
    return notes


def write_history(path: Path, descent: Descended, name: str, values: np.ndarray, unit: str) -> None:
    """Write a column of values for each start, beside iterations, time and evaluations.

    Args:
        path: of the table.
        descent: the iterations.
        name: of the columns, which are numbered from 1.
        values: [iterations + 1, starts].
        unit: of the values.
    """
    columns: dict[str, Any] = {
        "iteration": np.arange(len(values), dtype=np.int32),
        "warm_up": np.arange(len(values)) <= descent.warm_up,
        "seconds": descent.seconds,
        "evaluations": descent.evaluations,
    }
    units = {"iteration": "1", "seconds": "s", "evaluations": "1"}
    for k in range(values.shape[1]):
        columns[f"{name}_{k + 1}"], units[f"{name}_{k + 1}"] = values[:, k], unit
    write_table(path, columns, units)


def _write_replays(path: Path, replays: Sequence[Replay]) -> None:
    """All logs below each other: time, measured, start and fit."""
    parts: dict[str, list[np.ndarray]] = {}
    units = {"t": "s", "pressure": "Pa", "elevation": "m"}
    for one in replays:
        record = one.record
        series: dict[str, Any] = {
            "log": np.full(len(record.t), one.name),
            "t": record.t,
            "pressure": record.pressure,
            "elevation": record.elevation,
            "judged": one.judged,
        }
        for signal in ("a_s", "a_u"):
            series[f"{signal}_measured"] = getattr(record, signal)
            series[f"{signal}_start"] = getattr(one.start, signal)
            series[f"{signal}_fit"] = getattr(one.fit, signal)
        for name, values in series.items():
            parts.setdefault(name, []).append(values)
            if name.startswith("a_"):
                units[name] = "m/s^2"
    write_table(path, {name: np.concatenate(values) for name, values in parts.items()}, units)


def number(value: float, digits: int = 5) -> str:
    """A number to so many digits, without exponent where that is short; a dash for none."""
    if not np.isfinite(value):
        return "-"
    if value != 0 and not 1e-4 <= abs(value) < 1e9:
        return f"{value:.{digits - 1}g}"
    if abs(value) >= 10.0**digits:
        return f"{value:.0f}"
    return np.format_float_positional(value, digits, unique=False, fractional=False, trim="-")
