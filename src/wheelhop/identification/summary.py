"""An identification as plain numbers, with units in their names."""

from __future__ import annotations

from typing import Any

import numpy as np

from wheelhop.identification.blind import BlindIdentification
from wheelhop.identification.identify import Identification
from wheelhop.identification.objective import lost
from wheelhop.identification.parameters import value_of
from wheelhop.identification.uncertainty import WEAK
from wheelhop.vehicle.corner_modes import corner_modes, equivalent_damping
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.tire import stiffness_from_pressure

AnyIdentification = Identification | BlindIdentification

SAME_MINIMUM = 0.01
"""Starts whose loss is within this share of the best one ended in the same minimum."""


def summarise_identification(found: Identification) -> dict[str, Any]:
    """What `summary.json` holds of an identification: plain Python numbers, lists and text.

    Args:
        found: the identification.
    """
    descent = found.descent
    norm = descent_norms(found)
    return {
        "parameters": parameters_of(found),
        "correlation": found.uncertainty.correlation.tolist(),
        "directions": directions_of(found),
        "loss_m_per_s2": found.loss,
        "start_loss_m_per_s2": float(np.linalg.norm(found.start_rmse)),
        "measured_norm_m_per_s2": float(np.linalg.norm(found.measured_rms)),
        "unexplained_share": found.unexplained,
        "records": [
            {
                "name": name,
                **{
                    f"{signal}_{what}_m_per_s2": float(values[k, c])
                    for c, signal in enumerate(("a_s", "a_u"))
                    for what, values in (
                        ("start_rmse", found.start_rmse),
                        ("rmse", found.rmse),
                        ("measured_rms", found.measured_rms),
                    )
                },
            }
            for k, name in enumerate(found.names)
        ],
        "descent": {
            "iterations": len(descent.seconds) - 1,
            "warm_up_iterations": descent.warm_up,
            "evaluations": int(descent.evaluations[-1]),
            "duration_s": float(descent.seconds[-1]),
            "converged": descent.converged.tolist(),
            "loss_m_per_s2": norm[-1].tolist(),
            "starts_at_the_best_minimum": starts_at_best(found),
        },
        "problems": list(found.problems),
    }


def parameters_of(found: AnyIdentification) -> dict[str, Any]:
    """The fitted parameters of the car by name and unit, with their errors and bounds."""
    known = found.uncertainty
    return {
        f"{name}{unit_suffix(found.space.units[k])}": {
            "start": float(value_of(found.start, name)),
            "estimate": float(found.values[k]),
            "standard_error": float(known.standard_errors[k]),
            "robust_standard_error": float(known.robust_errors[k]),
            "relative_error": float(relative_errors(found)[k]),
            "lower_bound": found.space.lower[k],
            "upper_bound": found.space.upper[k],
            "note": parameter_note(found, k),
        }
        for k, name in enumerate(found.space.names)
    }


def directions_of(found: AnyIdentification) -> list[dict[str, Any]]:
    """Combinations that the data determine on their own, from the best known to the worst."""
    return [
        {"relative_weights": dict(d.weights), "relative_error": d.relative_error}
        for d in found.uncertainty.directions
    ]


def relative_errors(found: AnyIdentification) -> np.ndarray:
    """The larger of standard and robust standard error over the parameter's size, [n].

    Infinite where the data say nothing, NaN for a parameter held at its bound.
    """
    known = found.uncertainty
    # a fit without a road has the roads behind the car
    error = np.maximum(known.standard_errors, known.robust_errors)[: len(found.values)]
    size = np.abs(found.values)
    unknown = np.where(np.isnan(error), np.nan, np.inf)
    return np.divide(error, size, out=unknown, where=size > 0)


def parameter_note(found: AnyIdentification, k: int) -> str:
    """What limits parameter k, in plain words; empty where nothing does."""
    if found.at_bound[k]:
        return f"at its {found.at_bound[k]} bound"
    error = relative_errors(found)[k]
    if not np.isfinite(error):
        return "not known"
    return "hardly known" if error >= WEAK else ""


def descent_norms(found: Identification) -> np.ndarray:
    """Loss norm [m/s^2] of each start after each iteration, [iterations + 1, starts].

    The first row is the beginning; NaN where a simulation left the finite numbers.
    """
    share = np.where(lost(found.descent.history), np.nan, found.descent.history)
    return np.sqrt(share) * float(np.linalg.norm(found.measured_rms))


def starts_at_best(found: Identification) -> int:
    """How many starts ended in the best minimum."""
    last = found.descent.loss
    return int(np.sum(np.sqrt(last) <= (1.0 + SAME_MINIMUM) * np.sqrt(last.min())))


def physical_reading(car: QuarterCar, pressure: float, velocity_rms: float) -> dict[str, float]:
    """Modes of a quarter car with its damper linearised at the motion it had.

    Args:
        car: parameters.
        pressure: of the tyre [Pa].
        velocity_rms: root mean square of the suspension's velocity [m/s]; where it is not finite,
            the quadratic damping is left out.
    """
    velocity = velocity_rms if np.isfinite(velocity_rms) else 0.0
    modes = corner_modes(car, pressure, velocity)
    return {
        "ride_frequency_Hz": modes.ride_frequency,
        "ride_damping_ratio": modes.ride_damping,
        "wheel_hop_frequency_Hz": modes.hop_frequency,
        "wheel_hop_damping_ratio": modes.hop_damping,
        "equivalent_damping_Ns_per_m": equivalent_damping(car, velocity),
        "tire_stiffness_N_per_m": float(stiffness_from_pressure(pressure, car.tire)),
    }


def unit_suffix(unit: str) -> str:
    """A unit as the end of a key: Ns^2/m^2 becomes _Ns2_per_m2, and 1 becomes nothing."""
    return "" if unit == "1" else "_" + unit.replace("^", "").replace("/", "_per_")
