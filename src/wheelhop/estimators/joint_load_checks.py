"""What the joint load filter refuses before it compiles anything."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from wheelhop.errors import InputError, require_in_range
from wheelhop.estimators.joint_load_params import JointLoadTuning
from wheelhop.vehicle.load_record import (
    FASTEST_RATE,
    LARGEST_BODY,
    LARGEST_COMPRESSION,
    LARGEST_WHEEL,
    SLOWEST_RATE,
    VehicleLoadSample,
)
from wheelhop.vehicle.time_grid import require_rate

LARGEST_HORIZONTAL = 30.0
"""Beyond this a_x or a_y has a wrong unit [m/s^2]."""

LONGEST_GAP = 0.1
"""A brake is not stepped on and released in it [s]."""

_RELATIVE = ("tilt_per_walk", "scale_prior", "scale_walk", "spring_doubt", "damper_doubt")

_LIMITS = (
    ("a_s", LARGEST_BODY, "m/s^2"),
    ("compression", LARGEST_COMPRESSION, "m"),
    ("a_u", LARGEST_WHEEL, "m/s^2"),
)


def checked_sample(sample: VehicleLoadSample, dt: float) -> VehicleLoadSample:
    """The record as arrays, if loads can be found from it.

    Without its compression no strut's force is known. Without any accelerometer a load shows only
    in how the compressions bend, which tells it from the weight of an unknown payload too late.

    Args:
        sample: of the sensors, entries [time], NaN where one is missing.
        dt: sampling interval [s].

    Raises:
        InputError: for a record that is too short, of unequal lengths or in other units, for a
            corner without compression, and for a record without any accelerometer.
    """
    rate = 1.0 / dt if dt > 0 else 0.0
    require_rate("sampling rate 1/dt", rate, SLOWEST_RATE, FASTEST_RATE)
    found = VehicleLoadSample(*(np.asarray(entry, float) for entry in sample))
    shapes = {entry.shape for entry in found}
    if len(shapes) != 1 or len(found.a_s_FL.shape) != 1 or found.a_s_FL.size < 2:
        raise InputError(
            "sample",
            f"its entries have the shapes {sorted(shapes)}",
            "Give twelve columns of one length, two samples or more, NaN where one is missing.",
        )
    for name, entry in found._asdict().items():
        _check_unit(name, entry[~np.isnan(entry)])
    for name, entry in found._asdict().items():
        if name.startswith("compression") and np.isnan(entry).all():
            raise InputError(
                name,
                "it has no sample",
                "Give the deflection at every corner: the strut's force follows from it.",
            )
    if all(np.isnan(e).all() for n, e in found._asdict().items() if n.startswith("a_")):
        raise InputError(
            "a_s_FL",
            "no accelerometer has a sample, neither on the body nor on a wheel",
            "Give the vertical accelerations of the body above the wheels.",
        )
    return found


def checked_horizontal(name: str, signal: np.ndarray, samples: int, dt: float) -> np.ndarray:
    """a_x or a_y [time] without gaps: what is lost is drawn straight between its neighbours.

    Args:
        name: of the signal.
        signal: [m/s^2], [time], NaN where a sample is missing.
        samples: of the record.
        dt: sampling interval [s].

    Raises:
        InputError: for another length, another unit, or a gap that may hide a maneuver.
    """
    found = np.asarray(signal, float)
    if found.shape != (samples,):
        raise InputError(
            name, f"its shape is {found.shape}", f"Give {samples} samples, those of the record."
        )
    known = ~np.isnan(found)
    if not known.any():
        raise InputError(
            name, "it has no sample", "Give an accelerometer, or find the loads without it."
        )
    if not np.abs(found[known]).max() <= LARGEST_HORIZONTAL:
        raise InputError(
            name,
            f"it reaches {np.abs(found[known]).max():.4g}, beyond {LARGEST_HORIZONTAL:g} m/s^2",
            "Give m/s^2, of an accelerometer at the body's centre of mass.",
        )
    place = np.flatnonzero(known)
    ends = np.concatenate([[-1], place, [samples]])
    gaps = dt * (np.diff(ends) - 1)
    if gaps.max() > LONGEST_GAP:
        raise InputError(
            name,
            f"it is missing for {gaps.max():.3g} s from {dt * (ends[gaps.argmax()] + 1):.4g} s on",
            f"Gaps of {LONGEST_GAP:g} s are bridged; cut the record, or find the loads without it.",
        )
    return np.interp(np.arange(samples), place, found[place])


def check_tuning(tuning: JointLoadTuning) -> None:
    """Refuse a tuning out of range.

    Args:
        tuning: noise and priors.

    Raises:
        InputError: naming the field.
    """
    for field in fields(tuning):
        if field.name not in (
            "load_walks",
            "patch_tilt",
            "tilt_per_walk",
            "spring_doubt",
            "damper_doubt",
        ):
            require_in_range(
                f"tuning.{field.name}", getattr(tuning, field.name), 1e-7, 1e7, "(SI unit)"
            )
    require_in_range("tuning.patch_tilt", tuning.patch_tilt, 0.0, 0.5, "rad")
    for name in _RELATIVE[1:]:
        require_in_range(f"tuning.{name}", getattr(tuning, name), 0.0, 1.0, "(relative)")
    require_in_range("tuning.tilt_per_walk", tuning.tilt_per_walk, 0.0, 1e-3, "rad s^0.5/N")
    if not tuning.load_walks:
        raise InputError("tuning.load_walks", "it is empty", "Give one intensity or more.")
    for walk in tuning.load_walks:
        require_in_range("tuning.load_walks", walk, 1.0, 1e6, "N/s^0.5")


def _check_unit(name: str, known: np.ndarray) -> None:
    quantity = name[: name.rindex("_")]
    limit, unit = next((most, u) for one, most, u in _LIMITS if one == quantity)
    if known.size and not np.max(np.abs(known)) <= limit:
        raise InputError(
            name,
            f"it reaches {np.max(np.abs(known)):.4g}, beyond {limit:g} {unit}",
            f"Give {unit}; accelerations less gravity, compressions from the design place.",
        )
