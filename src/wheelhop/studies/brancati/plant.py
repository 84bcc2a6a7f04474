"""Drives of the full vehicle for Brancati & Tufano's validation, many at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from wheelhop.errors import InputError, require_in_range
from wheelhop.estimators.candidate import Records, as_float
from wheelhop.staging import staged_jit
from wheelhop.vehicle.equilibrium import require_rest, state_at_rest, static_equilibrium
from wheelhop.vehicle.fleet import fleet_simulator
from wheelhop.vehicle.full_vehicle import FullVehicle, Surroundings
from wheelhop.vehicle.full_vehicle_parameters import as_arrays, suv, with_payload
from wheelhop.vehicle.maneuver import straight
from wheelhop.vehicle.pressure_course import PressureCourse
from wheelhop.vehicle.quarter_car import Accelerations
from wheelhop.vehicle.road import class_level, stationary_variance
from wheelhop.vehicle.road.build import SPACING, START, build_surface, lines_of
from wheelhop.vehicle.road.isotropic import draw_tracks, prepare_isotropic
from wheelhop.vehicle.road.tracks import grid_points, with_lead_in

RATE = 500.0
"""Sampling rate [Hz] of logs and filters."""

SUBSTEPS = 2
"""Runge-Kutta steps of the vehicle per sample."""

CORNER = 0
"""Front left."""

DRIVEN = "ABCDE"
"""Classes of roads that a car stays on at these speeds."""

FLEET = 128
"""Vehicles in one compiled call."""


@dataclass(frozen=True)
class Drive:
    """One straight drive at constant speed.

    Attributes:
        number: of the drive's random road and sensors; drives of one number share both.
        speed: v [m/s].
        pressure: of all four tyres [Pa].
        road: ISO 8608 class of the road, or "measured".
        then: class from `change` on; None for the same road throughout.
        change: time [s] of the change of road.
        end_pressure: of the front-left tyre after its loss [Pa]; None where it holds.
        loss: begin and duration [s] of the loss, linear in time.
        payload: added to the body [kg].
    """

    number: int
    speed: float
    pressure: float
    road: str
    then: str | None = None
    change: float = 0.0
    end_pressure: float | None = None
    loss: tuple[float, float] = (5.0, 1.5)
    payload: float = 0.0


@dataclass(frozen=True)
class Driven:
    """Logs of the front-left corner and the truth behind them.

    Attributes:
        records: what the sensors report.
        pressure: of the front-left tyre [Pa], [runs, time].
        elevation: of the road under it [m], [runs, time].
        wheel_acceleration: noise-free [m/s^2], [runs, time].
    """

    records: Records
    pressure: np.ndarray
    elevation: np.ndarray
    wheel_acceleration: np.ndarray

    @property
    def t(self) -> np.ndarray:
        """Time [s] of every sample, [time]."""
        return self.records.dt * np.arange(1, self.pressure.shape[1] + 1)

    def part(self, runs: slice | np.ndarray) -> Driven:
        """Some of the runs."""
        return Driven(
            self.records.part(runs),
            self.pressure[runs],
            self.elevation[runs],
            self.wheel_acceleration[runs],
        )


@dataclass(frozen=True)
class Plant:
    """What all drives of a study share.

    Attributes:
        duration: of a drive [s].
        convention: of the roads' levels, "iso8608" or "brancati2022".
        seed: of roads and sensors.
        noise: of both accelerometers [m/s^2].
        fastest: highest speed [m/s], for which the roads are long enough.
        measured: elevation of the measured road [m] every `SPACING`, where drives use it; drive
            number n starts further along it than drive n - 1.
    """

    duration: float = 10.0
    convention: str = "iso8608"
    seed: int = 0
    noise: float = 0.5
    fastest: float = 80 / 3.6
    measured: np.ndarray | None = None

    @property
    def samples(self) -> int:
        """Samples of a drive."""
        return round(self.duration * RATE)


def drive_all(
    plant: Plant,
    drives: list[Drive],
    on_progress: Callable[[int, int], None] | None = None,
    fleet: int = FLEET,
) -> Driven:
    """Drive, in fleets of one compiled shape.

    Args:
        plant: what they share.
        drives: each one run.
        on_progress: called with drives done and in all.
        fleet: vehicles in one call.

    Raises:
        InputError: for a road, speed, pressure or payload that cannot be driven.
        DivergenceError: naming the run that left the finite numbers.
    """
    for drive in drives:
        _check(plant, drive)
    parts = []
    for first in range(0, len(drives), fleet):
        part = drives[first : first + fleet]
        filled = part + [part[-1]] * (fleet - len(part))
        found = _drive_fleet(plant, filled)
        parts.append(found.part(slice(0, len(part))))
        if on_progress is not None:
            on_progress(first + len(part), len(drives))
    return joined(parts)


def _check(plant: Plant, drive: Drive) -> None:
    require_in_range("speed", drive.speed, 1.0, plant.fastest, "m/s")
    for pressure in (drive.pressure, drive.end_pressure or drive.pressure):
        require_in_range("pressure", pressure, 50e3, 1e6, "Pa")
    require_in_range("payload", drive.payload, 0.0, 2000.0, "kg")
    for road in (drive.road, drive.then or drive.road):
        if road == "measured" and plant.measured is None:
            raise InputError("road", "the plant has no measured road", "Give it `measured`.")
        if road != "measured" and road not in DRIVEN:
            raise InputError("road", f"{road!r} is not driven", f"Use one of {DRIVEN}, measured.")


def joined(parts: list[Driven]) -> Driven:
    """Runs of several parts, one after the other."""
    measured = [p.records.measured for p in parts]
    cat = np.concatenate
    return Driven(
        Records(
            Accelerations(cat([m.a_s for m in measured]), cat([m.a_u for m in measured])),
            cat([p.records.speed for p in parts]),
            parts[0].records.dt,
        ),
        cat([p.pressure for p in parts]),
        cat([p.elevation for p in parts]),
        cat([p.wheel_acceleration for p in parts]),
    )


def _drive_fleet(plant: Plant, drives: list[Drive]) -> Driven:
    vehicles = _stacked([as_arrays(with_payload(suv(), d.payload)) for d in drives])
    speeds = jnp.asarray([d.speed for d in drives], float)
    courses = as_float(_stacked([_course(d) for d in drives]))
    around = as_float(Surroundings())
    rest, start = _compiled_start()(vehicles, speeds, courses.start, around)
    require_rest(rest)
    roads = jax.vmap(build_surface)(_tracks(plant, drives))
    maneuvers = as_float(_stacked([straight(d.speed) for d in drives]))
    simulate = _fleet(plant.samples, len(drives))
    a_s, a_u, speed, pressure, elevation = (
        np.asarray(a) for a in simulate(start, vehicles, maneuvers, roads, courses, around)
    )
    noise = plant.noise * np.asarray(_noise(_keys(plant, drives, 1), a_s.shape[1]))
    measured = Accelerations(a_s + noise[:, 0], a_u + noise[:, 1])
    return Driven(Records(measured, speed, 1.0 / RATE), pressure, elevation, a_u)


def _stacked(trees: list[Any]) -> Any:
    return jax.tree.map(lambda *a: np.stack([np.asarray(v, float) for v in a]), *trees)


def _course(drive: Drive) -> PressureCourse:
    start = np.full(4, drive.pressure)
    end = start.copy()
    if drive.end_pressure is not None:
        end[CORNER] = drive.end_pressure
    begin, duration = drive.loss
    return PressureCourse(start, end, begin, duration)


@lru_cache(maxsize=1)
def _compiled_start() -> Any:
    def start(vehicle: FullVehicle, speed: Any, pressure: Any, around: Surroundings) -> Any:
        rest = static_equilibrium(vehicle, pressure, around)
        return rest, state_at_rest(rest, speed, vehicle)

    return staged_jit(jax.vmap(start, in_axes=(0, 0, 0, None)))


@lru_cache(maxsize=4)
def _fleet(samples: int, lanes: int) -> Any:
    return fleet_simulator(
        samples,
        RATE,
        SUBSTEPS,
        in_axes=(0, 0, 0, 0, 0, None),
        lanes=lanes,
        keep=lambda s: (
            s.body_acceleration[:, CORNER],
            s.wheel_acceleration[:, CORNER],
            s.speed,
            s.pressure[:, CORNER],
            s.elevation[:, CORNER],
        ),
    )


def _keys(plant: Plant, drives: list[Drive], use: int) -> Array:
    """A random key of every drive: 0 for its road, 1 for its sensors."""
    key = jax.random.fold_in(jax.random.key(plant.seed), use)
    numbers = jnp.asarray([d.number for d in drives])
    return jax.vmap(lambda n: jax.random.fold_in(key, n))(numbers)


@lru_cache(maxsize=2)
def _compiled_noise(samples: int) -> Any:
    return jax.jit(jax.vmap(lambda key: jax.random.normal(key, (2, samples))))


def _noise(keys: Array, samples: int) -> Any:
    return _compiled_noise(samples)(keys)


def _tracks(plant: Plant, drives: list[Drive]) -> Float[Array, "runs 4 points"]:
    """Elevation under the four wheels of every drive [m]."""
    length = plant.fastest * plant.duration + 10.0
    x = grid_points(START, length, SPACING)
    random = _random_tracks(plant, drives, x)
    if plant.measured is None:
        return random
    shift = round(7.0 / SPACING)
    on_it = np.array([d.road == "measured" for d in drives])
    own = np.stack([_from(plant.measured, d.number * shift, x) for d in drives])
    return jnp.where(on_it[:, None, None], own[:, None, :], random)


def _random_tracks(plant: Plant, drives: list[Drive], x: np.ndarray) -> Any:
    road = _prepared(len(x))
    ratio = stationary_variance(1.0, plant.convention) / stationary_variance(1.0)

    def level(name: str) -> float:
        return ratio * class_level("A" if name == "measured" else name)

    before = jnp.asarray([level(d.road) for d in drives], float)
    after = jnp.asarray([level(d.then or d.road) for d in drives], float)
    # the front wheels run ahead of the centre of mass, which is at x = 0 in the beginning
    ahead = float(suv().chassis.front_arm)
    at = jnp.asarray([ahead + d.change * d.speed for d in drives], float)
    points = jnp.asarray(x, float)
    return _draw()(_keys(plant, drives, 0), road, before, after, at, points)


@lru_cache(maxsize=1)
def _draw() -> Any:
    def one(key: Any, road: Any, before: Any, after: Any, at: Any, x: Any) -> Any:
        z = draw_tracks(key, road, 1.0)[:, : x.shape[0]]
        # slopes change their scale where the class does, so that the elevation has no step
        gain = jnp.sqrt(jnp.where(x[1:] < at, before, after))
        z = jnp.concatenate([z[:, :1] * gain[0], jnp.diff(z) * gain[None]], axis=1)
        return with_lead_in(jnp.cumsum(z, axis=1), x)

    return jax.jit(jax.vmap(one, in_axes=(0, None, 0, 0, 0, None)))


@lru_cache(maxsize=2)
def _prepared(points: int) -> Any:
    return prepare_isotropic(points * SPACING, SPACING, 2.0, lines_of(suv()))


def _from(measured: np.ndarray, first: int, x: np.ndarray) -> np.ndarray:
    """A stretch of the measured road, there and back where it ends, out of the flat."""
    n = len(measured)
    k = (first + np.maximum(np.round(x / SPACING).astype(int), 0)) % (2 * n - 2)
    z = measured[np.minimum(k, 2 * n - 2 - k)]
    return np.asarray(with_lead_in(jnp.asarray(z - z[0])[None], jnp.asarray(x)))[0]
