"""Half car: both corners of an axle with an anti-roll bar, by the Youla observer.

The bar's force k_b (q - q_other) is one more term of the inverse of Filipozzi et al. 2021, Eq. 14,
who say that it is needed and leave it out. In mean and difference of the two sides the axle is two
quarter cars with the stiffnesses k and k + 2 k_b.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from wheelhop.estimators.inverse_load import (
    Inverse,
    InverseParams,
    LoadSensors,
    inverse_observer,
    times_polynomial,
    undone,
)
from wheelhop.estimators.wheel_load import LoadObserver
from wheelhop.estimators.youla_load import constant_loads, unknown_before
from wheelhop.filtering.gaussian import Gaussian


class AxleSample(NamedTuple):
    """What the sensors of an axle say, as two `LoadSample`s; [m/s^2] and [m]."""

    body_acceleration_left: Any
    body_acceleration_right: Any
    deflection_left: Any
    deflection_right: Any


class AxleLoad(NamedTuple):
    """The unknown inputs of an axle, as two `WheelLoad`s [N]."""

    normal_left: Any
    normal_right: Any
    transfer_left: Any
    transfer_right: Any


@lru_cache(maxsize=1)
def axle_youla() -> LoadObserver:
    """The observer of an axle; its parameters are `youla_params` of corners [2, ...]."""
    return inverse_observer(axle_inverse, AxleLoad, _noise)


def unknown_axle_before(deflection: Any = 0.0) -> Gaussian:
    """Prior of a record that begins at any time, as `youla_load.unknown_before`."""
    (at, ((a,), (zero, q))) = unknown_before(deflection)
    mean = AxleSample(at[0], at[0], at[1], at[1])
    return Gaussian(mean, ((a,), (zero, a), (zero, zero, q), (zero, zero, zero, q)))


def axle_inverse(params: InverseParams) -> Inverse:
    """Inverse of an axle with a bar, the sensors' own dynamics undone.

    Args:
        params: of corners [2, ...]; the bar is that of the left one.
    """
    sides = [jax.tree.map(lambda leaf, k=k: jnp.asarray(leaf)[k], params.corner) for k in (0, 1)]
    bar = sides[0].anti_roll
    a = undone(params.sensors.acceleration_bandwidth)
    q = undone(params.sensors.deflection_bandwidth)
    normal: list[Any] = []
    transfer: list[Any] = []
    constants = []
    for k, c in enumerate(sides):
        across = [-bar * x for x in q]
        strut = times_polynomial([c.stiffness + bar, c.damping], q)
        wheel = times_polynomial([c.stiffness + bar, c.damping, c.unsprung_mass], q)
        for rows, mass, own in (
            (normal, c.unsprung_mass, wheel),
            (transfer, -c.sprung_mass, strut),
        ):
            row: list[Any] = [[mass * x for x in a], [], own, across]
            rows.append(row if k == 0 else [row[1], row[0], row[3], row[2]])
        constants.append(constant_loads(c))
    (left, left_transfer), (right, right_transfer) = constants
    return Inverse((*normal, *transfer), (left, right, left_transfer, right_transfer))


def _noise(sensors: LoadSensors) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
    a, q = sensors.acceleration_noise, sensors.deflection_noise
    a_drift, q_drift = sensors.acceleration_drift, sensors.deflection_drift
    return (a, a, q, q), (a_drift, a_drift, q_drift, q_drift)
