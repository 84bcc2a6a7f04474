"""What a sensor does to a signal: bias, noise, quantisation, dropouts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from wheelhop.errors import require_in_range


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Sensor:
    """A sensor's imperfections, in the unit of its signal.

    Attributes:
        noise: standard deviation of white Gaussian noise.
        bias: constant offset.
        resolution: quantisation step; 0 for none.
        dropout: probability that a sample is lost (NaN).
    """

    noise: Any = 0.0
    bias: Any = 0.0
    resolution: Any = 0.0
    dropout: Any = 0.0


DATASHEET_ACCELEROMETER = Sensor(noise=0.5)
"""0.5 m/s^2 of white noise: Brancati & Tufano 2022, section 5.3."""


def measure(key: Array, signal: Float[Array, " time"], sensor: Sensor) -> Float[Array, " time"]:
    """What the sensor reports of a signal.

    Args:
        key: JAX random key.
        signal: true values.
        sensor: its imperfections.

    Returns:
        signal + bias + noise, rounded to the resolution, NaN where the sample is lost.
    """
    noise_key, drop_key = jax.random.split(key)
    value = signal + sensor.bias
    value = value + sensor.noise * jax.random.normal(noise_key, signal.shape, signal.dtype)
    quantised = sensor.resolution > 0
    step = jnp.where(quantised, sensor.resolution, 1.0)
    value = jnp.where(quantised, step * jnp.round(value / step), value)
    lost = jax.random.uniform(drop_key, signal.shape) < sensor.dropout
    return jnp.where(lost, jnp.nan, value)


def validate(name: str, sensor: Sensor) -> Sensor:
    """The same sensor, checked.

    Raises:
        InputError: naming the figure that is out of range.
    """
    require_in_range(f"{name}.noise", sensor.noise, 0.0, 1e3, "m/s^2")
    require_in_range(f"{name}.bias", sensor.bias, -1e3, 1e3, "m/s^2")
    require_in_range(f"{name}.resolution", sensor.resolution, 0.0, 1e3, "m/s^2")
    require_in_range(f"{name}.dropout", sensor.dropout, 0.0, 0.99, "(probability)")
    return sensor
