"""Cornering drives of the full vehicle: symmetry, balances, and what the sensors add."""

from dataclasses import replace

import jax
import numpy as np
import pytest

from wheelhop.errors import InputError
from wheelhop.studies.solmaz.sensor_errors import SensorErrors, with_sensor_errors
from wheelhop.studies.solmaz.vehicle_drives import (
    CorneringRuns,
    LateralSignals,
    drive_cornering,
    lateral_suv,
    sound_vehicle,
)
from wheelhop.studies.solmaz.vehicle_maneuvers import (
    followed_lane_change,
    held_angle,
    slalom,
    steered_lane_change,
    straight_ahead,
)

SPEED = 25.0
CAR = sound_vehicle()
WAVE = slalom(SPEED, 3.0, CAR, frequency=0.5, begin=0.2)
MIRRORED = replace(WAVE, steer=replace(WAVE.steer, y=-WAVE.steer.y))
NAMES = ("sound", "soft", "mirrored", "heavy", "slippery", "straight")
RUNS = CorneringRuns(
    soft=np.array([[0, 0, 0, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0] * 4, [0] * 4, [0] * 4], bool),
    maneuvers=(WAVE, WAVE, MIRRORED, WAVE, WAVE, straight_ahead(SPEED)),
    friction=np.array([1.0, 1.0, 1.0, 1.0, 0.2, 1.0]),
    load=np.array([1.0, 1.0, 1.0, 1.2, 1.0, 1.0]),
)


@pytest.fixture(scope="module")
def drives():
    signals = drive_cornering(RUNS, duration=2.0)
    return {name: LateralSignals(*(leaf[k] for leaf in signals)) for k, name in enumerate(NAMES)}


def test_left_and_right_are_mirror_images(drives):
    one, other = drives["soft"], drives["mirrored"]
    for name in ("steer", "lateral_acceleration", "yaw_rate", "side_slip", "roll"):
        np.testing.assert_allclose(getattr(one, name), -getattr(other, name), atol=1e-9)
    np.testing.assert_allclose(one.load, other.load[:, [1, 0, 3, 2]], atol=1e-5)
    np.testing.assert_allclose(one.lateral, -other.lateral[:, [1, 0, 3, 2]], atol=1e-5)


def test_forces_balance_the_acceleration_less_gravity_on_the_leaning_body(drives):
    signals = drives["sound"]
    c = CAR.chassis
    mass = float(c.body_mass + c.wheel_mass.sum())
    true = signals.lateral_acceleration - 9.80665 * np.sin(signals.roll)
    rms = np.sqrt(np.mean((signals.lateral.sum(-1) / mass - true) ** 2))
    assert rms < 0.05 * np.abs(true).max()


def test_loads_carry_the_vehicle_and_its_payload(drives):
    c = CAR.chassis
    for name, load in (("straight", 1.0), ("heavy", 1.2)):
        weight = 9.80665 * float(load * c.body_mass + c.wheel_mass.sum())
        np.testing.assert_allclose(drives[name].load.sum(-1).mean(), weight, rtol=2e-3)


def test_a_soft_tyre_pulls_less_and_a_slippery_road_limits(drives):
    sound, soft, slippery = (drives[n] for n in ("sound", "soft", "slippery"))
    pulled = lambda s: np.sqrt(np.mean(s.lateral[:, 0] ** 2))  # noqa: E731
    assert pulled(soft) < 0.75 * pulled(sound)
    # the generic tyre's friction is at most 1.15 where it is hardly loaded
    assert np.all(np.abs(slippery.lateral) < 0.2 * 1.15 * slippery.load)
    assert np.abs(slippery.lateral_acceleration).max() < np.abs(sound.lateral_acceleration).max()


def test_the_driver_keeps_a_symmetric_car_straight(drives):
    straight = drives["straight"]
    for name in ("steer", "lateral_acceleration", "yaw_rate", "side_slip"):
        np.testing.assert_allclose(getattr(straight, name), 0.0, atol=1e-9)
    np.testing.assert_allclose(straight.speed, SPEED, rtol=2e-3)


def test_sensors_add_noise_and_offsets_of_the_stated_size():
    rng = np.random.default_rng(0)
    clean = LateralSignals(*rng.standard_normal((8, 40, 500)))
    noise, bias = SensorErrors(0.05, 0.002, 0.016, 0.02), SensorErrors(0.1, 0.0, 0.032, 0.0)
    found = with_sensor_errors(jax.random.key(1), clean, noise, bias)
    for name, sigma, offset in (
        ("steer", 0.001, 0.002),
        ("speed", 0.02, 0.0),
        ("lateral_acceleration", 0.05, 0.1),
        ("yaw_rate", 0.002, 0.0),
    ):
        error = np.asarray(getattr(found, name)) - getattr(clean, name)
        np.testing.assert_allclose(error.std(), sigma, rtol=0.03)
        np.testing.assert_allclose(error.mean(), offset, atol=4 * sigma / np.sqrt(error.size))
    none = SensorErrors()
    found = with_sensor_errors(jax.random.key(1), clean, none, biased=SensorErrors(0.1))
    error = np.asarray(found.lateral_acceleration) - clean.lateral_acceleration
    np.testing.assert_allclose(np.ptp(error, axis=1), 0.0, atol=1e-12)
    assert 0.07 < error[:, 0].std() < 0.13


def test_maneuvers_steer_what_they_say():
    angle = held_angle(SPEED, 3.0, CAR)
    lane = steered_lane_change(SPEED, 3.0, CAR, begin=1.0, period=2.0, gap=1.0)
    np.testing.assert_allclose(np.max(lane.steer.y), angle)
    np.testing.assert_allclose(lane.steer.x[:8], [1, 1.5, 2.5, 3, 4, 4.5, 5.5, 6])
    assert followed_lane_change(SPEED, 3.0).path.offset == 3.5
    assert straight_ahead(SPEED).follow == 1.0
    # without understeer from the tyres, the angle of a circle would be L / R alone
    assert angle > 3.0 * 2.818 / SPEED**2


def test_soft_tyres_lose_or_gain_stiffness_as_the_law_says():
    slope = lambda law: float(lateral_suv(law).tire.slip.ppy1[0])  # noqa: E731
    assert slope("falling") > 0.0 > slope("published")
    assert slope("none") == 0.0


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"soft": np.zeros((2, 4), bool)}, "soft"),
        ({"friction": np.full(6, 0.0)}, "friction"),
        ({"load": np.ones(5)}, "load"),
        ({"softened": 1e3}, "softened"),
        ({"law": "rising"}, "law"),
        ({"road_level": -1.0}, "road_level"),
    ],
)
def test_bad_runs_are_refused_before_anything_is_compiled(change, field):
    with pytest.raises(InputError, match=field):
        drive_cornering(replace(RUNS, **change), duration=2.0)


def test_bad_maneuvers_and_sensors_are_refused():
    with pytest.raises(InputError, match="peak"):
        steered_lane_change(SPEED, 50.0, CAR)
    with pytest.raises(InputError, match="frequency"):
        slalom(SPEED, 3.0, CAR, frequency=30.0)
    with pytest.raises(InputError, match="speed"):
        drive_cornering(replace(RUNS, maneuvers=(straight_ahead(80.0),) * 6))
    clean = LateralSignals(*np.zeros((8, 1, 2)))
    with pytest.raises(InputError, match="yaw_rate"):
        with_sensor_errors(jax.random.key(0), clean, SensorErrors(yaw_rate=-1.0))
