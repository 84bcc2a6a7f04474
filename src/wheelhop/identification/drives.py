"""Records with a known road and pressure, checked and laid on the simulator's grid.

The grid is as fine as the integrator needs: where it is finer than the record, the road between
the samples is a cubic spline through them, and only the record's own samples count.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from scipy.interpolate import CubicSpline

from wheelhop.errors import InputError, InputWarning
from wheelhop.vehicle.record import CornerRecord
from wheelhop.vehicle.road.profile import Profile, elevation_at, without_aliases

BLOCK = 0.5
"""Time [s] of a block of a record: partial sums are kept per block."""

AFTER_GAP = 1.0
"""Time [s] after a gap in the road that does not count, as the motion is not known."""

FEWEST = 200
"""Fewest samples of a channel that must count."""

SETTLING = 1.0
"""Time [s] at a record's start that no error is counted of: its initial motion is not known."""

SHORTEST = 2.0
"""Shortest record [s] beside the settling time."""

COARSEST_STEP = 1.05e-3
"""Longest Runge-Kutta step [s]."""

_LEAST_ROUGHNESS = 2e-3
_LEAST_ACCELERATION = 0.02


class Drives(NamedTuple):
    """Records in blocks of integration steps, every leaf [records, ...].

    Attributes:
        rise: of the road over each step [m], [records, blocks, steps].
        slope: the road's velocity at the step's end [m/s], the same shape.
        pressure: of the tyre [Pa].
        a_s, a_u: measured accelerations [m/s^2], zero where they do not count.
        count_s, count_u: 1 where a step ends at a sample that counts, else 0.
        dt: integration step [s], [records].
    """

    rise: Any
    slope: Any
    pressure: Any
    a_s: Any
    a_u: Any
    count_s: Any
    count_u: Any
    dt: Any


@dataclass(frozen=True)
class Prepared:
    """Checked records.

    Attributes:
        names: of the records.
        records: as given.
        drives: the same on the simulator's grid.
        steps: integration steps per sampling interval of each record.
    """

    names: tuple[str, ...]
    records: tuple[CornerRecord, ...]
    drives: Drives
    steps: tuple[int, ...]


