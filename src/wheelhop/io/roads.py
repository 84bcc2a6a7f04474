"""Road profiles in: x_m, z_m tables with one or several tracks."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from wheelhop.errors import InputError
from wheelhop.io.tables import Table, read_table
from wheelhop.io.units import to_si
from wheelhop.vehicle.road.profile import Profile, profile_from_samples


def read_road(path: Path, track: str | None = None) -> Profile:
    """Read one track of a road profile.

    The file has a column x_m (or `x [unit]`) and one elevation column a track: z_m, or any
    names. Elevations without a declared unit are metres.

    Args:
        path: CSV or Parquet file.
        track: elevation column to read; the only one, or the middle one, by default.

    Raises:
        InputError: naming the column or file, what was found, and the remedy.
    """
    table = read_table(Path(path))
    x_name = next((n for n in ("x_m", "x") if n in table.columns), None)
    if x_name is None:
        raise InputError(
            "column 'x_m'",
            f"{table.path.name} has only {', '.join(table.columns)}",
            "Name the distance column x_m [m].",
        )
    name = track or default_track(table, x_name)
    if name not in table.columns or name == x_name:
        raise InputError(
            "--track",
            f"{table.path.name} has no elevation column {name!r}",
            f"Use one of {', '.join(tracks(table, x_name))}.",
        )
    return profile_from_samples(_metres(table, x_name), _metres(table, name))


def tracks(table: Table, x_name: str = "x_m") -> list[str]:
    """Names of a road table's elevation columns."""
    return [n for n in table.columns if n != x_name]


def default_track(table: Table, x_name: str = "x_m") -> str:
    """The only elevation column, or the middle one of several.

    Raises:
        InputError: if there is none.
    """
    names = tracks(table, x_name)
    if not names:
        raise InputError(
            "column 'z_m'", f"{table.path.name} has only {x_name}", "Add elevations in z_m [m]."
        )
    return names[len(names) // 2]


def _metres(table: Table, name: str) -> np.ndarray:
    unit = table.units.get(name, "m")
    return table.columns[name] * to_si(f"column {name!r}", "length", unit)
