"""`wheelhop simulate --vehicle suv`: a drive of the full vehicle."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.cli.drive_report import drive_summary, print_drive, write_drive
from wheelhop.cli.session import computing, console, messages, provenance
from wheelhop.cli.vehicle_road import CONTACTS, RoadChoice, road_for
from wheelhop.errors import InputError, require_in_range
from wheelhop.io.results import output_directory, require_writable
from wheelhop.io.tires import read_tire
from wheelhop.vehicle.chassis import corner_masses
from wheelhop.vehicle.drives import DRIVES, Drive
from wheelhop.vehicle.full_vehicle_parameters import VEHICLES, suv, with_tire
from wheelhop.vehicle.full_vehicle_state import STANDARD_GRAVITY, FullVehicle
from wheelhop.vehicle.pressure_course import PressureCourse
from wheelhop.vehicle.sensors import DATASHEET_ACCELEROMETER, Sensor
from wheelhop.vehicle.sensors import validate as validate_sensor
from wheelhop.vehicle.vehicle_record import SensorSuite, drive_vehicle

_RATE = 1000.0
_LONGEST_STEP = 5e-4


@dataclass(frozen=True)
class DriveChoice:
    """What the options say; None where the maneuver or the vehicle decides.

    Units are those of the command line: kPa, km/h, g, s, Hz.
    """

    vehicle: str
    maneuver: str
    road: RoadChoice
    pressures: str | None = None
    end_pressures: str | None = None
    speed: float | None = None
    peak: float | None = None
    duration: float | None = None
    rate: float | None = None
    sensor: Sensor = DATASHEET_ACCELEROMETER
    tire: Path | None = None
    anti_roll: bool | None = None
    ppy1: float | None = None
    animate: bool = False


def simulate_drive(choice: DriveChoice, out: Path, seed: int, precision: str) -> None:
    """Drive, print, and write log, figure, summary and, if asked, an animation.

    Args:
        choice: what the options say.
        out: directory for the results.
        seed: of all random numbers.
        precision: float64 or float32.

    Raises:
        InputError: naming the option that cannot be met.
        DivergenceError: if the vehicle rolls over or leaves the finite numbers.
    """
    if out.suffix in (".csv", ".parquet"):
        raise InputError(
            "--out", f"{out} is a file, and a drive writes several", "Name a directory."
        )
    require_writable(out)
    with computing(precision):
        drive, seconds = _drive(choice)
        vehicle = _vehicle(choice)
        pressure = _pressures(choice, vehicle, seconds)
        rate = _RATE if choice.rate is None else choice.rate
        substeps = max(1, math.ceil(1.0 / (rate * _LONGEST_STEP)))
        sensor = validate_sensor("sensor", choice.sensor)
        suite = SensorSuite(body_acceleration=sensor, wheel_acceleration=sensor)
        road_key, sensor_key = jax.random.split(jax.random.key(seed))
        distance = float(drive.maneuver.speed) * seconds
        road = road_for(choice.road, road_key, vehicle, distance, drive.obstacles)
        title = (
            f"{choice.vehicle}, {choice.maneuver} at {3.6 * drive.maneuver.speed:.4g} km/h, "
            f"road {Path(choice.road.name).name}"
        )
        console.print(f"{title}; {seconds:.4g} s at {rate:g} Hz", soft_wrap=True)
        with messages.status("driving (the first drive of a length compiles for some seconds)"):
            record = drive_vehicle(
                sensor_key,
                vehicle,
                drive.maneuver,
                road,
                pressure,
                seconds,
                rate=rate,
                substeps=substeps,
                suite=suite,
            )
    results = drive_summary(record)
    print_drive(results)
    settings = _settings(choice, drive, pressure, rate, seed) | {
        "duration_s": seconds,
        "simulation_steps_per_sample": substeps,
        "sensors": asdict(suite),
    }
    made_by = provenance("simulate", precision, **settings)
    summary = {**made_by, "results": results}
    write_drive(output_directory(out), record, vehicle, title, summary, choice.animate)


def _drive(choice: DriveChoice) -> tuple[Drive, float]:
    if choice.maneuver not in DRIVES:
        raise InputError(
            "--maneuver", f"{choice.maneuver!r} is unknown", f"Use one of {', '.join(DRIVES)}."
        )
    if choice.road.contact not in CONTACTS:
        raise InputError(
            "--contact", f"{choice.road.contact!r} is unknown", f"Use one of {', '.join(CONTACTS)}."
        )
    options = {}
    if choice.peak is not None:
        if choice.maneuver != "lane-change":
            raise InputError(
                "--peak", f"a {choice.maneuver} has none", "Use it with --maneuver lane-change."
            )
        require_in_range("--peak", choice.peak, 0.01, 2.0, "g")
        options["peak"] = choice.peak * STANDARD_GRAVITY
    if choice.speed is not None:
        require_in_range("--speed", choice.speed, 3.6, 360.0, "km/h")
        options["speed"] = choice.speed / 3.6
    drive = DRIVES[choice.maneuver](**options)
    seconds = drive.duration if choice.duration is None else choice.duration
    require_in_range("--duration", seconds, 0.1, 3600.0, "s")
    if choice.rate is not None:
        require_in_range("--rate", choice.rate, 50.0, 20e3, "Hz")
    return drive, seconds


def _vehicle(choice: DriveChoice) -> FullVehicle:
    vehicle = _on_its_tires(choice)
    if choice.ppy1 is None:
        return vehicle
    require_in_range("--ppy1", choice.ppy1, -2.0, 2.0, "(no unit)")
    slip = vehicle.tire.slip
    softer = replace(slip, ppy1=choice.ppy1 + jnp.zeros_like(slip.pky1))
    return replace(vehicle, tire=replace(vehicle.tire, slip=softer))


def _on_its_tires(choice: DriveChoice) -> FullVehicle:
    if choice.anti_roll is not None and choice.vehicle != "suv":
        raise InputError(
            "--anti-roll/--no-anti-roll", f"{choice.vehicle} is as published", "Use it with suv."
        )
    vehicle = suv(choice.anti_roll) if choice.anti_roll is not None else VEHICLES[choice.vehicle]()
    if choice.tire is None:
        return vehicle
    tire = read_tire(choice.tire)
    for warning in tire.warnings:
        messages.print(f"[yellow]note[/] {warning}", soft_wrap=True)
    low, high = tire.load_range
    loads = STANDARD_GRAVITY * np.asarray(corner_masses(vehicle.chassis))
    if loads.min() < low or loads.max() > high:
        messages.print(
            f"[yellow]note[/] the corners carry {loads.min():.0f} to {loads.max():.0f} N at rest, "
            f"the tyre's data hold from {low:.0f} to {high:.0f} N",
            soft_wrap=True,
        )
    return with_tire(vehicle, tire.magic_formula)


def _pressures(choice: DriveChoice, vehicle: FullVehicle, seconds: float) -> PressureCourse:
    nominal = np.asarray(vehicle.nominal_pressure, float)
    start = _four("--pressures", choice.pressures, nominal)
    end = _four("--end-pressures", choice.end_pressures, start)
    if choice.pressures is None:
        console.print(f"pressures: {nominal[0] / 1e3:g} kPa all round (no --pressures given)")
    return PressureCourse(start, end, 0.0, seconds)


def _four(option: str, text: str | None, default: np.ndarray) -> np.ndarray:
    """Four pressures [Pa] from text as 230,230,180,230 or one for all [kPa]."""
    if text is None:
        return default
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (1, 4):
        raise InputError(
            option, f"{text!r} is not one or four numbers", "Write FL,FR,RL,RR as 230,230,180,230."
        )
    for number in numbers:
        require_in_range(option, number, 20.0, 1500.0, "kPa")
    return 1e3 * np.broadcast_to(np.array(numbers), (4,))


def _settings(
    choice: DriveChoice, drive: Drive, pressure: PressureCourse, rate: float, seed: int
) -> dict[str, Any]:
    return {
        "vehicle": choice.vehicle,
        "anti_roll": choice.anti_roll,
        "ppy1": choice.ppy1,
        "tire": None if choice.tire is None else str(choice.tire),
        "maneuver": choice.maneuver,
        "speed_km_per_h": 3.6 * float(drive.maneuver.speed),
        "peak_lateral_acceleration_g": choice.peak,
        **asdict(choice.road),
        "pressures_kPa": np.asarray(pressure.start) / 1e3,
        "end_pressures_kPa": np.asarray(pressure.end) / 1e3,
        "rate_Hz": rate,
        "seed": seed,
    }
