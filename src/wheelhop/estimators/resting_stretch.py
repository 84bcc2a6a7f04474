"""Where a log stands still, and what its sensors show there."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from wheelhop.errors import InputError
from wheelhop.vehicle.full_vehicle_parameters import CORNERS
from wheelhop.vehicle.load_record import LARGEST_COMPRESSION


class Stands(NamedTuple):
    """What the sensors show of one or several stands, each the mean of a calm stretch.

    Attributes:
        deflection: q, compressions of the struts from their design place FL, FR, RL, RR [m],
            [stands, 4].
        a_x, a_y: accelerometers on the body, forward and to the left [m/s^2], [stands].
    """

    deflection: Any
    a_x: Any
    a_y: Any


class Calm(NamedTuple):
    """The longest calm stretch of a log.

    Attributes:
        begin, end: its first sample and the one after its last.
        stand: means over it, one stand.
        deflection_sigma: standard deviation of the mean deflections as white noise has it [m];
            an offset of a sensor is not in it.
    """

    begin: int
    end: int
    stand: Stands
    deflection_sigma: float


def at_rest(
    t: Any,
    deflection: Any,
    speed: Any,
    a_x: Any = None,
    a_y: Any = None,
    *,
    block: float = 0.5,
    slowest: float = 0.1,
    rate: float = 2e-3,
) -> Calm:
    """Where a log stands still, and the means there.

    Blocks count as calm where the mean speed is below `slowest` and the slope of every deflection,
    by least squares, below `rate` plus three standard deviations of that slope; the longest run of
    calm blocks is taken. Lost samples (NaN) are left out.

    Args:
        t: time [s], [time].
        deflection: compressions of the struts [m], [time, 4].
        speed: [m/s], [time].
        a_x, a_y: accelerometers on the body [m/s^2], [time]; zero, level ground, by default.
        block: length of a block [s].
        slowest: speed that counts as standing [m/s].
        rate: deflection rate that counts as calm [m/s].

    Raises:
        InputError: for wrong shapes, times that do not rise, a corner without samples or in
            another unit, or where the log has no calm block.
    """
    t, q, v = (np.asarray(x, float) for x in (t, deflection, speed))
    a = [np.zeros_like(t) if x is None else np.asarray(x, float) for x in (a_x, a_y)]
    if t.ndim != 1 or q.shape != (len(t), 4) or any(x.shape != t.shape for x in (v, *a)):
        raise InputError(
            "log",
            f"t {t.shape}, deflection {q.shape}, speed {v.shape}",
            "Give [time], [time, 4] and [time] of one length.",
        )
    _check_values(t, q)
    size = max(4, round(block / np.median(np.diff(t)))) if len(t) > 1 else 4
    count = len(t) // size
    calm = [_calm(slice(k * size, (k + 1) * size), t, q, v, slowest, rate) for k in range(count)]
    first, length, run = 0, 0, 0
    for k, quiet in enumerate(calm):
        run = run + 1 if quiet else 0
        first, length = (k + 1 - run, run) if run > length else (first, length)
    if length == 0:
        raise InputError(
            "log",
            f"no {block:g} s below {slowest:g} m/s with deflections that move less than "
            f"{1e3 * rate:g} mm/s",
            "Log some seconds at rest before driving off, or give the mean deflections of a stand.",
        )
    rest = slice(first * size, (first + length) * size)
    mean, seen = np.nanmean(q[rest], 0), np.sum(np.isfinite(q[rest]), 0)
    spread = np.sqrt(np.nanvar(q[rest], 0) * seen / np.maximum(seen - 1, 1))
    sigma = float(np.sqrt(np.mean(spread**2 / seen)))
    stand = Stands(mean[None], *(np.array([np.nanmean(x[rest])]) for x in a))
    return Calm(rest.start, rest.stop, stand, sigma)


def _check_values(t: np.ndarray, q: np.ndarray) -> None:
    if not np.isfinite(t).all() or (np.diff(t) <= 0.0).any():
        raise InputError("t", "it does not rise from row to row", "Give rising times in s.")
    for corner, one in zip(CORNERS, q.T, strict=True):
        known = np.abs(one[np.isfinite(one)])
        if not known.size:
            raise InputError(f"deflection {corner}", "it has no sample", "Repair its sensor.")
        if known.max() > LARGEST_COMPRESSION:
            raise InputError(
                f"deflection {corner}",
                f"it reaches {known.max():g} m, beyond {LARGEST_COMPRESSION:g} m",
                "Give m, counted from the design place.",
            )


def _calm(
    part: slice, t: np.ndarray, q: np.ndarray, v: np.ndarray, slowest: float, rate: float
) -> bool:
    if not np.isfinite(v[part]).any() or not abs(np.nanmean(v[part])) < slowest:
        return False
    for one in q[part].T:
        known = np.isfinite(one)
        if known.sum() < 4:
            return False
        time, values = t[part][known] - t[part][known].mean(), one[known] - one[known].mean()
        power = float(time @ time)
        slope = float(time @ values) / power
        left = values - slope * time
        doubt = np.sqrt(float(left @ left) / (len(left) - 2) / power)
        if not abs(slope) < rate + 3.0 * doubt:
            return False
    return True
