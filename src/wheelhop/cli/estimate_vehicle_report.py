"""What `estimate` and `demo` print and write of four tyres."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from wheelhop.cli.session import console, escape, headed_table
from wheelhop.estimators.alarm_events import AlarmEvent
from wheelhop.estimators.alarms import AlarmOutput
from wheelhop.estimators.estimate_vehicle import VehicleEstimate
from wheelhop.estimators.four_corners import WHEELS
from wheelhop.io.results import write_figure, write_json, write_table
from wheelhop.plots.alarms import plot_alarms
from wheelhop.vehicle.record import CornerRecord

_ROWS = 10
_SETTLED = 10.0
_FITTING = (0.7, 1.3)
_PLAUSIBLE = (0.3, 1.6)


def write_estimate(
    directory: Path,
    estimate: VehicleEstimate,
    output: AlarmOutput,
    events: list[AlarmEvent],
    records: list[CornerRecord],
    placard: float,
    made_by: dict[str, Any],
) -> list[str]:
    """Print the table, alarms and doubts; write data, summary and figure.

    Args:
        directory: for the results.
        estimate: over the drive.
        output: of the alarms.
        events: the alarms in words.
        records: of the corners; where they hold true pressures, errors are told.
        placard: recommended pressure [Pa].
        made_by: what made the result.

    Returns:
        Names of the files.
    """
    t, truth = estimate.t, _truth(estimate.t, records)
    console.print(_table(t, output, truth))
    for event in events:
        console.print(f"[bold red]alarm[/] {escape(event.words)}", soft_wrap=True)
    if not events:
        console.print("no alarm")
    nis = float(np.mean(estimate.nis))
    console.print(f"innovations: mean NIS {nis:.2f} ({estimate.entries} where the model fits)")
    doubts = _doubts(nis / estimate.entries, output.pressure[-1], placard)
    for doubt in doubts:
        console.print(f"[yellow]warning[/] {escape(doubt)}", soft_wrap=True)
    results: dict[str, Any] = {
        "final_pressure_Pa": dict(zip(WHEELS, output.pressure[-1].tolist(), strict=True)),
        "final_pressure_sigma_Pa": dict(zip(WHEELS, output.pressure_sd[-1].tolist(), strict=True)),
        "final_road_level_m3_per_rad": float(estimate.level[-1]),
        "mean_nis": nis,
        "missing_measurements": int(estimate.missing.sum()),
        "alarms": [asdict(event) for event in events],
        "doubts": doubts,
    }
    if truth is not None:
        late = t >= min(_SETTLED, 0.25 * t[-1])
        error = (output.pressure - truth)[late]
        results["rms_error_Pa"] = np.sqrt(np.mean(error**2, axis=0)).tolist()
        worst = max(results["rms_error_Pa"])
        console.print(
            f"against the truth after {t[late][0]:.0f} s: rms error "
            f"{np.sqrt(np.mean(error**2)) / 1e3:.1f} kPa over all wheels, {worst / 1e3:.1f} kPa "
            "of the worst"
        )
    write_table(directory / "estimate.parquet", *_columns(estimate, output, truth))
    figure = plot_alarms(t, output.pressure, output.pressure_sd, placard, events, truth=truth)
    write_figure(directory / "estimate.png", figure)
    write_json(directory / "summary.json", {**made_by, "results": results})
    return ["estimate.parquet", "estimate.png", "summary.json"]


def _doubts(fit: float, pressure: np.ndarray, placard: float) -> list[str]:
    """Reasons not to use the estimate; none where nothing speaks against it."""
    doubts = []
    if not _FITTING[0] < fit < _FITTING[1]:
        doubts.append(
            f"the innovations are {fit**0.5:.2g} times as large as the model expects: the "
            "vehicle's parameters, the noise or the kind of road do not fit (try --method hop)"
        )
    for wheel, p in zip(WHEELS, pressure, strict=True):
        if not _PLAUSIBLE[0] * placard < p < _PLAUSIBLE[1] * placard:
            doubts.append(f"{p / 1e3:.0f} kPa is no plausible pressure of {wheel}: do not use it")
    return doubts


def _truth(t: np.ndarray, records: list[CornerRecord]) -> np.ndarray | None:
    if any(r.pressure is None or not np.isfinite(r.pressure).all() for r in records):
        return None
    return np.stack([np.interp(t, r.t, np.asarray(r.pressure)) for r in records], axis=-1)


def _table(t: np.ndarray, output: AlarmOutput, truth: np.ndarray | None) -> Any:
    head = [f"{w} [kPa]" for w in WHEELS]
    table = headed_table("time [s]", *head, "alarm", title="tyre pressure, +- one sigma")
    for column in table.columns:
        column.justify = "right"
    for k in np.unique(np.linspace(0, len(t) - 1, _ROWS + 1).round().astype(int)[1:]):
        cells = [
            f"{output.pressure[k, i] / 1e3:.0f} +- {output.pressure_sd[k, i] / 1e3:.0f}"
            + ("" if truth is None else f" (true {truth[k, i] / 1e3:.0f})")
            for i in range(len(WHEELS))
        ]
        on = ", ".join(w for w, a in zip(WHEELS, output.alarm[k], strict=True) if a) or "-"
        table.add_row(f"{t[k]:.1f}", *cells, on)
    return table


def _columns(
    estimate: VehicleEstimate, output: AlarmOutput, truth: np.ndarray | None
) -> tuple[dict[str, Any], dict[str, str]]:
    columns: dict[str, Any] = {"t": estimate.t}
    units = {"t": "s", "level": "m^3/rad", "level_sigma": "1", "nis": "1"}
    for i, wheel in enumerate(WHEELS):
        columns |= {
            f"pressure_{wheel}": output.pressure[:, i],
            f"pressure_sigma_{wheel}": output.pressure_sd[:, i],
            f"ln_stiffness_{wheel}": np.asarray(estimate.stiffness.mean)[:, i],
            f"loss_probability_{wheel}": output.probability[:, i],
            f"alarm_{wheel}": output.alarm[:, i].astype(np.int32),
        }
        units |= {f"pressure_{wheel}": "Pa", f"pressure_sigma_{wheel}": "Pa"}
        units |= {f"ln_stiffness_{wheel}": "1", f"loss_probability_{wheel}": "1"}
        units |= {f"alarm_{wheel}": "1"}
        if truth is not None:
            columns[f"true_pressure_{wheel}"] = truth[:, i]
            units[f"true_pressure_{wheel}"] = "Pa"
    columns |= {"level": estimate.level, "level_sigma": estimate.level_sigma, "nis": estimate.nis}
    for k, mode in enumerate(estimate.modes):
        columns[f"probability_{mode}"] = estimate.mode_probabilities[:, k]
        units[f"probability_{mode}"] = "1"
    return columns, units
