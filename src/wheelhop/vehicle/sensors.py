"""What a sensor does to a signal: bandwidth, bias, noise, quantisation, dropouts."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from wheelhop.errors import InputError, require_in_range


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Sensor:
    """A sensor's imperfections, in the unit of its signal.

    Attributes:
        noise: standard deviation of white Gaussian noise.
        bias: constant offset.
        resolution: quantisation step; 0 for none.
        dropout: probability that a sample is lost (NaN).
        bandwidth: -3 dB frequency [Hz] of a second-order Butterworth low-pass before the noise;
            infinite for a sensor that follows at once.
    """

    noise: Any = 0.0
    bias: Any = 0.0
    resolution: Any = 0.0
    dropout: Any = 0.0
    bandwidth: Any = math.inf


DATASHEET_ACCELEROMETER = Sensor(noise=0.5)
"""0.5 m/s^2 of white noise: Brancati & Tufano 2022, section 5.3."""


def measure(
    key: Array, signal: Float[Array, " time"], sensor: Sensor, dt: Any = None
) -> Float[Array, " time"]:
    """What the sensor reports of a signal.

    Args:
        key: JAX random key.
        signal: true values.
        sensor: its imperfections.
        dt: sampling interval [s], which a finite bandwidth needs; without it the bandwidth is
            left out.

    Returns:
        low-passed signal + bias + noise, rounded to the resolution, NaN where the sample is
        lost.
    """
    noise_key, drop_key = jax.random.split(key)
    if dt is not None:
        signal = low_pass(signal, sensor.bandwidth, dt)
    value = signal + sensor.bias
    value = value + sensor.noise * jax.random.normal(noise_key, signal.shape, signal.dtype)
    quantised = sensor.resolution > 0
    step = jnp.where(quantised, sensor.resolution, 1.0)
    value = jnp.where(quantised, step * jnp.round(value / step), value)
    lost = jax.random.uniform(drop_key, signal.shape) < sensor.dropout
    return jnp.where(lost, jnp.nan, value)


def low_pass(signal: Float[Array, " time"], bandwidth: Any, dt: Any) -> Float[Array, " time"]:
    """Second-order Butterworth low-pass, at rest on the first sample.

    Bilinear transform with the -3 dB frequency kept exact (prewarped). An infinite bandwidth, or
    one at or beyond the Nyquist frequency, passes the signal unchanged.

    Args:
        signal: [time].
        bandwidth: -3 dB frequency [Hz].
        dt: sampling interval [s].
    """
    bandwidth = jnp.asarray(bandwidth, signal.dtype)
    acts = bandwidth * dt < 0.5
    w = jnp.tan(jnp.pi * dt * jnp.where(acts, bandwidth, 0.25 / dt))
    scale = 1.0 / (1.0 + math.sqrt(2.0) * w + w * w)
    gain = w * w * scale
    back1, back2 = 2.0 * (w * w - 1.0) * scale, (1.0 - math.sqrt(2.0) * w + w * w) * scale

    def step(carry: Any, u: Any) -> tuple[Any, Any]:
        # transposed direct form II
        s1, s2 = carry
        y = gain * u + s1
        return (2.0 * gain * u - back1 * y + s2, gain * u - back2 * y), y

    first = signal[0]
    rest = ((1.0 - gain) * first, (gain - back2) * first)
    filtered = jax.lax.scan(step, rest, signal)[1]
    return jnp.where(acts, filtered, signal)


def validate(name: str, sensor: Sensor, unit: str = "m/s^2") -> Sensor:
    """The same sensor, checked.

    Args:
        name: of the sensor, for the message.
        sensor: to check.
        unit: of its signal.

    Raises:
        InputError: naming the figure that is out of range.
    """
    require_in_range(f"{name}.noise", sensor.noise, 0.0, 1e3, unit)
    require_in_range(f"{name}.bias", sensor.bias, -1e3, 1e3, unit)
    require_in_range(f"{name}.resolution", sensor.resolution, 0.0, 1e3, unit)
    require_in_range(f"{name}.dropout", sensor.dropout, 0.0, 0.99, "(probability)")
    if not float(sensor.bandwidth) > 0:
        raise InputError(
            f"{name}.bandwidth",
            f"{float(sensor.bandwidth):g} Hz",
            "Give a positive frequency, or inf for none.",
        )
    return sensor
