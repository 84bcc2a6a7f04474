"""A record of one corner's accelerometers, and the checks it must pass to be used."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace

import numpy as np

from wheelhop.errors import InputError, InputWarning

SLOWEST_NYQUIST = 25.0
"""Hz: twice a wheel-hop frequency of 12 Hz, below which the tyre cannot be seen."""

_GRID_TOLERANCE = 0.2
_LONGEST_GAP = 2.0
_STUCK_TIME = 0.5
_CRAWLING = 1.0
_FASTEST = 120.0
_SMALLEST_SHARE = 0.2

LARGEST_ACCELERATION = 2000.0
"""m/s^2: beyond it a wheel's acceleration is a wrong unit or a broken sensor."""

MINIMUM_SAMPLES = 50
"""Fewest samples of a record."""


@dataclass(frozen=True)
class CornerRecord:
    """Accelerations of one corner over time; NaN where a sample is missing.

    Attributes:
        t: time [s], [time].
        a_s: vertical acceleration of the body above the wheel [m/s^2], up positive, gravity
            removed.
        a_u: vertical acceleration of the wheel carrier [m/s^2].
        v: vehicle speed [m/s].
        pressure: true tyre pressure [Pa] where it is known (simulation, calibration), or None.
        elevation: of the road under the wheel [m] where it was measured or simulated, or None.
    """

    t: np.ndarray
    a_s: np.ndarray
    a_u: np.ndarray
    v: np.ndarray
    pressure: np.ndarray | None = None
    elevation: np.ndarray | None = None

    @property
    def dt(self) -> float:
        """Sampling interval [s]."""
        return float(np.median(np.diff(self.t)))


def checked_record(record: CornerRecord) -> CornerRecord:
    """The record on a uniform time grid, with unusable samples marked missing.

    Rows that are missing become NaN rows, a channel that is stuck for half a second becomes
    NaN there, and each such repair is told as an `InputWarning`.

    Raises:
        InputError: naming the column, the value and the remedy, if the record cannot be used.
    """
    _check_length_and_time(record)
    record = _on_uniform_grid(record)
    _check_speed(record)
    for name in ("a_s", "a_u"):
        record = replace(record, **{name: _checked_channel(name, getattr(record, name), record.dt)})
    _check_gaps(record)
    return record


def _check_length_and_time(record: CornerRecord) -> None:
    t = record.t
    if len(t) < MINIMUM_SAMPLES:
        raise InputError(
            "t", f"the log has {len(t)} samples", f"Give at least {MINIMUM_SAMPLES} samples."
        )
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
    nyquist = 0.5 / record.dt
    if nyquist < SLOWEST_NYQUIST:
        raise InputError(
            "t",
            f"the sampling rate of {1 / record.dt:.4g} Hz cannot show a wheel hop at 10 to 15 Hz",
            f"Log at {2 * SLOWEST_NYQUIST:g} Hz or more; 200 to 500 Hz is better.",
        )


def _on_uniform_grid(record: CornerRecord) -> CornerRecord:
    t, dt = record.t, record.dt
    steps = np.diff(t) / dt
    off_grid = np.abs(steps - np.round(steps))
    worst = int(np.argmax(off_grid))
    if off_grid[worst] > _GRID_TOLERANCE or np.min(np.round(steps)) < 1:
        raise InputError(
            "t",
            f"the interval at data row {worst + 2} is {1e3 * steps[worst] * dt:.4g} ms while the "
            f"median is {1e3 * dt:.4g} ms",
            "Resample the log to a uniform rate first.",
        )
    longest = float(np.max(steps) * dt)
    if longest > _LONGEST_GAP:
        raise InputError(
            "t",
            f"there is a gap of {longest:.4g} s at data row {int(np.argmax(steps)) + 2}",
            f"Split the log there: gaps up to {_LONGEST_GAP:g} s can be bridged.",
        )
    index = np.concatenate([[0], np.cumsum(np.round(steps).astype(int))])
    count = int(index[-1]) + 1
    dt = float((t[-1] - t[0]) / (count - 1))
    if count > len(t):
        _warn("t", f"{count - len(t)} rows are missing; they are bridged without a measurement.")
    elif np.max(off_grid) > 1e-2:
        worst_percent = 100 * np.max(off_grid)
        _warn("t", f"time jitters by up to {worst_percent:.2g} % of the interval; taken as even.")

    def spread(values: np.ndarray) -> np.ndarray:
        grid = np.full(count, np.nan)
        grid[index] = values
        return grid

    known = np.isfinite(record.v)
    if not known.any():
        raise InputError("v", "no speed in any row", "Add the vehicle speed to the log.")
    _refuse_long_gap("v", dt * _longest_run(~known))
    if not known.all():
        _warn("v", f"{int((~known).sum())} samples are missing; interpolated.")
    uniform = t[0] + dt * np.arange(count)
    return CornerRecord(
        t=uniform,
        a_s=spread(record.a_s),
        a_u=spread(record.a_u),
        v=np.interp(uniform, t[known], record.v[known]),
        pressure=None if record.pressure is None else spread(record.pressure),
        elevation=None if record.elevation is None else spread(record.elevation),
    )


