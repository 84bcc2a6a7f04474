"""Drive a full vehicle and log what its sensors report, with the truth beside it."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from functools import lru_cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.errors import InputError
from wheelhop.staging import native_jit, staged_jit
from wheelhop.vehicle import sensors as _sensors
from wheelhop.vehicle.drive_checks import (
    check_drive,
    checked_surroundings,
    refuse_runaway,
    warn_of_rims,
)
from wheelhop.vehicle.equilibrium import require_rest, state_at_rest, static_equilibrium
from wheelhop.vehicle.full_vehicle import FullVehicle, Surroundings
from wheelhop.vehicle.full_vehicle_parameters import CORNERS, as_arrays
from wheelhop.vehicle.maneuver import Maneuver
from wheelhop.vehicle.pressure_course import PressureCourse, pressure_at
from wheelhop.vehicle.record import CornerRecord
from wheelhop.vehicle.road.surface import RoadSurface, road_under
from wheelhop.vehicle.sensors import Sensor, measure
from wheelhop.vehicle.simulation import RATE, SUBSTEPS, Signals, simulate_vehicle


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class SensorSuite:
    """Sensors of the vehicle, each in the SI unit of its signal.

    Attributes:
        body_acceleration: vertical, on the body above each wheel [m/s^2].
        wheel_acceleration: vertical, on each wheel carrier [m/s^2].
        compression: of each strut [m].
        wheel_speed: of each wheel [rad/s].
        acceleration: a_x and a_y at the body's centre of mass [m/s^2].
        rotation: gyroscope [rad/s].
        steering: steering-wheel angle [rad].
        speed: of the vehicle [m/s].
    """

    body_acceleration: Sensor = _sensors.DATASHEET_ACCELEROMETER
    wheel_acceleration: Sensor = _sensors.DATASHEET_ACCELEROMETER
    compression: Sensor = field(default=Sensor(noise=5e-4))
    wheel_speed: Sensor = field(default=Sensor(noise=0.05))
    acceleration: Sensor = field(default=Sensor(noise=0.05))
    rotation: Sensor = field(default=Sensor(noise=2e-3))
    steering: Sensor = field(default=Sensor(noise=2e-3))
    speed: Sensor = field(default=Sensor(noise=0.02))


UNITS = {
    "body_acceleration": "m/s^2",
    "wheel_acceleration": "m/s^2",
    "compression": "m",
    "wheel_speed": "rad/s",
    "acceleration": "m/s^2",
    "rotation": "rad/s",
    "steering": "rad",
    "speed": "m/s",
}
"""Unit of each sensor's signal."""


@dataclass(frozen=True)
class VehicleRecord:
    """A log of the whole vehicle.

    Attributes:
        t: time [s], [time].
        measured: what the sensors report, by column name; corners as a suffix, `a_s_FL`.
        truth: the noise-free signals, [time] or [time, 4].
        units: of the columns.
    """

    t: np.ndarray
    measured: dict[str, np.ndarray]
    truth: Signals
    units: dict[str, str]

    @property
    def dt(self) -> float:
        """Sampling interval [s]."""
        return float(np.median(np.diff(self.t)))

    def corner(self, name: str) -> CornerRecord:
        """Record of one corner, as the quarter-car estimators take it.

        Args:
            name: FL, FR, RL or RR.

        Raises:
            InputError: for another name.
        """
        if name not in CORNERS:
            raise InputError("corner", f"{name!r} is no corner", f"Use one of {CORNERS}.")
        k = CORNERS.index(name)
        m = self.measured
        pressure = np.asarray(self.truth.pressure[:, k])
        elevation = np.asarray(self.truth.elevation[:, k])
        return CornerRecord(self.t, m[f"a_s_{name}"], m[f"a_u_{name}"], m["v"], pressure, elevation)


