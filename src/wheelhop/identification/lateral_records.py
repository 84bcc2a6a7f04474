"""Records of cornering, checked and made ready for a fit: gaps filled, weights, equal lengths."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from wheelhop.errors import InputError, require_in_range
from wheelhop.estimators.lateral import LateralSample

SHORTEST = 2.0
"""Shortest record of a fit [s]."""

LONGEST_GAP = 0.2
"""Longest gap of steer, speed or, for loads, lateral acceleration that is interpolated [s]."""

SLOWEST = 3.0
"""Least speed of a fit [m/s]: below it slip angles are mostly geometry."""

SMALLEST_STEER = 1e-3
"""Front wheel angle [rad] that at least one sample of all records must reach."""

_BLOCK = 1.0
_FEWEST = 20
# a value beyond is of another unit, or of no car
_LARGEST = {"steer": 0.9, "speed": 120.0, "lateral_acceleration": 30.0, "yaw_rate": 5.0}
_UNITS = {"steer": "rad", "speed": "m/s", "lateral_acceleration": "m/s^2", "yaw_rate": "rad/s"}


class LateralNoise(NamedTuple):
    """Standard deviations of the sensors.

    Attributes:
        lateral_acceleration: [m/s^2].
        yaw_rate: [rad/s].
    """

    lateral_acceleration: float = 0.05
    yaw_rate: float = 0.002


class Cornering(NamedTuple):
    """Records of one length.

    Attributes:
        drive: samples without gaps, [records, time].
        counted: whether lateral acceleration and yaw rate were measured, [records, time, 2].
        interval: to the sample before [s], 0 for the first, [time].
        blocks: of about a second, which divide the samples.
        measured_rms: of lateral acceleration [m/s^2] and yaw rate [rad/s], [records, 2].
        peak: largest lateral acceleration but for the noise's tail [m/s^2].
    """

    drive: LateralSample
    counted: np.ndarray
    interval: np.ndarray
    blocks: int
    measured_rms: np.ndarray
    peak: float


def cornering(
    records: Sequence[LateralSample] | LateralSample,
    dt: float,
    noise: LateralNoise,
    loads: str,
) -> Cornering:
    """Records ready for a fit.

    Args:
        records: of entries [time] each, or one of [time] or [records, time]; NaN where a sample
            is missing.
        dt: sampling interval [s].
        noise: of the sensors.
        loads: "measured" if the lateral acceleration gives them, so that it needs every sample.

    Raises:
        InputError: naming record and entry, for records that are too short, out of range, with
            long gaps, or that excite the lateral motion too little.
    """
    require_in_range("dt", dt, 1e-4, 0.05, "s")
    for name in noise._fields:
        require_in_range(f"noise.{name}", getattr(noise, name), 1e-9, 10.0, _UNITS[name])
    each = _separate(records)
    for k, record in enumerate(each):
        _check(record, f"record {k + 1}", dt)
    _check_excitation(each, noise)
    filled = [_filled(r, f"record {k + 1}", dt, loads) for k, r in enumerate(each)]
    block = max(round(_BLOCK / dt), 1)
    blocks = -(-max(len(r.steer) for r in each) // block)
    drive = LateralSample(
        *(
            np.stack([_padded(entry, blocks * block) for entry in kind])
            for kind in zip(*filled, strict=True)
        )
    )
    counted = np.stack([_counted(r, blocks * block) for r in each])
    interval = np.full(blocks * block, dt)
    interval[0] = 0.0
    peak = max(float(np.nanquantile(np.abs(_or_zero(r.lateral_acceleration)), 0.99)) for r in each)
    rms = np.array([[_rms(r.lateral_acceleration), _rms(r.yaw_rate)] for r in each])
    return Cornering(drive, counted, interval, blocks, rms, peak)


def _separate(records: Sequence[LateralSample] | LateralSample) -> list[LateralSample]:
    if isinstance(records, LateralSample):
        arrays = LateralSample(*(np.asarray(entry, float) for entry in records))
        if len({a.shape for a in arrays}) != 1 or arrays.steer.ndim not in (1, 2):
            shapes = {name: a.shape for name, a in zip(arrays._fields, arrays, strict=True)}
            raise InputError("records", f"shapes {shapes}", "Give [time] or [records, time].")
        if arrays.steer.ndim == 1:
            return [arrays]
        return [LateralSample(*rows) for rows in zip(*arrays, strict=True)]
    found = []
    for k, record in enumerate(records):
        one = LateralSample(*(np.asarray(entry, float) for entry in record))
        if len({a.shape for a in one}) != 1 or one.steer.ndim != 1:
            shapes = {name: a.shape for name, a in zip(one._fields, one, strict=True)}
            raise InputError(f"record {k + 1}", f"shapes {shapes}", "Give entries [time] alike.")
        found.append(one)
    if not found:
        raise InputError("records", "there are none", "Give at least one.")
    return found


def _check(record: LateralSample, name: str, dt: float) -> None:
    samples = len(record.steer)
    if samples < max(_FEWEST, round(SHORTEST / dt)):
        raise InputError(
            name,
            f"{samples} samples, {samples * dt:g} s, are too short",
            f"Give at least {SHORTEST:g} s and {_FEWEST} samples of a manoeuvre.",
        )
    for entry, values in zip(record._fields, record, strict=True):
        there = values[~np.isnan(values)]
        most = float(np.max(np.abs(there), initial=0.0))
        if most > _LARGEST[entry]:
            raise InputError(
                f"{name}.{entry}",
                f"it reaches {most:g} {_UNITS[entry]}",
                f"Give it in {_UNITS[entry]}, within {_LARGEST[entry]:g}.",
            )
    slowest = float(np.nanmin(_or_zero(record.speed)))
    if slowest < SLOWEST:
        raise InputError(
            f"{name}.speed",
            f"it falls to {slowest:g} m/s",
            f"Cut the record where the vehicle is slower than {SLOWEST:g} m/s or reverses.",
        )
    if np.isnan(record.lateral_acceleration).all() and np.isnan(record.yaw_rate).all():
        raise InputError(
            name, "it has neither lateral acceleration nor yaw rate", "Leave this record out."
        )


def _check_excitation(records: Sequence[LateralSample], noise: LateralNoise) -> None:
    steer = max(float(np.nanmax(np.abs(_or_zero(r.steer)))) for r in records)
    if steer < SMALLEST_STEER:
        raise InputError(
            "records.steer",
            f"no cornering: the front wheels turn by {steer:.2g} rad at most",
            f"Give records in which they turn by {SMALLEST_STEER:g} rad and more.",
        )
    a = max(_rms(r.lateral_acceleration) for r in records)
    rate = max(_rms(r.yaw_rate) for r in records)
    # noise alone has the noise's rms
    if a < 1.5 * noise.lateral_acceleration and rate < 1.5 * noise.yaw_rate:
        raise InputError(
            "records",
            f"no cornering: lateral acceleration of {a:.2g} m/s^2 rms and yaw rate of "
            f"{rate:.2g} rad/s rms are hardly more than the sensors' noise",
            "Give records of harder cornering, or of less noise.",
        )


def _filled(record: LateralSample, name: str, dt: float, loads: str) -> LateralSample:
    """Gaps interpolated; where an entry is only compared, what is filled in does not count."""
    needed = {"steer", "speed"} | ({"lateral_acceleration"} if loads == "measured" else set())
    entries = []
    for entry, values in zip(record._fields, record, strict=True):
        gone = np.isnan(values)
        longest = _longest(gone) * dt
        if entry in needed and longest > LONGEST_GAP:
            remedy = "Split the record there."
            if entry == "lateral_acceleration":
                remedy = "Split the record there, or take loads='model'."
            raise InputError(
                f"{name}.{entry}", f"a gap of {longest:g} s, but {LONGEST_GAP:g} s at most", remedy
            )
        there = np.flatnonzero(~gone)
        lost = not there.size
        at = np.arange(len(values))
        entries.append(np.zeros(len(values)) if lost else np.interp(at, there, values[there]))
    return LateralSample(*entries)


def _counted(record: LateralSample, samples: int) -> np.ndarray:
    driven = ~(np.isnan(record.steer) | np.isnan(record.speed))
    both = np.stack([~np.isnan(record.lateral_acceleration), ~np.isnan(record.yaw_rate)], axis=1)
    counted = np.zeros((samples, 2), bool)
    counted[: len(driven)] = both & driven[:, None]
    return counted


def _padded(values: np.ndarray, samples: int) -> np.ndarray:
    return np.pad(values, (0, samples - len(values)), mode="edge")


def _longest(gone: np.ndarray) -> int:
    """Length of the longest run of missing samples."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], gone.astype(int), [0]])))
    return int(np.max(edges[1::2] - edges[::2], initial=0))


def _rms(values: Any) -> float:
    there = values[~np.isnan(values)]
    return float(np.sqrt(np.mean(there * there))) if there.size else 0.0


def _or_zero(values: Any) -> Any:
    """The same, but zeros where nothing was measured at all."""
    return np.zeros(1) if np.isnan(values).all() else values
