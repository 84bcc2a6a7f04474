"""Logs for wheel loads: accelerometers of the body and wheels, compressions of the struts."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np

from wheelhop.errors import InputError
from wheelhop.io.settings import read_declaration
from wheelhop.io.tables import Table, declared_column, read_table
from wheelhop.vehicle.full_vehicle_parameters import CORNERS
from wheelhop.vehicle.load_record import LoadRecord, VehicleLoadSample, checked_load

TRUE_LOADS = tuple(f"true_load_{corner}" for corner in CORNERS)

COLUMNS: dict[str, tuple[str, str]] = {
    "t": ("time", "s"),
    **{
        name: ("length", "m") if name.startswith("compression") else ("acceleration", "m/s^2")
        for name in VehicleLoadSample._fields
    },
    "v": ("speed", "m/s"),
    "a_x": ("acceleration", "m/s^2"),
    "a_y": ("acceleration", "m/s^2"),
    **dict.fromkeys(TRUE_LOADS, ("force", "N")),
}
"""Quantity and usual unit of every column."""

SUSPENSION = tuple(n for n in VehicleLoadSample._fields if not n.startswith("a_u"))
"""What the methods need that know springs and dampers."""

LEVER_ARMS = ("a_x", "a_y")
"""What the loads by lever arms need."""


def read_load_log(
    path: Path, declaration: Path | None = None, needed: Collection[str] = SUSPENSION
) -> LoadRecord:
    """Read, convert and check a log.

    Of the columns t, a_s_FL, compression_FL, a_u_FL, and so on for FR, RL and RR, v, a_x, a_y and
    true_load_FL and so on, t and those `needed` are required; where nothing of the suspension is
    needed, none of it is read. A compression counts positive as the wheel moves up towards the
    body, a_x forward, a_y to the left, a_s and a_u up. Units stand in the header
    (`compression_FL [mm]`) or in a TOML file with `[units]` and, for other names, `[columns]`;
    LOG.toml beside the log is read by itself. What `wheelhop simulate --vehicle` writes is such a
    log.

    Args:
        path: CSV or Parquet file.
        declaration: TOML file with units and column names.
        needed: columns that must be there, `SUSPENSION` or `LEVER_ARMS`.

    Raises:
        InputError: naming the column or file, what was found, and the remedy.
    """
    table = read_table(Path(path))
    sidecar = Path(path).with_suffix(".toml")
    if declaration is None and sidecar.is_file():
        declaration = sidecar
    units, names = read_declaration(declaration, COLUMNS) if declaration else ({}, {})
    present = {name for name in COLUMNS if names.get(name, name) in table.columns}
    wanted = {"t", *needed, *names}
    _refuse_missing(table, [names.get(n, n) for n in COLUMNS if n in wanted - present])

    unused = () if set(needed) & set(SUSPENSION) else VehicleLoadSample._fields

    def column(name: str) -> Any:
        if name not in present or name in unused:
            return None
        return declared_column(table, name, *COLUMNS[name], units, names)

    sample = VehicleLoadSample(*(column(name) for name in VehicleLoadSample._fields))
    truth = [column(name) for name in TRUE_LOADS]
    return checked_load(
        column("t"),
        sample,
        column("v"),
        column("a_x"),
        column("a_y"),
        None if any(load is None for load in truth) else np.stack(truth, 1),
    )


def _refuse_missing(table: Table, missing: list[str]) -> None:
    if not missing:
        return
    several = len(missing) > 1
    field = f"column{'s' if several else ''} {', '.join(missing)}"
    remedy = (
        f"Add {'them' if several else 'it'}, or name what the log calls "
        f'{"them" if several else "it"} in a TOML file: [columns] {missing[0]} = "...".'
    )
    if any(name.startswith("compression") for name in missing):
        able = all(name in table.columns for name in LEVER_ARMS)
        remedy += (
            " Without compressions --method algebraic finds the loads of slow maneuvers from a_x "
            f"and a_y, which {'this log has' if able else 'this log lacks too'}."
        )
    elif set(missing) <= set(LEVER_ARMS):
        remedy += " Or use another --method: they need the a_s and compression of each corner."
    raise InputError(field, f"{table.path.name} has only {table.contents}", remedy)
