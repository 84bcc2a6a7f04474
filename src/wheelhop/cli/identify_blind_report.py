"""What `identify --blind` prints and writes of a fit without a road."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from wheelhop.cli.identify_files import number, write_fitted_vehicle, write_history
from wheelhop.cli.identify_report import parameter_table, percent, say_worth
from wheelhop.cli.session import console, headed_table, say_files
from wheelhop.identification.blind import BlindIdentification
from wheelhop.identification.blind_summary import (
    estimate_of,
    levels_of,
    starts_at_top,
    summarise_blind,
)
from wheelhop.io.results import output_directory, write_figure, write_json
from wheelhop.plots.identification_blind import plot_blind_roads

_BESIDE = {
    "waviness": ("waviness of all roads", "1"),
    "noise_a_s": ("noise of a_s", "m/s^2"),
    "noise_a_u": ("noise of a_u", "m/s^2"),
}


def report_blind(found: BlindIdentification, out: Path, made_by: dict[str, Any]) -> None:
    """Print the tables and what they are worth; write vehicle, history, summary and figure.

    Args:
        found: the fit without a road.
        out: directory to write to.
        made_by: what made it, for the summary and the vehicle.
    """
    console.print(parameter_table(found))
    console.print(_roads(found))
    beside = _fitted_beside(found)
    if beside.rows:
        console.print(beside)
    say_worth(found, _verdict(found))
    _write(found, out, made_by)


def _roads(found: BlindIdentification) -> Table:
    table = headed_table(
        "log",
        "Gd(W0) [m^3/rad]",
        "+- [%]",
        "ISO 8608",
        "mean NIS",
        title="roads; the mean NIS is 2 where the model fits",
    )
    table.columns[0].no_wrap = True
    for k in (1, 2, 4):
        table.columns[k].justify = "right"
    for name, level, road_class, nis in zip(
        found.names, levels_of(found), found.classes, found.nis.tolist(), strict=True
    ):
        share = percent(level.relative_error)
        table.add_row(name, f"{level.value:.3g}", share, road_class, f"{nis:.2f}")
    return table


def _fitted_beside(found: BlindIdentification) -> Table:
    """Waviness and noise, where they were fitted."""
    table = headed_table(
        "quantity", "unit", "fit", "std. error", "robust error", title="roads and sensors"
    )
    for column in table.columns[2:]:
        column.justify = "right"
    for label, (name, unit) in _BESIDE.items():
        fitted = estimate_of(found, label)
        if fitted is not None:
            errors = (number(e, 3) for e in (fitted.standard_error, fitted.robust_error))
            table.add_row(name, unit, number(fitted.value, 4), *errors)
    return table


def _verdict(found: BlindIdentification) -> list[str]:
    """What the fit is worth, in plain words."""
    ascent = found.ascent
    iterations, runs = len(ascent.seconds) - 1, int(ascent.evaluations[-1])
    lines = [
        f"log-likelihood: {found.start_log_likelihood:.1f} with the start's car on roads of the "
        f"likeliest classes, {found.log_likelihood:.1f} fitted",
        f"{iterations} iterations, {runs} filter runs over all logs in {ascent.seconds[-1]:.1f} s "
        f"after compiling; {starts_at_top(found)} of {len(ascent.loss)} starts ended at the best "
        "maximum",
    ]
    known = []
    if "waviness" not in found.labels:
        known.append(f"waviness {found.waviness:g}")
    if "noise_a_s" not in found.labels:
        known.append("noise of {:g} and {:g} m/s^2".format(*found.noise))
    if known:
        lines.append(f"taken as known: {' and '.join(known)}")
    return lines


def _write(found: BlindIdentification, out: Path, made_by: dict[str, Any]) -> None:
    figure = plot_blind_roads(found)
    directory = output_directory(out)
    worth = (
        f"without a road: log-likelihood {found.log_likelihood:.6g} on roads of ISO 8608 "
        f"{', '.join(found.classes)}"
    )
    write_fitted_vehicle(directory / "vehicle.toml", found, worth, made_by)
    write_figure(directory / "roads.png", figure)
    climbed = np.where(np.isfinite(found.ascent.history), -found.ascent.history, np.nan)
    write_history(directory / "history.parquet", found.ascent, "log_likelihood", climbed, "1")
    write_json(directory / "summary.json", {**made_by, "results": summarise_blind(found)})
    say_files(directory, "vehicle.toml", "roads.png", "history.parquet", "summary.json")
