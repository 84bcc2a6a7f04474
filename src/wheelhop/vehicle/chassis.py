"""Rigid multibody dynamics of a body on four wheels that slide along its vertical axis.

Ten second-order unknowns (the body's six, four wheel strokes) and four spins, without small angles
or linearisation. Steering turns the tyres' forces and slips; the wheels' inertia and the reaction
of drive and brake torques stay about the body's lateral axis, which a few degrees allow. The
wheels' vertical accelerations follow from their own forces, the body's translation from the
momentum of the whole, and a 3 x 3 system remains for the rotation. The degrees of freedom are
those of Shim & Ghike 2007; Newton and Euler's equations are written out here for the body's frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from wheelhop.vehicle.vector import (
    Vector,
    add,
    cross,
    lift,
    over_corners,
    scale,
    solve_symmetric,
)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Chassis:
    """Masses, inertias and geometry; corners FL, FR, RL, RR.

    Attributes:
        body_mass: sprung mass m_s [kg].
        roll_inertia, pitch_inertia, yaw_inertia: of the body about its centre of mass [kg m^2].
        roll_yaw_product: I_xz = integral of x z dm [kg m^2].
        front_arm, rear_arm: from the body's centre of mass to the axles [m].
        front_track, rear_track: distances of the wheels of an axle [m].
        hub_drop: height of the body's centre of mass above the wheel centres at zero
            compression [m], [4].
        wheel_mass: unsprung mass of a corner [kg], [4].
        spin_inertia: of a wheel about its axis [kg m^2], [4].
        diametral_inertia: of a wheel about its diameter [kg m^2], [4].
    """

    body_mass: Any
    roll_inertia: Any
    pitch_inertia: Any
    yaw_inertia: Any
    roll_yaw_product: Any
    front_arm: Any
    rear_arm: Any
    front_track: Any
    rear_track: Any
    hub_drop: Any
    wheel_mass: Any
    spin_inertia: Any
    diametral_inertia: Any


class BodyMotion(NamedTuple):
    """Velocities: of the body's centre of mass [m/s] and rotation [rad/s] in the body's frame,
    compression rates s' [m/s] and relative wheel spins [rad/s], [4]."""

    velocity: Vector
    rotation: Vector
    compression_rate: Any
    spin: Any


class Loads(NamedTuple):
    """What acts on the chassis, in the body's frame.

    Attributes:
        wheel_force: from the road at each wheel centre [N], entries [4].
        wheel_moment: from the road about each wheel centre [Nm], entries [4].
        spin_torque: about each wheel's axis, drive, brakes and road [Nm], [4].
        strut: force of each strut that pushes the body up and the wheel down [N], [4].
        body_force: aerodynamic force at the body's centre of mass [N].
        gravity: acceleration of gravity [m/s^2].
    """

    wheel_force: Vector
    wheel_moment: Vector
    spin_torque: Any
    strut: Any
    body_force: Vector
    gravity: Vector


class Accelerations14(NamedTuple):
    """Accelerations of the fourteen degrees of freedom, in the body's frame.

    Attributes:
        body: of the body's centre of mass in inertial space [m/s^2].
        rotation: angular acceleration [rad/s^2].
        compression: s'' [m/s^2], [4].
        spin: of the wheels relative to the body [rad/s^2], [4].
        wheel: of the wheel centres in inertial space [m/s^2], entries [4].
    """

    body: Vector
    rotation: Vector
    compression: Any
    spin: Any
    wheel: Vector


def wheel_places(compression: Any, chassis: Chassis) -> Vector:
    """Wheel centres [m] in the body's frame, entries [4, ...], at compressions [4, ...]."""
    c = chassis
    half_front, half_rear = 0.5 * c.front_track, 0.5 * c.rear_track
    x = jnp.stack([c.front_arm, c.front_arm, -c.rear_arm, -c.rear_arm])
    y = jnp.stack([half_front, -half_front, half_rear, -half_rear])
    z = compression - c.hub_drop
    return Vector(*jnp.broadcast_arrays(_like(x, z), _like(y, z), z))


def corner_masses(chassis: Chassis) -> Any:
    """Mass that each wheel of the level vehicle carries, its own included [kg], [4, ...]."""
    c = chassis
    arms = jnp.stack([c.rear_arm, c.rear_arm, c.front_arm, c.front_arm])
    body = 0.5 * c.body_mass[None] * arms / (c.front_arm + c.rear_arm)[None]
    return body + c.wheel_mass


def point_acceleration(
    place: Vector, body: Vector, rotation_rate: Vector, rotation: Vector
) -> Vector:
    """Acceleration [m/s^2] of points fixed to the body: a + alpha x r + w x (w x r)."""
    spinning = cross(rotation, cross(rotation, place))
    return add(body, cross(rotation_rate, place), spinning)


