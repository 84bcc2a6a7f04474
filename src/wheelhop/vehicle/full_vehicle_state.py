"""Parameters, state and inputs of a full vehicle, and what surrounds it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from wheelhop.vehicle.chassis import Chassis
from wheelhop.vehicle.strut import AntiRollBars, Strut
from wheelhop.vehicle.vector import Vector
from wheelhop.vehicle.wheel_contact import WheelTire

STANDARD_GRAVITY = 9.80665
"""[m/s^2]."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class FullVehicle:
    """Parameters of the whole vehicle; corners FL, FR, RL, RR on a leading axis of 4.

    Attributes:
        chassis: masses, inertias, geometry.
        strut: springs, dampers and stops.
        anti_roll: bars of the axles.
        tire: the tyres.
        drag_area: c_d A [m^2].
        drive_share: of the drive torque on each wheel, [4], sum 1.
        brake_share: of the brake torque on each wheel, [4], sum 1.
        steering_ratio: steering-wheel angle per front wheel angle [-].
        nominal_pressure: at which the vehicle was designed [Pa], [4].
    """

    chassis: Chassis
    strut: Strut
    anti_roll: AntiRollBars
    tire: WheelTire
    drag_area: Any
    drive_share: Any
    brake_share: Any
    steering_ratio: Any
    nominal_pressure: Any


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Surroundings:
    """What is around the vehicle.

    Attributes:
        grade: of the mean road plane, uphill positive [rad].
        bank: of the mean road plane, rising to the left positive [rad].
        friction: of the road relative to the tyres' data [-], [] or [4].
        air_density: [kg/m^3].
        gravity: [m/s^2].
    """

    grade: Any = 0.0
    bank: Any = 0.0
    friction: Any = 1.0
    air_density: Any = 1.2
    gravity: Any = STANDARD_GRAVITY


class VehicleState(NamedTuple):
    """State of the vehicle.

    Attributes:
        x, y, z: body's centre of mass in the world, the mean road plane's frame [m].
        roll, pitch, yaw: of the body [rad]; pitch positive nose down.
        v_x, v_y, v_z: velocity of that point in the body's frame [m/s].
        p, q, r: angular velocity in the body's frame [rad/s].
        compression: of the struts from their design place [m], [4].
        compression_rate: [m/s], [4].
        spin: of the wheels relative to the body [rad/s], [4].
        kappa: relaxed longitudinal slip [-], [4].
        tan_alpha: relaxed tangent of the slip angle [-], [4].
    """

    x: Any
    y: Any
    z: Any
    roll: Any
    pitch: Any
    yaw: Any
    v_x: Any
    v_y: Any
    v_z: Any
    p: Any
    q: Any
    r: Any
    compression: Any
    compression_rate: Any
    spin: Any
    kappa: Any
    tan_alpha: Any


class Controls(NamedTuple):
    """Inputs of the driver, [4] each: wheel steer [rad], drive and brake torques [Nm]."""

    steer: Any
    drive: Any
    brake: Any


def gravity_in_plane(around: Surroundings) -> Vector:
    """Acceleration of gravity [m/s^2] in the frame of the mean road plane."""
    level = jnp.cos(around.grade)
    return Vector(
        -around.gravity * jnp.sin(around.grade),
        -around.gravity * level * jnp.sin(around.bank),
        -around.gravity * level * jnp.cos(around.bank),
    )
