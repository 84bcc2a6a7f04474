"""Linear suspension of a corner with the wheel's load as an input: Filipozzi et al. 2021, Eq. 2-5.

p_s' = k q + b q' - m_s g - dF, p_u' = -k q - b q' - m_u g + F, q' = p_u / m_u - p_s / m_s, with
q the compression, F the tyre's normal force and dF the load transfer on the sprung mass.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.errors import require_in_range
from wheelhop.vehicle.chassis import corner_masses
from wheelhop.vehicle.full_vehicle_state import STANDARD_GRAVITY, FullVehicle
from wheelhop.vehicle.strut import damper_force, spring_force


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class CornerSuspension:
    """Parameters of a corner, or with a leading axis [4] of the corners FL, FR, RL, RR.

    Attributes:
        sprung_mass: m_s, the body's share [kg].
        unsprung_mass: m_u [kg].
        stiffness: k, of the spring at the wheel [N/m].
        damping: b, of the damper at the wheel [Ns/m].
        preload: force of the spring at zero deflection [N]; m_s g where the deflection is
            measured from rest on level ground, 0 where it is measured from the free spring.
        anti_roll: k_b, force of the axle's bar per difference of its two deflections [N/m].
    """

    sprung_mass: Any
    unsprung_mass: Any
    stiffness: Any
    damping: Any
    preload: Any
    anti_roll: Any = 0.0


def corner_suspensions(vehicle: FullVehicle) -> CornerSuspension:
    """The four linear corners of a full vehicle, leaves [4]; pure.

    Springs and dampers are linearised at the design place: stiffness and damping are the slopes of
    the strut's laws there, so that a digressive damper is believed as stiff as it is at rest.

    Args:
        vehicle: parameters, as arrays.
    """
    strut = vehicle.strut
    still = jnp.zeros_like(vehicle.chassis.wheel_mass)
    one = jnp.ones_like(still)
    preload, stiffness = jax.jvp(lambda s: spring_force(s, strut), (still,), (one,))
    damping = jax.jvp(lambda w: damper_force(w, strut), (still,), (one,))[1]
    bars = vehicle.anti_roll
    front, rear = (bar + jnp.zeros_like(still[0]) for bar in (bars.front, bars.rear))
    masses = corner_masses(vehicle.chassis) - vehicle.chassis.wheel_mass
    return CornerSuspension(
        masses,
        vehicle.chassis.wheel_mass,
        stiffness,
        damping,
        preload,
        jnp.stack([front, front, rear, rear]),
    )


def static_load(corner: CornerSuspension, gravity: Any = STANDARD_GRAVITY) -> Any:
    """Load at rest on level ground (m_s + m_u) g [N]."""
    return (corner.sprung_mass + corner.unsprung_mass) * gravity


def validate(corner: CornerSuspension) -> CornerSuspension:
    """The same corners, checked; what JAX traces passes.

    Raises:
        InputError: naming the parameter that is out of range.
    """
    limits = (
        ("sprung_mass", 1.0, 2e4, "kg"),
        ("unsprung_mass", 0.1, 2e3, "kg"),
        ("stiffness", 1e2, 1e7, "N/m"),
        ("damping", 0.0, 1e6, "Ns/m"),
        ("preload", 0.0, 2e5, "N"),
        ("anti_roll", 0.0, 1e6, "N/m"),
    )
    for name, low, high, unit in limits:
        value = getattr(corner, name)
        if isinstance(value, jax.core.Tracer):
            continue
        for number in np.ravel(np.asarray(value)).tolist():
            require_in_range(f"corner.{name}", number, low, high, unit)
    return corner
