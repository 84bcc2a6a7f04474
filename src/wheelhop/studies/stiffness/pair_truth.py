"""Axle pairs that no filter simulates: the rear wheel meets the front wheel's road, and its own."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.estimators.axle_pair_model import PairSample
from wheelhop.estimators.axle_pair_settings import AxlePairTuning
from wheelhop.studies.stiffness.frame import PRESSURES, RATE, SPEEDS, StiffnessSettings
from wheelhop.studies.stiffness.truth import FLEET, levels, speeds, uniform
from wheelhop.vehicle.parameters import BRANCATI_TABLE_1, QuarterCar
from wheelhop.vehicle.quarter_car import Accelerations, RelativeState
from wheelhop.vehicle.road import road_velocity_intensity
from wheelhop.vehicle.scenario import simulate_and_measure
from wheelhop.vehicle.sensors import Sensor

WHEELBASE = BRANCATI_TABLE_1.front_semi_wheelbase + BRANCATI_TABLE_1.rear_semi_wheelbase
"""l [m]."""

AXLES = ("front", "rear")


class PairDrives(NamedTuple):
    """What is driven, each [runs] but for the pressure, [runs, 2].

    Attributes:
        pressure: of the tyres [Pa].
        level: Gd(W0) of both roads [m^3/rad].
        speed: v [m/s].
        steps: fine steps of simulation from the front wheel's passing to the rear wheel's.
        indicated: speed that the estimator is told [m/s].
    """

    pressure: np.ndarray
    level: np.ndarray
    speed: np.ndarray
    steps: np.ndarray
    indicated: np.ndarray


def pair_drives(settings: StiffnessSettings) -> PairDrives:
    """Draws of every run; the rear wheel comes a whole number of fine steps later."""
    pressure = [uniform(f"axle pair, {axle}", settings, *PRESSURES) for axle in AXLES]
    fine = 1.0 / (RATE * settings.substeps)
    steps = np.round(WHEELBASE / (speeds("axle pair", settings) * fine)).astype(int)
    speed = WHEELBASE / (steps * fine)
    # an error of the indicated speed as the estimator's prior has it, uniform
    off = np.sqrt(3.0) * AxlePairTuning().speed_sigma
    error = np.exp(uniform("axle pair, indicated speed", settings, -off, off))
    return PairDrives(
        np.stack(pressure, axis=1), levels("axle pair", settings), speed, steps, speed * error
    )


def simulated_pair(
    cars: tuple[QuarterCar, ...],
    drives: PairDrives,
    coherence: float,
    samples: int,
    settings: StiffnessSettings,
) -> PairSample:
    """What both corners measure, entries [runs, time]; the sensors' noise is that of the settings.

    Args:
        cars: front and rear corner.
        drives: what is driven.
        coherence: of the two wheels' roads, equal at all wavelengths.
        samples: of the logs.
        settings: noise, seed and steps.
    """
    runs = len(drives.speed)
    width = min(FLEET, runs)
    longest = int(np.ceil(1.05 * WHEELBASE / SPEEDS[0] * RATE * settings.substeps))
    work = _simulator(samples, settings.substeps, longest, settings.noise)
    root = jax.random.fold_in(jax.random.key(settings.seed), zlib.crc32(b"axle pair"))
    leaves = jax.tree.map(lambda a: jnp.asarray(a, float), cars)
    parts = []
    for first in range(0, runs, width):
        numbers = np.minimum(np.arange(first, first + width), runs - 1)
        keys = jax.vmap(lambda n: jax.random.fold_in(root, n))(jnp.asarray(numbers))
        each = [jnp.asarray(a[numbers], float) for a in drives[:3]]
        found = work(keys, leaves, *each, jnp.asarray(drives.steps[numbers]), coherence)
        parts.append(jax.tree.map(np.asarray, found))
    return jax.tree.map(lambda *a: np.concatenate(a)[:runs], *parts)


@lru_cache(maxsize=4)
def _simulator(samples: int, substeps: int, longest: int, noise: float) -> Callable[..., Any]:
    sensors = (Sensor(noise=noise), Sensor(noise=noise))
    fine = samples * substeps

    def one(
        key: Any, cars: Any, pressure: Any, level: Any, speed: Any, steps: Any, coherence: Any
    ) -> PairSample:
        shared, own, *of_sensors = jax.random.split(key, 4)
        step = jnp.sqrt(road_velocity_intensity(level, speed) / (RATE * substeps))
        road = jax.random.normal(shared, (longest + fine,), step.dtype)
        alone = jax.random.normal(own, (fine,), step.dtype)
        behind = jax.lax.dynamic_slice(road, (longest - steps,), (fine,))
        rest = jnp.sqrt(1.0 - coherence * coherence)
        rises = (road[longest:], coherence * behind + rest * alone)
        zero = jnp.zeros_like(step)
        still = RelativeState(zero, zero, zero, zero)
        measured = [
            simulate_and_measure(
                k, car, still, p, (step * rise).reshape(samples, substeps), 1.0 / RATE, sensors
            )[1]
            for k, car, p, rise in zip(of_sensors, cars, pressure, rises, strict=True)
        ]
        return PairSample(*(Accelerations(*m) for m in measured))

    return jax.jit(jax.vmap(one, in_axes=(0, None, 0, 0, 0, 0, None)))
