"""What the sensors of stability control report of a drive."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp

from wheelhop.errors import require_in_range
from wheelhop.estimators.lateral import LateralSample
from wheelhop.studies.solmaz.vehicle_drives import LateralSignals


@dataclass(frozen=True)
class SensorErrors:
    """Of every sensor a standard deviation or a constant.

    Attributes:
        lateral_acceleration: [m/s^2].
        yaw_rate: [rad/s].
        steering_wheel: [rad], at the steering wheel.
        speed: [m/s].
    """

    lateral_acceleration: float = 0.0
    yaw_rate: float = 0.0
    steering_wheel: float = 0.0
    speed: float = 0.0


STABILITY_CONTROL = SensorErrors(0.05, 0.002, 0.002, 0.02)
"""Noise of the sensors of stability control."""


def with_sensor_errors(
    key: Any,
    signals: LateralSignals,
    noise: SensorErrors = STABILITY_CONTROL,
    bias: SensorErrors = SensorErrors(),
    biased: SensorErrors = SensorErrors(),
    steering_ratio: float = 16.0,
) -> LateralSample:
    """What the sensors report, [runs, time].

    Args:
        key: JAX random key.
        signals: of the vehicle.
        noise: standard deviations of white noise.
        bias: constants, the same in every run.
        biased: standard deviations of further constants, drawn for every run.
        steering_ratio: steering-wheel angle per front wheel angle [-].

    Raises:
        InputError: for a standard deviation that is negative.
    """
    for name, errors in (("noise", noise), ("biased", biased)):
        for sensor, size in vars(errors).items():
            require_in_range(f"{name}.{sensor}", size, 0.0, 10.0, "(unit of the sensor)")
    entries = (
        ("steering_wheel", signals.steer, 1.0 / steering_ratio),
        ("speed", signals.speed, 1.0),
        ("lateral_acceleration", signals.lateral_acceleration, 1.0),
        ("yaw_rate", signals.yaw_rate, 1.0),
    )
    keys = jax.random.split(key, 2 * len(entries))
    reported = []
    for k, (name, signal, scale) in enumerate(entries):
        clean = jnp.asarray(signal, jnp.result_type(float))
        white = jax.random.normal(keys[2 * k], clean.shape, clean.dtype)
        drawn = jax.random.normal(keys[2 * k + 1], (clean.shape[0], 1), clean.dtype)
        error = getattr(noise, name) * white + getattr(biased, name) * drawn + getattr(bias, name)
        reported.append(clean + scale * error)
    return LateralSample(*reported)
