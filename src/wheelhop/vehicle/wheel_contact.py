"""Where a wheel meets the road, how it slips there, and the force it gets."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from wheelhop.vehicle.magic_formula import relaxation_lengths, slip_forces, slip_stiffness
from wheelhop.vehicle.magic_formula_parameters import MagicFormula
from wheelhop.vehicle.vector import (
    Frame,
    Vector,
    add,
    cross,
    dot,
    lift_frame,
    normalise,
    scale,
    to_world,
)
from wheelhop.vehicle.vertical_tire import VerticalTire, effective_radius, vertical_load

# regularisation, ours: small against any motion of interest, slow enough for a step of 1 ms
_REST_SPIN = 0.5
_REST_SPEED = 2.0
_BRAKE_RESPONSE = 5e-4
_SMALLEST_DEMAND = 1e-4
_SHORTEST = 0.005
_FASTEST_RESPONSE = 1e-3


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class WheelTire:
    """The tyres of the corners.

    Attributes:
        vertical: vertical law, leaves [4].
        slip: Magic Formula, leaves [4].
        rolling_resistance: f_r [-], torque per load and radius, [4].
        standstill_damping: xi_0 [s/m], slip per slip speed added below 2 m/s, so that a
            stopped car comes to rest on its tyres' springs, [4].
    """

    vertical: VerticalTire
    slip: MagicFormula
    rolling_resistance: Any
    standstill_damping: Any


class WheelPose(NamedTuple):
    """Kinematics of the wheels in the world, entries [4].

    Attributes:
        centre: of the wheel [m].
        velocity: of the wheel centre [m/s].
        rotation: angular velocity of the carrier [rad/s].
        axis: unit vector of the spin axis, to the left.
        spin: about the axis relative to the carrier [rad/s].
    """

    centre: Vector
    velocity: Vector
    rotation: Vector
    axis: Vector
    spin: Any


class ContactState(NamedTuple):
    """A tyre's deflection and slip speeds, entries [4].

    Attributes:
        frame: x along the wheel on the road, y to its left, z the road's normal, in the world.
        radius: loaded radius R_l [m].
        deflection: rho = R_0 - R_l [m].
        rate: d rho / dt [m/s].
        speed: V_x of the wheel centre along the wheel [m/s].
        lateral_slip: V_sy [m/s] of the contact point.
        sin_camber: sine of the inclination to the road's normal.
        spin: of the wheel in the world about its axis [rad/s].
    """

    frame: Frame
    radius: Any
    deflection: Any
    rate: Any
    speed: Any
    lateral_slip: Any
    sin_camber: Any
    spin: Any


class TireForces(NamedTuple):
    """Forces of the tyres in their contact frames, and the rates of their slip states, [4].

    Attributes:
        load: F_z [N].
        longitudinal, lateral: F_x, F_y [N].
        kappa_rate: of the relaxed longitudinal slip [1/s].
        tan_alpha_rate: of the relaxed tangent of the slip angle [1/s].
        effective_radius: R_e [m].
    """

    load: Any
    longitudinal: Any
    lateral: Any
    kappa_rate: Any
    tan_alpha_rate: Any
    effective_radius: Any


def wheel_pose(
    places: Vector,
    frame: Frame,
    position: Vector,
    velocity: Vector,
    rotation: Vector,
    compression_rate: Any,
    spin: Any,
    steer: Any,
) -> WheelPose:
    """Wheels in the world.

    Args:
        places: wheel centres in the body's frame [m], entries [4, ...].
        frame: axes of the body in the world.
        position: of the body's centre of mass in the world [m].
        velocity, rotation: of the body, in its frame, lifted to [1, ...].
        compression_rate: s' [m/s], [4, ...].
        spin: relative to the body [rad/s], [4, ...].
        steer: angle of each wheel [rad], to the left positive, [4, ...].
    """
    axes = lift_frame(frame)
    zero = jnp.zeros_like(steer)
    sliding = Vector(zero, zero, compression_rate)
    moving = add(velocity, cross(rotation, places), sliding)
    axis = Vector(-jnp.sin(steer), jnp.cos(steer), zero)
    offset = to_world(axes, places)
    centre = Vector(*(p[None] + o for p, o in zip(position, offset, strict=True)))
    return WheelPose(
        centre, to_world(axes, moving), to_world(axes, rotation), to_world(axes, axis), spin
    )


def contact_state(
    pose: WheelPose, elevation: Any, slope_x: Any, slope_y: Any, tire: WheelTire
) -> ContactState:
    """Contact of wheels with the effective road plane under each.

    The deflection rate follows from the plane's slope; under a tandem cam, whose slope is not the
    derivative of its height, it is approximate (it meets the tyre's damping alone).

    Args:
        pose: of the wheels.
        elevation: of the planes [m], [4, ...].
        slope_x, slope_y: of the planes [-], [4, ...].
        tire: the tyres.
    """
    normal = normalise(Vector(-slope_x, -slope_y, jnp.ones_like(slope_x)))
    forward = normalise(cross(pose.axis, normal))
    left = cross(normal, forward)
    radius = (pose.centre.z - elevation) * normal.z
    foot = add(pose.velocity, cross(pose.rotation, scale(-radius, normal)))
    return ContactState(
        frame=Frame(forward, left, normal),
        radius=radius,
        deflection=tire.vertical.unloaded_radius - radius,
        rate=-dot(pose.velocity, normal),
        speed=dot(pose.velocity, forward),
        lateral_slip=dot(foot, left),
        sin_camber=dot(pose.axis, normal),
        spin=pose.spin + dot(pose.rotation, pose.axis),
    )


def tire_forces(
    contact: ContactState,
    kappa: Any,
    tan_alpha: Any,
    pressure: Any,
    friction: Any,
    tire: WheelTire,
) -> TireForces:
    """Forces of tyres whose slip follows its steady value over the relaxation length.

    sigma_k kappa' = -V_sx - |V_x| kappa, sigma_a tan_alpha' = V_sy - |V_x| tan_alpha (Pacejka
    2012, section 7.2, in slips). A sliding tyre stretches no further, so both lengths shrink as
    the demand C slip / (mu F_z) grows, sigma / (1 + demand): the secant of a saturating tyre.

    Args:
        contact: of each tyre with the road.
        kappa, tan_alpha: slip states, [4, ...].
        pressure: [Pa], [4, ...].
        friction: of the road relative to that of the tyre's data, [4, ...].
        tire: parameters.
    """
    load = vertical_load(contact.deflection, contact.rate, contact.spin, pressure, tire.vertical)
    rolling = effective_radius(contact.deflection, tire.vertical)
    slip_speed = contact.speed - contact.spin * rolling
    carried = jnp.abs(contact.speed)
    sigma_k, sigma_a = _shortened(contact, kappa, tan_alpha, load, pressure, friction, tire)
    near_rest = 0.5 * (1.0 + jnp.cos(jnp.pi * jnp.minimum(carried / _REST_SPEED, 1.0)))
    xi = tire.standstill_damping * near_rest
    forces = slip_forces(
        kappa - xi * slip_speed,
        tan_alpha + xi * contact.lateral_slip,
        load,
        contact.sin_camber,
        pressure,
        tire.slip,
        friction,
    )
    return TireForces(
        load=load,
        longitudinal=forces.longitudinal,
        lateral=forces.lateral,
        kappa_rate=(-slip_speed - carried * kappa) / sigma_k,
        tan_alpha_rate=(contact.lateral_slip - carried * tan_alpha) / sigma_a,
        effective_radius=rolling,
    )


def _shortened(
    contact: ContactState,
    kappa: Any,
    tan_alpha: Any,
    load: Any,
    pressure: Any,
    friction: Any,
    tire: WheelTire,
) -> tuple[Any, Any]:
    """Relaxation lengths [m] of tyres that may slide; never faster than 1 ms."""
    ahead, across = slip_stiffness(load, pressure, tire.slip)
    limit = jnp.maximum(friction, 0.01) * jnp.maximum(load, 1.0)
    x, y = ahead * kappa / limit, across * tan_alpha / limit
    shrink = 1.0 + jnp.sqrt(x * x + y * y + _SMALLEST_DEMAND**2)
    floor = _SHORTEST + _FASTEST_RESPONSE * jnp.abs(contact.speed)
    sigma_k, sigma_a = relaxation_lengths(load, tire.slip)
    return jnp.maximum(sigma_k / shrink, floor), jnp.maximum(sigma_a / shrink, floor)


def force_in_world(contact: ContactState, forces: TireForces) -> Vector:
    """Force of the road on each wheel [N], in the world."""
    f = contact.frame
    return add(scale(forces.load, f.z), scale(forces.longitudinal, f.x), scale(forces.lateral, f.y))


def road_moment(
    pose: WheelPose, contact: ContactState, forces: TireForces, force: Vector, tire: WheelTire
) -> Vector:
    """Moment of the road about each wheel centre [Nm], in the world.

    That of the force at the foot of the loaded radius, and rolling resistance about the axis,
    f_r F_z R_e against the spin, smooth within 0.5 rad/s of rest.

    Args:
        pose: of the wheels.
        contact: with the road.
        forces: of the tyres.
        force: the same in the world [N].
        tire: parameters.
    """
    turning = jnp.tanh(pose.spin / _REST_SPIN)
    resisting = tire.rolling_resistance * forces.load * forces.effective_radius * turning
    at_foot = cross(scale(-contact.radius, contact.frame.z), force)
    return add(at_foot, scale(-resisting, pose.axis))


def spin_torque(pose: WheelPose, moment: Vector, drive: Any, brake: Any, spin_inertia: Any) -> Any:
    """Torque about each wheel's axis [Nm], [4, ...]: drive, brake and the road's moment.

    The brake works against the spin, smoothly within 0.5 rad/s of rest and what the torque
    itself changes in 0.5 ms: there is no stiction, a car held on a grade creeps.

    Args:
        pose: of the wheels.
        moment: of the road about the wheel centres, in the world [Nm].
        drive, brake: torques [Nm].
        spin_inertia: of the wheels [kg m^2].
    """
    width = _REST_SPIN + _BRAKE_RESPONSE * jnp.abs(brake) / spin_inertia
    return drive - brake * jnp.tanh(pose.spin / width) + dot(moment, pose.axis)
