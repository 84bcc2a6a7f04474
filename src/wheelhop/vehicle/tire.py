"""Tyre pressure and vertical stiffness."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax

from wheelhop.errors import InputError, require_in_range


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Tire:
    """Vertical stiffness law of a tyre, linear in pressure.

    Attributes:
        stiffness: k_t0 [N/m] at the nominal pressure.
        nominal_pressure: p_0 [Pa], gauge.
        pressure_coefficient: p_Fz1 [-], relative change of stiffness per relative change of
            pressure.
        damping: c_t [Ns/m] of a damper beside the spring; estimators on an unknown road leave it
            out.
    """

    stiffness: Any
    nominal_pressure: Any
    pressure_coefficient: Any
    damping: Any = 0.0


def stiffness_from_pressure(pressure: Any, tire: Tire) -> Any:
    """k_t [N/m] = k_t0 (1 + p_Fz1 (p - p_0) / p_0) at p [Pa].

    Brancati & Tufano 2022, Eq. 3-4; the linear term of the Magic Formula's vertical law.
    """
    excess = (pressure - tire.nominal_pressure) / tire.nominal_pressure
    return tire.stiffness * (1.0 + tire.pressure_coefficient * excess)


def pressure_from_stiffness(stiffness: Any, tire: Tire) -> Any:
    """p [Pa] at k_t [N/m]: the inverse of `stiffness_from_pressure`."""
    excess = (stiffness / tire.stiffness - 1.0) / tire.pressure_coefficient
    return tire.nominal_pressure * (1.0 + excess)


def pressure_slope(tire: Tire) -> Any:
    """dp/dk_t [Pa m/N], the factor that turns a stiffness error into a pressure error."""
    return tire.nominal_pressure / (tire.stiffness * tire.pressure_coefficient)


def validate(tire: Tire) -> Tire:
    """The same parameters, checked.

    Raises:
        InputError: naming the parameter that is out of physical range.
    """
    require_in_range("tire.stiffness", tire.stiffness, 2e4, 3e6, "N/m")
    require_in_range("tire.nominal_pressure", tire.nominal_pressure, 5e4, 1.5e6, "Pa")
    require_in_range("tire.pressure_coefficient", tire.pressure_coefficient, 0.05, 1.2, "(no unit)")
    require_in_range("tire.damping", tire.damping, 0.0, 1e4, "Ns/m")
    return tire


def require_stiff(tire: Tire, lowest_pressure: float) -> None:
    """Raise `InputError` if the linear law gives no positive stiffness at a pressure [Pa]."""
    stiffness = float(stiffness_from_pressure(lowest_pressure, tire))
    if not stiffness > 0.05 * float(tire.stiffness):
        raise InputError(
            "tire.pressure_coefficient",
            f"{float(tire.pressure_coefficient):g} makes the tyre's stiffness {stiffness:.3g} N/m "
            f"at {lowest_pressure / 1e3:g} kPa",
            "Use a higher pressure, or a smaller coefficient.",
        )