def prepare(
    records: Sequence[CornerRecord],
    names: Sequence[str] | None = None,
    settling: float = SETTLING,
) -> Prepared:
    """Check records for identification and lay them side by side.

    Args:
        records: checked ones (`vehicle.record.checked_record`) with pressure and elevation.
        names: of the records, for messages and tables.
        settling: time at the start of each that is simulated but not judged [s].

    Raises:
        InputError: naming the record, the field and the remedy, for no record, one without
            pressure or road, too short, or without excitation.
    """
    names = checked_names(records, names, settling)
    for name, record in zip(names, records, strict=True):
        _check(name, record, settling)
    steps = tuple(max(1, math.ceil(record.dt / COARSEST_STEP)) for record in records)
    longest = max(len(r.t) * m for r, m in zip(records, steps, strict=True))
    finest = min(record.dt / m for record, m in zip(records, steps, strict=True))
    size = min(longest, round(BLOCK / finest))
    blocks = -(-longest // size)
    columns = [
        _columns(record, settling, m, blocks * size)
        for record, m in zip(records, steps, strict=True)
    ]
    laid = {
        key: jnp.asarray(np.stack([c[key] for c in columns]).reshape(-1, blocks, size), float)
        for key in columns[0]
    }
    dt = np.array([r.dt / m for r, m in zip(records, steps, strict=True)])
    drives = Drives(**laid, dt=jnp.asarray(dt, float))
    return Prepared(names, tuple(records), drives, steps)


def checked_names(
    records: Sequence[CornerRecord], names: Sequence[str] | None, settling: float
) -> tuple[str, ...]:
    """Names of the records, `record 1` and so on if none are given.

    Raises:
        InputError: for no record, names that do not fit or repeat, or a settling time that is
            none.
    """
    if not records:
        raise InputError("records", "there is none", "Give at least one record.")
    if names is None:
        names = [f"record {k + 1}" for k in range(len(records))]
    if len(names) != len(records):
        raise InputError(
            "names", f"{len(names)} for {len(records)} records", "Give one for each record."
        )
    if len(set(names)) != len(names):
        raise InputError("names", f"{list(names)}", "Give each record a name of its own.")
    if not (math.isfinite(settling) and settling >= 0):
        raise InputError("settling", f"{settling:g} s", "Give a time of at least 0 s.")
    return tuple(names)


def with_road(record: CornerRecord, road: Profile, reflect: bool = False) -> CornerRecord:
    """The record with the elevation of a road that it drives along.

    x = 0 is one sampling interval before the first sample, where drives begin.

    Args:
        record: checked one, whose speed is integrated to distance.
        road: measured profile.
        reflect: continue a road that is too short there and back.

    Raises:
        InputError: if the record drives beyond the road.
    """
    moved = np.cumsum(0.5 * (record.v[1:] + record.v[:-1]) * np.diff(record.t))
    x = record.v[0] * record.dt + np.concatenate([[0.0], moved])
    spacing = float(np.median(np.diff(x)))
    z = elevation_at(without_aliases(road, max(spacing, 1e-3)), x, reflect)
    return replace(record, elevation=np.asarray(z, float))


def _check(name: str, record: CornerRecord, settling: float) -> None:
    remedies = {
        "pressure": "Add a column `pressure`, the tyre's true one, to the log, or state it.",
        "elevation": "Add a column `elevation`, or a road; without one, use `identify_blind`.",
    }
    for field, remedy in remedies.items():
        values = getattr(record, field)
        if values is None or not np.isfinite(values).any():
            raise InputError(f"{name}: {field}", "it is missing", remedy)
    assert record.elevation is not None
    duration = float(record.t[-1] - record.t[0])
    if duration < settling + SHORTEST:
        raise InputError(
            f"{name}: t",
            f"the record lasts {duration:.3g} s, of which {settling:g} s are for settling",
            f"Give at least {settling + SHORTEST:g} s.",
        )
    # NaN where a neighbour is missing
    rough = float(_spread_of(np.diff(record.elevation))) / record.dt
    if not rough >= _LEAST_ROUGHNESS:
        raise InputError(
            f"{name}: elevation",
            f"the road's velocity varies by {rough:.2g} m/s only: it excites nothing",
            "Give a record over a rough road.",
        )
    gaps = int(np.sum(~np.isfinite(record.elevation)))
    if gaps:
        text = f"{name}: elevation: {gaps} samples are missing; what follows a gap does not count."
        warnings.warn(text, InputWarning, stacklevel=3)
    counted = _judged(record, settling)
    for field in ("a_s", "a_u"):
        values = getattr(record, field)[counted]
        usable = int(np.isfinite(values).sum())
        if usable < FEWEST:
            raise InputError(
                f"{name}: {field}",
                f"{usable} samples count: behind the settling time, on a known road, finite",
                f"Give a record with at least {FEWEST}.",
            )
        spread = _spread_of(values)
        if not spread > _LEAST_ACCELERATION:
            raise InputError(
                f"{name}: {field}",
                f"it varies by {spread:.2g} m/s^2 only: the record holds no excitation",
                "Give a record over a rough road.",
            )


def _spread_of(values: np.ndarray) -> float:
    """Standard deviation of the finite ones; 0 where there are none."""
    known = values[np.isfinite(values)]
    return float(np.std(known)) if known.size else 0.0


def _judged(record: CornerRecord, settling: float) -> np.ndarray:
    """Where errors count: behind the settling time, and away from gaps in the road."""
    assert record.elevation is not None
    t = record.t
    missing = ~np.isfinite(record.elevation)
    since = np.full(len(t), np.inf)
    last = -np.inf
    for k, gone in enumerate(missing):
        last = t[k] if gone else last
        since[k] = t[k] - last
    return (t - t[0] >= settling) & (since >= AFTER_GAP)


def _columns(record: CornerRecord, settling: float, m: int, length: int) -> dict[str, np.ndarray]:
    """One record in steps of a m-th of its interval, padded: what lies outside does not count."""
    assert record.elevation is not None
    assert record.pressure is not None
    t = record.t
    # one interval of standing still before the first sample, from which nothing is known
    before = np.concatenate([[t[0] - record.dt], t])
    elevation = _filled(t, record.elevation)
    elevation = np.concatenate([elevation[:1], elevation])
    grid = before[0] + record.dt / m * np.arange(1, m * len(t) + 1)
    road = CubicSpline(before, elevation)
    fine = elevation[1:] if m == 1 else road(grid)
    judged = _judged(record, settling)
    pressure = np.interp(grid, t, _filled(t, record.pressure))
    columns = {
        "rise": np.diff(fine, prepend=elevation[0]),
        "slope": road(grid, 1),
        "pressure": pressure,
    }
    for field in ("a_s", "a_u"):
        values = getattr(record, field)
        counts = judged & np.isfinite(values)
        columns[field] = _at_ends(np.where(counts, values, 0.0), m)
        columns[f"count_{field[2:]}"] = _at_ends(counts.astype(float), m)
    fills = {"pressure": pressure[-1]}
    extra = length - len(grid)
    return {
        key: np.concatenate([value, np.full(extra, fills.get(key, 0.0))])
        for key, value in columns.items()
    }


def _at_ends(values: np.ndarray, m: int) -> np.ndarray:
    """Values at every m-th step, zero between."""
    spread = np.zeros(m * len(values))
    spread[m - 1 :: m] = values
    return spread


def _filled(t: np.ndarray, values: np.ndarray) -> np.ndarray:
    known = np.isfinite(values)
    return np.interp(t, t[known], values[known])
