"""Road profiles in: x_m, z_m tables with one or several tracks, and OpenCRG surfaces."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from wheelhop.errors import InputError
from wheelhop.io.opencrg import read_opencrg
from wheelhop.io.tables import Table, read_table
from wheelhop.io.units import to_si
from wheelhop.vehicle.road.profile import Profile, profile_from_samples
from wheelhop.vehicle.road.tracks import profile_along

_DISTANCE = re.compile(r"x(_[a-z]+)?")
_SUFFIX = re.compile(r".*_(m|mm|cm|ft|in|km)")


def read_road(path: Path, track: str | None = None) -> tuple[Profile, str]:
    """Read one track of a road profile.

    The distance is a column x_m (or `x [unit]`, x_mm, ...), an elevation a column whose name
    begins with z: z_m, `z [mm]`, z_left. The unit stands in brackets or as the name's ending;
    without either it is metres. Of an OpenCRG surface, laid out along its reference line, the
    track is the lateral position in metres, left positive.

    Args:
        path: CSV, Parquet or OpenCRG (.crg) file.
        track: elevation column to read; the only one, or the middle one, by default. Lateral
            position of an OpenCRG track; its reference line by default.

    Returns:
        The profile, and the name of the column it was read from.

    Raises:
        InputError: naming the column or file, what was found, and the remedy.
    """
    if Path(path).suffix.lower() == ".crg":
        return _crg_track(Path(path), track)
    table = read_table(Path(path))
    x_name = next((n for n in table.columns if _DISTANCE.fullmatch(n)), None)
    if x_name is None:
        raise InputError(
            "column 'x_m'",
            f"{table.path.name} has only {table.contents}",
            "Name the distance column x_m [m].",
        )
    names = [n for n in table.columns if n.startswith("z")]
    if track is None and not names:
        raise InputError(
            "column 'z_m'",
            f"{table.path.name} has only {table.contents}",
            "Name the elevation column z_m [m], or choose a column with --track.",
        )
    name = track if track is not None else names[len(names) // 2]
    if name not in table.columns or name == x_name:
        raise InputError(
            "--track",
            f"{table.path.name} has no elevation column {name!r}",
            f"Use one of {', '.join(names) or table.contents}.",
        )
    return profile_from_samples(_metres(table, x_name), _metres(table, name)), name


def _crg_track(path: Path, track: str | None) -> tuple[Profile, str]:
    try:
        lateral = 0.0 if track is None else float(track)
    except ValueError:
        raise InputError(
            "--track", f"{track!r} is no lateral position", "Give metres, left positive, as 0.75."
        ) from None
    grid = read_opencrg(path, unroll=True)
    return profile_along(grid, lateral), f"y = {lateral:g} m"


def _metres(table: Table, name: str) -> np.ndarray:
    suffix = _SUFFIX.fullmatch(name)
    unit = table.units.get(name) or (suffix[1] if suffix else "m")
    return table.columns[name] * to_si(f"column {name!r}", "length", unit)
