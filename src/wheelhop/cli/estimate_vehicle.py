"""Four tyres at once: estimate, calibration, alarms, and the demo."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import jax
import numpy as np

from wheelhop.cli.session import (
    computing,
    console,
    escape,
    headed_table,
    progress_bar,
    provenance,
    say_files,
)
from wheelhop.errors import InputError, require_in_range
from wheelhop.estimators.alarm_events import AlarmEvent, alarm_events
from wheelhop.estimators.alarms import AlarmOutput
from wheelhop.estimators.calibration import (
    SHORTEST,
    Calibration,
    calibrate,
    from_dict,
    to_dict,
)
from wheelhop.estimators.changing import ChangeTuning
from wheelhop.estimators.estimate_vehicle import (
    VehicleEstimate,
    estimate_by_hop,
    estimate_vehicle,
    watch,
)
from wheelhop.estimators.four_corners import VEHICLE_TUNING, WHEELS
from wheelhop.estimators.hop_band import HOP_TUNING
from wheelhop.estimators.stiffness import StiffnessTuning, validate_tuning
from wheelhop.io.logs import corners_of_log, read_log, write_vehicle_records
from wheelhop.io.results import output_directory, write_figure, write_json, write_table
from wheelhop.io.vehicles import read_vehicle
from wheelhop.plots.alarms import plot_alarms
from wheelhop.studies.four_tyres import FourTyres, corners, simulate_four_tyres
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.record import CornerRecord
from wheelhop.vehicle.road import class_level

_DEMO = replace(VEHICLE_TUNING, prior_pressure=FourTyres().placard)
_ROWS = 10
_SETTLED = 10.0
_FITTING = (0.7, 1.3)
_PLAUSIBLE = (0.3, 1.6)


def estimate_four(
    log: Path,
    units: Path | None,
    vehicles: tuple[Path | None, Path | None],
    method: str,
    placard: float,
    calibration: Path | None,
    reset: float | None,
    noise: float,
    walk: float | None,
    out: Path,
    precision: str,
) -> None:
    """`wheelhop estimate` of a log of four corners.

    Args:
        log: CSV or Parquet.
        units: TOML with units and columns.
        vehicles: TOML of the front and of the rear corner; the default SUV's for None.
        method: rml, or hop.
        placard: recommended pressure [Pa].
        calibration: JSON of an earlier calibration.
        reset: known pressure [Pa] of all tyres, to calibrate at.
        noise: of the accelerometers [m/s^2].
        walk: of ln k_t [1/sqrt(s)], or None.
        out: directory.
        precision: of the computation.
    """
    held = corners_of_log(log)
    missing = [name for name in WHEELS if name not in held]
    if missing:
        raise InputError(
            "--corner",
            f"{log.name} holds only {', '.join(held)} of {', '.join(WHEELS)}",
            f"Choose one, as --corner {held[0]}.",
        )
    require_in_range("--placard", placard / 1e3, 50.0, 1500.0, "kPa")
    if reset is not None:
        require_in_range("--calibrate", reset / 1e3, 50.0, 1500.0, "kPa")
    if walk is not None:
        require_in_range("--walk", walk, 1e-5, 1.0, "1/sqrt(s)")
    default = HOP_TUNING if method == "hop" else VEHICLE_TUNING
    # the tyres are believed near what they should have, or are known to have
    near = placard if reset is None else reset
    tuning = replace(default, noise_a_s=noise, noise_a_u=noise, prior_pressure=near)
    tuning = validate_tuning(tuning if walk is None else replace(tuning, stiffness_walk=walk))
    with computing(precision):
        records = [read_log(log, units, corner) for corner in WHEELS]
        cars, names = _cars(vehicles)
        made_for = {"method": method, "corners": [repr(car) for car in (cars[0], cars[2])]}
        known = None if calibration is None else _read_calibration(calibration, made_for)
        if reset is not None:
            length = float(records[0].t[-1] - records[0].t[0])
            require_in_range("length of the log", length, _SETTLED + SHORTEST, 1e9, "s")
        estimate, output, events = _estimate(records, cars, placard, tuning, known, method)
    settings = {
        "log": str(log),
        "vehicles": names,
        "method": method,
        "placard_Pa": placard,
        "calibration": None if calibration is None else str(calibration),
        "tuning": asdict(tuning),
        "changes": asdict(ChangeTuning()),
    }
    files = _write(
        output_directory(out),
        estimate,
        output,
        events,
        records,
        placard,
        provenance("estimate", precision, **settings),
    )
    if reset is not None:
        made = _calibrate(estimate, cars, reset, tuning)
        write_json(out / "calibration.json", {**to_dict(made), "made_for": made_for})
        files.append("calibration.json")
        console.print(f"calibrated at {reset / 1e3:g} kPa over {made.duration:.0f} s")
    say_files(out, *files)


def demo_of_four(out: Path, road: str, duration: float, seed: int, precision: str) -> None:
    """`wheelhop demo`: simulate four corners of which one leaks, estimate, and watch.

    Args:
        out: directory.
        road: ISO 8608 class.
        duration: of the drive [s].
        seed: of roads and sensors.
        precision: of the computation.
    """
    require_in_range("--duration", duration, 20.0, 3600.0, "s")
    class_level(road)
    whole = FourTyres()
    share = duration / whole.duration
    leak = replace(whole.leak, begin=share * whole.leak.begin, finish=share * whole.leak.finish)
    settings = replace(whole, road_class=road, duration=duration, leak=leak, seed=seed)
    console.print(
        f"four corners of the SUV of Brancati & Tufano 2022; ISO class {road}, 60 km/h, 500 Hz; "
        f"the front right tyre leaks from {leak.start / 1e3:.0f} to {leak.end / 1e3:.0f} kPa "
        f"between {leak.begin:.0f} and {leak.finish:.0f} s"
    )
    cars = corners()
    with computing(precision):
        records = simulate_four_tyres(settings)
        estimate, output, events = _estimate(records, cars, settings.placard, _DEMO, None)
    made_by = provenance("demo", precision, study=asdict(settings), tuning=asdict(_DEMO))
    directory = output_directory(out)
    files = _write(directory, estimate, output, events, records, settings.placard, made_by)
    write_vehicle_records(directory / "log.parquet", records, WHEELS)
    say_files(directory, *files, "log.parquet")


def _estimate(
    records: list[CornerRecord],
    cars: Any,
    placard: float,
    tuning: StiffnessTuning,
    calibration: Calibration | None,
    method: str = "rml",
) -> tuple[VehicleEstimate, AlarmOutput, list[AlarmEvent]]:
    with progress_bar("filtering", "samples") as advance:
        by = estimate_by_hop if method == "hop" else estimate_vehicle
        estimate = by(records, cars, tuning=tuning, on_progress=advance)
    output = watch(estimate, cars, placard, tuning=tuning, calibration=calibration)
    return estimate, output, alarm_events(estimate.t, output, WHEELS)


def _cars(files: tuple[Path | None, Path | None]) -> tuple[tuple[QuarterCar, ...], list[str]]:
    default = corners()
    front = default[0] if files[0] is None else read_vehicle(files[0])
    rear = default[2] if files[1] is None else read_vehicle(files[1])
    names = [
        f"{axle}: {'SUV of Brancati & Tufano 2022' if file is None else file}"
        for axle, file in zip(("front", "rear"), files, strict=True)
    ]
    console.print(f"corners {'; '.join(names)}", soft_wrap=True)
    return (front, front, rear, rear), names


def _calibrate(
    estimate: VehicleEstimate, cars: Any, pressure: float, tuning: StiffnessTuning
) -> Calibration:
    tire = jax.tree.map(lambda *a: np.array(a, float), *(car.tire for car in cars))
    mean, cov = (np.asarray(a) for a in estimate.stiffness)
    settled = estimate.t >= min(_SETTLED, 0.25 * estimate.t[-1])
    return calibrate(
        estimate.t[settled],
        mean[settled],
        cov[settled],
        tire,
        pressure,
        belief_walk=tuning.stiffness_walk,
    )


def _read_calibration(path: Path, made_for: dict[str, Any]) -> Calibration:
    if not path.is_file():
        raise InputError("--calibration", f"there is no file {path}", "Check the path.")
    try:
        content = json.loads(path.read_text())
    except ValueError as error:
        raise InputError("--calibration", f"{path} is no JSON", "Calibrate again.") from error
    if not isinstance(content, dict):
        raise InputError("--calibration", f"{path} holds no calibration", "Calibrate again.")
    found = from_dict(content)
    if len(found.offset) != len(WHEELS):
        raise InputError("--calibration", f"{len(found.offset)} wheels", "Calibrate four.")
    for name, here in made_for.items():
        if content.get("made_for", {}).get(name) != here:
            raise InputError(
                "--calibration",
                f"{path} was made with another {name.removesuffix('s')}",
                "Calibrate again with the same --method and vehicles.",
            )
    return found


def _write(
    directory: Path,
    estimate: VehicleEstimate,
    output: AlarmOutput,
    events: list[AlarmEvent],
    records: list[CornerRecord],
    placard: float,
    made_by: dict[str, Any],
) -> list[str]:
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
