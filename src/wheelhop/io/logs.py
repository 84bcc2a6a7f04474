"""Logs of one corner, or of one corner out of four: t, a_s, a_u, v, with declared units."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from wheelhop.errors import InputError
from wheelhop.io.results import write_table
from wheelhop.io.settings import read_declaration
from wheelhop.io.tables import Table, declared_column, read_table
from wheelhop.vehicle.record import CornerRecord, checked_record

REQUIRED = {"t": "time", "a_s": "acceleration", "a_u": "acceleration", "v": "speed"}
OPTIONAL = {"pressure": "pressure", "elevation": "length"}

LOG_UNITS = {
    "t": "s",
    "a_s": "m/s^2",
    "a_u": "m/s^2",
    "v": "m/s",
    "pressure": "Pa",
    "elevation": "m",
}


def read_log(
    path: Path, declaration: Path | None = None, corner: str | None = None
) -> CornerRecord:
    """Read, convert and check a log.

    Columns t, a_s, a_u, v are required; `pressure`, the true one, and `elevation` of the road
    under the wheel are optional. Units stand in the header (`a_s [m/s^2]`) or in a TOML file with
    `[units]` and, where the log names its columns otherwise, `[columns]`; LOG.toml beside the log
    is read by itself. In a log of several corners the columns end in the corner's name, `a_s_FL`;
    one is read.

    Args:
        path: CSV or Parquet file.
        declaration: TOML file with units and column names.
        corner: the one to read where the log holds several, as FL.

    Raises:
        InputError: naming the column or file, what was found, and the remedy.
    """
    table = read_table(Path(path))
    sidecar = Path(path).with_suffix(".toml")
    if declaration is None and sidecar.is_file():
        declaration = sidecar
    units, names = (
        read_declaration(declaration, {*REQUIRED, *OPTIONAL}) if declaration else ({}, {})
    )
    names = _columns_of_corner(table, corner, names) | names
    columns = {
        field: declared_column(table, field, quantity, LOG_UNITS[field], units, names)
        for field, quantity in (REQUIRED | OPTIONAL).items()
        if field in REQUIRED or field in names or field in table.columns
    }
    return checked_record(CornerRecord(**columns))


def corners_of_log(path: Path) -> tuple[str, ...]:
    """Corners that a log holds by name (`a_s_FL` and `a_u_FL`); none for a log of one corner.

    Raises:
        InputError: if the file cannot be read as a table.
    """
    columns = read_table(Path(path)).columns
    return () if "a_s" in columns else _corners(columns)


def _corners(columns: Any) -> tuple[str, ...]:
    return tuple(n[4:] for n in columns if n.startswith("a_s_") and f"a_u_{n[4:]}" in columns)


def write_log(path: Path, record: CornerRecord) -> Path:
    """Write a record as a log that `read_log` reads, with its units declared."""
    columns: dict[str, Any] = {"t": record.t, "a_s": record.a_s, "a_u": record.a_u, "v": record.v}
    for name in OPTIONAL:
        if getattr(record, name) is not None:
            columns[name] = getattr(record, name)
    return write_table(path, columns, LOG_UNITS)


def write_vehicle_records(
    path: Path, records: Sequence[CornerRecord], corners: Sequence[str]
) -> Path:
    """Write records of several corners on one time grid as one log; `read_log` reads a corner."""
    columns: dict[str, Any] = {"t": records[0].t, "v": records[0].v}
    units = {"t": LOG_UNITS["t"], "v": LOG_UNITS["v"]}
    for record, corner in zip(records, corners, strict=True):
        for name in ("a_s", "a_u", *OPTIONAL):
            if getattr(record, name) is not None:
                columns[f"{name}_{corner}"] = getattr(record, name)
                units[f"{name}_{corner}"] = LOG_UNITS[name]
    return write_table(path, columns, units)


def _columns_of_corner(table: Table, corner: str | None, names: dict[str, str]) -> dict[str, str]:
    """Names of the columns of the chosen corner; none where the log holds a single one."""
    present = table.columns
    corners = _corners(present)
    if corner is None:
        if corners and "a_s" not in {*present, *names}:
            raise InputError(
                "--corner",
                f"{table.path.name} holds the corners {', '.join(corners)}",
                f"Choose one, as --corner {corners[0]}.",
            )
        return {}
    if corner not in corners:
        held = f"only {', '.join(corners)}" if corners else "one corner without a name"
        raise InputError(
            "--corner",
            f"{corner!r} is not in {table.path.name}, which holds {held}",
            "Choose one of these." if corners else "Leave --corner out.",
        )
    return {
        field: f"{field}_{corner}"
        for field in ("a_s", "a_u", *OPTIONAL)
        if f"{field}_{corner}" in present
    }
