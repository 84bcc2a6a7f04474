"""Simulated drives, and records drawn from a model, for the tests of the joint load filter."""

from dataclasses import replace
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.estimators.joint_load import CHUNK
from wheelhop.estimators.joint_load_params import joint_load_params
from wheelhop.vehicle.full_vehicle_parameters import suv
from wheelhop.vehicle.load_record import VehicleLoadSample
from wheelhop.vehicle.maneuver import brake_step, double_lane_change
from wheelhop.vehicle.pressure_course import held
from wheelhop.vehicle.road.build import build_surface, lines_of, random_tracks
from wheelhop.vehicle.road.iso8608 import level_of
from wheelhop.vehicle.vehicle_record import drive_vehicle

SAMPLES = 3 * CHUNK
CAR = suv()
CHASSIS = CAR.chassis
HEAVY = replace(CAR, chassis=replace(CHASSIS, body_mass=CHASSIS.body_mass + 200.0))


def drive(heavy=False, turning=False):
    """At 90 km/h on a road of class B, braking after 0.5 s, or a lane change after 0.2 s.

    With digressive dampers and bars.
    """
    return _drive(heavy, turning)


@cache
def _drive(heavy, turning):
    tracks = random_tracks(jax.random.key(1), level_of("B"), 60.0, lines_of(CAR))
    car = HEAVY if heavy else CAR
    return drive_vehicle(
        jax.random.key(2),
        car,
        double_lane_change(begin=0.2) if turning else brake_step(begin=0.5),
        build_surface(tracks),
        held(car.nominal_pressure),
        1e-3 * SAMPLES,
    )


def sample_of(columns, wheel=True):
    found = VehicleLoadSample(*(np.array(columns[name]) for name in VehicleLoadSample._fields))
    return found if wheel else found._replace(**lost("a_u"))


def lost(*kinds):
    """Columns without a sample, of every corner."""
    names = (n for n in VehicleLoadSample._fields if n.startswith(kinds))
    return {name: np.full(SAMPLES, np.nan) for name in names}


def least_squares_moments(body_acceleration, strut):
    """Moments that explain the body's four accelerations under the struts' forces, [time, 4]."""
    p = joint_load_params(CAR, 1e-3)
    x, y = np.asarray(p.x), np.asarray(p.y)
    plane = np.stack([np.ones(4), y, -x], 1)
    _, roll, pitch = np.linalg.lstsq(plane, body_acceleration.T, rcond=None)[0]
    return (
        float(p.roll_inertia) * roll - strut @ y,
        float(p.pitch_inertia) * pitch + strut @ x,
    )


def recorder(model, params, start):
    """Draws records from a model with its own noise.

    Args:
        model: of a joint load filter.
        params: its parameters.
        start: state before the first sample.

    Returns:
        seed, what the state gains besides at every sample, a_x and a_y there -> sample, states.
    """
    belief, rows = type(start), model.process_cov(start, params)
    n = len(rows)
    q = [jnp.stack([rows[max(i, j)][min(i, j)] for j in range(n)]) for i in range(n)]
    push = jnp.linalg.cholesky(jnp.stack(q))
    sensors = jnp.asarray(np.repeat([0.5, 5e-4, 0.5], 4))

    def step(x, given):
        key, gain, told = given
        p = params if told is None else replace(params, told=1.0, a_x=told[0], a_y=told[1])
        one, two = jax.random.split(key)
        moved = jnp.stack(model.transition(belief(*x), p))
        x = moved + push @ jax.random.normal(one, (n,)) + gain
        y = jnp.stack(model.observation(belief(*x), p))
        return x, (y + sensors * jax.random.normal(two, (12,)), x)

    draw = jax.jit(lambda *given: jax.lax.scan(step, jnp.stack(start), given)[1])

    def record(seed, gain, told=None):
        y, x = draw(jax.random.split(jax.random.key(seed), len(gain)), jnp.asarray(gain), told)
        return VehicleLoadSample(*np.asarray(y).T), np.asarray(x)

    return record


def nees(found, load):
    """Squared errors of the loads by their covariance, [time]."""
    error = found.load - load
    return np.einsum("ti,tij,tj->t", error, np.linalg.inv(found.covariance), error)


def rms(error):
    return np.sqrt(np.mean(error**2))
