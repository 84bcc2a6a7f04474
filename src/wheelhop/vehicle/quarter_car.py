"""The quarter car: dynamics in relative and absolute coordinates, and its simulation.

Brancati & Tufano 2022, Eq. 1. z is positive upwards; s = sprung, u = unsprung, r = road.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from wheelhop.vehicle.integrate import integrator, rk4
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.suspension import Suspension, stored_energy, suspension_force


class RelativeState(NamedTuple):
    """Quarter car relative to the road: no unobservable height, every entry small.

    Attributes:
        deflection: d = z_s - z_u [m].
        tyre_deflection: e = z_u - z_r [m].
        v_s: sprung velocity [m/s].
        v_u: unsprung velocity [m/s].
    """

    deflection: Any
    tyre_deflection: Any
    v_s: Any
    v_u: Any


class AbsoluteState(NamedTuple):
    """Quarter car in the coordinates the paper prints: z_s, z_u [m], v_s, v_u [m/s]."""

    z_s: Any
    z_u: Any
    v_s: Any
    v_u: Any


class Accelerations(NamedTuple):
    """What the two accelerometers measure: sprung a_s and unsprung a_u [m/s^2]."""

    a_s: Any
    a_u: Any


class Simulation(NamedTuple):
    """A simulated record: every entry [time], at the end of each sampling interval."""

    state: RelativeState
    accelerations: Accelerations


def accelerations(
    x: Any, stiffness: Any, car: QuarterCar, road_velocity: Any = None
) -> Accelerations:
    """Body and wheel acceleration of a state that has the fields of `RelativeState`.

    Args:
        x: state, entries of any one shape.
        stiffness: tyre stiffness k_t [N/m].
        car: parameters.
        road_velocity: z_r' [m/s], which the tyre's damper feels; None leaves that damper out.
    """
    force = suspension_force(x.deflection, x.v_s - x.v_u, car.suspension)
    tyre = stiffness * x.tyre_deflection
    if road_velocity is not None:
        tyre = tyre + car.tire.damping * (x.v_u - road_velocity)
    return Accelerations(-force / car.sprung_mass, (force - tyre) / car.unsprung_mass)


def relative_derivative(
    x: Any, stiffness: Any, road_velocity: Any, car: QuarterCar
) -> RelativeState:
    """Time derivative of the relative state on a road rising at `road_velocity` [m/s].

    None instead of a velocity: the road is level here (a filter's process noise moves it), and
    the tyre's damper is left out.
    """
    a = accelerations(x, stiffness, car, road_velocity)
    gap = x.v_u if road_velocity is None else x.v_u - road_velocity
    return RelativeState(x.v_s - x.v_u, gap, a.a_s, a.a_u)


def absolute_derivative(
    x: AbsoluteState, stiffness: Any, elevation: Any, car: QuarterCar
) -> AbsoluteState:
    """Time derivative of the absolute state on a road at `elevation` [m]."""
    a = accelerations(relative(x, elevation), stiffness, car)
    return AbsoluteState(x.v_s, x.v_u, a.a_s, a.a_u)


def printed_accelerations(
    x: AbsoluteState, stiffness: Any, elevation: Any, car: QuarterCar
) -> Accelerations:
    """Eq. 16 as printed: quadratic damping with the same sign on both masses.

    It breaks Newton's third law and exists for the reproduction of the paper only.
    """
    linear = Suspension(
        car.suspension.stiffness, car.suspension.cubic_stiffness, car.suspension.damping, 0.0
    )
    force = suspension_force(x.z_s - x.z_u, x.v_s - x.v_u, linear)
    square = car.suspension.quadratic_damping * (x.v_s - x.v_u) * (x.v_s - x.v_u)
    tyre = stiffness * (x.z_u - elevation)
    return Accelerations(
        -(force + square) / car.sprung_mass, (force - square - tyre) / car.unsprung_mass
    )


def printed_step(
    x: AbsoluteState, stiffness: Any, elevation: Any, dt: Any, car: QuarterCar
) -> AbsoluteState:
    """Eq. 15 as printed: one forward Euler step of the absolute state."""
    a = printed_accelerations(x, stiffness, elevation, car)
    return AbsoluteState(
        x.z_s + dt * x.v_s, x.z_u + dt * x.v_u, x.v_s + dt * a.a_s, x.v_u + dt * a.a_u
    )


def relative(x: AbsoluteState, elevation: Any) -> RelativeState:
    """Relative state of an absolute one over a road at `elevation` [m]."""
    return RelativeState(x.z_s - x.z_u, x.z_u - elevation, x.v_s, x.v_u)


def absolute(x: RelativeState, elevation: Any) -> AbsoluteState:
    """Absolute state of a relative one over a road at `elevation` [m]."""
    z_u = x.tyre_deflection + elevation
    return AbsoluteState(x.deflection + z_u, z_u, x.v_s, x.v_u)


def relative_step(
    x: RelativeState,
    stiffness: Any,
    road_velocity: Any,
    dt: Any,
    car: QuarterCar,
    method: str = "rk4",
) -> RelativeState:
    """Relative state a time dt [s] later, at constant stiffness and road velocity (or None)."""
    step = integrator(method)
    return step(lambda s: relative_derivative(s, stiffness, road_velocity, car), x, dt)


def mechanical_energy(x: RelativeState, stiffness: Any, car: QuarterCar) -> Any:
    """Kinetic and elastic energy [J] about the static equilibrium."""
    kinetic = 0.5 * (car.sprung_mass * x.v_s * x.v_s + car.unsprung_mass * x.v_u * x.v_u)
    tyre = 0.5 * stiffness * x.tyre_deflection * x.tyre_deflection
    return kinetic + stored_energy(x.deflection, car.suspension) + tyre


def simulate(
    initial: RelativeState, stiffness: Any, road_rise: Any, dt: Any, car: QuarterCar
) -> Simulation:
    """Simulate a record with RK4 steps finer than the sampling interval.

    Args:
        initial: state at the start.
        stiffness: k_t [N/m], [time] or [], constant within each sampling interval.
        road_rise: change of road elevation [m] over each fine step, [time, substeps]; the
            road is taken as straight within a fine step.
        dt: sampling interval [s].
        car: parameters.

    Returns:
        States and accelerations at the end of every sampling interval, entries [time].
    """
    samples, substeps = road_rise.shape
    fine = dt / substeps
    stiffness = jnp.broadcast_to(jnp.asarray(stiffness), (samples,))

    def sample(x: RelativeState, inputs: Any) -> tuple[RelativeState, Simulation]:
        k_t, rises = inputs

        def substep(s: RelativeState, rise: Any) -> tuple[RelativeState, None]:
            return rk4(lambda z: relative_derivative(z, k_t, rise / fine, car), s, fine), None

        x, _ = jax.lax.scan(substep, x, rises)
        return x, Simulation(x, accelerations(x, k_t, car, rises[-1] / fine))

    return jax.lax.scan(sample, initial, (stiffness, road_rise))[1]
