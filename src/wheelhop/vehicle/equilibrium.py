"""Static equilibrium of a full vehicle: heights, attitude and compressions at rest."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree

from wheelhop.errors import DivergenceError
from wheelhop.staging import stage
from wheelhop.vehicle.chassis import BodyMotion, Loads, accelerations, wheel_places
from wheelhop.vehicle.full_vehicle import (
    FullVehicle,
    Surroundings,
    VehicleState,
    gravity_in_plane,
    strut_force,
)
from wheelhop.vehicle.vector import (
    Vector,
    body_frame,
    cross,
    lift_frame,
    to_body,
    to_world,
)
from wheelhop.vehicle.vertical_tire import effective_radius, vertical_load

_ITERATIONS = 30
_TOLERANCE = 1e-4


class Rest(NamedTuple):
    """A vehicle at rest.

    Attributes:
        z: height of the body's centre of mass [m].
        roll, pitch: of the body [rad].
        compression: of the struts [m], [4].
        load: of the tyres [N], [4].
        deflection: of the tyres [m], [4].
        residual: largest acceleration left [m/s^2, rad/s^2].
    """

    z: Any
    roll: Any
    pitch: Any
    compression: Any
    load: Any
    deflection: Any
    residual: Any


class _Unknowns(NamedTuple):
    z: Any
    roll: Any
    pitch: Any
    compression: Any


def static_equilibrium(
    vehicle: FullVehicle, pressure: Any, around: Surroundings, elevation: Any = None
) -> Rest:
    """Where the vehicle rests, by Newton's method on its own equations of motion.

    The tyres hold the vehicle on a grade or bank in proportion to their loads. Pure: it maps
    over vehicles and differentiates (implicitly, through the last Newton step).

    Args:
        vehicle: parameters.
        pressure: of the tyres [Pa], [4].
        around: gravity's direction.
        elevation: of the road under each wheel [m], [4]; flat by default.
    """
    pressure = jnp.asarray(pressure)
    road = jnp.zeros_like(pressure) if elevation is None else elevation
    hub = vehicle.chassis.hub_drop
    still = jnp.zeros_like(hub)
    guess = _Unknowns(
        jnp.mean(hub + vehicle.tire.vertical.unloaded_radius - 0.02 + road),
        jnp.zeros_like(hub[0]),
        jnp.zeros_like(hub[0]),
        still,
    )
    start, restore = ravel_pytree(guess)

    def residual(flat: Any) -> Any:
        a = stage(_at_rest)(restore(flat), pressure, road, vehicle, around)[0]
        return jnp.concatenate([jnp.stack([a.body.z, a.rotation.x, a.rotation.y]), a.compression])

    def newton(flat: Any, _: Any) -> tuple[Any, None]:
        step = jnp.linalg.solve(jax.jacfwd(residual)(flat), residual(flat))
        return flat - jnp.clip(step, -0.05, 0.05), None

    found = jax.lax.stop_gradient(jax.lax.scan(newton, start, None, length=_ITERATIONS)[0])
    # one more step carries the derivative of the solution by the implicit function theorem
    slope = jax.lax.stop_gradient(jax.jacfwd(residual)(found))
    found = found - jnp.linalg.solve(slope, residual(found))
    rest = restore(found)
    _, load, deflection = _at_rest(rest, pressure, road, vehicle, around)
    left = jnp.max(jnp.abs(residual(found)))
    return Rest(rest.z, rest.roll, rest.pitch, rest.compression, load, deflection, left)


def state_at_rest(rest: Rest, speed: Any, vehicle: FullVehicle, x: Any = 0.0) -> VehicleState:
    """The vehicle in that attitude, rolling straight ahead at a speed [m/s] from x [m]."""
    zero = jnp.zeros_like(rest.z)
    none = jnp.zeros_like(rest.compression)
    ahead = to_body(body_frame(rest.roll, rest.pitch, zero), Vector(zero + speed, zero, zero))
    rolling = effective_radius(rest.deflection, vehicle.tire.vertical)
    return VehicleState(
        x=zero + x,
        y=zero,
        z=rest.z,
        roll=rest.roll,
        pitch=rest.pitch,
        yaw=zero,
        v_x=ahead.x,
        v_y=ahead.y,
        v_z=ahead.z,
        p=zero,
        q=zero,
        r=zero,
        compression=rest.compression,
        compression_rate=none,
        spin=speed / rolling,
        kappa=none,
        tan_alpha=none,
    )


def require_rest(rest: Rest) -> Rest:
    """The same equilibrium, checked.

    Raises:
        DivergenceError: if no equilibrium was found, or a wheel hangs in the air.
    """
    worst = float(jnp.max(rest.residual))
    scale = 1.0 if rest.load.dtype == jnp.float64 else 1e3
    if not worst < scale * _TOLERANCE:
        raise DivergenceError(
            f"the vehicle finds no static equilibrium ({worst:.3g} m/s^2 are left); check spring "
            "preloads, stiffnesses and pressures"
        )
    if not float(jnp.min(rest.load)) > 0:
        raise DivergenceError(
            f"a wheel carries no load at rest ({float(jnp.min(rest.load)):.3g} N); check the "
            "grade, bank and geometry"
        )
    return rest


def _at_rest(
    at: Any, pressure: Any, elevation: Any, vehicle: FullVehicle, around: Surroundings
) -> tuple[Any, Any, Any]:
    """Accelerations, tyre loads and deflections of a vehicle that does not move."""
    none = jnp.zeros_like(at.compression)
    zero = jnp.zeros_like(at.z)
    frame = body_frame(at.roll, at.pitch, zero)
    axes = lift_frame(frame)
    places = wheel_places(at.compression, vehicle.chassis)
    radius = at.z[None] + to_world(axes, places).z - elevation
    deflection = vehicle.tire.vertical.unloaded_radius - radius
    load = vertical_load(deflection, none, none, pressure, vehicle.tire.vertical)
    down = gravity_in_plane(around)
    force = Vector(load * (down.x / down.z), load * (down.y / down.z), load)
    moment = cross(Vector(none, none, -radius), force)
    still = Vector(zero, zero, zero)
    loads = Loads(
        wheel_force=to_body(axes, force),
        wheel_moment=to_body(axes, moment),
        spin_torque=none,
        strut=strut_force(at.compression, none, vehicle),
        body_force=still,
        gravity=to_body(frame, down),
    )
    motion = BodyMotion(still, still, none, none)
    return accelerations(places, motion, loads, vehicle.chassis), load, deflection
