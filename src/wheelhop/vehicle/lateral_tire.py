"""Lateral force of a tyre over slip angle and load: the law a two-track model takes as a parameter.

Slip angles here are the two-track model's: positive where the wheel points to the left of its
motion, so that the force, to the left, is positive too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from wheelhop.errors import require_in_range
from wheelhop.vehicle.arctangent import arctan
from wheelhop.vehicle.magic_formula import slip_forces, slip_stiffness
from wheelhop.vehicle.magic_formula_parameters import MagicFormula


class TireLaw(NamedTuple):
    """How a tyre answers; functions of numbers or arrays of one shape.

    Attributes:
        force: (slip angle [rad], load [N], tyre, friction [-]) -> lateral force [N].
        stiffness: (load [N], tyre) -> slope of the force at zero slip [N/rad].
        overloaded: (load [N], tyre) -> whether the law is used where it does not hold.
    """

    force: Callable[[Any, Any, Any, Any], Any]
    stiffness: Callable[[Any, Any], Any]
    overloaded: Callable[[Any, Any], Any]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class ArctangentTire:
    """Coefficients of Solmaz, Eq. 3.

    Attributes:
        k1: force per load of an unloaded tyre at unit arctangent [-].
        k2: load scale of the loss of grip [N]; no force beyond a load of k1 k2.
        k3: initial slope of the arctangent per slip angle [1/rad].
    """

    k1: Any
    k2: Any
    k3: Any


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class InflatedTire:
    """A Magic Formula tyre at a pressure.

    Attributes:
        slip: coefficients of one tyre.
        pressure: [Pa].
    """

    slip: MagicFormula
    pressure: Any


NOMINAL_TIRE = ArctangentTire(1.0, 5650.0, 15.0)
"""Properly inflated: Solmaz, section IV."""

SOFT_TIRE = ArctangentTire(1.0, 4500.0, 12.0)
"""Pressure compromised: Solmaz, section IV. Half the nominal cornering stiffness at 3.3 kN."""


def arctangent_force(slip_angle: Any, load: Any, tire: ArctangentTire, friction: Any = 1.0) -> Any:
    """S = (k1 - F_z / k2) F_z mu atan(k3 alpha / mu) [N]: Solmaz, Eq. 3, guarded.

    The printed bracket turns negative beyond F_z = k1 k2, and a lifted wheel has a negative F_z by
    Eq. 7: both give no force here (`overloaded` tells). Friction, which the paper leaves open,
    scales force and slip alike, as the similarity method does (Pacejka 2012, section 4.2): the
    cornering stiffness stays.

    Args:
        slip_angle: alpha [rad], any shape.
        load: F_z [N].
        tire: coefficients.
        friction: mu relative to the road the coefficients hold for [-], positive.
    """
    grip = jnp.maximum(load, 0.0) * jnp.maximum(tire.k1 - load / tire.k2, 0.0)
    return grip * friction * arctan(tire.k3 * slip_angle / friction)


def overloaded(load: Any, tire: ArctangentTire) -> Any:
    """Whether the guard of `arctangent_force` acts: load [N] negative or beyond k1 k2."""
    return (load < 0.0) | (load > tire.k1 * tire.k2)


def arctangent_stiffness(load: Any, tire: ArctangentTire) -> Any:
    """Slope of `arctangent_force` at zero slip [N/rad], whatever the friction."""
    return jnp.maximum(load, 0.0) * jnp.maximum(tire.k1 - load / tire.k2, 0.0) * tire.k3


def inflated_force(slip_angle: Any, load: Any, tire: InflatedTire, friction: Any = 1.0) -> Any:
    """Lateral force [N] of the Magic Formula, upright and free rolling.

    Args:
        slip_angle: alpha [rad], any shape.
        load: F_z [N]; zero or less gives no force.
        tire: coefficients and pressure.
        friction: of the road relative to the tyre's data [-].
    """
    slip = jnp.asarray(slip_angle)
    load = jnp.asarray(load) + jnp.zeros_like(slip)
    none = jnp.zeros_like(load)
    sine, cosine = jnp.sin(slip), jnp.cos(slip)
    return slip_forces(none, -sine / cosine, load, none, tire.pressure, tire.slip, friction).lateral


def inflated_stiffness(load: Any, tire: InflatedTire) -> Any:
    """Slope of `inflated_force` at zero slip of a tyre without shifts [N/rad]."""
    return -slip_stiffness(jnp.asarray(load), tire.pressure, tire.slip)[1]


def lifted(load: Any, tire: InflatedTire) -> Any:
    """Whether a load [N] is negative: the wheel has left the road."""
    del tire
    return load < 0.0


ARCTANGENT = TireLaw(arctangent_force, arctangent_stiffness, overloaded)
"""The paper's law, over `ArctangentTire`."""

MAGIC_FORMULA = TireLaw(inflated_force, inflated_stiffness, lifted)
"""The full vehicle's law, over `InflatedTire`."""


def validate(name: str, tire: ArctangentTire) -> ArctangentTire:
    """The same coefficients, checked; for plain numbers.

    Args:
        name: of the tyre, for the message.
        tire: to check.

    Raises:
        InputError: naming the coefficient that is out of range.
    """
    require_in_range(f"{name}.k1", tire.k1, 0.01, 10.0, "(no unit)")
    require_in_range(f"{name}.k2", tire.k2, 100.0, 1e6, "N")
    require_in_range(f"{name}.k3", tire.k3, 0.1, 200.0, "1/rad")
    return tire
