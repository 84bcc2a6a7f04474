"""The pressure-stiffness law against the paper's figures, and sensors by their statistics."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from wheelhop.errors import InputError
from wheelhop.vehicle import sensors
from wheelhop.vehicle.parameters import brancati_suv
from wheelhop.vehicle.sensors import Sensor, measure
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


def test_impossible_sensor_is_named():
    with pytest.raises(InputError, match=r"sensor\.dropout: 1\.5"):
        sensors.validate("sensor", Sensor(dropout=1.5))
