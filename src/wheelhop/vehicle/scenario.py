"""Drive one virtual corner over a road and log what its sensors report."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.errors import DivergenceError, InputError, require_in_range
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.quarter_car import Accelerations, RelativeState, Simulation, simulate
from wheelhop.vehicle.record import LARGEST_ACCELERATION, MINIMUM_SAMPLES, CornerRecord
from wheelhop.vehicle.road.profile import Profile, elevation_at, without_aliases
from wheelhop.vehicle.road.shape_filter import elevations, stationary_variance
from wheelhop.vehicle.sensors import DATASHEET_ACCELEROMETER, Sensor, measure
from wheelhop.vehicle.tire import require_stiff, stiffness_from_pressure

RATE = 500.0
"""Default sampling rate of a virtual log [Hz]."""

SUBSTEPS = 10
"""Default simulation steps per sample: the truth is ten times finer than the filter."""


@dataclass(frozen=True)
class Leak:
    """Pressure over time: `start` until `begin`, then linearly to `end` at `finish`.

    Attributes:
        start: pressure before [Pa].
        end: pressure after [Pa].
        begin: time [s] the leak begins.
        finish: time [s] it has ended.
    """

    start: float
    end: float
    begin: float = 0.0
    finish: float = 1.0

    def at(self, t: np.ndarray) -> np.ndarray:
        """Pressure [Pa] at times [s]."""
        return np.interp(
            t, [self.begin, max(self.finish, self.begin + 1e-9)], [self.start, self.end]
        )


def constant_pressure(pressure: float) -> Leak:
    """A tyre that holds its pressure [Pa]."""
    return Leak(pressure, pressure)


def road_rise_from_profile(
    profile: Profile,
    speed: float,
    duration: float,
    rate: float = RATE,
    substeps: int = SUBSTEPS,
    reflect: bool = False,
) -> np.ndarray:
    """Rise of the road [m] in every fine step, [time, substeps], at constant speed [m/s].

    A road sampled more finely than the steps is low-passed first, so that nothing aliases.

    Args:
        profile: measured road.
        speed: v [m/s].
        duration: of the drive [s].
        rate: sampling rate [Hz].
        substeps: simulation steps per sample.
        reflect: continue a road that is too short there and back.
    """
    samples = round(duration * rate)
    travel = speed / (rate * substeps)
    x = travel * np.arange(samples * substeps + 1)
    z = elevation_at(without_aliases(profile, travel), x, reflect)
    return np.diff(z).reshape(samples, substeps)


def road_rise_of_class(
    key: Any,
    level: Any,
    travel: Any,
    convention: str = "iso8608",
) -> Any:
    """Rise of a random road [m] in every fine step, by the exact shape filter.

    Args:
        key: JAX random key.
        level: Gd(W0) [m^3/rad], [] or [time, substeps] where the class changes.
        travel: distance [m] driven in every fine step, [time, substeps].
        convention: of the level, "iso8608" or "brancati2022".
    """
    variance = jnp.broadcast_to(stationary_variance(level, convention), travel.shape)
    z = elevations(key, variance.ravel(), travel.ravel())
    return jnp.diff(z).reshape(travel.shape)


def drive(
    key: Any,
    car: QuarterCar,
    road_rise: Any,
    pressure: Leak,
    speed: float,
    rate: float = RATE,
    sensors: tuple[Sensor, Sensor] = (DATASHEET_ACCELEROMETER, DATASHEET_ACCELEROMETER),
) -> tuple[CornerRecord, Simulation]:
    """A log of the corner from rest over a road, and the truth behind it.

    Args:
        key: JAX random key of the sensors.
        car: the corner.
        road_rise: rise of the road [m], [time, substeps].
        pressure: tyre pressure over time.
        speed: v [m/s].
        rate: sampling rate [Hz].
        sensors: of the body and of the wheel.

    Raises:
        InputError: if speed, rate, duration or pressure is out of range.
        DivergenceError: if the simulation does not stay physical.
    """
    require_in_range("speed", speed, 1.0, 100.0, "m/s")
    require_in_range("rate", rate, 50.0, 20e3, "Hz")
    require_in_range("pressure", min(pressure.start, pressure.end), 20e3, 1.5e6, "Pa")
    require_in_range("pressure", max(pressure.start, pressure.end), 20e3, 1.5e6, "Pa")
    require_stiff(car.tire, min(pressure.start, pressure.end))
    if road_rise.shape[0] < MINIMUM_SAMPLES:
        raise InputError(
            "duration",
            f"{road_rise.shape[0] / rate:.3g} s at {rate:g} Hz are {road_rise.shape[0]} samples",
            f"Drive longer or sample faster: a log needs {MINIMUM_SAMPLES} samples.",
        )
    t = np.arange(1, road_rise.shape[0] + 1) / rate
    p = pressure.at(t)
    rise = jnp.asarray(road_rise, float)
    zero = jnp.zeros((), rise.dtype)
    start = RelativeState(zero, zero, zero, zero)
    simulation, ys = _simulate_and_measure(
        key, car, start, jnp.asarray(p, rise.dtype), rise, 1.0 / rate, sensors
    )
    _refuse_runaway(simulation, t)
    elevation = np.cumsum(np.sum(np.asarray(road_rise, float), axis=1))
    record = CornerRecord(
        t,
        np.asarray(ys.a_s, float),
        np.asarray(ys.a_u, float),
        np.full(len(t), float(speed)),
        p,
        elevation,
    )
    return record, jax.tree.map(np.asarray, simulation)


def simulate_and_measure(
    key: Any,
    car: QuarterCar,
    start: RelativeState,
    pressure: Any,
    road_rise: Any,
    dt: Any,
    sensors: tuple[Sensor, Sensor],
) -> tuple[Simulation, Accelerations]:
    """Truth and measurements of one corner; pure, so it jits and vmaps.

    Args:
        key: JAX random key of the sensors.
        car: the corner.
        start: initial motion.
        pressure: tyre pressure [Pa], [] or [time].
        road_rise: rise of the road [m], [time, substeps].
        dt: sampling interval [s].
        sensors: of the body and of the wheel.
    """
    stiffness = stiffness_from_pressure(pressure, car.tire)
    simulation = simulate(start, stiffness, road_rise, dt, car)
    body, wheel = jax.random.split(key)
    return simulation, Accelerations(
        measure(body, simulation.accelerations.a_s, sensors[0]),
        measure(wheel, simulation.accelerations.a_u, sensors[1]),
    )


_simulate_and_measure = jax.jit(simulate_and_measure)


def constant_travel(speed: Any, samples: int, rate: float, substeps: int = SUBSTEPS) -> Any:
    """Distance [m] driven in every fine step at constant speed [m/s], [time, substeps]."""
    return jnp.full((samples, substeps), speed / (rate * substeps))


def _refuse_runaway(simulation: Simulation, t: np.ndarray) -> None:
    a_u = np.abs(np.asarray(simulation.accelerations.a_u))
    bad = np.flatnonzero(~(a_u < LARGEST_ACCELERATION))
    if bad.size:
        raise DivergenceError(
            f"the simulated wheel acceleration leaves {LARGEST_ACCELERATION:g} m/s^2 at t = "
            f"{t[bad[0]]:.4g} s; check masses and damping, or raise the sampling rate"
        )
