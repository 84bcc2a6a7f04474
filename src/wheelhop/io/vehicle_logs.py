"""Logs of a full vehicle out: what its sensors report, and the truth beside it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from wheelhop.io.logs import OPTIONAL
from wheelhop.io.results import write_table
from wheelhop.vehicle.full_vehicle_parameters import CORNERS
from wheelhop.vehicle.vehicle_record import VehicleRecord

TRUTH_UNITS = {
    "speed": "m/s",
    "lateral_speed": "m/s",
    "a_x": "m/s^2",
    "a_y": "m/s^2",
    "a_z": "m/s^2",
    "roll_rate": "rad/s",
    "pitch_rate": "rad/s",
    "yaw_rate": "rad/s",
    "roll": "rad",
    "pitch": "rad",
    "yaw": "rad",
    "x": "m",
    "y": "m",
    "z": "m",
    "body_acceleration": "m/s^2",
    "wheel_acceleration": "m/s^2",
    "compression": "m",
    "compression_rate": "m/s",
    "wheel_speed": "rad/s",
    "steer": "rad",
    "drive": "Nm",
    "brake": "Nm",
    "load": "N",
    "longitudinal": "N",
    "lateral": "N",
    "tire_deflection": "m",
    "strut": "N",
    "kappa": "1",
    "tan_alpha": "1",
    "elevation": "m",
    "pressure": "Pa",
}
"""Unit of every signal of the truth."""


def write_vehicle_log(path: Path, record: VehicleRecord) -> Path:
    """Write a record with its units declared; `read_log` reads one corner of it.

    Measured columns keep their names (`a_s_FL`), the true pressures are `pressure_FL`, the road is
    `elevation_FL`, all other truth is `true_load_FL`, `true_roll` and so on.

    Args:
        path: .parquet or .csv file.
        record: the log.

    Raises:
        InputError: for another file ending, or if the file system refuses.
    """
    columns, units = vehicle_columns(record)
    return write_table(path, columns, units)


def vehicle_columns(record: VehicleRecord) -> tuple[dict[str, Any], dict[str, str]]:
    """Columns of a record by name, and their units."""
    columns: dict[str, Any] = {"t": record.t, **record.measured}
    units = {"t": "s", **record.units}
    for name, unit in TRUTH_UNITS.items():
        values = np.asarray(getattr(record.truth, name))
        prefix = name if name in OPTIONAL else f"true_{name}"
        if values.ndim == 1:
            columns[prefix], units[prefix] = values, unit
            continue
        for k, corner in enumerate(CORNERS):
            columns[f"{prefix}_{corner}"], units[f"{prefix}_{corner}"] = values[:, k], unit
    return columns, units
