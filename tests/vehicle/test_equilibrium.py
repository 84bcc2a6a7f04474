"""Static corner loads against lever arms, moments and a linear seven-degree model."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.oracles.vehicle_numpy import bodies, gravity, plain, seven, tire_stiffness
from tests.vehicle.driving import plant, rest, start, surroundings
from wheelhop.errors import DivergenceError
from wheelhop.staging import staged_jit
from wheelhop.vehicle.equilibrium import require_rest, static_equilibrium
from wheelhop.vehicle.full_vehicle_parameters import bmw_e90, commonroad_2, suv, with_payload

G = 9.80665
NOMINAL = np.full(4, 250e3)
CAR = suv()


def total_mass(car):
    return float(car.chassis.body_mass) + float(np.sum(car.chassis.wheel_mass))


def lever_loads(car):
    """Loads on level ground from the lever arms of the body's centre of mass."""
    c = plain(car.chassis)
    arms = np.array([c["rear_arm"], c["rear_arm"], c["front_arm"], c["front_arm"]])
    share = 0.5 * arms / (c["front_arm"] + c["rear_arm"])
    return G * (c["body_mass"] * share + c["wheel_mass"])


@pytest.mark.parametrize("build", [suv, bmw_e90, commonroad_2])
def test_level_loads_are_those_of_the_lever_arms(build):
    """At the design load and pressure the car is level with its struts at zero."""
    car = build()
    found = rest(car, np.asarray(car.nominal_pressure))
    np.testing.assert_allclose(found.load, lever_loads(car), rtol=1e-9)
    np.testing.assert_allclose(found.compression, 0.0, atol=1e-9)
    assert abs(float(found.roll)) + abs(float(found.pitch)) < 1e-10


def test_a_soft_tyre_shifts_load_as_the_linear_model_says():
    """Front left at 130 kPa: loads shift along the diagonals; the sum does not."""
    pressure = np.array([130e3, 250e3, 250e3, 250e3])
    found = rest(CAR, pressure)
    _, _, stiffness, _ = seven(CAR, pressure)
    vertical = plain(CAR.tire.vertical)
    before = lever_loads(CAR)
    # tyres pushed by their design deflection at the new stiffness, against the design load
    deflection = before / tire_stiffness(vertical, NOMINAL)
    k = tire_stiffness(vertical, pressure)
    move = np.linalg.solve(stiffness, np.r_[np.zeros(3), k * deflection - before])
    expected = k * (deflection - move[3:])
    np.testing.assert_allclose(found.load, expected, atol=1.0)
    assert expected[0] < before[0] - 15
    assert float(jnp.sum(found.load)) == pytest.approx(G * total_mass(CAR), rel=1e-5)
    assert float(found.roll) == pytest.approx(move[1], rel=0.02)


def test_payload():
    found = rest(with_payload(CAR, 400.0), NOMINAL)
    heavier = replace(CAR, chassis=replace(CAR.chassis, body_mass=CAR.chassis.body_mass + 400.0))
    np.testing.assert_allclose(found.load, lever_loads(heavier), rtol=2e-3)
    assert float(jnp.sum(found.load)) == pytest.approx(G * (total_mass(CAR) + 400.0), rel=1e-5)
    assert float(found.compression.min()) > 0.02


@pytest.mark.parametrize(("grade", "bank"), [(0.15, 0.0), (-0.1, 0.0), (0.0, 0.08), (0.1, -0.05)])
def test_grade_and_bank_shift_load_by_the_height(grade, bank):
    tracks = replace(CAR.chassis, rear_track=CAR.chassis.front_track)
    car, around = replace(CAR, chassis=tracks), surroundings(grade=grade, bank=bank)
    found = rest(car, NOMINAL, around)
    mass, position, _ = bodies(start(car, NOMINAL, 0.0, around), car.chassis)
    down = gravity(grade, bank)
    load, total = np.asarray(found.load), mass.sum()
    assert load.sum() == pytest.approx(-total * down[2], rel=1e-9)
    # moments of all weights about the x and y axes through the contact points
    centre = mass @ position / total
    across, ahead = position[1:, 1] - centre[1], position[1:, 0] - centre[0]
    height = centre[2]
    assert load @ across == pytest.approx(height * total * down[1], abs=1e-4 * total)
    assert load @ ahead == pytest.approx(height * total * down[0], abs=1e-4 * total)
    # the textbook transfer, without the body's own lean
    track = float(car.chassis.front_track)
    base = float(car.chassis.front_arm + car.chassis.rear_arm)
    level = lever_loads(car) * -down[2] / G
    left, rear = load[[0, 2]].sum() - level[[0, 2]].sum(), load[2:].sum() - level[2:].sum()
    assert left == pytest.approx(height * total * down[1] / track, rel=0.12, abs=1.0)
    assert rear == pytest.approx(-height * total * down[0] / base, rel=0.05, abs=1.0)


def test_nothing_moves_at_rest():
    """The plant itself has no acceleration left."""
    now, rate = plant(start(CAR, NOMINAL * 0.8, 0.0), CAR, NOMINAL * 0.8)
    for name in rate._fields:
        np.testing.assert_allclose(getattr(rate, name), 0.0, atol=1e-9, err_msg=name)
    assert float(now.forces.load.sum()) == pytest.approx(G * total_mass(CAR), rel=1e-9)


def test_its_derivative_is_that_of_finite_differences():
    def height(scale):
        car = replace(CAR, strut=replace(CAR.strut, preload=scale * CAR.strut.preload))
        return static_equilibrium(car, jnp.asarray(NOMINAL), surroundings()).z

    slope = staged_jit(lambda s: jax.jvp(height, (s,), (jnp.ones_like(s),))[1])(jnp.asarray(1.0))
    raised = [
        float(
            rest(replace(CAR, strut=replace(CAR.strut, preload=s * CAR.strut.preload)), NOMINAL).z
        )
        for s in (1.001, 0.999)
    ]
    assert float(slope) == pytest.approx((raised[0] - raised[1]) / 2e-3, rel=1e-5)


def test_a_car_that_cannot_rest_is_told():
    found = rest(CAR, NOMINAL)
    with pytest.raises(DivergenceError, match="no static equilibrium"):
        require_rest(found._replace(residual=jnp.asarray(jnp.nan)))
    with pytest.raises(DivergenceError, match="carries no load"):
        require_rest(found._replace(load=jnp.asarray([-1.0, 1.0, 1.0, 1.0])))
