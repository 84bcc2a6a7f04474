"""Logs of the sensors of stability control: t, v, a_y, yaw_rate, steering_wheel or steer."""

from __future__ import annotations

from pathlib import Path

from wheelhop.errors import require_in_range
from wheelhop.io.settings import read_declaration
from wheelhop.io.tables import declared_column, read_table
from wheelhop.vehicle.lateral_record import LateralRecord, LateralSample, checked_lateral

COLUMNS = {
    "t": ("time", "s"),
    "v": ("speed", "m/s"),
    "a_y": ("acceleration", "m/s^2"),
    "yaw_rate": ("angular speed", "rad/s"),
    "steering_wheel": ("angle", "rad"),
    "steer": ("angle", "rad"),
}
"""Quantity and usual unit of every column."""


def read_lateral_log(
    path: Path, steering_ratio: float, declaration: Path | None = None
) -> LateralRecord:
    """Read, convert and check a log.

    Columns t, v, a_y (to the left), yaw_rate (to the left) and either `steer`, the angle of the
    front wheels, or `steering_wheel` are required. Units stand in the header (`a_y [m/s^2]`) or in
    a TOML file with `[units]` and, for other names, `[columns]`; LOG.toml beside the log is read
    by itself. What `wheelhop simulate --vehicle` writes is such a log.

    Args:
        path: CSV or Parquet file.
        steering_ratio: steering-wheel angle per front wheel angle [-].
        declaration: TOML file with units and column names.

    Raises:
        InputError: naming the column or file, what was found, and the remedy.
    """
    require_in_range("steering ratio", steering_ratio, 1.0, 50.0, "(no unit)")
    table = read_table(Path(path))
    sidecar = Path(path).with_suffix(".toml")
    if declaration is None and sidecar.is_file():
        declaration = sidecar
    units, names = read_declaration(declaration, COLUMNS) if declaration else ({}, {})
    wheel = names.get("steer", "steer") in table.columns
    steer = "steer" if wheel else "steering_wheel"
    found = {
        field: declared_column(table, field, *COLUMNS[field], units, names)
        for field in ("t", "v", "a_y", "yaw_rate", steer)
    }
    angle = found[steer] if wheel else found[steer] / steering_ratio
    sample = LateralSample(angle, found["v"], found["a_y"], found["yaw_rate"])
    return checked_lateral(found["t"], sample)
