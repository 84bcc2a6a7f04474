"""OpenCRG files: measured road surfaces on a curved regular grid."""

from __future__ import annotations

import importlib
import warnings
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from wheelhop.errors import InputError
from wheelhop.vehicle.road.tracks import RoadGrid

_REMEDY = "Copy the file again in binary mode: a converted line ending or a cut end destroys it."


def read_opencrg(path: Path, unroll: bool = False) -> RoadGrid:
    """Read the surface of an OpenCRG file: elevation with slope and banking of its line.

    x is the distance along the reference line from its start, y the lateral position, left
    positive. Cross sections that were not measured to their edge are continued sideways at
    their last value; unevenly spaced sections are interpolated to their smallest spacing.

    Args:
        path: the .crg file.
        unroll: lay a road with a curved reference line out straight, instead of refusing it.

    Raises:
        InputError: if the package `pyopencrg` is missing, the file is missing, no OpenCRG file
            or corrupted, the surface has a hole, or its line is curved and `unroll` is off.
    """
    library, path = _library(), Path(path)
    if not path.is_file():
        kind = "it is a directory" if path.is_dir() else "there is no such file"
        raise InputError(str(path), kind, "Name an OpenCRG file.")
    road = _read(library, path)
    if not (road.is_straight or unroll):
        radius = 1.0 / float(np.max(np.abs(road.curvature)))
        raise InputError(
            str(path),
            f"its reference line is curved, with a radius down to {radius:.3g} m",
            "Use a straight road, or lay it out along its line with unroll=True.",
        )
    elevation = np.asarray(road.surface_z(), float).T
    return _evenly(road, _to_the_edges(elevation, path))


def _library() -> ModuleType:
    try:
        return importlib.import_module("pyopencrg")
    except ImportError as error:
        raise InputError(
            "pyopencrg",
            "this package, which reads OpenCRG files, is not installed",
            'Install it with: pip install "wheelhop[io]"',
        ) from error


def _read(library: ModuleType, path: Path) -> Any:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return library.read(path)
    except library.checks.CrgCheckError as error:
        first = next(iter(error.report.errors or error.report.warnings), "unknown problem")
        raise InputError(str(path), f"it is corrupted: {first}", _REMEDY) from error
    except library.io.CrgFormatError as error:
        reason = str(error).splitlines()[0].removeprefix(f"{path}: ")
        remedy = "Give an OpenCRG file (.crg), whole and copied in binary mode."
        raise InputError(str(path), f"it is no OpenCRG file: {reason}", remedy) from error
    except (OSError, ValueError, IndexError, KeyError, MemoryError) as error:
        reason = next(iter(str(error).splitlines()), type(error).__name__)
        raise InputError(str(path), f"it cannot be read: {reason}", _REMEDY) from error


def _to_the_edges(elevation: np.ndarray, path: Path) -> np.ndarray:
    """Fill the unmeasured ends of every cross section from its last measured point."""
    measured = np.isfinite(elevation)
    if measured.all():
        return elevation
    rows = len(elevation)
    first = measured.argmax(axis=0)
    last = rows - 1 - measured[::-1].argmax(axis=0)
    holes = measured.sum(axis=0) != last - first + 1
    if holes.any() or not measured.any(axis=0).all():
        section = int(np.flatnonzero(holes | ~measured.any(axis=0))[0])
        raise InputError(
            str(path),
            f"cross section {section + 1} has a hole between its measured points",
            "Fill the holes of the surface first, for instance with pyopencrg's fill_holes().",
        )
    nearest = np.clip(np.arange(rows)[:, None], first[None, :], last[None, :])
    return np.take_along_axis(elevation, nearest, axis=0)


def _evenly(road: Any, elevation: np.ndarray) -> RoadGrid:
    v = np.asarray(road.v, float)
    gap = float(np.diff(v).min())
    if road.v_inc is None and np.ptp(np.diff(v)) > 1e-6 * gap:
        even = np.linspace(v[0], v[-1], round((v[-1] - v[0]) / gap) + 1)
        place = np.clip(np.searchsorted(v, even, side="right") - 1, 0, len(v) - 2)
        part = ((even - v[place]) / (v[place + 1] - v[place]))[:, None]
        elevation = (1.0 - part) * elevation[place] + part * elevation[place + 1]
        v = even
    spacing = (v[-1] - v[0]) / (len(v) - 1)
    return RoadGrid(float(road.u_inc), float(v[0]), float(spacing), elevation)
