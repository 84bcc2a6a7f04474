"""Records with a known road and pressure, checked and laid on the simulator's grid."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from wheelhop.errors import InputError
from wheelhop.vehicle.record import CornerRecord
from wheelhop.vehicle.road.profile import Profile, elevation_at, without_aliases

BLOCK = 500
"""Samples per block of a record: partial sums are kept per block."""

SETTLING = 1.0
"""Time [s] at a record's start that no error is counted of: its initial motion is not known."""

SHORTEST = 2.0
"""Shortest record [s] beside the settling time."""

COARSEST_STEP = 1.05e-3
"""Longest Runge-Kutta step [s]."""

_LEAST_ROUGHNESS = 2e-3
_LEAST_ACCELERATION = 0.02


class Drives(NamedTuple):
    """Records in blocks, every leaf [records, ...]; sums are over samples with weight 1.

    Attributes:
        rise: of the road over each sampling interval [m], [records, blocks, samples].
        pressure: of the tyre [Pa], the same shape.
        a_s, a_u: measured accelerations [m/s^2], zero where they do not count.
        count_s, count_u: 1 where a sample counts, else 0.
        dt: sampling interval [s], [records].
    """

    rise: Any
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
        substeps: Runge-Kutta steps per sampling interval.
    """

    names: tuple[str, ...]
    records: tuple[CornerRecord, ...]
    drives: Drives
    substeps: int


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
    if not records:
        raise InputError("records", "there is none", "Give at least one record.")
    if names is None:
        names = [f"record {k + 1}" for k in range(len(records))]
    if len(names) != len(records):
        raise InputError(
            "names", f"{len(names)} for {len(records)} records", "Give one for each record."
        )
    if not (math.isfinite(settling) and settling >= 0):
        raise InputError("settling", f"{settling:g} s", "Give a time of at least 0 s.")
    for name, record in zip(names, records, strict=True):
        _check(name, record, settling)
    longest = max(len(r.t) for r in records)
    blocks = -(-longest // BLOCK)
    columns = [_columns(record, settling, blocks * BLOCK) for record in records]
    stacked = {
        key: jnp.asarray(np.stack([c[key] for c in columns]).reshape(len(records), blocks, BLOCK))
        for key in columns[0]
    }
    stacked = {key: jnp.asarray(value, float) for key, value in stacked.items()}
    dt = np.array([r.dt for r in records])
    substeps = max(1, math.ceil(float(dt.max()) / COARSEST_STEP))
    drives = Drives(**stacked, dt=jnp.asarray(dt, float))
    return Prepared(tuple(names), tuple(records), drives, substeps)


def with_road(record: CornerRecord, road: Profile, reflect: bool = False) -> CornerRecord:
    """The record with the elevation of a road that it drives along from x = 0.

    Args:
        record: checked one, whose speed is integrated to distance.
        road: measured profile.
        reflect: continue a road that is too short there and back.

    Raises:
        InputError: if the record drives beyond the road.
    """
    x = np.concatenate([[0.0], np.cumsum(0.5 * (record.v[1:] + record.v[:-1]) * np.diff(record.t))])
    spacing = float(np.median(np.diff(x)))
    z = elevation_at(without_aliases(road, max(spacing, 1e-3)), x, reflect)
    return replace(record, elevation=np.asarray(z, float))


def _check(name: str, record: CornerRecord, settling: float) -> None:
    remedies = {
        "pressure": "Add a column `pressure`, the tyre's true one, to the log, or state it.",
        "elevation": "Add a column `elevation`, or a road; without it, fit the likelihood instead.",
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
    known = np.isfinite(record.elevation)
    rough = float(np.std(np.diff(record.elevation[known]))) / record.dt
    if rough < _LEAST_ROUGHNESS:
        raise InputError(
            f"{name}: elevation",
            f"the road's velocity varies by {rough:.2g} m/s only: it excites nothing",
            "Give a record over a rough road.",
        )
    for field in ("a_s", "a_u"):
        values = getattr(record, field)
        spread = float(np.nanstd(values))
        if not spread > _LEAST_ACCELERATION:
            raise InputError(
                f"{name}: {field}",
                f"it varies by {spread:.2g} m/s^2 only: the record holds no excitation",
                "Give a record over a rough road.",
            )


def _columns(record: CornerRecord, settling: float, length: int) -> dict[str, np.ndarray]:
    """One record, padded: what lies outside it does not count."""
    assert record.elevation is not None
    assert record.pressure is not None
    t = record.t
    elevation = _filled(t, record.elevation)
    pressure = _filled(t, record.pressure)
    rise = np.diff(elevation, prepend=elevation[0])
    judged = t - t[0] >= settling
    columns = {"rise": rise, "pressure": pressure}
    for field in ("a_s", "a_u"):
        values = getattr(record, field)
        counts = judged & np.isfinite(values)
        columns[field] = np.where(counts, values, 0.0)
        columns[f"count_{field[2:]}"] = counts.astype(float)
    extra = length - len(t)
    fills = {"pressure": pressure[-1]}
    return {
        key: np.concatenate([value, np.full(extra, fills.get(key, 0.0))])
        for key, value in columns.items()
    }


def _filled(t: np.ndarray, values: np.ndarray) -> np.ndarray:
    known = np.isfinite(values)
    return np.interp(t, t[known], values[known])