def _check_speed(record: CornerRecord) -> None:
    v = record.v
    if np.min(v) < 0:
        raise InputError(
            "v",
            f"speed is {np.min(v):g} m/s at t = {record.t[int(np.argmin(v))]:g} s",
            "Give forward speed; cut reversing out of the log.",
        )
    if np.max(v) < _CRAWLING:
        raise InputError(
            "v",
            f"the vehicle never exceeds {np.max(v):g} m/s",
            "Give a log of a moving vehicle: without motion the road says nothing of the tyre.",
        )
    if np.max(v) > _FASTEST:
        raise InputError(
            "v",
            f"speed reaches {np.max(v):g} m/s ({3.6 * np.max(v):.0f} km/h)",
            "Check the column's unit: declare km/h if it is in km/h.",
        )
    slow = float(np.mean(v < _CRAWLING))
    if slow > 1 - _SMALLEST_SHARE:
        raise InputError(
            "v",
            f"the vehicle is slower than {_CRAWLING:g} m/s for {100 * slow:.3g} % of the log",
            "Cut the standstill out of the log.",
        )
    if slow > 0:
        _warn(
            "v", f"{100 * slow:.3g} % of the log is slower than {_CRAWLING:g} m/s and says little."
        )


def _checked_channel(name: str, values: np.ndarray, dt: float) -> np.ndarray:
    values = np.where(np.isfinite(values), values, np.nan)
    present = np.isfinite(values)
    if not present.any():
        raise InputError(name, "no sample is a number", "Give a log with this channel recorded.")
    largest = float(np.max(np.abs(values[present])))
    if largest > LARGEST_ACCELERATION:
        raise InputError(
            name,
            f"it reaches {largest:g} m/s^2",
            "Check the column's unit and the sensor's scaling.",
        )
    if np.ptp(values[present]) == 0:
        raise InputError(
            name,
            f"it is constant at {values[present][0]:g} m/s^2: the channel is stuck",
            "Check the sensor and give a log in which it works.",
        )
    stuck = _stuck_samples(values, max(3, round(_STUCK_TIME / dt)))
    if stuck.any():
        _warn(
            name,
            f"{int(stuck.sum())} samples repeat one value for {_STUCK_TIME:g} s or longer; "
            "treated as missing.",
        )
        values = np.where(stuck, np.nan, values)
        present = np.isfinite(values)
    if present.mean() < _SMALLEST_SHARE:
        raise InputError(
            name,
            f"only {int(present.sum())} of {len(values)} samples can be used",
            "Check the sensor and give a log in which it works.",
        )
    mean, spread = float(values[present].mean()), float(values[present].std())
    if 7.0 < abs(mean) < 12.0 and abs(mean) > spread:
        raise InputError(
            name,
            f"its mean is {mean:.3g} m/s^2: gravity is still in it",
            "Subtract 9.81 m/s^2 (or the channel's mean) first.",
        )
    return values


def _stuck_samples(values: np.ndarray, run: int) -> np.ndarray:
    """True where a value is repeated at least `run` times."""
    same = np.concatenate([[False], np.diff(values) == 0])
    starts = np.flatnonzero(~same)
    lengths = np.diff(np.append(starts, len(values)))
    return np.repeat(lengths >= run, lengths)


def _check_gaps(record: CornerRecord) -> None:
    for name in ("a_s", "a_u"):
        missing = ~np.isfinite(getattr(record, name))
        if missing.any():
            longest = record.dt * _longest_run(missing)
            _refuse_long_gap(name, longest)
            _warn(
                name,
                f"{int(missing.sum())} of {len(missing)} samples are missing, the longest gap "
                f"lasts {longest:.3g} s; the filter predicts through them.",
            )


def _longest_run(flags: np.ndarray) -> int:
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    return int(np.max(edges[1::2] - edges[::2], initial=0))


def _refuse_long_gap(name: str, longest: float) -> None:
    if longest > _LONGEST_GAP:
        raise InputError(
            name,
            f"there is a gap of {longest:.4g} s without a usable sample",
            f"Split the log there: gaps up to {_LONGEST_GAP:g} s can be bridged.",
        )


def _warn(field: str, text: str) -> None:
    warnings.warn(f"{field}: {text}", InputWarning, stacklevel=5)
