"""A fleet in lanes is the same as every vehicle by itself."""

import os
import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from wheelhop.errors import DivergenceError, InputError
from wheelhop.staging import staged_jit
from wheelhop.vehicle.equilibrium import state_at_rest, static_equilibrium
from wheelhop.vehicle.fleet import fleet_simulator
from wheelhop.vehicle.full_vehicle_parameters import suv, with_payload
from wheelhop.vehicle.full_vehicle_state import Surroundings
from wheelhop.vehicle.maneuver import double_lane_change
from wheelhop.vehicle.pressure_course import held
from wheelhop.vehicle.road.envelope import Envelope
from wheelhop.vehicle.road.surface import surface_from_tracks
from wheelhop.vehicle.simulation import simulate_vehicle
from wheelhop.vehicle.vertical_tire import (
    contact_half_length,
    vertical_load,
    vertical_stiffness,
)

SETTINGS = SAMPLES, RATE, SUBSTEPS = 20, 200.0, 5
MANY = 32
"""Cars that fill the widest vectors of a processor, four of them in float64."""


def arrays(tree):
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, float), tree)


def begin():
    vehicle, around = suv(), arrays(Surroundings())
    rest = staged_jit(static_equilibrium)(vehicle, jnp.full(4, 250e3), around)
    maneuver = arrays(double_lane_change(begin=0.0))
    initial = state_at_rest(rest, maneuver.speed, vehicle)
    return initial, vehicle, maneuver, around


@pytest.fixture(scope="module")
def drive():
    return begin()


@pytest.fixture(scope="module")
def alone():
    """One vehicle's drive, with what is kept of it."""
    compiled = staged_jit(lambda *arguments: simulate_vehicle(*arguments, *SETTINGS)[1])
    return lambda *arguments: kept(compiled(*arguments))


def kept(signals):
    return {"load": signals.load, "roll": signals.roll, "lateral": signals.lateral}


def roads(count):
    rng = np.random.default_rng(1)
    tracks = 1e-3 * rng.standard_normal((count, 4, 400)).cumsum(-1)
    make = lambda z: surface_from_tracks(z, 0.05, -5.0, Envelope("moving_average", (0.05, 0.1)))  # noqa: E731
    return jax.vmap(make)(jnp.asarray(tracks))


def run(tree, k):
    return jax.tree.map(lambda leaf: leaf[k], tree)


def different_cars(drive):
    """Arguments of a fleet whose cars differ in payload, speed and pressures."""
    initial, vehicle, maneuver, around = drive
    initials = jax.vmap(lambda v: initial._replace(v_x=v))(jnp.linspace(15.0, 30.0, MANY))
    cars = [with_payload(vehicle, float(mass)) for mass in np.linspace(0.0, 300.0, MANY)]
    cars = jax.tree.map(lambda *leaves: jnp.stack(leaves), *cars)
    pressures = jnp.asarray(np.random.default_rng(2).uniform(150e3, 280e3, (MANY, 4)))
    return initials, cars, maneuver, run(roads(1), 0), jax.vmap(held)(pressures), around


def many_cars(**options):
    return fleet_simulator(*SETTINGS, in_axes=(0, 0, None, None, 0, None), keep=kept, **options)


@pytest.fixture(scope="module")
def compiled_fleet(stages_as_users_compile):
    with stages_as_users_compile():
        return many_cars()


def one_of(arguments, k):
    initials, cars, maneuver, road, pressures, around = arguments
    return run(initials, k), run(cars, k), maneuver, road, run(pressures, k), around


def test_a_fleet_on_roads_of_its_own_equals_its_vehicles(drive, alone):
    initial, vehicle, maneuver, around = drive
    count = 5
    initials = jax.vmap(lambda v: initial._replace(v_x=v))(jnp.linspace(20.0, 30.0, count))
    pressures = held(jnp.linspace(150e3, 250e3, 4 * count).reshape(count, 4))
    axes = type(pressures)(0, 0, None, None, None, None, None)
    every = roads(count)
    fleet = fleet_simulator(*SETTINGS, in_axes=(0, None, None, 0, axes, None), keep=kept, lanes=3)
    found = fleet(initials, vehicle, maneuver, every, arrays(pressures), around)
    assert found["load"].shape == (count, SAMPLES, 4)
    assert np.ptp(found["load"][:, -1, 0]) > 10.0
    for k in range(count):
        pressure = arrays(held(pressures.start[k]))
        expected = alone(run(initials, k), vehicle, maneuver, run(every, k), pressure, around)
        np.testing.assert_allclose(found["load"][k], expected["load"], rtol=1e-8)
        np.testing.assert_allclose(found["roll"][k], expected["roll"], rtol=1e-6, atol=1e-10)


