"""Modes against mass, damping and stiffness matrices; gains against the rigid car's inertia."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.oracles.vehicle_numpy import places, plain, seven
from tests.vehicle.driving import rest, surroundings
from wheelhop.vehicle.full_vehicle_parameters import suv
from wheelhop.vehicle.linearise import modes, relative_gain_array, static_gain

NOMINAL = np.full(4, 250e3)
KPA = (130, 180, 230)


def oracle_modes(car, pressure):
    """Frequencies [Hz] and damping ratios of M q'' + C q' + K q = 0 in state space."""
    mass, damping, stiffness, _ = seven(car, pressure)
    inverse = np.linalg.inv(mass)
    system = np.block([[np.zeros((7, 7)), np.eye(7)], [-inverse @ stiffness, -inverse @ damping]])
    values = np.linalg.eigvals(system)
    values = values[values.imag > 0]
    values = values[np.argsort(abs(values))]
    return abs(values) / (2 * np.pi), -values.real / abs(values)


@pytest.mark.parametrize("kpa", KPA)
def test_modes_equal_those_of_the_matrices(kpa):
    """Unequal pressures too; the small rest is the attitude at which the car stands."""
    car, pressure = suv(), 1e3 * kpa * np.array([1.0, 1.0, 1.0, 1.1])
    found = modes(car, pressure)
    frequency, damping = oracle_modes(car, pressure)
    np.testing.assert_allclose(found.frequency, frequency, rtol=1e-3)
    np.testing.assert_allclose(found.damping, damping, rtol=4e-3)


def test_frequencies_are_those_of_a_road_car():
    hop = {}
    for kpa in KPA:
        found = modes(suv(), np.full(4, 1e3 * kpa))
        named = dict(zip(found.name, found.frequency, strict=True))
        assert set(named) == {
            "heave", "roll", "pitch", "front hop", "front tramp", "rear hop", "rear tramp"
        }  # fmt: skip
        assert 1.3 < named["heave"] < 1.8
        hop[kpa] = named["front hop"]
        assert np.all((found.frequency[3:] > 8.9) & (found.frequency[3:] < 13))
    assert (hop[230] - hop[130]) / 2 == pytest.approx(0.8, abs=0.1)
    assert hop[130] < hop[180] < hop[230]


def test_shapes_are_those_of_their_names():
    found = modes(suv(), NOMINAL)
    shape = dict(zip(found.name, found.shape, strict=True))
    hop, tramp = shape["front hop"][3:5], shape["front tramp"][3:5]
    np.testing.assert_allclose(hop[0], hop[1], atol=1e-6)
    np.testing.assert_allclose(tramp[0], -tramp[1], atol=1e-6)
    assert abs(shape["roll"][0]) < 1e-6 < abs(shape["roll"][1])


def test_an_overdamped_mode_keeps_its_product_and_sum():
    car = suv()
    damper = replace(car.strut.damper, damping=4.0 * car.strut.damper.damping)
    found = modes(replace(car, strut=replace(car.strut, damper=damper)), NOMINAL)
    assert found.damping.max() > 1
    mass, damping, stiffness, _ = seven(
        replace(car, strut=replace(car.strut, damper=damper)), NOMINAL
    )
    product = np.prod((2 * np.pi * found.frequency) ** 2)
    assert product == pytest.approx(np.linalg.det(stiffness) / np.linalg.det(mass), rel=1e-2)
    total = np.sum(2 * found.damping * 2 * np.pi * found.frequency)
    assert total == pytest.approx(np.trace(np.linalg.inv(mass) @ damping), rel=1e-2)


def expected_gain(car):
    """K^-1 (I - m J M^-1 J^T): what is left of the loads after the wheels' own inertia."""
    c = plain(car.chassis)
    r, m = places(np.zeros(4), car.chassis), c["wheel_mass"]
    jacobian = np.stack([np.ones(4), r[:, 1], -r[:, 0]], axis=1)
    mass, *_ = seven(car, NOMINAL)
    rigid = mass[:3, :3] + jacobian.T @ np.diag(m) @ jacobian
    strut = np.eye(4) - np.diag(m) @ jacobian @ np.linalg.solve(rigid, jacobian.T)
    stiffness = np.diag(np.asarray(car.strut.stiffness, float))
    for at, bar in ((0, car.anti_roll.front), (2, car.anti_roll.rear)):
        stiffness[at : at + 2, at : at + 2] += float(bar) * np.array([[1, -1], [-1, 1]])
    return np.linalg.solve(stiffness, strut)


def bars(front, rear):
    car = suv()
    return replace(
        car, anti_roll=replace(car.anti_roll, front=jnp.asarray(front), rear=jnp.asarray(rear))
    )


GAIN = jax.jit(static_gain)


@pytest.mark.parametrize(("front", "rear"), [(0.0, 0.0), (0.0, 9e3), (15e3, 8e3)])
def test_gain_equals_the_rigid_cars(front, rear):
    car = bars(front, rear)
    found = GAIN(rest(car, NOMINAL), car, surroundings())
    np.testing.assert_allclose(found, expected_gain(car), rtol=1e-6, atol=1e-12)


def relative(front, rear):
    car = bars(front, rear)
    return np.asarray(relative_gain_array(GAIN(rest(car, NOMINAL), car, surroundings())))


def test_bars_couple_the_wheels_of_their_axle_only():
    """The pattern of Filipozzi et al. 2021, Eq. 1."""
    free, rear = relative(0.0, 0.0), relative(0.0, 9e3)
    for array in (free, rear):
        np.testing.assert_allclose(array.sum(0), 1.0, atol=1e-12)
        np.testing.assert_allclose(array.sum(1), 1.0, atol=1e-12)
    np.testing.assert_allclose(np.diag(free), 1.0, atol=0.05)
    np.testing.assert_allclose(rear[:2], free[:2], atol=2e-3)
    assert rear[2, 2] > free[2, 2] + 0.03
    assert rear[2, 3] < free[2, 3] - 0.03
    assert abs(rear[2, 3] - rear[3, 2]) < 2e-3


def test_relative_gains_of_two_by_two():
    """Bristol's closed form 1 / (1 - g12 g21 / (g11 g22))."""
    gain = jnp.asarray([[2.0, 0.5], [-0.3, 1.5]])
    expected = 1 / (1 + 0.15 / 3.0)
    found = np.asarray(relative_gain_array(gain))
    np.testing.assert_allclose(found, [[expected, 1 - expected], [1 - expected, expected]])
