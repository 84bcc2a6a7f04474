"""Simulate a full vehicle: fixed-step Runge-Kutta, one record of every signal."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from wheelhop.vehicle.chassis import point_acceleration, wheel_places
from wheelhop.vehicle.full_vehicle import (
    Controls,
    FullVehicle,
    Moment,
    Surroundings,
    VehicleState,
    derivative,
    evaluate,
    gravity_in_plane,
)
from wheelhop.vehicle.integrate import rk4
from wheelhop.vehicle.maneuver import Maneuver, controls_at
from wheelhop.vehicle.pressure_course import PressureCourse, pressure_at
from wheelhop.vehicle.road.surface import RoadSurface
from wheelhop.vehicle.vector import Vector, lift, per_corner, subtract, to_body

RATE = 1000.0
"""Default output rate [Hz]."""

SUBSTEPS = 2
"""Default Runge-Kutta steps per output sample: 0.5 ms at 1 kHz."""


class Signals(NamedTuple):
    """What happens in the vehicle, noise-free; each [time], or [time, 4] where it says 4.

    Accelerations are what accelerometers fixed to the part show, less standard gravity along
    the part's upward axis, so that they are zero at rest on level ground.

    Attributes:
        speed: longitudinal velocity of the body [m/s].
        lateral_speed: lateral velocity of the body [m/s].
        a_x, a_y, a_z: accelerometer at the body's centre of mass [m/s^2].
        roll_rate, pitch_rate, yaw_rate: gyroscope [rad/s].
        roll, pitch, yaw: attitude [rad].
        x, y, z: body's centre of mass in the world [m].
        body_acceleration: vertical accelerometer on the body above each wheel [m/s^2], 4.
        wheel_acceleration: vertical accelerometer on each wheel carrier [m/s^2], 4.
        compression: of the struts [m], 4.
        compression_rate: [m/s], 4.
        wheel_speed: spin of the wheels [rad/s], 4.
        steer: angle of the wheels [rad], 4.
        drive, brake: torques [Nm], 4.
        load, longitudinal, lateral: tyre forces [N], 4.
        tire_deflection: [m], 4.
        strut: force of the struts [N], 4.
        kappa, tan_alpha: relaxed slips [-], 4.
        elevation: of the road under the wheels [m], 4.
        pressure: of the tyres [Pa], 4.
    """

    speed: Any
    lateral_speed: Any
    a_x: Any
    a_y: Any
    a_z: Any
    roll_rate: Any
    pitch_rate: Any
    yaw_rate: Any
    roll: Any
    pitch: Any
    yaw: Any
    x: Any
    y: Any
    z: Any
    body_acceleration: Any
    wheel_acceleration: Any
    compression: Any
    compression_rate: Any
    wheel_speed: Any
    steer: Any
    drive: Any
    brake: Any
    load: Any
    longitudinal: Any
    lateral: Any
    tire_deflection: Any
    strut: Any
    kappa: Any
    tan_alpha: Any
    elevation: Any
    pressure: Any


def simulate_vehicle(
    initial: VehicleState,
    vehicle: FullVehicle,
    maneuver: Maneuver,
    road: RoadSurface,
    pressure: PressureCourse,
    around: Surroundings,
    samples: int,
    rate: float = RATE,
    substeps: int = SUBSTEPS,
) -> tuple[VehicleState, Signals]:
    """Drive and record; pure, so it jits, maps over vehicles, roads and maneuvers, differentiates.

    Compile it, its map or its derivative by `wheelhop.staging.staged_jit`, with every array an
    argument: `staged_jit(jax.vmap(f, in_axes=(0, None)))(pressures, vehicle)`. Plain `jax.jit`
    gives the same numbers, but takes minutes and gigabytes to compile a derivative. Many vehicles
    drive fastest by `fleet.fleet_simulator`.

    Args:
        initial: state at time zero, as from `state_at_rest`.
        vehicle: parameters, as arrays (`as_arrays`).
        maneuver: the driver.
        road: surface under the wheels.
        pressure: of the tyres over time.
        around: gravity's direction, friction, air.
        samples: length of the record.
        rate: samples per second [Hz].
        substeps: Runge-Kutta steps per sample.

    Returns:
        The last state, and the signals at the end of every sampling interval, entries [time]
        or [time, 4].
    """
    step = jnp.asarray(1.0 / (rate * substeps), initial.x.dtype)

    def inputs(t: Any, x: VehicleState) -> tuple[Controls, Any]:
        return controls_at(maneuver, t, x, vehicle, around), pressure_at(pressure, t)

    def slope(at: tuple[Any, VehicleState]) -> tuple[Any, VehicleState]:
        t, x = at
        controls, p = inputs(t, x)
        return jnp.ones_like(t), derivative(x, controls, p, road, vehicle, around)

    def substep(at: Any, _: Any) -> tuple[Any, None]:
        return rk4(slope, at, step, staged=False), None

    def sample(x: VehicleState, k: Any) -> tuple[VehicleState, Signals]:
        # time from the sample's number: sums of steps drift in float32
        t = jnp.zeros_like(x.x) + k.astype(step.dtype) * (substeps * step)
        (t, x), _ = jax.lax.scan(substep, (t, x), None, length=substeps)
        controls, p = inputs(t, x)
        now = evaluate(x, controls, p, road, vehicle, around)
        return x, signals(x, now, controls, p, vehicle, around)

    return jax.lax.scan(sample, initial, jnp.arange(samples))


def signals(
    x: VehicleState,
    now: Moment,
    controls: Controls,
    pressure: Any,
    vehicle: FullVehicle,
    around: Surroundings,
) -> Signals:
    """Every signal of one instant; arguments as those of `evaluate`."""
    rotation = Vector(x.p, x.q, x.r)
    gravity = to_body(now.frame, gravity_in_plane(around))
    felt = subtract(now.acceleration.body, gravity)
    above = wheel_places(jnp.zeros_like(x.compression), vehicle.chassis)
    corner = point_acceleration(
        Vector(above.x, above.y, jnp.zeros_like(above.z)),
        lift(felt),
        lift(now.acceleration.rotation),
        lift(rotation),
    )
    standard = per_corner(jnp.asarray(around.gravity), x.compression)
    wheel = now.acceleration.wheel.z - gravity.z[None]
    return Signals(
        speed=x.v_x,
        lateral_speed=x.v_y,
        a_x=felt.x,
        a_y=felt.y,
        a_z=felt.z - around.gravity,
        roll_rate=x.p,
        pitch_rate=x.q,
        yaw_rate=x.r,
        roll=x.roll,
        pitch=x.pitch,
        yaw=x.yaw,
        x=x.x,
        y=x.y,
        z=x.z,
        body_acceleration=corner.z - standard,
        wheel_acceleration=wheel - standard,
        compression=x.compression,
        compression_rate=x.compression_rate,
        wheel_speed=x.spin,
        steer=controls.steer,
        drive=controls.drive,
        brake=controls.brake,
        load=now.forces.load,
        longitudinal=now.forces.longitudinal,
        lateral=now.forces.lateral,
        tire_deflection=now.contact.deflection,
        strut=now.strut,
        kappa=x.kappa,
        tan_alpha=x.tan_alpha,
        elevation=now.road.elevation,
        pressure=pressure,
    )
