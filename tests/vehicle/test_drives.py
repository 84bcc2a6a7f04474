"""The named drives do what the literature says of them."""

import jax
import numpy as np
import pytest

from wheelhop.vehicle.drives import DRIVES, lane_change
from wheelhop.vehicle.full_vehicle_parameters import suv
from wheelhop.vehicle.pressure_course import held
from wheelhop.vehicle.road.build import build_surface, flat_tracks
from wheelhop.vehicle.vehicle_record import drive_vehicle
from wheelhop.vehicle.vertical_tire import deflection_at_load, vertical_stiffness

G = 9.80665


def driven(plan, duration):
    road = build_surface(flat_tracks(400.0), plan.obstacles)
    pressure = held(np.full(4, 250e3))
    return drive_vehicle(
        jax.random.key(0), suv(), plan.maneuver, road, pressure, duration, rate=200.0, substeps=5
    ).truth


@pytest.mark.parametrize(("speed", "peak"), [(90 / 3.6, 0.6), (120 / 3.6, 0.3)])
def test_double_lane_changes_reach_their_acceleration_and_come_back(speed, peak):
    """90 km/h up to 0.6 g, and 120 km/h; the driver meets the path's peak within a quarter."""
    truth = driven(lane_change(speed, peak * G), 12.0)
    lateral = truth.speed * truth.yaw_rate
    assert 0.85 * peak * G < np.abs(lateral).max() < 1.25 * peak * G
    assert truth.y.max() == pytest.approx(3.5, abs=0.6)
    assert abs(truth.y[-1]) < 0.3
    assert np.ptp(truth.speed) < 0.3
    outside = truth.load[np.argmax(lateral)]
    assert outside[1] > outside[0] + 1000.0
    assert outside[3] > outside[2] + 1000.0


def test_the_slope_ends_at_its_gradient():
    truth = driven(DRIVES["slope"](), 12.0)
    mass = 1788.0 + 2 * (61.14 + 52.75)
    assert truth.load[-1].sum() == pytest.approx(mass * G * np.cos(np.arctan(0.2)), rel=1e-3)
    assert truth.a_x[-1] == pytest.approx(G * np.sin(-truth.pitch[-1]), rel=2e-2)
    assert np.abs(truth.speed - 30 / 3.6).max() < 0.15


@pytest.mark.parametrize("speed", [1.0, 10.0, 30.0])
def test_a_drive_is_long_enough_for_what_it_does(speed):
    slope, change = DRIVES["slope"](speed), lane_change(speed, 0.05 * G)
    hill = slope.obstacles[0]
    assert slope.duration * speed > hill.start + hill.transition + 5.0
    path = change.maneuver.path
    assert change.duration * speed > path.begin + 2 * path.length + path.gap


def test_load_and_speed_stiffen_the_tire_of_one_suv():
    """In pressure, +-20 % of load are worth some 8 kPa and 40 to 80 km/h some 11 kPa."""
    tire = jax.tree.map(lambda leaf: leaf[0], suv(load_and_speed=True).tire.vertical)

    def stiffness(load, speed):
        spin = speed / 0.35
        deflection = deflection_at_load(load, spin, 250e3, tire)
        return float(vertical_stiffness(deflection, spin, 250e3, tire))

    slope = 264.7e3 * 0.7 / 250e3
    assert stiffness(5000.0, 0.0) == pytest.approx(264.7e3, rel=1e-6)
    by_load = (stiffness(6000.0, 10.0) - stiffness(4000.0, 10.0)) / slope / 2
    by_speed = (stiffness(5000.0, 80 / 3.6) - stiffness(5000.0, 40 / 3.6)) / slope
    assert by_load == pytest.approx(8e3, rel=0.5)
    assert by_speed == pytest.approx(11e3, rel=0.2)
    linear = jax.tree.map(lambda leaf: leaf[0], suv().tire.vertical)
    assert float(vertical_stiffness(0.01, 60.0, 250e3, linear)) == pytest.approx(264.7e3)
