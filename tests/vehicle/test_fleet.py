"""A fleet in lanes is the same as every vehicle by itself."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from wheelhop.errors import InputError
from wheelhop.staging import staged_jit
from wheelhop.vehicle.equilibrium import state_at_rest, static_equilibrium
from wheelhop.vehicle.fleet import fleet_simulator
from wheelhop.vehicle.full_vehicle_parameters import suv
from wheelhop.vehicle.full_vehicle_state import Surroundings
from wheelhop.vehicle.maneuver import double_lane_change
from wheelhop.vehicle.pressure_course import held
from wheelhop.vehicle.road.envelope import Envelope
from wheelhop.vehicle.road.surface import surface_from_tracks
from wheelhop.vehicle.simulation import simulate_vehicle

SAMPLES, RATE, SUBSTEPS = 20, 200.0, 5


def arrays(tree):
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, float), tree)


@pytest.fixture(scope="module")
def drive():
    vehicle, around = suv(), arrays(Surroundings())
    rest = staged_jit(static_equilibrium)(vehicle, jnp.full(4, 250e3), around)
    maneuver = arrays(double_lane_change(begin=0.0))
    initial = state_at_rest(rest, maneuver.speed, vehicle)
    return initial, vehicle, maneuver, around


def roads(count):
    rng = np.random.default_rng(1)
    tracks = 1e-3 * rng.standard_normal((count, 4, 400)).cumsum(-1)
    make = lambda z: surface_from_tracks(z, 0.05, -5.0, Envelope("moving_average", (0.05, 0.1)))  # noqa: E731
    return jax.vmap(make)(jnp.asarray(tracks))


@pytest.mark.parametrize("own_road", [False, True])
def test_a_fleet_equals_its_vehicles(drive, own_road):
    initial, vehicle, maneuver, around = drive
    count = 5
    speeds = jnp.linspace(20.0, 30.0, count)
    initials = jax.vmap(lambda v: initial._replace(v_x=v))(speeds)
    pressures = held(jnp.linspace(150e3, 250e3, 4 * count).reshape(count, 4))
    axes = type(pressures)(0, 0, None, None, None, None, None)
    every = roads(count)
    road = every if own_road else jax.tree.map(lambda leaf: leaf[0], every)
    fleet = fleet_simulator(
        SAMPLES,
        RATE,
        SUBSTEPS,
        in_axes=(0, None, None, 0 if own_road else None, axes, None),
        keep=lambda s: {"load": s.load, "roll": s.roll},
        lanes=3,
    )
    found = fleet(initials, vehicle, maneuver, road, arrays(pressures), around)
    one = staged_jit(lambda x, r, p: simulate_vehicle(
        x, vehicle, maneuver, r, p, around, SAMPLES, RATE, SUBSTEPS
    )[1])  # fmt: skip
    assert found["load"].shape == (count, SAMPLES, 4)
    assert np.ptp(found["load"][:, -1, 0]) > 10.0
    for k in range(count):
        p = arrays(held(pressures.start[k]))
        own = jax.tree.map(lambda leaf, k=k: leaf[k], (initials, every if own_road else None))
        alone = one(own[0], own[1] if own_road else road, p)
        np.testing.assert_allclose(found["load"][k], alone.load, rtol=1e-8)
        np.testing.assert_allclose(found["roll"][k], alone.roll, rtol=1e-6, atol=1e-10)


def test_run_axes_of_different_lengths_are_refused(drive):
    initial, vehicle, maneuver, around = drive
    three = jax.tree.map(lambda leaf: jnp.stack([leaf] * 3), initial)
    pressures = arrays(held(jnp.full((2, 4), 250e3)))
    fleet = fleet_simulator(2, in_axes=(0, None, None, None, 0, None))
    with pytest.raises(InputError, match="lengths"):
        fleet(three, vehicle, maneuver, roads(1), pressures, around)
    with pytest.raises(InputError, match="lanes"):
        fleet_simulator(2, lanes=0)
