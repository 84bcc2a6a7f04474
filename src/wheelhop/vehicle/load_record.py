"""What a wheel-load estimator of the whole vehicle is given, and the checks it must pass."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from wheelhop.errors import InputError, InputWarning
from wheelhop.vehicle.time_grid import time_grid


class VehicleLoadSample(NamedTuple):
    """Measurements of the four corners; NaN where a sample is lost or there is no such sensor.

    Attributes:
        a_s_FL, a_s_FR, a_s_RL, a_s_RR: vertical accelerometers on the body above each wheel, less
            standard gravity [m/s^2].
        compression_FL, compression_FR, compression_RL, compression_RR: of the struts from their
            design place, positive as the wheel moves up towards the body [m].
        a_u_FL, a_u_FR, a_u_RL, a_u_RR: vertical accelerometers on the wheel carriers, less
            standard gravity [m/s^2].
    """

    a_s_FL: Any
    a_s_FR: Any
    a_s_RL: Any
    a_s_RR: Any
    compression_FL: Any
    compression_FR: Any
    compression_RL: Any
    compression_RR: Any
    a_u_FL: Any
    a_u_FR: Any
    a_u_RL: Any
    a_u_RR: Any


SLOWEST_RATE, FASTEST_RATE = 50.0, 10e3
"""Sampling rates [Hz] that loads up to wheel hop at 10 to 15 Hz are estimated from."""

MINIMUM_DURATION = 1.0
"""[s]."""

LARGEST_BODY, LARGEST_WHEEL, LARGEST_COMPRESSION = 200.0, 2000.0, 0.3
"""Beyond these a signal has a wrong unit or its sensor is broken [m/s^2], [m/s^2], [m]."""

_LARGEST_GAP_SHARE = 0.5
_GRAVITY_MEAN = (7.0, 12.0)
_SUSPECT_MEAN = 0.5
_SMALLEST_MOTION = 2e-4
_LARGEST_LOAD = 2e5
_SMOOTHED = 0.3
_CLEARLY = 0.6
# parts of the compressions FL, FR, RL, RR that rise with an acceleration however the road is, and
# how much that must vary: the struts' mean force alone makes the body heave
_FOLLOWS = (
    ((-1.0, -1.0, 1.0, 1.0), "a_x", 0.5, "the nose rises where a_x < 0 brakes"),
    ((-1.0, 1.0, -1.0, 1.0), "a_y", 0.5, "the car leans into the bend"),
    ((1.0, 1.0, 1.0, 1.0), "mean a_s", 0.3, "the body falls where its struts push it up"),
)


@dataclass(frozen=True)
class LoadRecord:
    """Signals of one drive on a uniform grid.

    Attributes:
        t: time [s], [time].
        sample: the sensors, entries [time]; NaN where a sample is missing or there is no sensor.
        speed: [m/s], [time], or None.
        a_x: accelerometer forward at the body's centre of mass [m/s^2], [time], or None.
        a_y: accelerometer to the left there [m/s^2], [time], or None.
        true_load: normal forces FL, FR, RL, RR [N] where they are known, [time, 4], or None.
    """

    t: np.ndarray
    sample: VehicleLoadSample
    speed: np.ndarray | None = None
    a_x: np.ndarray | None = None
    a_y: np.ndarray | None = None
    true_load: np.ndarray | None = None

    @property
    def dt(self) -> float:
        """Sampling interval [s]."""
        return float((self.t[-1] - self.t[0]) / (len(self.t) - 1))

    def without_wheel_accelerometers(self) -> LoadRecord:
        """The same record as if the wheel carriers had no accelerometers."""
        none = np.full(len(self.t), np.nan)
        lost = {name: none for name in self.sample._fields if name.startswith("a_u")}
        return replace(self, sample=self.sample._replace(**lost))


def checked_load(
    t: np.ndarray,
    sample: VehicleLoadSample,
    speed: np.ndarray | None = None,
    a_x: np.ndarray | None = None,
    a_y: np.ndarray | None = None,
    true_load: np.ndarray | None = None,
) -> LoadRecord:
    """The record on a uniform grid, with missing samples as NaN.

    Signals out of range are an error; missing samples, offsets of accelerometers and compressions
    that hardly move or have the wrong sign are told as an `InputWarning`.

    Args:
        t: time [s], [rows].
        sample: of the sensors, entries [rows], or None where there is no such sensor.
        speed: [m/s], [rows], or None.
        a_x, a_y: accelerometers at the body's centre of mass [m/s^2], [rows], or None.
        true_load: normal forces [N], [rows, 4], or None.

    Raises:
        InputError: naming the column, the value and the remedy, if the record cannot be used.
    """
    grid = time_grid(t, MINIMUM_DURATION, SLOWEST_RATE, FASTEST_RATE)
    none = np.full(len(grid.t), np.nan)
    entries = []
    for name, signal in zip(VehicleLoadSample._fields, sample, strict=True):
        if signal is None:
            entries.append(none)
            continue
        values = _column(name, signal, (len(grid.place),))
        if name.startswith("compression"):
            _check_compression(name, values)
        else:
            _check_vertical(name, values)
        entries.append(grid.spread(values))
    others: dict[str, np.ndarray | None] = {}
    for name, signal in (("v", speed), ("a_x", a_x), ("a_y", a_y)):
        if signal is None:
            others[name] = None
            continue
        values = _column(name, signal, (len(grid.place),))
        _check_size(name, values, 120.0 if name == "v" else 30.0, "m/s" if name == "v" else "m/s^2")
        others[name] = grid.spread(values)
    if true_load is not None:
        true_load = np.asarray(true_load, float)
        _check_shape("true_load", true_load, (len(grid.place), 4))
        _check_size("true_load", true_load, _LARGEST_LOAD, "N")
        true_load = grid.spread(true_load)
    record = LoadRecord(
        grid.t, VehicleLoadSample(*entries), others["v"], others["a_x"], others["a_y"], true_load
    )
    _check_signs(record)
    return record


def _column(name: str, signal: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    values = np.asarray(signal, float)
    _check_shape(name, values, shape)
    lost = 1.0 - float(np.isfinite(values).mean())
    if lost == 1.0:
        remedy = "Repair the sensor or the log, or leave the column out where it is not needed."
        if name.startswith(("a_s", "compression")):
            remedy += " The method algebraic needs a_x and a_y alone."
        raise InputError(name, "it has no sample", remedy)
    if lost > _LARGEST_GAP_SHARE:
        raise InputError(
            name, f"{100 * lost:.0f} % of its samples are missing", "Repair the sensor or the log."
        )
    if lost > 0.0:
        _warn(f"{name}: {100 * lost:.2g} % of its samples are missing and left out")
    return values


def _check_shape(name: str, values: np.ndarray, shape: tuple[int, ...]) -> None:
    if values.shape != shape:
        raise InputError(
            name,
            f"its shape is {values.shape}, {shape} by the time stamps",
            "Give a value for every time stamp, NaN where one is missing.",
        )


def _check_size(name: str, values: np.ndarray, largest: float, unit: str) -> None:
    top = float(np.abs(values[np.isfinite(values)]).max(initial=0.0))
    if top > largest:
        raise InputError(
            name,
            f"it reaches {top:g} {unit}, beyond {largest:g} {unit}",
            "Check the unit that is declared for it, and the sensor.",
        )


def _check_vertical(name: str, values: np.ndarray) -> None:
    mean = float(np.nanmean(np.where(np.isfinite(values), values, np.nan)))
    low, high = _GRAVITY_MEAN
    if low < abs(mean) < high:
        raise InputError(
            name,
            f"its mean is {mean:.3g} m/s^2: gravity is still in it",
            "Subtract 9.81 m/s^2 first, so that it shows 0 at rest on level ground."
            if mean > 0
            else "Turn its sign, so that up is positive, and subtract 9.81 m/s^2.",
        )
    wheel = name.startswith("a_u")
    _check_size(name, values, LARGEST_WHEEL if wheel else LARGEST_BODY, "m/s^2")
    if abs(mean) > _SUSPECT_MEAN:
        _warn(
            f"{name}: its mean is {mean:.2g} m/s^2, which no car keeps up: an offset, or a wrong "
            "unit; the loads are wrong by the mass times that"
        )


def _check_compression(name: str, values: np.ndarray) -> None:
    known = values[np.isfinite(values)]
    top = float(np.abs(known).max())
    if top > 5.0 * LARGEST_COMPRESSION:
        raise InputError(
            name,
            f"it reaches {top:g} m, as a compression in millimetres does",
            f'Declare its unit: {name} [mm] in the header, or {name} = "mm" in a TOML file.',
        )
    if top > LARGEST_COMPRESSION:
        raise InputError(
            name,
            f"it reaches {top:g} m, beyond {LARGEST_COMPRESSION:g} m",
            "Count it from the design place, where the unladen car rests on level ground: subtract "
            "what it shows there.",
        )
    motion = float(np.ptp(known))
    if motion < _SMALLEST_MOTION:
        _warn(
            f"{name}: it moves by {1e3 * motion:.2g} mm in all: check the sensor, and the unit "
            "that is declared"
        )


def _check_signs(record: LoadRecord) -> None:
    """Tell of compressions that run against the accelerations: extension taken as positive."""
    compression = np.stack(record.sample[4:8], 1)
    body = np.stack(record.sample[:4], 1)
    accelerations = {"a_x": record.a_x, "a_y": record.a_y, "mean a_s": body.mean(1)}
    width = max(1, round(_SMOOTHED / record.dt))
    for part, name, least, against in _FOLLOWS:
        signal = accelerations[name]
        if signal is None:
            continue
        known = np.isfinite(signal) & np.isfinite(compression).all(1)
        if known.sum() < 2 * width:
            continue
        # lost samples are bridged: gaps are short beside the smoothing, or spoil a little of it
        calm, motion = (
            np.convolve(values[known], np.full(width, 1.0 / width), "valid")
            for values in (signal, compression @ np.array(part))
        )
        spread = float(calm.std()) * float(motion.std())
        if calm.std() < least or spread == 0.0:
            continue
        likeness = float(np.mean((calm - calm.mean()) * (motion - motion.mean()))) / spread
        if likeness < -_CLEARLY:
            _warn(
                f"compression: by its sign {against} (correlation {likeness:.2f} with {name}); it "
                "counts positive as the wheel moves up towards the body: turn the sign of "
                "compression_FL to compression_RR, or of the acceleration"
            )
            return


def _warn(text: str) -> None:
    warnings.warn(InputWarning(text), stacklevel=4)
