"""A record of the sensors of stability control, and the checks it must pass to be used."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from wheelhop.errors import InputError, InputWarning
from wheelhop.vehicle.time_grid import time_grid


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
    grid = time_grid(t, MINIMUM_DURATION, SLOWEST_RATE, FASTEST_RATE)
    entries = [np.asarray(entry, float) for entry in sample]
    for name, entry, largest in zip(LateralSample._fields, entries, LARGEST, strict=True):
        _check_signal(name, entry, largest)
    if np.nanmin(entries[1]) < 0.0:
        raise InputError(
            "speed", f"it falls to {np.nanmin(entries[1]):g} m/s", "Give the speed forwards."
        )
    return LateralRecord(grid.t, LateralSample(*(grid.spread(entry) for entry in entries)))


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