def drive_vehicle(
    key: Any,
    vehicle: FullVehicle,
    maneuver: Maneuver,
    road: RoadSurface,
    pressure: PressureCourse,
    duration: float,
    around: Surroundings | None = None,
    rate: float = RATE,
    substeps: int = SUBSTEPS,
    suite: SensorSuite | None = None,
) -> VehicleRecord:
    """A log of the vehicle from its static equilibrium at x = 0, and the truth behind it.

    Args:
        key: JAX random key of the sensors.
        vehicle: parameters.
        maneuver: the driver.
        road: surface under the wheels.
        pressure: of the tyres over time.
        duration: of the drive [s].
        around: gravity's direction, friction, air.
        rate: of the log [Hz].
        substeps: Runge-Kutta steps per sample.
        suite: the sensors.

    Raises:
        InputError: if a parameter is out of range.
        DivergenceError: if the vehicle finds no equilibrium, leaves the finite numbers or rolls
            over; says when.
    """
    check_drive(vehicle, maneuver, pressure, duration, rate, substeps)
    around = checked_surroundings(Surroundings() if around is None else around)
    suite = validate_suite(SensorSuite() if suite is None else suite)
    vehicle, maneuver, pressure, around = (
        as_arrays(vehicle),
        _arrays(maneuver),
        _arrays(pressure),
        _arrays(around),
    )
    rest, start = _compiled_start()(vehicle, maneuver.speed, road, pressure, around)
    require_rest(rest)
    samples = round(duration * rate)
    truth = _run(samples, float(rate), substeps)(start, vehicle, maneuver, road, pressure, around)
    truth = jax.tree.map(np.asarray, truth)
    t = np.arange(1, samples + 1) / rate
    radius = float(np.min(vehicle.tire.vertical.unloaded_radius))
    refuse_runaway(truth, t, radius)
    warn_of_rims(truth, radius)
    columns, units = _measured(key, truth, float(vehicle.steering_ratio), suite, 1.0 / rate)
    return VehicleRecord(t, columns, truth, units)


def validate_suite(suite: SensorSuite) -> SensorSuite:
    """The same sensors, checked.

    Raises:
        InputError: naming the sensor and figure that is out of range.
    """
    for entry in fields(suite):
        _sensors.validate(entry.name, getattr(suite, entry.name), UNITS[entry.name])
    return suite


@lru_cache(maxsize=16)
def _run(samples: int, rate: float, substeps: int) -> Any:
    settings = (samples, rate, substeps)

    def run(start: Any, vehicle: Any, maneuver: Any, road: Any, p: Any, around: Any) -> Signals:
        return simulate_vehicle(start, vehicle, maneuver, road, p, around, *settings)[1]

    return native_jit(run)


@lru_cache(maxsize=1)
def _compiled_start() -> Any:
    return staged_jit(_start)


def _start(vehicle: FullVehicle, speed: Any, road: Any, pressure: Any, around: Any) -> Any:
    """The vehicle at rest in its place on the road, and rolling there at a speed."""
    c = vehicle.chassis
    x = jnp.stack([c.front_arm, c.front_arm, -c.rear_arm, -c.rear_arm])
    y = 0.5 * jnp.stack([c.front_track, -c.front_track, c.rear_track, -c.rear_track])
    under = road_under(road, x, y)
    elevation = under.elevation[under.elevation.shape[0] // 2]
    now = pressure_at(pressure, jnp.zeros_like(c.body_mass))
    rest = static_equilibrium(vehicle, now, around, elevation)
    return rest, state_at_rest(rest, speed, vehicle)


def _measured(
    key: Any, truth: Signals, steering_ratio: float, suite: SensorSuite, dt: float
) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    front = truth.steer[:, 0] * steering_ratio
    single = [
        ("v", truth.speed, suite.speed, "m/s"),
        ("a_x", truth.a_x, suite.acceleration, "m/s^2"),
        ("a_y", truth.a_y, suite.acceleration, "m/s^2"),
        ("roll_rate", truth.roll_rate, suite.rotation, "rad/s"),
        ("pitch_rate", truth.pitch_rate, suite.rotation, "rad/s"),
        ("yaw_rate", truth.yaw_rate, suite.rotation, "rad/s"),
        ("steering_wheel", front, suite.steering, "rad"),
    ]
    corner = [
        ("a_s", truth.body_acceleration, suite.body_acceleration, "m/s^2"),
        ("a_u", truth.wheel_acceleration, suite.wheel_acceleration, "m/s^2"),
        ("compression", truth.compression, suite.compression, "m"),
        ("wheel_speed", truth.wheel_speed, suite.wheel_speed, "rad/s"),
    ]
    for name, signal, sensor, unit in corner:
        single += [(f"{name}_{c}", signal[:, k], sensor, unit) for k, c in enumerate(CORNERS)]
    keys = jax.random.split(key, len(single))
    columns, units = {}, {}
    for k, (name, signal, sensor, unit) in zip(keys, single, strict=True):
        columns[name] = np.asarray(_measure(k, jnp.asarray(signal), sensor, dt), float)
        units[name] = unit
    # a speed sensor counts pulses: its noise does not make it go backwards
    columns["v"] = np.maximum(columns["v"], 0.0)
    return columns, units


_measure = jax.jit(measure)


def _arrays(tree: Any) -> Any:
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.asarray(0.0).dtype), tree)
