"""The pressure-stiffness law against the paper's figures, and sensors by their statistics."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.signal import butter, sosfilt, sosfilt_zi

from wheelhop.errors import InputError
from wheelhop.vehicle import sensors
from wheelhop.vehicle.parameters import brancati_suv
from wheelhop.vehicle.sensors import Sensor, low_pass, measure
from wheelhop.vehicle.tire import (
    Tire,
    pressure_from_stiffness,
    pressure_slope,
    stiffness_from_pressure,
    validate,
)

TIRE = brancati_suv().tire


@pytest.mark.parametrize(
    ("kpa", "kilonewtons"), [(130, 175.8), (180, 212.8), (230, 249.9), (250, 264.7)]
)
def test_stiffness_of_the_suv_tyre(kpa, kilonewtons):
    assert stiffness_from_pressure(1e3 * kpa, TIRE) == pytest.approx(1e3 * kilonewtons, abs=60)


def test_pressure_and_stiffness_are_inverse():
    p = np.linspace(50e3, 400e3, 9)
    np.testing.assert_allclose(pressure_from_stiffness(stiffness_from_pressure(p, TIRE), TIRE), p)
    slope = jax.grad(lambda k: pressure_from_stiffness(k, TIRE))(2e5)
    assert float(slope) == pytest.approx(float(pressure_slope(TIRE)))


def test_unphysical_tyre_is_named():
    with pytest.raises(InputError, match=r"tire\.nominal_pressure: 2\.5 Pa is outside"):
        validate(Tire(264.7e3, 2.5, 0.7))


def test_noise_bias_and_dropout_have_their_statistics():
    signal = jnp.zeros(200_000)
    y = np.asarray(measure(jax.random.key(0), signal, Sensor(0.5, 0.2, 0.0, 0.05)))
    lost = np.isnan(y)
    assert lost.mean() == pytest.approx(0.05, abs=4 * np.sqrt(0.05 * 0.95 / len(y)))
    assert y[~lost].mean() == pytest.approx(0.2, abs=4 * 0.5 / np.sqrt(len(y)))
    assert y[~lost].std() == pytest.approx(0.5, rel=0.01)


def test_quantisation_rounds_to_the_step():
    y = np.asarray(measure(jax.random.key(0), jnp.linspace(-1, 1, 41), Sensor(resolution=0.1)))
    np.testing.assert_allclose(y / 0.1, np.round(y / 0.1), atol=1e-12)
    assert np.max(np.abs(y - np.linspace(-1, 1, 41))) <= 0.05 + 1e-12


def test_an_ideal_sensor_changes_nothing():
    signal = jnp.linspace(0, 1, 7)
    np.testing.assert_array_equal(measure(jax.random.key(1), signal, Sensor()), signal)


@pytest.mark.parametrize("hertz", [3.0, 40.0, 240.0])
def test_bandwidth_is_scipys_butterworth(hertz):
    rng = np.random.default_rng(4)
    signal = 9.0 + rng.normal(size=600)
    sections = butter(2, hertz, fs=500.0, output="sos")
    expected, _ = sosfilt(sections, signal, zi=signal[0] * sosfilt_zi(sections))
    found = jax.jit(low_pass)(jnp.asarray(signal), hertz, 1 / 500.0)
    np.testing.assert_allclose(found, expected, atol=1e-11)


def test_bandwidth_is_the_minus_3_db_frequency():
    t = np.arange(4000) / 1000.0
    late = t > 2.0
    wave = jnp.asarray(np.sin(2 * np.pi * 20.0 * t))
    found = np.asarray(measure(jax.random.key(0), wave, Sensor(bandwidth=20.0), 1e-3))
    assert np.sqrt(2) * found[late].std() == pytest.approx(np.sqrt(0.5), rel=1e-3)


def test_without_a_finite_bandwidth_nothing_changes():
    signal = jnp.asarray(np.random.default_rng(1).normal(size=50))
    noisy = Sensor(0.3, 0.1, 0.01, 0.1)
    old = measure(jax.random.key(3), signal, noisy)
    np.testing.assert_array_equal(measure(jax.random.key(3), signal, noisy, 1e-3), old)
    np.testing.assert_array_equal(low_pass(signal, 600.0, 1e-3), signal)


def test_bandwidth_filters_the_signal_and_not_the_noise():
    y = np.asarray(measure(jax.random.key(0), jnp.zeros(20_000), Sensor(0.5, bandwidth=5.0), 1e-3))
    assert y.std() == pytest.approx(0.5, rel=0.02)
    assert abs(np.corrcoef(y[1:], y[:-1])[0, 1]) < 0.03


def test_impossible_sensor_is_named():
    with pytest.raises(InputError, match=r"sensor\.dropout: 1\.5"):
        sensors.validate("sensor", Sensor(dropout=1.5))
    with pytest.raises(InputError, match=r"sensor\.bandwidth: 0 Hz"):
        sensors.validate("sensor", Sensor(bandwidth=0.0))
