"""Suspension force of one corner."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp

from wheelhop.errors import require_in_range


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Suspension:
    """Spring and damper of one corner, cubic and signed-quadratic.

    Attributes:
        stiffness: k_s [N/m].
        cubic_stiffness: k_snl [N/m^3].
        damping: c_s [Ns/m].
        quadratic_damping: c_snl [Ns^2/m^2].
    """

    stiffness: Any
    cubic_stiffness: Any
    damping: Any
    quadratic_damping: Any


def suspension_force(deflection: Any, velocity: Any, suspension: Suspension) -> Any:
    """Force [N] that pulls the body down and the wheel up when the suspension is extended.

    F = k_s d + k_snl d^3 + c_s w + c_snl w|w|. Brancati & Tufano 2022, Eq. 1, with the signed
    square that Newton's third law needs.

    Args:
        deflection: d = z_s - z_u [m], any shape.
        velocity: w = v_s - v_u [m/s], the same shape.
        suspension: parameters.
    """
    d, w = deflection, velocity
    spring = suspension.stiffness * d + suspension.cubic_stiffness * d * d * d
    return spring + suspension.damping * w + suspension.quadratic_damping * w * jnp.abs(w)


def dissipated_power(velocity: Any, suspension: Suspension) -> Any:
    """Power [W] that the damper takes out at the relative velocity w [m/s]; never negative."""
    w = velocity
    return suspension.damping * w * w + suspension.quadratic_damping * jnp.abs(w) * w * w


def stored_energy(deflection: Any, suspension: Suspension) -> Any:
    """Energy [J] in the spring at the deflection d [m]."""
    square = deflection * deflection
    return 0.5 * suspension.stiffness * square + 0.25 * suspension.cubic_stiffness * square * square


def validate(suspension: Suspension) -> Suspension:
    """The same parameters, checked.

    Raises:
        InputError: naming the parameter that is out of physical range.
    """
    s = suspension
    require_in_range("suspension.stiffness", s.stiffness, 1e3, 1e6, "N/m")
    require_in_range("suspension.cubic_stiffness", s.cubic_stiffness, 0.0, 1e9, "N/m^3")
    require_in_range("suspension.damping", s.damping, 0.0, 1e5, "Ns/m")
    require_in_range("suspension.quadratic_damping", s.quadratic_damping, 0.0, 1e5, "Ns^2/m^2")
    return s
