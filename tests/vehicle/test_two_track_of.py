"""The two-track model of a full vehicle against the full vehicle on a circle."""

import jax.numpy as jnp
import numpy as np
import pytest

from tests.vehicle.driving import TIMES, coasting, flow, plant, start
from wheelhop.vehicle.full_vehicle_parameters import suv, with_payload, with_tire
from wheelhop.vehicle.lateral_tire import MAGIC_FORMULA
from wheelhop.vehicle.magic_formula_parameters import generic_passenger_tire
from wheelhop.vehicle.two_track import validate, wheel_loads, yaw_gain
from wheelhop.vehicle.two_track_of import common_centre, tires_of, two_track_of

SPEED, STEER = 20.0, 0.01
NOMINAL = jnp.full(4, 250e3)


@pytest.fixture(scope="module")
def vehicle():
    return suv()


@pytest.fixture(scope="module")
def circle(vehicle):
    """The full vehicle 3 s after its wheels were turned to the left, coasting."""
    angles = STEER * np.clip(TIMES, 0.0, 1.0)
    x = start(vehicle, NOMINAL, SPEED)
    x = flow(x, vehicle, coasting(SPEED, angles), 3.0, 2e-3, NOMINAL)
    return x, plant(x, vehicle, NOMINAL, steer=np.array([STEER, STEER, 0.0, 0.0]))[0]


def test_mass_and_inertia_are_those_of_the_parts_put_together(vehicle):
    c = vehicle.chassis
    mass = np.r_[float(c.body_mass), np.asarray(c.wheel_mass)]
    x = np.r_[0.0, np.repeat([float(c.front_arm), -float(c.rear_arm)], 2)]
    y = np.r_[0.0, 0.5 * np.repeat([float(c.front_track), float(c.rear_track)], 2) * [1, -1, 1, -1]]
    centre = mass @ x / mass.sum()
    own = np.r_[float(c.yaw_inertia), np.asarray(c.diametral_inertia)]
    car = validate(two_track_of(vehicle))
    np.testing.assert_allclose(car.mass, mass.sum(), rtol=1e-12)
    np.testing.assert_allclose(car.front_arm, x[1] - centre, rtol=1e-12)
    np.testing.assert_allclose(car.rear_arm, centre - x[3], rtol=1e-12)
    inertia = np.sum(own + mass * ((x - centre) ** 2 + y**2))
    np.testing.assert_allclose(car.yaw_inertia, inertia, rtol=1e-12)
    # Table 1 of Brancati & Tufano 2022 gives the whole car's height
    np.testing.assert_allclose(common_centre(vehicle, NOMINAL).height, 0.6, rtol=1e-3)


def test_a_payload_lowers_the_car_on_its_springs(vehicle):
    heavy = with_payload(vehicle, 300.0)
    x = start(heavy, NOMINAL, SPEED)
    below = common_centre(heavy, NOMINAL).below
    np.testing.assert_allclose(common_centre(heavy, NOMINAL).height, x.z - below, atol=1e-4)


def test_loads_and_roll_are_those_of_the_full_vehicle_on_a_circle(vehicle, circle):
    x, now = circle
    car = two_track_of(vehicle)
    a_y = float(x.v_x * x.r)
    assert 1.0 < a_y < 2.5
    model, load = wheel_loads(a_y, car), np.asarray(now.forces.load)
    np.testing.assert_allclose(model.front_right - model.front_left, load[1] - load[0], rtol=0.01)
    np.testing.assert_allclose(model.rear_right - model.rear_left, load[3] - load[2], rtol=0.01)
    np.testing.assert_allclose(np.asarray(model), load, rtol=0.03)
    np.testing.assert_allclose(car.roll_gain * a_y / 9.80665, x.roll, rtol=0.01)


def test_an_accelerometer_on_the_leaning_body_shows_the_gain(vehicle, circle):
    x, now = circle
    felt = float(now.acceleration.body.y + 9.80665 * jnp.sin(x.roll) * jnp.cos(x.pitch))
    gain = 1.0 + float(two_track_of(vehicle).roll_gain)
    np.testing.assert_allclose(felt / float(x.v_x * x.r), gain, rtol=0.005)


def test_yaw_gain_is_that_of_the_full_vehicle_within_its_drag(vehicle, circle):
    x, _ = circle
    car, tires = two_track_of(vehicle), tires_of(vehicle, NOMINAL)
    slopes = [
        float(MAGIC_FORMULA.stiffness(f, t))
        for f, t in zip(wheel_loads(0.0, car), tires, strict=True)
    ]
    gain = yaw_gain(float(x.v_x), slopes[0] + slopes[1], slopes[2] + slopes[3], car)
    np.testing.assert_allclose(float(x.r) / STEER, gain, rtol=0.04)


def test_every_tyre_has_its_own_pressure_and_side(vehicle):
    car = with_tire(vehicle, generic_passenger_tire(ppy1=0.9))
    tires = tires_of(car, np.array([250e3, 125e3, 250e3, 200e3]))
    load = jnp.asarray(5000.0)
    slopes = np.array([float(MAGIC_FORMULA.stiffness(load, t)) for t in tires])
    np.testing.assert_allclose(slopes / slopes[0], [1.0, 0.55, 1.0, 0.82], rtol=1e-12)
    assert [float(t.slip.side) for t in tires] == [1.0, -1.0, 1.0, -1.0]
