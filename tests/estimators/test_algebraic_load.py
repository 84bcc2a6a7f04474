"""Algebraic wheel loads against moment balances, signs a driver knows, and the full vehicle."""

import jax.numpy as jnp
import numpy as np
import pytest

from tests.oracles.vehicle_numpy import bodies, gravity
from tests.vehicle.driving import rest, start, surroundings
from wheelhop.errors import InputError
from wheelhop.estimators.algebraic_load import (
    WeightDistribution,
    algebraic_loads,
    distribution_of,
    validate,
)
from wheelhop.vehicle.full_vehicle_parameters import bmw_e90, suv

G = 9.80665
CAR = WeightDistribution(1800.0, 1.3, 0.72, 0.6, 2.8, 1.56)
RNG = np.random.default_rng(0)
A_X, A_Y = RNG.uniform(-8, 8, (2, 50))


def loads(a_x, a_y, car=CAR, **others):
    return np.asarray(algebraic_loads(jnp.asarray(a_x), jnp.asarray(a_y), car, **others))


def test_axles_and_sides_balance_every_moment():
    """Moments about the rear axle's and the right wheels' lines of contact."""
    found = loads(A_X, A_Y)
    assert found.shape == (50, 4)
    np.testing.assert_allclose(found.sum(-1), 1800 * G, rtol=1e-14)
    np.testing.assert_allclose(found[:, :2].sum(-1) * 2.8, 1800 * (G * 1.5 - 0.6 * A_X), rtol=1e-13)
    np.testing.assert_allclose(
        found[:, [0, 2]].sum(-1) * 1.56, 1800 * (G * 0.84 - 0.6 * A_Y), rtol=1e-13
    )


def test_at_rest_front_to_rear_is_alike_on_both_sides():
    fl, fr, rl, rr = loads(0.0, 0.0)
    assert fl / rl == pytest.approx(1.5 / 1.3, rel=1e-14)
    assert fl * rr == pytest.approx(fr * rl, rel=1e-14)


def test_the_product_of_both_transfers_is_left_out():
    """Sharing an axle's load as the sides share would make 4 m h^2 a_x a_y / (g L W) more warp."""
    found = loads(A_X, A_Y)
    front, left = found[:, :2].sum(-1), found[:, [0, 2]].sum(-1)
    weight = 1800 * G
    shared = weight * (2 * front / weight - 1) * (2 * left / weight - 1)
    warp = found @ np.array([1.0, -1.0, -1.0, 1.0])
    product = 4 * 1800 * 0.6**2 * A_X * A_Y / (G * 2.8 * 1.56)
    np.testing.assert_allclose(warp, shared - product, atol=1e-9 * weight)


@pytest.mark.parametrize(
    ("a_x", "a_y", "heavier"),
    [(-3.0, 0.0, [0, 1]), (3.0, 0.0, [2, 3]), (0.0, 3.0, [1, 3]), (0.0, -3.0, [0, 2])],
)
def test_braking_loads_the_front_and_a_left_turn_the_right(a_x, a_y, heavier):
    more = loads(a_x, a_y) > loads(0.0, 0.0)
    assert sorted(np.flatnonzero(more)) == heavier


@pytest.mark.parametrize("build", [suv, bmw_e90])
def test_the_distribution_is_that_of_all_masses(build):
    """Sums over body and wheels at rest; hubs stand a loaded radius above the road."""
    car = build()
    mass, position, _ = bodies(start(car, np.asarray(car.nominal_pressure), 0.0), car.chassis)
    centre = mass @ position / mass.sum()
    found = distribution_of(car)
    assert float(found.mass) == pytest.approx(mass.sum(), rel=1e-14)
    assert float(found.front_distance) == pytest.approx(position[1, 0] - centre[0], abs=1e-12)
    assert float(found.height) == pytest.approx(centre[2], abs=1e-9)
    assert float(found.wheelbase) == pytest.approx(position[1, 0] - position[3, 0], abs=1e-12)
    across = position[[1, 3], 1] - position[[2, 4], 1]
    assert float(found.track) == pytest.approx(across.mean(), abs=1e-12)
    assert float(found.left_distance) == pytest.approx(across.mean() / 2, abs=1e-12)


@pytest.mark.parametrize(("grade", "bank"), [(0.197, 0.0), (-0.1, 0.0), (0.0, 0.06)])
def test_it_loads_the_full_vehicle_on_a_slope(grade, bank):
    """Signs are those of the sensors; what is left is the body's lean, and where a bank's transfer
    goes: this model shares it by weight, the car by roll stiffness."""
    car = suv()
    felt = -gravity(grade, bank)
    found = loads(felt[0], felt[1], distribution_of(car), a_z=jnp.asarray(felt[2] - G))
    truth = np.asarray(rest(car, np.full(4, 250e3), surroundings(grade=grade, bank=bank)).load)
    assert found.sum() == pytest.approx(truth.sum(), rel=1e-12)
    level = loads(0.0, 0.0, distribution_of(car)) * felt[2] / G
    moved = np.abs(truth - level).max()
    assert moved > 150
    assert np.abs(found - truth).max() < (0.05 if bank == 0 else 0.25) * moved
    overstated = loads(felt[0], felt[1], distribution_of(car)).sum() / truth.sum()
    assert overstated == pytest.approx(G / felt[2], rel=1e-12)


def test_what_no_vehicle_has_is_refused():
    assert validate(CAR) is CAR
    with pytest.raises(InputError, match=r"distribution\.mass"):
        validate(CAR._replace(mass=1.0))
    with pytest.raises(InputError, match=r"front_distance.*between 0 and 2.8"):
        validate(CAR._replace(front_distance=3.0))