def test_cars_that_fill_the_widest_vectors_equal_each_car_alone(drive, alone, compiled_fleet):
    arguments = different_cars(drive)
    found = compiled_fleet(*arguments)
    with jax.enable_x64(False):
        single = compiled_fleet(*jax.tree.map(lambda leaf: jnp.asarray(leaf, "float32"), arguments))
    assert single["load"].dtype == jnp.float32
    assert np.ptp(found["load"][:, -1, 0]) > 100.0
    assert np.abs(found["lateral"][:, -1]).max(-1).min() > 30.0
    for k in range(MANY):
        expected = alone(*one_of(arguments, k))
        for name, size in (("load", 5e3), ("lateral", 1e3), ("roll", 0.01)):
            np.testing.assert_allclose(found[name][k], expected[name], atol=1e-9 * size)
            np.testing.assert_allclose(single[name][k], expected[name], rtol=0, atol=1e-2 * size)


def test_a_run_that_leaves_the_finite_numbers_is_named(drive, compiled_fleet):
    initials, *others = different_cars(drive)
    lost = initials._replace(v_x=initials.v_x.at[jnp.asarray([6, 9])].set(jnp.nan))
    with pytest.raises(DivergenceError, match=r"^2 of 32 runs .* the first is run 6:"):
        compiled_fleet(lost, *others)


# with `check=False`, and one run whose speed is not a number
ON_TWO = """
import sys
import jax
jax.config.update("jax_enable_x64", True)
import numpy as np
from tests.vehicle.test_fleet import begin, different_cars, many_cars
initials, *others = different_cars(begin())
initials = initials._replace(v_x=initials.v_x.at[5].set(np.nan))
assert len(jax.devices()) == 2
found = many_cars(lanes=12, devices=jax.devices(), check=False)(initials, *others)
assert all(leaf.devices() == {jax.devices()[0]} for leaf in found.values())
np.savez(sys.argv[1], **found)
"""


@pytest.mark.slow
def test_devices_share_a_fleet(drive, compiled_fleet, tmp_path):
    environment = os.environ | {
        "XLA_FLAGS": "--xla_force_host_platform_device_count=2",
        "JAX_PLATFORMS": "cpu",
        "JAX_COMPILATION_CACHE_DIR": jax.config.jax_compilation_cache_dir,
    }
    file = tmp_path / "found.npz"
    command = [sys.executable, "-c", ON_TWO, str(file)]
    done = subprocess.run(
        command,
        cwd=Path(__file__).parents[2],
        env=environment,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    found = np.load(file)
    expected = compiled_fleet(*different_cars(drive))
    others = np.delete(np.arange(MANY), 5)
    assert np.isnan(found["load"][5]).all()
    for name, size in (("load", 5e3), ("lateral", 1e3), ("roll", 0.01)):
        np.testing.assert_allclose(
            found[name][others], expected[name][others], rtol=0, atol=1e-9 * size
        )


def test_run_axes_of_different_lengths_are_refused(drive):
    initial, vehicle, maneuver, around = drive
    three = jax.tree.map(lambda leaf: jnp.stack([leaf] * 3), initial)
    pressures = arrays(held(jnp.full((2, 4), 250e3)))
    fleet = fleet_simulator(2, in_axes=(0, None, None, None, 0, None))
    with pytest.raises(InputError, match="lengths"):
        fleet(three, vehicle, maneuver, roads(1), pressures, around)
    with pytest.raises(InputError, match="lanes"):
        fleet_simulator(2, lanes=0)


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_what_is_not_a_number_gives_no_plausible_load(precision, stages_as_users_compile):
    tire = jax.tree.map(lambda leaf: jnp.asarray(leaf[0], precision), suv().tire.vertical)
    good = jnp.full(64, 0.02, precision)
    lost = jnp.where(jnp.arange(64) % 4 == 0, jnp.nan, good)

    def vertical(deflection, rate):
        load = vertical_load(deflection, rate, good, 1e7 * good, tire)
        half = contact_half_length(deflection, tire)
        return load, vertical_stiffness(deflection, good, 1e7 * good, tire) + rate, half + rate

    with stages_as_users_compile():
        compiled = staged_jit(vertical)
    for arguments in ((lost, good), (good, lost)):
        for values in compiled(*arguments):
            np.testing.assert_array_equal(np.isnan(values), np.isnan(lost))
            assert np.isfinite(values[1::4]).all()
    apart = compiled(-good, 0.0 * good)
    assert all(np.all(np.asarray(values) == 0.0) for values in apart)
