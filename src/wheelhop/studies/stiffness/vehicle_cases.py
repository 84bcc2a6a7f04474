"""What the full vehicle drives in the study: to be identified, calibrated, tried and disturbed."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from wheelhop.io.roads import read_road
from wheelhop.studies.stiffness.frame import PRESSURES, StiffnessSettings
from wheelhop.studies.stiffness.vehicle_drives import Road, VehicleDrive
from wheelhop.vehicle.parameters import BRANCATI_TABLE_1
from wheelhop.vehicle.road import class_level

KNOWN = 230e3
"""Pressure [Pa] of all tyres while the estimator is calibrated."""

SYNTHETIC, LIDAR, BLOCK, COURSE = "synthetic", "LIDAR road", "Belgian block", "ride course"

_SHAPES = (
    ("A", 0.0, 2.0, 70),
    ("B", 0.0, 2.0, 60),
    ("C", 2.0, 2.0, 50),
    ("B", 1.0, 1.6, 60),
    ("B", -2.0, 1.8, 75),
    ("A", 3.0, 2.2, 70),
    ("B", -1.0, 2.4, 55),
    ("B", 2.0, 2.7, 60),
    ("C", -3.0, 1.6, 45),
    ("C", -1.0, 2.7, 50),
)
"""Class, level off its centre [dB], waviness, speed [km/h]."""

_ROADS = "roads/normalized"
_MEASURED = (
    (LIDAR, "lidar_czech_B.csv", (None,), (60, 75)),
    (BLOCK, "belgian_block_7tracks.csv", ("z_v+0.8", "z_v-0.8"), (30, 40)),
    (f"{COURSE}, 1 in", "krc_rms_course_1in.csv", (None,), (30,)),
    (f"{COURSE}, 2 in", "krc_rms_course_2in.csv", (None,), (20,)),
)
"""Name, file, elevation columns of left and right, speeds [km/h]."""


class Case(NamedTuple):
    """A drive that the estimator is tried on."""

    kind: str
    name: str
    drive: VehicleDrive


def random_road(road_class: str, decibels: float = 0.0, waviness: float = 2.0) -> Road:
    """A road whose level lies off the centre of an ISO 8608 class."""
    level = class_level(road_class) * 10.0 ** (0.1 * decibels)
    name = f"{road_class} {decibels:+g} dB" if decibels else road_class
    return Road(f"{name}, w {waviness:g}", level, waviness)


def to_identify(settings: StiffnessSettings) -> list[VehicleDrive]:
    """Drives over known roads at known pressures, from which the corners are identified."""
    plan = (("A", 60, 200e3), ("B", 45, 230e3), ("C", 50, 180e3), ("B", 75, 250e3))
    return [
        VehicleDrive(100 + k, random_road(c), v / 3.6, (p,) * 4, noise=settings.noise)
        for k, (c, v, p) in enumerate(plan)
    ]


def to_calibrate(settings: StiffnessSettings) -> list[VehicleDrive]:
    """Three stretches of one road at `KNOWN` pressure."""
    road, tyres = random_road("B"), (KNOWN,) * 4
    return [VehicleDrive(110 + k, road, 60 / 3.6, tyres, noise=settings.noise) for k in range(3)]


def to_try(settings: StiffnessSettings, data: Path | None) -> list[Case]:
    """Synthetic roads between the classes and of other waviness, and measured ones where found.

    Args:
        settings: of the study; the pressures of all wheels are drawn by its seed.
        data: directory of the measured roads, or None.
    """
    kinds = [
        (SYNTHETIC, random_road(c, decibels, waviness), v) for c, decibels, waviness, v in _SHAPES
    ]
    for name, file, columns, speeds in _MEASURED:
        if data is not None and (data / _ROADS / file).is_file():
            road = _measured(name, data / _ROADS / file, columns)
            kinds += [(name.split(",")[0], road, v) for v in speeds]
    rng = np.random.default_rng((settings.seed, 2))
    pressures = rng.uniform(*PRESSURES, (len(kinds), 4))
    return [
        Case(
            kind,
            f"{road.name}, {v:g} km/h",
            VehicleDrive(k, road, v / 3.6, tuple(p.tolist()), noise=settings.noise),
        )
        for k, ((kind, road, v), p) in enumerate(zip(kinds, pressures, strict=True))
    ]


def data_directory() -> Path | None:
    """Where `WHEELHOP_DATA` says, else beside the working directory; None where there is none."""
    named = os.environ.get("WHEELHOP_DATA")
    place = Path(named) if named else Path.cwd().parent / "shared" / "data"
    return place if (place / _ROADS).is_dir() else None


def _measured(name: str, file: Path, columns: tuple[str | None, ...]) -> Road:
    profiles = [read_road(file, column)[0] for column in columns]
    return Road(name, tracks=(profiles[0], profiles[-1]))


NOMINAL = "as identified"

DISTURBANCES: dict[str, dict[str, float | bool]] = {
    NOMINAL: {},
    "20 % more load": {"payload": 0.2 * BRANCATI_TABLE_1.chassis_mass},
    "20 % less load": {"payload": -0.2 * BRANCATI_TABLE_1.chassis_mass},
    "dampers 20 % harder": {"damper": 1.2},
    "dampers 20 % softer": {"damper": 0.8},
    "sensor noise x 2, not told": {"noise": 2.0},
    "road not averaged by the patch": {"patch": False},
    "tyre stiffens with load and speed": {"stiffening": True},
}
"""What the vehicle is other than the estimator thinks; noise is relative."""


def to_disturb(settings: StiffnessSettings) -> tuple[list[VehicleDrive], list[VehicleDrive]]:
    """Every disturbance on a road for the calibration, and on another one for the trial."""
    calibration = VehicleDrive(
        200, random_road("B", 1.0), 60 / 3.6, (KNOWN,) * 4, noise=settings.noise
    )
    pressures = (190e3, 230e3, 200e3, 150e3)
    trial = VehicleDrive(
        201, random_road("B", -1.0, 2.3), 70 / 3.6, pressures, noise=settings.noise
    )
    return _disturbed(calibration), _disturbed(trial)


def _disturbed(base: VehicleDrive) -> list[VehicleDrive]:
    found = []
    for changes in DISTURBANCES.values():
        values: dict[str, Any] = {**changes, "noise": base.noise * changes.get("noise", 1.0)}
        found.append(replace(base, **values))
    return found
