"""The driver's inputs against geometry and balances of force."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.vehicle.driving import arrays, coasting, surroundings
from wheelhop.errors import InputError
from wheelhop.vehicle.full_vehicle import VehicleState
from wheelhop.vehicle.full_vehicle_parameters import suv
from wheelhop.vehicle.maneuver import (
    brake_step,
    controls_at,
    double_lane_change,
    path_at,
    straight,
)
from wheelhop.vehicle.road.obstacles import smoothstep

CAR = suv()


def state(**values):
    four = ("compression", "compression_rate", "spin", "kappa", "tan_alpha")
    zero = {n: np.zeros(4) if n in four else 0.0 for n in VehicleState._fields}
    return arrays(VehicleState(**(zero | values)))


CONTROLS = jax.jit(controls_at)


def controls(maneuver, t, x, around=None):
    return CONTROLS(arrays(maneuver), jnp.asarray(t), x, CAR, around or surroundings())


def test_the_path_peaks_at_the_wanted_acceleration_and_returns():
    speed, peak, offset = 25.0, 4.0, 3.5
    path = double_lane_change(speed, peak, offset).path
    x = jnp.linspace(0.0, 400.0, 40001)
    y, slope, curvature = (np.asarray(part) for part in path_at(path, x, x))
    assert np.abs(curvature).max() * speed**2 == pytest.approx(peak, rel=1e-6)
    assert y.max() == pytest.approx(offset)
    assert y[-1] == pytest.approx(0.0, abs=1e-12)
    assert y[0] == 0.0
    np.testing.assert_allclose(np.gradient(y, x), slope, atol=1e-5)
    np.testing.assert_allclose(np.gradient(slope, x), curvature, atol=2e-5)


def test_brake_rises_once_to_its_torque_and_is_split():
    maneuver = brake_step(25.0, 3000.0, 1.0)
    x = state(v_x=25.0)
    before, during, after = (controls(maneuver, t, x) for t in (0.99, 1.05, 1.2))
    np.testing.assert_array_equal(before.brake, 0.0)
    np.testing.assert_allclose(after.brake, 3000.0 * np.asarray(CAR.brake_share))
    assert float(during.brake.sum()) == pytest.approx(1500.0)
    np.testing.assert_array_equal(after.drive, 0.0)
    assert np.all(np.asarray(before.drive) > 0)
    u = np.linspace(-0.5, 1.5, 9)
    expected = np.clip(u, 0, 1)
    expected = 6 * expected**5 - 15 * expected**4 + 10 * expected**3
    np.testing.assert_allclose(smoothstep(jnp.asarray(u)), expected, atol=1e-15)


def test_drive_torque_balances_drag_rolling_resistance_and_grade():
    speed, grade = 30.0, 0.06
    total = float(CAR.chassis.body_mass + CAR.chassis.wheel_mass.sum())
    found = controls(straight(speed), 0.0, state(v_x=speed), surroundings(grade=grade))
    drag = 0.5 * 1.2 * float(CAR.drag_area) * speed**2
    force = drag + 9.80665 * total * (0.01 + np.sin(grade))
    assert float(found.drive.sum()) == pytest.approx(0.36 * force, rel=1e-9)
    # half a metre per second too slow: 2 1/s of it is added
    slow = controls(straight(speed), 0.0, state(v_x=speed - 0.5), surroundings(grade=grade))
    change = 0.36 * (
        total * 2.0 * 0.5 - (drag - 0.5 * 1.2 * float(CAR.drag_area) * (speed - 0.5) ** 2)
    )
    assert float(slow.drive.sum() - found.drive.sum()) == pytest.approx(change, rel=1e-9)


def test_the_driver_steers_back_to_the_path_and_not_at_rest():
    angle = lambda maneuver, **s: float(controls(maneuver, 0.0, state(**s)).steer[0])  # noqa: E731
    assert angle(straight(20.0), v_x=20.0) == 0.0
    assert angle(straight(20.0), v_x=20.0, y=0.5) < 0 < angle(straight(20.0), v_x=20.0, y=-0.5)
    assert angle(straight(20.0), v_x=20.0, yaw=0.05) < 0
    assert angle(straight(20.0), v_x=0.0, y=0.5) == 0.0
    assert angle(coasting(20.0), v_x=20.0, y=0.5) == 0.0
    assert angle(coasting(20.0, np.full(9, 0.03)), v_x=20.0, y=0.5) == pytest.approx(0.03)
    rear = controls(straight(20.0), 0.0, state(v_x=20.0, y=1.0)).steer[2:]
    np.testing.assert_array_equal(rear, 0.0)


def test_inputs_have_finite_derivatives_even_with_a_release_that_never_comes():
    x = state(v_x=20.0, y=0.1)

    def total(maneuver):
        u = controls_at(maneuver, jnp.asarray(0.5), x, CAR, surroundings())
        return jnp.sum(u.drive) + jnp.sum(u.brake) + jnp.sum(u.steer)

    slope = jax.jit(jax.grad(total))(arrays(straight(20.0)))
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(slope))


def test_an_instant_brake_has_no_hole_at_its_beginning():
    maneuver = brake_step(20.0, 1000.0, 0.5)
    maneuver = replace(maneuver, brake=replace(maneuver.brake, rise=0.0))
    torque = [float(controls(maneuver, t, state()).brake.sum()) for t in (0.4, 0.5, 0.6)]
    assert torque == [0.0, 0.0, 1000.0]


def test_impossible_lane_change_is_named():
    with pytest.raises(InputError, match=r"double_lane_change\.peak: -1"):
        double_lane_change(peak=-1.0)
