"""A vehicle of fourteen degrees of freedom on a road under four wheels.

Body surge, sway, heave, roll, pitch and yaw; four wheel strokes and four spins; tyres with
relaxed slips. It shares no equation with the quarter car of the filters. The degrees of freedom
are those of Shim & Ghike 2007, which Filipozzi et al. 2021 simulate.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import jax.numpy as jnp

from wheelhop.staging import stage
from wheelhop.vehicle.chassis import (
    Accelerations14,
    BodyMotion,
    Chassis,
    Loads,
    accelerations,
    wheel_places,
)
from wheelhop.vehicle.full_vehicle_state import (
    Controls,
    FullVehicle,
    Surroundings,
    VehicleState,
    gravity_in_plane,
)
from wheelhop.vehicle.road.surface import (
    Contact,
    RoadSurface,
    RoadUnderWheels,
    enveloped,
    road_under,
)
from wheelhop.vehicle.strut import (
    anti_roll_force,
    damper_force,
    spring_force,
)
from wheelhop.vehicle.vector import (
    Frame,
    Vector,
    body_frame,
    cross,
    lift,
    lift_frame,
    per_corner,
    subtract,
    to_body,
    to_world,
)
from wheelhop.vehicle.vertical_tire import contact_half_length
from wheelhop.vehicle.wheel_contact import (
    ContactState,
    TireForces,
    WheelPose,
    WheelTire,
    contact_state,
    force_in_world,
    road_moment,
    spin_torque,
    tire_forces,
    wheel_pose,
)

__all__ = [
    "Controls",
    "FullVehicle",
    "Moment",
    "Surroundings",
    "VehicleState",
    "derivative",
    "evaluate",
    "gravity_in_plane",
    "state_rate",
    "strut_force",
]


class Moment(NamedTuple):
    """Everything at one instant: kinematics, forces and accelerations."""

    frame: Frame
    pose: WheelPose
    contact: ContactState
    road: Contact
    forces: TireForces
    strut: Any
    acceleration: Accelerations14


def strut_force(compression: Any, compression_rate: Any, vehicle: FullVehicle) -> Any:
    """Force of every strut and anti-roll bar that pushes the body up [N], [4, ...]."""
    force = spring_force(compression, vehicle.strut) + damper_force(compression_rate, vehicle.strut)
    return force + anti_roll_force(compression, vehicle.anti_roll)


def evaluate(
    x: VehicleState,
    controls: Controls,
    pressure: Any,
    road: RoadSurface,
    vehicle: FullVehicle,
    around: Surroundings,
) -> Moment:
    """Forces and accelerations of a state.

    Args:
        x: state.
        controls: steer and torques of the wheels.
        pressure: of the tyres [Pa], [4, ...].
        road: surface under the wheels.
        vehicle: parameters.
        around: gravity's direction, friction, air.
    """
    frame, pose = stage(_pose)(x, controls.steer, vehicle.chassis)
    # looking up the road is no elementwise arithmetic, so it stands between two stages
    under = road_under(road, pose.centre.x, pose.centre.y)
    bank = replace(road, coefficients=None, slope_coefficients=None)
    patch, contact = stage(_contact)(pose, under, bank, vehicle.tire)
    forces = stage(tire_forces)(
        contact,
        x.kappa,
        x.tan_alpha,
        pressure,
        per_corner(jnp.asarray(around.friction), pressure),
        vehicle.tire,
    )
    strut = stage(strut_force)(x.compression, x.compression_rate, vehicle)
    loads = stage(_loads)(x, controls, frame, pose, contact, forces, strut, vehicle, around)
    reaction = stage(_reaction)(x, loads, vehicle.chassis)
    return Moment(frame, pose, contact, patch, forces, strut, reaction)


def derivative(
    x: VehicleState,
    controls: Controls,
    pressure: Any,
    road: RoadSurface,
    vehicle: FullVehicle,
    around: Surroundings,
) -> VehicleState:
    """Time derivative of the state; arguments as those of `evaluate`."""
    now = evaluate(x, controls, pressure, road, vehicle, around)
    return state_rate(x, now)


def _pose(x: VehicleState, steer: Any, chassis: Chassis) -> tuple[Frame, WheelPose]:
    frame = body_frame(x.roll, x.pitch, x.yaw)
    velocity, rotation = Vector(x.v_x, x.v_y, x.v_z), Vector(x.p, x.q, x.r)
    pose = wheel_pose(
        wheel_places(x.compression, chassis),
        frame,
        Vector(x.x, x.y, x.z),
        lift(velocity),
        lift(rotation),
        x.compression_rate,
        x.spin,
        steer,
    )
    return frame, pose


def _contact(
    pose: WheelPose, under: RoadUnderWheels, bank: RoadSurface, tire: WheelTire
) -> tuple[Contact, ContactState]:
    middle = under.elevation[under.elevation.shape[0] // 2]
    near = tire.vertical.unloaded_radius - (pose.centre.z - middle)
    patch = enveloped(under, contact_half_length(near, tire.vertical), bank)
    return patch, contact_state(pose, patch.elevation, patch.slope_x, patch.slope_y, tire)


def _loads(
    x: VehicleState,
    controls: Controls,
    frame: Frame,
    pose: WheelPose,
    contact: ContactState,
    forces: TireForces,
    strut: Any,
    vehicle: FullVehicle,
    around: Surroundings,
) -> Loads:
    force = force_in_world(contact, forces)
    moment = road_moment(pose, contact, forces, force, vehicle.tire)
    axes = lift_frame(frame)
    drag = -0.5 * around.air_density * vehicle.drag_area * jnp.abs(x.v_x) * x.v_x
    nothing = jnp.zeros_like(drag)
    return Loads(
        wheel_force=to_body(axes, force),
        wheel_moment=to_body(axes, moment),
        spin_torque=spin_torque(
            pose, moment, controls.drive, controls.brake, vehicle.chassis.spin_inertia
        ),
        strut=strut,
        body_force=Vector(drag, nothing, nothing),
        gravity=to_body(frame, gravity_in_plane(around)),
    )


def _reaction(x: VehicleState, loads: Loads, chassis: Chassis) -> Accelerations14:
    velocity, rotation = Vector(x.v_x, x.v_y, x.v_z), Vector(x.p, x.q, x.r)
    motion = BodyMotion(velocity, rotation, x.compression_rate, x.spin)
    return accelerations(wheel_places(x.compression, chassis), motion, loads, chassis)


def state_rate(x: VehicleState, now: Moment) -> VehicleState:
    """Time derivative of a state whose forces and accelerations are known."""
    a = now.acceleration
    velocity, rotation = Vector(x.v_x, x.v_y, x.v_z), Vector(x.p, x.q, x.r)
    moving = to_world(now.frame, velocity)
    change = subtract(a.body, cross(rotation, velocity))
    turning = x.q * jnp.sin(x.roll) + x.r * jnp.cos(x.roll)
    yaw_rate = turning / jnp.cos(x.pitch)
    return VehicleState(
        x=moving.x,
        y=moving.y,
        z=moving.z,
        roll=x.p + yaw_rate * jnp.sin(x.pitch),
        pitch=x.q * jnp.cos(x.roll) - x.r * jnp.sin(x.roll),
        yaw=yaw_rate,
        v_x=change.x,
        v_y=change.y,
        v_z=change.z,
        p=a.rotation.x,
        q=a.rotation.y,
        r=a.rotation.z,
        compression=x.compression_rate,
        compression_rate=a.compression,
        spin=a.spin,
        kappa=now.forces.kappa_rate,
        tan_alpha=now.forces.tan_alpha_rate,
    )
