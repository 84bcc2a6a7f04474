"""Compiled functions of the full vehicle that its tests share."""

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.staging import native_jit, staged_jit
from wheelhop.vehicle.curve import curve
from wheelhop.vehicle.equilibrium import require_rest, state_at_rest, static_equilibrium
from wheelhop.vehicle.full_vehicle import Controls, Surroundings, derivative, evaluate
from wheelhop.vehicle.integrate import rk4
from wheelhop.vehicle.maneuver import Maneuver, controls_at
from wheelhop.vehicle.road.surface import flat_surface, surface_from_tracks

SPACING = 0.05
POINTS = 1601


def arrays(tree):
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, float), tree)


def surroundings(**values):
    return arrays(Surroundings(**values))


@staged_jit
def _rest(car, pressure, around):
    return static_equilibrium(car, pressure, around)


def rest(car, pressure, around=None):
    return require_rest(_rest(arrays(car), arrays(pressure), around or surroundings()))


def start(car, pressure, speed, around=None):
    return state_at_rest(rest(car, pressure, around), jnp.asarray(speed), car)


@staged_jit
def _plant(x, controls, pressure, car, around):
    arguments = (x, controls, pressure, flat_surface(dtype=x.x.dtype), car, around)
    return evaluate(*arguments), derivative(*arguments)


def plant(x, car, pressure, around=None, steer=0.0, drive=0.0, brake=0.0):
    """Everything at one instant on a flat road, and the state's rate."""
    controls = Controls(*(jnp.asarray(np.broadcast_to(u, 4), float) for u in (steer, drive, brake)))
    return _plant(arrays(x), controls, arrays(pressure), arrays(car), around or surroundings())


@native_jit
def _flow(x, car, maneuver, road, pressure, around, dt, steps):
    def slope(at):
        t, x = at
        controls = controls_at(maneuver, t, x, car, around)
        return jnp.ones_like(t), derivative(x, controls, pressure, road, car, around)

    one = lambda _, at: rk4(slope, at, dt, staged=False)  # noqa: E731
    return jax.lax.fori_loop(0, steps, one, (jnp.zeros_like(dt), x))[1]


def flow(x, car, maneuver, duration, dt, pressure, around=None, tracks=None):
    """State after a duration [s], by Runge-Kutta steps dt; flat road by default."""
    tracks = np.zeros((4, POINTS)) if tracks is None else tracks
    road = surface_from_tracks(jnp.asarray(tracks, float), SPACING, -5.0)
    around = around or surroundings()
    steps = round(duration / dt)
    arguments = (arrays(maneuver), road, jnp.asarray(pressure, float), around)
    # one type for all: Python numbers become weakly typed arrays, each a compilation of its own
    return _flow(
        arrays(x), arrays(car), *arrays(arguments), jnp.asarray(dt, float), jnp.asarray(steps)
    )


TIMES = np.linspace(0.0, 2.0, 9)


def coasting(speed, angles=None, **others):
    """Nothing but a steering angle [rad] over `TIMES`; no drive, no driver."""
    angles = np.zeros_like(TIMES) if angles is None else angles
    settings = {"release": -1.0, "follow": 0.0} | others
    return Maneuver(speed, steer=curve(TIMES.tolist(), list(angles)), **settings)