def accelerations(
    places: Vector, motion: BodyMotion, loads: Loads, chassis: Chassis
) -> Accelerations14:
    """Accelerations of all degrees of freedom.

    Args:
        places: wheel centres in the body's frame [m], entries [4, ...].
        motion: velocities.
        loads: forces and moments.
        chassis: masses, inertias and geometry.
    """
    c, m, r = chassis, chassis.wheel_mass, places
    w, g = motion.rotation, loads.gravity
    lifted_w, lifted_g = lift(w), lift(g)

    # along the body's z every force on a wheel is known
    wheel_z = (loads.wheel_force.z - loads.strut) / m + lifted_g.z
    body_z = (jnp.sum(loads.strut, 0) + loads.body_force.z) / c.body_mass + g.z

    # acceleration of a wheel centre without the body's own: centrifugal and Coriolis
    stroke = Vector(jnp.zeros_like(r.x), jnp.zeros_like(r.x), 2.0 * motion.compression_rate)
    bias = add(cross(lifted_w, cross(lifted_w, r)), cross(lifted_w, stroke))

    total = c.body_mass + jnp.sum(m, 0)
    centre = scale(1.0 / total, over_corners(scale(m, r)))
    push_x = jnp.sum(loads.wheel_force.x - m * bias.x, 0) + loads.body_force.x
    push_y = jnp.sum(loads.wheel_force.y - m * bias.y, 0) + loads.body_force.y
    free_x, free_y = push_x / total + g.x, push_y / total + g.y

    rotation = _rotation(r, centre, motion, loads, chassis, wheel_z, bias, free_x, free_y)
    body = Vector(
        free_x - (rotation.y * centre.z - rotation.z * centre.y),
        free_y - (rotation.z * centre.x - rotation.x * centre.z),
        body_z,
    )
    rigid = add(lift(body), cross(lift(rotation), r), bias)
    return Accelerations14(
        body=body,
        rotation=rotation,
        compression=wheel_z - rigid.z,
        spin=loads.spin_torque / c.spin_inertia - rotation.y[None],
        wheel=Vector(rigid.x, rigid.y, wheel_z),
    )


def _rotation(
    r: Vector,
    centre: Vector,
    motion: BodyMotion,
    loads: Loads,
    c: Chassis,
    wheel_z: Any,
    bias: Vector,
    free_x: Any,
    free_y: Any,
) -> Vector:
    """Angular acceleration: moments about the body's centre of mass, translation eliminated."""
    m, w = c.wheel_mass, motion.rotation
    lifted_w = lift(w)
    weight = scale(m, lift(loads.gravity))
    inertial = scale(m, Vector(free_x[None] + bias.x, free_y[None] + bias.y, wheel_z))
    arm = cross(
        r, Vector(*(f + n - a for f, n, a in zip(loads.wheel_force, weight, inertial, strict=True)))
    )
    momentum = Vector(
        c.diametral_inertia * lifted_w.x,
        c.spin_inertia * (lifted_w.y + motion.spin),
        c.diametral_inertia * lifted_w.z,
    )
    gyroscopic = cross(lifted_w, momentum)
    body_momentum = Vector(
        c.roll_inertia * w.x - c.roll_yaw_product * w.z,
        c.pitch_inertia * w.y,
        c.yaw_inertia * w.z - c.roll_yaw_product * w.x,
    )
    turning = cross(w, body_momentum)
    spin = jnp.sum(loads.spin_torque, 0)
    sums = over_corners(
        Vector(*(a + t - h for a, t, h in zip(arm, loads.wheel_moment, gyroscopic, strict=True)))
    )
    right = Vector(sums.x - turning.x, sums.y - spin - turning.y, sums.z - turning.z)

    def spread(a: Any, b: Any, a_mean: Any, b_mean: Any) -> Any:
        return jnp.sum(m * a * (b - b_mean[None]), 0)

    xx = spread(r.x, r.x, centre.x, centre.x)
    yy = spread(r.y, r.y, centre.y, centre.y)
    zz = spread(r.z, r.z, centre.z, centre.z)
    xz = spread(r.x, r.z, centre.x, centre.z)
    yz = spread(r.y, r.z, centre.y, centre.z)
    disc = jnp.sum(c.diametral_inertia, 0)
    diagonal = Vector(
        c.roll_inertia + disc + zz, c.pitch_inertia + zz, c.yaw_inertia + disc + xx + yy
    )
    none = jnp.zeros_like(xz)
    return solve_symmetric(diagonal, none, -c.roll_yaw_product - xz, -yz, right)


def _like(values: Any, shape: Any) -> Any:
    """Corner values [4] or [4, ...] with as many trailing axes as `shape` has."""
    return values.reshape(values.shape + (1,) * (shape.ndim - values.ndim))
