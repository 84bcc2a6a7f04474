"""What a drive of the full vehicle must be to be simulated, and its truth to be believed."""

from __future__ import annotations

import warnings

import numpy as np

from wheelhop.errors import DivergenceError, InputError, InputWarning, require_in_range
from wheelhop.vehicle.full_vehicle import FullVehicle, Surroundings
from wheelhop.vehicle.full_vehicle_parameters import validate as validate_vehicle
from wheelhop.vehicle.maneuver import Maneuver
from wheelhop.vehicle.pressure_course import PressureCourse
from wheelhop.vehicle.pressure_course import validate as validate_pressure
from wheelhop.vehicle.simulation import Signals

_SIDEWALL = 0.25
_TOPPLED = 1.0

LARGEST_SUBSTEP = 1e-3
"""Longest Runge-Kutta step [s] at which wheel hop, spins and stops are resolved."""


def check_drive(
    vehicle: FullVehicle,
    maneuver: Maneuver,
    pressure: PressureCourse,
    duration: float,
    rate: float,
    substeps: int,
) -> None:
    """Check what a drive is asked for, before anything compiles.

    Args:
        vehicle: parameters.
        maneuver: the driver.
        pressure: of the tyres over time.
        duration: [s].
        rate: of the log [Hz].
        substeps: Runge-Kutta steps per sample.

    Raises:
        InputError: naming the parameter that is out of range.
    """
    validate_vehicle(vehicle)
    validate_pressure(pressure)
    require_in_range("maneuver.speed", maneuver.speed, 0.0, 100.0, "m/s")
    require_in_range("maneuver.brake.torque", maneuver.brake.torque, 0.0, 2e5, "Nm")
    require_in_range("maneuver.brake.rise", maneuver.brake.rise, 1e-3, 60.0, "s")
    require_in_range("duration", duration, 0.05, 3600.0, "s")
    require_in_range("rate", rate, 50.0, 20e3, "Hz")
    if substeps < 1 or 1.0 / (rate * substeps) > LARGEST_SUBSTEP:
        raise InputError(
            "substeps",
            f"{substeps} at {rate:g} Hz make steps of {1e3 / (rate * max(substeps, 1)):.3g} ms",
            f"Keep them below {1e3 * LARGEST_SUBSTEP:g} ms: use "
            f"{max(1, int(np.ceil(1.0 / (rate * LARGEST_SUBSTEP))))} or more.",
        )


def checked_surroundings(around: Surroundings) -> Surroundings:
    """The same surroundings, checked.

    Raises:
        InputError: naming the figure that is out of range.
    """
    for name, low, high, unit in (
        ("grade", -0.5, 0.5, "rad"),
        ("bank", -0.5, 0.5, "rad"),
        ("friction", 0.01, 5.0, "(no unit)"),
        ("air_density", 0.0, 10.0, "kg/m^3"),
        ("gravity", 0.1, 30.0, "m/s^2"),
    ):
        for number in np.ravel(np.asarray(getattr(around, name))).tolist():
            require_in_range(f"surroundings.{name}", number, low, high, unit)
    return around


def warn_of_rims(truth: Signals, radius: float) -> None:
    """The tyre's law knows no rim; an `InputWarning` says where a real tyre would be on it.

    Args:
        truth: signals of the drive.
        radius: of the unloaded tyres [m].
    """
    deepest = float(np.max(truth.tire_deflection))
    if deepest > _SIDEWALL * radius:
        warnings.warn(
            InputWarning(
                f"tyre deflection reaches {1e3 * deepest:.0f} mm, where most tyres of "
                f"{1e3 * radius:.0f} mm are on their rims; the model has no rim"
            ),
            stacklevel=3,
        )


def refuse_runaway(truth: Signals, t: np.ndarray, radius: float) -> None:
    """Refuse a drive that did not stay physical.

    Args:
        truth: signals of the drive.
        t: time of each [s].
        radius: of the unloaded tyres [m].

    Raises:
        DivergenceError: if the vehicle leaves the finite numbers, rolls over (1 rad of roll or
            pitch) or sinks a wheel through the road; says when.
    """
    finite = np.isfinite(truth.a_z) & np.all(np.isfinite(truth.wheel_acceleration), axis=1)
    upright = (np.abs(truth.roll) < _TOPPLED) & (np.abs(truth.pitch) < _TOPPLED)
    above = np.all(truth.tire_deflection < radius, axis=1)
    bad = np.flatnonzero(~(finite & upright & above))
    if bad.size:
        k = bad[0]
        what = "rolls over" if not upright[k] else "sinks a wheel through the road"
        what = what if finite[k] else "leaves the finite numbers"
        raise DivergenceError(
            f"the vehicle {what} at t = {t[bad[0]]:.4g} s; drive more gently, or raise the rate "
            "or the substeps"
        )
