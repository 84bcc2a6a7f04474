"""What the driver does: hold a speed, brake, follow a lane change, steer open loop."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp

from wheelhop.errors import require_in_range
from wheelhop.vehicle.chassis import corner_masses
from wheelhop.vehicle.curve import Curve, value
from wheelhop.vehicle.full_vehicle import Controls, FullVehicle, Surroundings, VehicleState
from wheelhop.vehicle.full_vehicle_state import STANDARD_GRAVITY
from wheelhop.vehicle.magic_formula import slip_stiffness
from wheelhop.vehicle.road.obstacles import smoothstep

# a driver of ours: speed within half a second, path at 1.3 rad/s, critically damped, and a look
# ahead that grows with speed as the car's lag does (0.2 s at 90 km/h)
_SPEED_GAIN = 2.0
_PATH_FREQUENCY = 1.3
_PATH_DAMPING = 1.0
_PREVIEW = 0.008
_SLOWEST = 5.0


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Brake:
    """A brake torque that rises at a time and stays.

    Attributes:
        torque: of all wheels together [Nm].
        begin: time [s] at which it begins to rise.
        rise: duration [s] of the rise.
    """

    torque: Any
    begin: Any
    rise: Any = 0.1


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class LaneChange:
    """Into the lane on the left and back, on sine arcs of lateral acceleration.

    Attributes:
        offset: of the lane [m].
        begin: x [m] where the first arc begins.
        length: of each arc [m].
        gap: straight ahead between the arcs [m].
    """

    offset: Any
    begin: Any
    length: Any
    gap: Any


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Maneuver:
    """Driver's inputs as functions of time and state.

    Attributes:
        speed: initial and target speed [m/s].
        release: time [s] at which the driver gives up holding the speed.
        brake: the brakes.
        path: lane change to follow; straight ahead where its offset is zero.
        steer: angle of the front wheels [rad] over time [s] on top of that, or None.
        follow: 1 where the driver corrects heading and offset, 0 where only `steer` acts.
    """

    speed: Any
    release: Any = math.inf
    brake: Brake = Brake(0.0, 0.0)
    path: LaneChange = LaneChange(0.0, 0.0, 1.0, 0.0)
    steer: Curve | None = None
    follow: Any = 1.0


def straight(speed: float) -> Maneuver:
    """Straight ahead at constant speed [m/s]."""
    return Maneuver(speed)


def brake_step(speed: float = 25.0, torque: float = 3000.0, begin: float = 1.0) -> Maneuver:
    """A step of brake torque, by default that of Filipozzi et al. 2021, section 6.

    Args:
        speed: initial speed [m/s].
        torque: of all wheels together [Nm].
        begin: time of the step [s], when the drive torque goes as well.
    """
    return Maneuver(speed, release=begin, brake=Brake(torque, begin))


def double_lane_change(
    speed: float = 25.0,
    peak: float = 0.6 * STANDARD_GRAVITY,
    offset: float = 3.5,
    begin: float = 1.0,
) -> Maneuver:
    """Into the left lane and back at constant speed.

    The car follows with a lag, so its own peak differs: within 5 % at 90 km/h, a fifth above
    it at 120 km/h.

    On a sine arc y = w (u - sin(2 pi u) / (2 pi)), u = x / L, the lateral acceleration of the path
    reaches 2 pi w v^2 / L^2, which sets the arc's length L.

    Args:
        speed: [m/s].
        peak: largest lateral acceleration of the path [m/s^2].
        offset: of the lane w [m].
        begin: time [s] at which the first arc begins.
    """
    require_in_range("double_lane_change.speed", speed, 1.0, 100.0, "m/s")
    require_in_range("double_lane_change.peak", peak, 0.01, 20.0, "m/s^2")
    require_in_range("double_lane_change.offset", offset, 0.1, 20.0, "m")
    length = speed * math.sqrt(2.0 * math.pi * offset / peak)
    return Maneuver(speed, path=LaneChange(offset, speed * begin, length, 0.5 * speed))


def controls_at(
    maneuver: Maneuver, t: Any, x: VehicleState, vehicle: FullVehicle, around: Surroundings
) -> Controls:
    """Wheel angles and torques at a time [s] and state."""
    front = front_angle(maneuver, t, x, vehicle)
    none = jnp.zeros_like(front)
    held = 1.0 - _risen(t, maneuver.release, maneuver.brake.rise)
    drive = held * drive_torque(maneuver, x, vehicle, around)
    brake = maneuver.brake.torque * _risen(t, maneuver.brake.begin, maneuver.brake.rise)
    return Controls(
        steer=jnp.stack([front, front, none, none]),
        drive=vehicle.drive_share * drive[None],
        brake=vehicle.brake_share * (brake + none)[None],
    )


def front_angle(maneuver: Maneuver, t: Any, x: VehicleState, vehicle: FullVehicle) -> Any:
    """Angle of the front wheels [rad]: path curvature ahead, corrected by offset and heading."""
    wheelbase = vehicle.chassis.front_arm + vehicle.chassis.rear_arm
    y, slope, curvature = path_at(maneuver.path, x.x, x.x + _PREVIEW * x.v_x * x.v_x)
    speed = jnp.maximum(x.v_x, _SLOWEST)
    drift = x.v_y * jnp.cos(x.yaw) + x.v_x * (jnp.sin(x.yaw) - slope)
    correction = _PATH_FREQUENCY**2 * (y - x.y) - 2.0 * _PATH_DAMPING * _PATH_FREQUENCY * drift
    curvature = curvature + maneuver.follow * correction / (speed * speed)
    # at a standstill there is nothing to correct
    needed = wheelbase + understeer_gradient(vehicle) * speed * speed
    angle = needed * curvature * jnp.tanh(jnp.maximum(x.v_x, 0.0))
    return angle if maneuver.steer is None else angle + value(maneuver.steer, t)


def understeer_gradient(vehicle: FullVehicle) -> Any:
    """Steer that lateral acceleration asks for beyond the wheelbase's [rad/(m/s^2)].

    K = m_f / C_f - m_r / C_r with the axles' masses and cornering stiffnesses at their loads on
    level ground.

    Args:
        vehicle: parameters.
    """
    tire = vehicle.tire.slip
    mass = corner_masses(vehicle.chassis)
    _, stiffness = slip_stiffness(STANDARD_GRAVITY * mass, vehicle.nominal_pressure, tire)
    front = (mass[0] + mass[1]) / (stiffness[0] + stiffness[1])
    rear = (mass[2] + mass[3]) / (stiffness[2] + stiffness[3])
    return rear - front


def path_at(path: LaneChange, x: Any, ahead: Any) -> tuple[Any, Any, Any]:
    """Lateral position [m] and slope of the path at x, and its curvature [1/m] at `ahead`."""
    back = path.begin + path.length + path.gap
    there = _arc((x - path.begin) / path.length)
    home = _arc((x - back) / path.length)
    bent = _bend((ahead - path.begin) / path.length) - _bend((ahead - back) / path.length)
    return (
        path.offset * (there[0] - home[0]),
        path.offset / path.length * (there[1] - home[1]),
        path.offset / (path.length * path.length) * bent,
    )


def drive_torque(
    maneuver: Maneuver, x: VehicleState, vehicle: FullVehicle, around: Surroundings
) -> Any:
    """Torque of all wheels [Nm] that holds the speed: resistances fed forward, error fed back.

    The slope is taken from the body's pitch, as an inclination sensor would.
    """
    c = vehicle.chassis
    mass = c.body_mass + jnp.sum(c.wheel_mass, 0)
    radius = jnp.mean(vehicle.tire.vertical.unloaded_radius, 0)
    uphill = jnp.sin(around.grade - x.pitch)
    resistance = 0.5 * around.air_density * vehicle.drag_area * jnp.abs(x.v_x) * x.v_x
    rolling = jnp.mean(vehicle.tire.rolling_resistance, 0) * mass * around.gravity
    wanted = mass * (_SPEED_GAIN * (maneuver.speed - x.v_x) + around.gravity * uphill)
    return radius * (wanted + resistance + rolling * jnp.tanh(x.v_x))


def _risen(t: Any, begin: Any, rise: Any) -> Any:
    # bounded before the division: an infinite or instant beginning has finite derivatives too
    return smoothstep(jnp.maximum(t - begin, 0.0) / jnp.maximum(rise, 1e-6))


def _arc(u: Any) -> tuple[Any, Any]:
    u = jnp.clip(u, 0.0, 1.0)
    turn = 2.0 * jnp.pi * u
    return u - jnp.sin(turn) / (2.0 * jnp.pi), 1.0 - jnp.cos(turn)


def _bend(u: Any) -> Any:
    return 2.0 * jnp.pi * jnp.sin(2.0 * jnp.pi * jnp.clip(u, 0.0, 1.0))
