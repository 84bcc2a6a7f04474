"""Records without a road, checked and laid side by side for the likelihood."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np

from wheelhop.errors import InputError
from wheelhop.estimators.road_model import LONGEST_STEP
from wheelhop.identification.drives import SHORTEST, checked_names
from wheelhop.identification.likelihood import Course
from wheelhop.vehicle.record import CornerRecord

SETTLING = 0.5
"""Time [s] at a record's start whose likelihood does not count: the filter finds the motion."""

RATE = 500.0
"""Default sampling rate [Hz] that a faster record is thinned to."""

BLOCK = 0.5
"""Length [s] of a block: partial sums, for robust errors, are kept per block."""

_LEAST_ACCELERATION = 0.02
_STANDS_OUT = 1.2
_CRAWLING = 1.0


@dataclass(frozen=True)
class Laid:
    """Checked records.

    Attributes:
        names: of the records.
        course: the same side by side.
        substeps: integration steps per sampling interval.
        speeds: mean speed of each record [m/s].
    """

    names: tuple[str, ...]
    course: Course
    substeps: int
    speeds: np.ndarray


def lay(
    records: Sequence[CornerRecord],
    names: Sequence[str] | None = None,
    settling: float = SETTLING,
    rate: float = RATE,
    noise: tuple[float, float] = (0.0, 0.0),
) -> Laid:
    """Check records for identification on an unknown road and lay them side by side.

    A record of a higher rate is thinned: of k samples the filter sees one. The likelihood of the
    samples that stay is exact, whatever lies above their Nyquist frequency; only what the others
    knew is lost. A low-pass before thinning would colour the noise.

    Args:
        records: checked ones (`vehicle.record.checked_record`) with pressure.
        names: of the records, for messages and tables.
        settling: time at the start of each that does not count [s].
        rate: highest sampling rate that is kept [Hz].
        noise: of a_s and a_u [m/s^2], above which a_u must stand out.

    Raises:
        InputError: naming the record, the field and the remedy, for no record, one without
            pressure or speed, standing still, too short, or without excitation.
    """
    names = checked_names(records, names, settling)
    if not (math.isfinite(rate) and rate >= 50.0):
        raise InputError("rate", f"{rate:g} Hz", "Give at least 50 Hz; the default is 500 Hz.")
    for name, record in zip(names, records, strict=True):
        _check(name, record, settling, noise)
    thinned = [_columns(record, settling, rate) for record in records]
    dt = np.array([interval for _, interval in thinned])
    longest = max(len(columns["a_s"]) for columns, _ in thinned)
    block = max(1, round(BLOCK / float(dt.min())))
    blocks = -(-longest // block)
    fields = {
        key: np.stack([_padded(c[key], blocks * block, key) for c, _ in thinned], -1)
        for key in thinned[0][0]
    }
    course = Course(
        **{k: jnp.asarray(v.reshape(blocks, block, -1), float) for k, v in fields.items()},
        dt=jnp.asarray(dt, float),
    )
    substeps = max(1, math.ceil(float(dt.max()) / LONGEST_STEP - 1e-6))
    speeds = np.array([float(np.mean(r.v)) for r in records])
    return Laid(names, course, substeps, speeds)


def _check(name: str, record: CornerRecord, settling: float, noise: tuple[float, float]) -> None:
    pressure, v = record.pressure, record.v
    if pressure is None or not np.isfinite(pressure).any():
        raise InputError(
            f"{name}: pressure",
            "it is missing",
            "Add a column `pressure`, the tyre's true one, to the log, or state it.",
        )
    if not np.isfinite(v).all():
        raise InputError(f"{name}: v", "it is missing", "Add the vehicle's speed to the log.")
    moving = float(np.mean(v >= _CRAWLING))
    if moving < 1.0:
        raise InputError(
            f"{name}: v",
            f"the vehicle is slower than {_CRAWLING:g} m/s for {1 - moving:.0%} of the record",
            "Cut the standstill out: a road's level says nothing there.",
        )
    duration = float(record.t[-1] - record.t[0])
    if duration < settling + SHORTEST:
        raise InputError(
            f"{name}: t",
            f"the record lasts {duration:.3g} s, of which {settling:g} s are for settling",
            f"Give at least {settling + SHORTEST:g} s.",
        )
    for field, least in (("a_s", 0.0), ("a_u", _STANDS_OUT * noise[1])):
        values = getattr(record, field)
        spread = float(np.nanstd(values)) if np.isfinite(values).any() else 0.0
        if not spread > max(least, _LEAST_ACCELERATION):
            raise InputError(
                f"{name}: {field}",
                f"it varies by {spread:.2g} m/s^2 only, hardly more than noise: nothing excites it",
                "Give a record over a rough road.",
            )


def _columns(
    record: CornerRecord, settling: float, rate: float
) -> tuple[dict[str, np.ndarray], float]:
    """One record, thinned, and its sampling interval."""
    assert record.pressure is not None
    every = max(1, math.floor(1.0 / (record.dt * rate) + 1e-6))
    known = np.isfinite(record.pressure)
    pressure = np.interp(record.t, record.t[known], record.pressure[known])
    columns = {
        "a_s": record.a_s,
        "a_u": record.a_u,
        "speed": record.v,
        "pressure": pressure,
        "count": (record.t - record.t[0] >= settling).astype(float),
    }
    return {k: np.asarray(v, float)[::every] for k, v in columns.items()}, every * record.dt


def _padded(values: np.ndarray, length: int, key: str) -> np.ndarray:
    """Lengthened: measurements by missing ones, what drives the model by its last value."""
    fill = {"a_s": np.nan, "a_u": np.nan, "count": 0.0}.get(key, values[-1])
    return np.concatenate([values, np.full(length - len(values), fill)])
