"""Time stamps of a log as places on a uniform grid."""

from __future__ import annotations

import warnings
from typing import NamedTuple

import numpy as np

from wheelhop.errors import InputError, InputWarning, require_in_range

_ROUNDING = 1e-3
_MANY_REPEATED = 0.25


class TimeGrid(NamedTuple):
    """A uniform grid and where the rows of a log lie on it.

    Attributes:
        t: the grid [s], [time].
        place: index of every row in it, [rows].
    """

    t: np.ndarray
    place: np.ndarray

    def spread(self, values: np.ndarray) -> np.ndarray:
        """Values of the rows [rows, ...] on the grid; NaN where there is no row or no number."""
        found = np.full((len(self.t), *values.shape[1:]), np.nan)
        found[self.place] = np.where(np.isfinite(values), values, np.nan)
        return found


def require_rate(field: str, rate: float, slowest: float, fastest: float) -> None:
    """Refuse a sampling rate out of range, but for what rounded time stamps leave.

    Args:
        field: what the rate is called.
        rate: samples in a second [Hz].
        slowest, fastest: between which it must lie [Hz].

    Raises:
        InputError: naming the field.
    """
    if not slowest * (1.0 - _ROUNDING) <= rate <= fastest * (1.0 + _ROUNDING):
        require_in_range(field, rate, slowest, fastest, "Hz")


def time_grid(t: np.ndarray, shortest: float, slowest: float, fastest: float) -> TimeGrid:
    """The uniform grid that a log's time stamps lie on; missing rows are told as a warning.

    Args:
        t: time stamps [s], [rows].
        shortest: duration that is needed [s].
        slowest, fastest: sampling rates between which the log is of use [Hz].

    Raises:
        InputError: naming the data row or figure, what was found, and the remedy.
    """
    t = np.asarray(t, float)
    if t.ndim != 1:
        raise InputError("t", f"it has the shape {t.shape}", "Give one time for each row.")
    if not np.all(np.isfinite(t)):
        row = int(np.flatnonzero(~np.isfinite(t))[0])
        raise InputError("t", f"no time at data row {row + 1}", "Remove rows without a time.")
    if len(t) > 1 and not np.ptp(t):
        raise InputError(
            "t",
            f"it is {t[0]:g} s in all {len(t)} rows",
            "Give the column that counts the time; a TOML file can name it.",
        )
    repeated = int(np.sum(np.diff(t) == 0))
    if repeated > _MANY_REPEATED * len(t):
        raise InputError(
            "t",
            f"{repeated} of {len(t)} rows have the time of the row before",
            "Write the time with more digits: one for each row.",
        )
    backwards = np.flatnonzero(np.diff(t) <= 0)
    if backwards.size:
        row = int(backwards[0])
        raise InputError(
            "t",
            f"time goes from {t[row]:g} to {t[row + 1]:g} s at data row {row + 2}",
            "Sort the rows by time and remove repeated ones.",
        )
    span = float(t[-1] - t[0]) if len(t) else 0.0
    if len(t) < 2 or span < shortest:
        raise InputError(
            "t",
            f"the log covers {span:g} s with {len(t)} rows",
            f"Give {shortest:g} s or more, and declare the unit of t if it is not s.",
        )
    dt = float(np.median(np.diff(t)))
    require_rate("sampling rate", 1.0 / dt, slowest, fastest)
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
            stacklevel=3,
        )
    return TimeGrid(t[0] + dt * np.arange(count), place)


def _unevenness(t: np.ndarray, dt: float) -> float:
    """Rms distance of the times from a grid of this interval, in intervals."""
    place = (t - t[0]) / dt
    return float(np.sqrt(np.mean((place - np.rint(place)) ** 2)))
