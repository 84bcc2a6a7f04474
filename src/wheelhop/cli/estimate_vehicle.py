"""Four tyres at once: estimate, calibration, alarms, and the demo."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import jax
import numpy as np

from wheelhop.cli.estimate_vehicle_report import write_estimate
from wheelhop.cli.session import (
    computing,
    console,
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
from wheelhop.io.results import output_directory, write_json
from wheelhop.io.vehicles import read_vehicle
from wheelhop.studies.four_tyres import FourTyres, corners, simulate_four_tyres
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.record import CornerRecord
from wheelhop.vehicle.road import class_level

_DEMO = replace(VEHICLE_TUNING, prior_pressure=FourTyres().placard)
_SETTLED = 10.0


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
    files = write_estimate(
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
    files = write_estimate(directory, estimate, output, events, records, settings.placard, made_by)
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
