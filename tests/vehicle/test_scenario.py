"""A virtual drive: the road under the wheel, the leak, and the log it leaves."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from wheelhop.errors import DivergenceError, InputError
from wheelhop.vehicle.parameters import brancati_suv
from wheelhop.vehicle.road import Profile, class_level, road_velocity_intensity
from wheelhop.vehicle.scenario import (
    Leak,
    constant_pressure,
    drive,
    road_rise_from_profile,
    road_rise_of_class,
)
from wheelhop.vehicle.sensors import Sensor

CAR = brancati_suv()
IDEAL = (Sensor(), Sensor())


def test_rises_add_up_to_the_elevation_under_the_wheel():
    x = 0.05 * np.arange(2001)
    profile = Profile(0.05, 0.02 * np.sin(0.8 * x))
    rise = road_rise_from_profile(profile, speed=20.0, duration=4.0, rate=200.0, substeps=5)
    assert rise.shape == (800, 5)
    at_samples = np.cumsum(rise.sum(axis=1))
    expected = 0.02 * np.sin(0.8 * 20.0 * np.arange(1, 801) / 200.0)
    np.testing.assert_allclose(at_samples, expected, atol=1e-7)


def test_a_fine_road_does_not_alias_at_high_speed():
    """Waves of 30 mm, met at steps of 50 mm, must vanish rather than turn into long ones."""
    x = 0.005 * np.arange(40_001)
    profile = Profile(0.005, 1e-3 * np.sin(2 * np.pi * x / 0.03))
    rise = road_rise_from_profile(profile, speed=50.0, duration=3.0, rate=100.0, substeps=10)
    assert np.abs(rise[20:-20]).max() < 2e-6


def test_a_random_road_has_the_intensity_of_its_class_on_both_sides_of_a_change():
    travel = jnp.full((4000, 10), 0.004)
    levels = jnp.where(jnp.arange(4000)[:, None] < 2000, class_level("A"), class_level("D"))
    levels = jnp.broadcast_to(levels, travel.shape)
    rise = np.asarray(road_rise_of_class(jax.random.key(0), levels, travel))
    for part, name in ((rise[:2000], "A"), (rise[2001:], "D")):
        expected = road_velocity_intensity(class_level(name), 1.0) * 0.004
        assert np.var(part) == pytest.approx(expected, rel=0.05)


def test_leak_is_linear_between_its_ends():
    leak = Leak(230e3, 180e3, 6.0, 12.0)
    np.testing.assert_allclose(
        leak.at(np.array([0.0, 6.0, 9.0, 12.0, 20.0])) / 1e3, [230, 230, 205, 180, 180]
    )
    assert constant_pressure(2e5).at(np.array([0.0, 99.0])).tolist() == [2e5, 2e5]


def test_an_ideal_log_is_the_simulation():
    rise = 1e-4 * np.random.default_rng(0).normal(size=(300, 4))
    record, truth = drive(jax.random.key(0), CAR, rise, constant_pressure(2e5), 15.0, 500.0, IDEAL)
    np.testing.assert_array_equal(record.a_u, truth.accelerations.a_u)
    assert record.t[0] == pytest.approx(0.002)
    assert record.dt == pytest.approx(0.002)
    assert np.all(record.v == 15.0)


@pytest.mark.parametrize(
    ("pressure", "speed", "message"),
    [(Leak(2e5, 3.0), 15.0, "pressure: 3 Pa"), (Leak(2e5, 2e5), -4.0, "speed: -4 m/s")],
)
def test_impossible_drives_are_named(pressure, speed, message):
    with pytest.raises(InputError, match=message):
        drive(jax.random.key(0), CAR, np.zeros((60, 4)), pressure, speed)


def test_a_tyre_that_would_pull_is_named():
    soft = replace(CAR, tire=replace(CAR.tire, pressure_coefficient=1.2))
    with pytest.raises(InputError, match=r"tire\.pressure_coefficient: 1\.2 makes the tyre"):
        drive(jax.random.key(0), soft, np.zeros((60, 4)), constant_pressure(40e3), 15.0)


def test_too_few_samples_are_named():
    with pytest.raises(InputError, match="are 7 samples"):
        drive(jax.random.key(0), CAR, np.zeros((7, 4)), constant_pressure(2e5), 15.0)


def test_an_unstable_simulation_is_not_written_as_a_log():
    stiff = replace(CAR, unsprung_mass=5.0, suspension=replace(CAR.suspension, damping=2e4))
    rise = 1e-4 * np.random.default_rng(0).normal(size=(300, 1))
    with pytest.raises(DivergenceError, match="raise the sampling rate"):
        drive(jax.random.key(0), stiff, rise, constant_pressure(2e5), 15.0, 100.0)
