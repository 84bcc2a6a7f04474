"""Equations that a vehicle at rest meets: Filipozzi et al. 2021, Eq. 35, and a body's equilibrium.

Unknowns are the sprung mass and the place of its centre, measurements q [4], a_x and a_y; results
come with the Jacobian with respect to all ten.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from wheelhop.estimators.algebraic_load import WeightDistribution, algebraic_loads
from wheelhop.vehicle.chassis import Chassis, wheel_places
from wheelhop.vehicle.full_vehicle_state import STANDARD_GRAVITY, FullVehicle
from wheelhop.vehicle.strut import AntiRollBars, Strut, anti_roll_force, spring_force
from wheelhop.vehicle.vertical_tire import VerticalTire, deflection_at_load

_TILT_ITERATIONS = 3


class KnownVehicle(NamedTuple):
    """Of the vehicle, what the equations need: parts of `FullVehicle`."""

    chassis: Chassis
    strut: Strut
    anti_roll: AntiRollBars
    vertical: VerticalTire
    pressure: Any


def known_of(car: FullVehicle) -> KnownVehicle:
    """The parts of a full vehicle, as arrays."""
    return KnownVehicle(
        car.chassis, car.strut, car.anti_roll, car.tire.vertical, car.nominal_pressure
    )


@lru_cache(maxsize=2)
def equations(method: str) -> Any:
    """(unknowns and measurements [10], vehicle) -> equations and results, and their Jacobian.

    Args:
        method: "printed" or "equilibrium".
    """
    one = _printed if method == "printed" else _equilibrium

    def both(at: Any, car: KnownVehicle) -> tuple[Any, Any]:
        def value(x: Any) -> tuple[Any, Any]:
            found = one(x[:4], x[4:8], x[8], x[9], car)
            return found, found

        jacobian, found = jax.jacfwd(value, has_aux=True)(at)
        return found, jacobian

    return jax.jit(both)


def _printed(theta: Any, q: Any, a_x: Any, a_y: Any, car: KnownVehicle) -> Any:
    """Eq. 35 of the four corners, [4], and total mass, l_F, w_L, h, [4]."""
    c = car.chassis
    mass, front, left, height = theta
    base, track = c.front_arm + c.rear_arm, 0.5 * (c.front_track + c.rear_track)
    loads = algebraic_loads(a_x, a_y, WeightDistribution(mass, front, left, height, base, track))
    total = mass + jnp.sum(c.wheel_mass)
    springs = car.strut.preload + car.strut.stiffness * q
    return jnp.concatenate([springs - loads, jnp.stack([total, front, left, height])])


def _equilibrium(theta: Any, q: Any, a_x: Any, a_y: Any, car: KnownVehicle) -> Any:
    """Heave [N], pitch and roll [kg m] of the body, [3], and total mass, l_F, w_L, h, [4].

    Every tyre's force is parallel to gravity, which the accelerometers show as
    s = (a_x, a_y, g_z). So the line through the centre of those forces, each at its contact
    point c_i, runs along s through the centre of all masses: D x s = 0 with
    D = sum (S_i / g_z + m_i) c_i - sum m_i p_i - m r. Contacts lie a loaded radius below the wheel
    centres p_i along the road's normal, which the deflections of struts and tyres show.
    """
    c, wheels = car.chassis, car.chassis.wheel_mass
    mass, centre = theta[0], theta[1:]
    g_z = jnp.sqrt(STANDARD_GRAVITY**2 - a_x**2 - a_y**2)
    felt = jnp.stack([a_x, a_y, g_z])
    place = jnp.stack(wheel_places(q, c))
    spring = spring_force(q, car.strut) + anti_roll_force(q, car.anti_roll)
    pressed = spring + wheels * g_z
    tire = car.vertical
    corner = jnp.stack([place[0], place[1], -jnp.ones(4)], axis=1)
    plane = jnp.linalg.pinv(corner)
    normal = jnp.array([0.0, 0.0, 1.0])
    for _ in range(_TILT_ITERATIONS):
        load = pressed * (normal @ felt) / g_z
        rho = deflection_at_load(load, jnp.zeros(4), car.pressure, tire)
        radius = tire.unloaded_radius - rho
        lean = plane @ (radius / normal[2] - place[2])
        normal = jnp.stack([lean[0], lean[1], jnp.ones_like(a_x)])
        normal = normal / jnp.linalg.norm(normal)
    contact = place - radius[None, :] * normal[:, None]
    share = spring / g_z + wheels
    lever = contact @ share - place @ wheels - mass * centre
    heave = jnp.sum(spring) - mass * g_z
    pitch = lever[0] - a_x / g_z * lever[2]
    roll = lever[1] - a_y / g_z * lever[2]
    total = mass + jnp.sum(wheels)
    common = (mass * centre + place @ wheels) / total
    height = normal @ (common - jnp.mean(contact, axis=1))
    track = 0.5 * (c.front_track + c.rear_track)
    told = jnp.stack([total, c.front_arm - common[0], 0.5 * track - common[1], height])
    return jnp.concatenate([jnp.stack([heave, pitch, roll]), told])
