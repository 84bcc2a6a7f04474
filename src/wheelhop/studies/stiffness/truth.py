"""Quarter cars that no filter simulates: a finer step, and roads of the exact ISO spectrum."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.studies.stiffness.frame import RATE, SPEEDS, StiffnessSettings
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.quarter_car import Accelerations, RelativeState
from wheelhop.vehicle.road import class_level, road_velocity_intensity
from wheelhop.vehicle.scenario import constant_travel, road_rise_of_class, simulate_and_measure
from wheelhop.vehicle.sensors import Sensor

ROADS = ("white", "shaped")
"""Kinds of roads: white in velocity, which is the ISO 8608 spectrum of waviness 2 at every
wavenumber, and by the shape filter of Brancati & Tufano 2022, Eq. 5, which levels off below a
cut-off."""

LEVELS = (class_level("A") / 2.0, class_level("D") * 2.0)
"""Gd(W0) [m^3/rad] at the smooth edge of class A and at the rough edge of class D."""

FLEET = 50
"""Runs that are simulated at once."""


class Drives(NamedTuple):
    """Runs of one corner.

    Attributes:
        pressure: of the tyre [Pa], [runs, time].
        level: Gd(W0) of the road [m^3/rad], [runs, time].
        speed: v [m/s], [runs].
    """

    pressure: np.ndarray
    level: np.ndarray
    speed: np.ndarray


def times(duration: float) -> np.ndarray:
    """Times of the samples [s]."""
    return np.arange(1, round(duration * RATE) + 1) / RATE


def uniform(name: str, settings: StiffnessSettings, low: float, high: float) -> np.ndarray:
    """A draw for each run, [runs]; a run's depends on its number, the name and the seed alone."""
    word = zlib.crc32(name.encode())
    return np.array(
        [
            np.random.default_rng([settings.seed, word, run]).uniform(low, high)
            for run in range(settings.runs)
        ]
    )


def speeds(name: str, settings: StiffnessSettings) -> np.ndarray:
    """Speed of each run [m/s], [runs]."""
    return uniform(f"{name}, speed", settings, *SPEEDS)


def levels(name: str, settings: StiffnessSettings) -> np.ndarray:
    """Level of each run's road [m^3/rad], [runs]: its logarithm is uniform between `LEVELS`."""
    return np.exp(uniform(f"{name}, level", settings, *np.log(LEVELS)))


def simulated(
    name: str,
    car: QuarterCar,
    drives: Drives,
    settings: StiffnessSettings,
    road: str = "white",
) -> Accelerations:
    """What the accelerometers of a quarter car measure, entries [runs, time].

    Args:
        name: of the Monte Carlo; draws of another name are independent.
        car: the corner.
        drives: what is driven.
        settings: noise, seed and steps.
        road: one of `ROADS`.
    """
    runs, samples = drives.pressure.shape
    width = min(FLEET, runs)
    work = _simulator(samples, settings.substeps, road, settings.noise)
    root = jax.random.fold_in(jax.random.key(settings.seed), zlib.crc32(name.encode()))
    leaves = jax.tree.map(lambda a: jnp.asarray(a, float), car)
    parts = []
    for first in range(0, runs, width):
        numbers = np.minimum(np.arange(first, first + width), runs - 1)
        keys = jax.vmap(lambda n: jax.random.fold_in(root, n))(jnp.asarray(numbers))
        each = [jnp.asarray(a[numbers], float) for a in drives]
        parts.append(jax.tree.map(np.asarray, work(keys, leaves, *each)))
    return Accelerations(*(np.concatenate(p)[:runs] for p in zip(*parts, strict=True)))


@lru_cache(maxsize=16)
def _simulator(samples: int, substeps: int, road: str, noise: float) -> Callable[..., Any]:
    sensors = (Sensor(noise=noise), Sensor(noise=noise))

    def one(key: Any, car: QuarterCar, pressure: Any, level: Any, speed: Any) -> Accelerations:
        of_road, of_sensors = jax.random.split(key)
        rise = _rise(of_road, level, speed, substeps, road)
        zero = jnp.zeros((), rise.dtype)
        rest = RelativeState(zero, zero, zero, zero)
        return simulate_and_measure(of_sensors, car, rest, pressure, rise, 1.0 / RATE, sensors)[1]

    return jax.jit(jax.vmap(one, in_axes=(0, None, 0, 0, 0)))


def _rise(key: Any, level: Any, speed: Any, substeps: int, road: str) -> Any:
    """Rise of the road [m] in every fine step, [time, substeps]."""
    shape = (level.shape[0], substeps)
    if road == "white":
        variance = road_velocity_intensity(level, speed) / (RATE * substeps)
        return jnp.sqrt(variance)[:, None] * jax.random.normal(key, shape, level.dtype)
    every = jnp.broadcast_to(level[:, None], shape)
    return road_rise_of_class(key, every, constant_travel(speed, shape[0], RATE, substeps))
