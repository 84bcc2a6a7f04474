"""The two-track model of a full vehicle, in closed form.

The wheels of the full vehicle slide along the body's vertical axis and lean with it, so that all
of the tyres' lateral forces reach the body and both axles share its roll moment by their roll
stiffness alone: there are no roll centres above the road that would take a part of it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from wheelhop.vehicle.chassis import Chassis, corner_masses
from wheelhop.vehicle.full_vehicle_state import STANDARD_GRAVITY, FullVehicle
from wheelhop.vehicle.lateral_tire import InflatedTire
from wheelhop.vehicle.two_track import TwoTrack, Wheels
from wheelhop.vehicle.vertical_tire import (
    deflection_at_load,
    effective_radius,
    vertical_stiffness,
)


class CommonCentre(NamedTuple):
    """Centre of mass of the whole vehicle, wheels included.

    Attributes:
        ahead: of the body's centre of mass [m].
        below: the body's centre of mass [m].
        height: above the road [m].
    """

    ahead: Any
    below: Any
    height: Any


class RollResponse(NamedTuple):
    """Steady cornering per lateral acceleration, at its beginning.

    Attributes:
        angle: of the body, its left side up in a left turn [rad/(m/s^2)].
        front, rear: load that moves from the left to the right wheel of the axle [N/(m/s^2)].
    """

    angle: Any
    front: Any
    rear: Any


def two_track_of(vehicle: FullVehicle, pressure: Any = None) -> TwoTrack:
    """The two-track model of a full vehicle; pure, so that it maps over vehicles.

    Mass, arms and yaw inertia are those of the whole about the common centre of mass; the track is
    the mean of both axles'. The height is the lever m h a_y of the whole load transfer: that of
    the common centre of mass, plus what the body's sideways lean and the wheels' gyroscopic
    moment add (`roll_response`). Side slip is that of the common centre of mass.

    Args:
        vehicle: parameters, as arrays.
        pressure: of the tyres [Pa], [4]; nominal by default. Left and right should be alike: the
            two-track model knows no other.
    """
    pressure = vehicle.nominal_pressure if pressure is None else pressure
    c = vehicle.chassis
    centre = common_centre(vehicle, pressure)
    mass = c.body_mass + jnp.sum(c.wheel_mass)
    roll = roll_response(vehicle, pressure)
    track = 0.5 * (c.front_track + c.rear_track)
    moved = roll.front + roll.rear
    return TwoTrack(
        mass=mass,
        yaw_inertia=_yaw_inertia(c, centre, mass),
        front_arm=c.front_arm - centre.ahead,
        rear_arm=c.rear_arm + centre.ahead,
        track=track,
        height=moved * track / mass,
        front_transfer=roll.front / moved,
        roll_gain=STANDARD_GRAVITY * roll.angle,
    )


def common_centre(vehicle: FullVehicle, pressure: Any) -> CommonCentre:
    """Where the centre of mass of the whole is, standing level.

    Args:
        vehicle: parameters, as arrays.
        pressure: of the tyres [Pa], [4].
    """
    c = vehicle.chassis
    drop, radius = _standing(vehicle, pressure)
    mass = c.body_mass + jnp.sum(c.wheel_mass)
    ahead = jnp.sum(c.wheel_mass * _arms(c)) / mass
    below = jnp.sum(c.wheel_mass * drop) / mass
    return CommonCentre(ahead, below, jnp.mean(drop + radius) - below)


def roll_response(vehicle: FullVehicle, pressure: Any) -> RollResponse:
    """Roll angle and load transfer per lateral acceleration, to first order.

    An axle resists with K = T^2/2 k_t (k_s + 2 b) / (k_t + k_s + 2 b): springs k_s and bar b in
    series with the tyres k_t. The moment that rolls the car per a_y is m h of the common centre
    of mass plus sum I_w / R_e, since the spinning wheels are turned; the body's weight, standing by
    `drop` above the wheels, leans sideways by drop phi. So phi / a_y = (m h + sum I_w / R_e) /
    (sum K - sum m_s g drop), and an axle moves K phi / T from left to right.

    Args:
        vehicle: parameters, as arrays.
        pressure: of the tyres [Pa], [4].
    """
    c = vehicle.chassis
    drop, radius = _standing(vehicle, pressure)
    tire = vehicle.tire.vertical
    deflection = tire.unloaded_radius - radius
    still = jnp.zeros_like(deflection)
    tires = vertical_stiffness(deflection, still, pressure, tire)
    bar = jnp.stack([vehicle.anti_roll.front] * 2 + [vehicle.anti_roll.rear] * 2)
    struts = vehicle.strut.stiffness + 2.0 * bar
    wheel = tires * struts / (tires + struts)
    front = 0.25 * c.front_track**2 * (wheel[0] + wheel[1])
    rear = 0.25 * c.rear_track**2 * (wheel[2] + wheel[3])
    mass = c.body_mass + jnp.sum(c.wheel_mass)
    spinning = jnp.sum(c.spin_inertia / effective_radius(deflection, tire))
    moment = mass * common_centre(vehicle, pressure).height + spinning
    leaning = STANDARD_GRAVITY * jnp.sum((corner_masses(c) - c.wheel_mass) * drop)
    angle = moment / (front + rear - leaning)
    return RollResponse(angle, front * angle / c.front_track, rear * angle / c.rear_track)


def tires_of(vehicle: FullVehicle, pressures: Any) -> Wheels:
    """The four tyres at their pressures, for the law `lateral_tire.MAGIC_FORMULA`.

    Args:
        vehicle: parameters, as arrays.
        pressures: FL, FR, RL, RR [Pa], [4] or [4, ...].
    """
    each = [jax.tree.map(lambda leaf, k=k: leaf[k], vehicle.tire.slip) for k in range(4)]
    return Wheels(*(InflatedTire(slip, pressures[k]) for k, slip in enumerate(each)))


def _standing(vehicle: FullVehicle, pressure: Any) -> tuple[Any, Any]:
    """Height of the body's centre of mass above the wheel centres, and loaded radii [m], [4]."""
    c, strut = vehicle.chassis, vehicle.strut
    carried = corner_masses(c)
    more = STANDARD_GRAVITY * (carried - c.wheel_mass) - strut.preload
    tire = vehicle.tire.vertical
    still = jnp.zeros_like(carried)
    deflection = deflection_at_load(STANDARD_GRAVITY * carried, still, pressure, tire)
    return c.hub_drop - more / strut.stiffness, tire.unloaded_radius - deflection


def _arms(c: Chassis) -> Any:
    return jnp.stack([c.front_arm, c.front_arm, -c.rear_arm, -c.rear_arm])


def _yaw_inertia(c: Chassis, centre: CommonCentre, mass: Any) -> Any:
    """Of the whole about the common centre of mass [kg m^2], by the parallel axes."""
    half = 0.5 * jnp.stack([c.front_track, c.front_track, c.rear_track, c.rear_track])
    wheels = jnp.sum(c.diametral_inertia + c.wheel_mass * (_arms(c) ** 2 + half**2))
    return c.yaw_inertia + wheels - mass * centre.ahead**2
