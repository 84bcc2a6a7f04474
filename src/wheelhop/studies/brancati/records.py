"""The drives behind Table 3: nine scenarios per road class, driven by the full vehicle."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop import __version__
from wheelhop.errors import DivergenceError, InputError, require_in_range
from wheelhop.identification.drives import SETTLING, SHORTEST
from wheelhop.io.logs import read_log, write_log
from wheelhop.io.results import output_directory, write_json
from wheelhop.vehicle.full_vehicle_parameters import suv
from wheelhop.vehicle.maneuver import straight
from wheelhop.vehicle.pressure_course import held
from wheelhop.vehicle.record import CornerRecord, checked_record
from wheelhop.vehicle.road import class_level, stationary_variance
from wheelhop.vehicle.road.build import build_surface, lines_of, random_tracks
from wheelhop.vehicle.sensors import Sensor
from wheelhop.vehicle.vehicle_record import SensorSuite, drive_vehicle

CORNER = "FL"
"""The corner that is identified."""

Progress = Callable[[int, int], None]

_MARGIN = 10.0


@dataclass(frozen=True)
class DriveSettings:
    """What the records depend on.

    Attributes:
        speeds: [m/s].
        pressures: of all four tyres [Pa].
        duration: of each drive [s].
        seed: of roads and sensors.
        noise: of the accelerometers [m/s^2].
        anti_roll: whether the vehicle has its anti-roll bars.
        convention: of the roads' levels, "iso8608" or "brancati2022".
    """

    speeds: tuple[float, ...] = (40 / 3.6, 60 / 3.6, 80 / 3.6)
    pressures: tuple[float, ...] = (130e3, 180e3, 230e3)
    duration: float = 12.0
    seed: int = 0
    noise: float = 0.0
    anti_roll: bool = True
    convention: str = "iso8608"


@dataclass(frozen=True)
class Scenario:
    """A straight drive: ISO 8608 class of the road, speed [m/s] and tyre pressure [Pa]."""

    road_class: str
    speed: float
    pressure: float

    def __str__(self) -> str:
        return (
            f"class {self.road_class}, {3.6 * self.speed:.4g} km/h, {self.pressure / 1e3:.4g} kPa"
        )

    @property
    def file(self) -> str:
        """Name of its log."""
        return f"{self.road_class}_{3.6 * self.speed:.4g}kmh_{self.pressure / 1e3:.4g}kPa.parquet"


def scenarios_of(settings: DriveSettings, road_class: str) -> tuple[Scenario, ...]:
    """Every speed at every pressure on roads of one class."""
    return tuple(Scenario(road_class, v, p) for v in settings.speeds for p in settings.pressures)


def validate_drives(settings: DriveSettings) -> DriveSettings:
    """The same settings, checked.

    Raises:
        InputError: naming the setting that is out of range.
    """
    for name, low, high, unit in (("speeds", 1.0, 60.0, "m/s"), ("pressures", 5e4, 1e6, "Pa")):
        values = getattr(settings, name)
        if not values or len(set(values)) != len(values):
            raise InputError(name, f"{list(values)}", "Give each value once, at least one.")
        for value in values:
            require_in_range(name, value, low, high, unit)
    stationary_variance(1.0, settings.convention)
    shortest = SETTLING + SHORTEST
    require_in_range("--duration", settings.duration, shortest, 600.0, "s")
    require_in_range("--noise", settings.noise, 0.0, 100.0, "m/s^2")
    return settings


def drive_scenario(settings: DriveSettings, scenario: Scenario) -> CornerRecord:
    """The record of the front-left corner, on a road of its own.

    Raises:
        DivergenceError: naming the scenario, if the vehicle leaves the finite numbers.
    """
    vehicle = suv(anti_roll=settings.anti_roll)
    road_key, sensor_key = jax.random.split(_key(settings, scenario))
    # one length for all speeds: the drive is compiled once
    length = max(settings.speeds) * settings.duration + _MARGIN
    ratio = stationary_variance(1.0, settings.convention) / stationary_variance(1.0)
    level = ratio * class_level(scenario.road_class)
    road = build_surface(random_tracks(road_key, level, length, lines_of(vehicle)))
    try:
        log = drive_vehicle(
            sensor_key,
            vehicle,
            straight(scenario.speed),
            road,
            held(jnp.full(4, scenario.pressure)),
            settings.duration,
            suite=_suite(settings.noise),
        )
    except DivergenceError as error:
        raise DivergenceError(f"{scenario}: {error}") from error
    record = log.corner(CORNER)
    for name in ("a_s", "a_u", "v", "pressure", "elevation"):
        if not np.isfinite(getattr(record, name)).all():
            raise DivergenceError(f"{scenario}: {name} left the finite numbers")
    return checked_record(record)


def drive_classes(
    settings: DriveSettings,
    classes: tuple[str, ...],
    store: Path | None = None,
    on_progress: Progress | None = None,
) -> dict[str, tuple[CornerRecord, ...]]:
    """Records of all scenarios by road class.

    Args:
        settings: of the drives.
        classes: ISO 8608 classes.
        store: directory where each record is kept once driven; what is there already, of the
            same settings, is read and not driven again.
        on_progress: called with drives done and in all.

    Raises:
        InputError: for settings out of range, or a store that holds other drives.
        DivergenceError: naming the scenario that left the finite numbers.
    """
    validate_drives(settings)
    if store is not None:
        _open_store(Path(store), settings)
    total = len(classes) * len(settings.speeds) * len(settings.pressures)
    done, records = 0, {}
    for road_class in classes:
        found = []
        for scenario in scenarios_of(settings, road_class):
            found.append(_driven(settings, scenario, store))
            done += 1
            if on_progress is not None:
                on_progress(done, total)
        records[road_class] = tuple(found)
    return records


def stored_drives(store: Path, settings: DriveSettings, classes: tuple[str, ...]) -> int:
    """Number of the drives whose records a store already holds.

    Raises:
        InputError: if it holds drives of other settings.
    """
    if not (Path(store) / "settings.json").is_file():
        return 0
    _require_same(Path(store), settings)
    files = [s.file for c in classes for s in scenarios_of(settings, c)]
    return sum((Path(store) / file).is_file() for file in files)


def _driven(settings: DriveSettings, scenario: Scenario, store: Path | None) -> CornerRecord:
    if store is None:
        return drive_scenario(settings, scenario)
    file = Path(store) / scenario.file
    if file.is_file():
        try:
            return read_log(file)
        except InputError:  # damaged: drive it again
            pass
    write_log(file, drive_scenario(settings, scenario))
    # as a resumed run will see it: both then give the same numbers to the last digit
    return read_log(file)


def _key(settings: DriveSettings, scenario: Scenario) -> Any:
    """Random key of a scenario, whatever other scenarios there are."""
    key = jax.random.key(settings.seed)
    for number in (
        ord(scenario.road_class),
        round(36e3 * scenario.speed),
        round(scenario.pressure),
    ):
        key = jax.random.fold_in(key, number)
    return key


def _suite(noise: float) -> SensorSuite:
    """Accelerometers of this noise [m/s^2]; the speed is known."""
    sensor = Sensor(noise=noise)
    return SensorSuite(body_acceleration=sensor, wheel_acceleration=sensor, speed=Sensor())


def _content(settings: DriveSettings) -> dict[str, Any]:
    """What the records depend on."""
    return {
        "speeds_m_per_s": list(settings.speeds),
        "pressures_Pa": list(settings.pressures),
        "duration_s": settings.duration,
        "seed": settings.seed,
        "noise_m_per_s2": settings.noise,
        "anti_roll": settings.anti_roll,
        "convention": settings.convention,
        "precision": str(jnp.zeros(()).dtype),
        "wheelhop": __version__,
        "jax": jax.__version__,
    }


def _open_store(store: Path, settings: DriveSettings) -> None:
    output_directory(store)
    if (store / "settings.json").is_file():
        _require_same(store, settings)
    else:
        write_json(store / "settings.json", _content(settings))


def _require_same(store: Path, settings: DriveSettings) -> None:
    try:
        found = json.loads((store / "settings.json").read_text())
    except ValueError:
        found = {}
    found = found if isinstance(found, dict) else {}
    wanted = _content(settings)
    different = [name for name in wanted if found.get(name) != wanted[name]]
    if different:
        raise InputError(
            "--out",
            f"{store} holds drives of other settings ({', '.join(different)})",
            "Give another directory, or remove that one to start afresh.",
        )
