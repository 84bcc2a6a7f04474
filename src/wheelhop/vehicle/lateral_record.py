"""A record of the sensors of stability control, and the checks it must pass to be used."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from wheelhop.errors import InputError, InputWarning, require_in_range


class LateralSample(NamedTuple):
    """Samples of the sensors of stability control; NaN where one is missing.

    Attributes:
        steer: angle of the front wheels [rad].
        speed: [m/s].
        lateral_acceleration: [m/s^2].
        yaw_rate: [rad/s].
    """

    steer: Any
    speed: Any
    lateral_acceleration: Any
    yaw_rate: Any


LARGEST = LateralSample(0.9, 120.0, 20.0, 4.0)
"""Beyond these a signal has a wrong unit or its sensor is broken."""

SLOWEST_RATE, FASTEST_RATE = 10.0, 2000.0
"""Sampling rates [Hz] that lateral dynamics of 0 to 2 Hz are estimated from."""

MINIMUM_DURATION = 1.0
"""[s]."""

_LARGEST_GAP_SHARE = 0.5


@dataclass(frozen=True)
class LateralRecord:
    """Signals of one drive on a uniform grid.

    Attributes:
        t: time [s], [time].
        sample: the sensors, entries [time]; NaN where a sample is missing.
    """

    t: np.ndarray
    sample: LateralSample

    @property
    def dt(self) -> float:
        """Sampling interval [s]."""
        return float(np.median(np.diff(self.t)))


def checked_lateral(t: np.ndarray, sample: LateralSample) -> LateralRecord:
    """The record on a uniform grid, with missing samples as NaN.

    Samples out of a sensor's range (`LARGEST`) are an error, missing ones are told as an
    `InputWarning`.

    Args:
        t: time [s], [time].
        sample: of the sensors, entries [time].

    Raises:
        InputError: naming the column, the value and the remedy, if the record cannot be used.
    """
    t = np.asarray(t, float)
    if not np.all(np.isfinite(t)):
        row = int(np.flatnonzero(~np.isfinite(t))[0])
        raise InputError("t", f"no time at data row {row + 1}", "Remove rows without a time.")
    backwards = np.flatnonzero(np.diff(t) <= 0)
    if backwards.size:
        row = int(backwards[0])
        raise InputError(
            "t",
            f"time goes from {t[row]:g} to {t[row + 1]:g} s at data row {row + 2}",
            "Sort the rows by time and remove repeated ones.",
        )
    span = float(t[-1] - t[0]) if len(t) else 0.0
    if len(t) < 2 or span < MINIMUM_DURATION:
        raise InputError("t", f"the log covers {span:g} s", f"Give {MINIMUM_DURATION:g} s or more.")
    dt = float(np.median(np.diff(t)))
    require_in_range("sampling rate", 1.0 / dt, SLOWEST_RATE, FASTEST_RATE, "Hz")
    entries = [np.asarray(entry, float) for entry in sample]
    for name, entry, largest in zip(LateralSample._fields, entries, LARGEST, strict=True):
        _check_signal(name, entry, largest)
    if np.nanmin(entries[1]) < 0.0:
        raise InputError(
            "speed", f"it falls to {np.nanmin(entries[1]):g} m/s", "Give the speed forwards."
        )
    # the median interval where rows are missing, the mean one where stamps are rounded or jitter
    dt = min((dt, span / (len(t) - 1)), key=lambda interval: _unevenness(t, interval))
    place = np.rint((t - t[0]) / dt).astype(int)
    if len(np.unique(place)) < len(place):
        row = int(np.flatnonzero(np.diff(place) == 0)[0])
        raise InputError(
            "t",
            f"the times {t[row]:g} and {t[row + 1]:g} s are closer than half the interval of "
            f"{dt:.4g} s",
            "Resample the log on a uniform grid.",
        )
    count = int(place[-1]) + 1
    if count > 2 * len(t):
        raise InputError(
            "t", f"{count - len(t)} of {count} samples are missing", "Cut the log at its gaps."
        )
    if count > len(t):
        warnings.warn(
            InputWarning(f"{count - len(t)} of {count} samples are missing in time and left out"),
            stacklevel=2,
        )
    grid = LateralSample(*(_on_grid(place, count, entry) for entry in entries))
    return LateralRecord(t[0] + dt * np.arange(count), grid)


def _unevenness(t: np.ndarray, dt: float) -> float:
    """Rms distance of the times from a grid of this interval, in intervals."""
    place = (t - t[0]) / dt
    return float(np.sqrt(np.mean((place - np.rint(place)) ** 2)))


def _check_signal(name: str, entry: np.ndarray, largest: float) -> None:
    known = np.isfinite(entry)
    lost = 1.0 - float(known.mean())
    if lost > _LARGEST_GAP_SHARE:
        raise InputError(
            name, f"{100 * lost:.0f} % of its samples are missing", "Repair the sensor or the log."
        )
    if lost > 0.0:
        warnings.warn(
            InputWarning(f"{name}: {100 * lost:.2g} % of its samples are missing and left out"),
            stacklevel=3,
        )
    top = float(np.abs(entry[known]).max())
    if top > largest:
        raise InputError(
            name, f"it reaches {top:g}, beyond {largest:g} in SI units", "Check the unit declared."
        )


def _on_grid(place: np.ndarray, count: int, entry: np.ndarray) -> np.ndarray:
    found = np.full(count, np.nan)
    found[place] = np.where(np.isfinite(entry), entry, np.nan)
    return found
