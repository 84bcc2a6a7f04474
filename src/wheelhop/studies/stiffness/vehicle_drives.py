"""Drives of the full vehicle of which all four corners are logged, many at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.errors import InputError, require_in_range
from wheelhop.staging import staged_jit
from wheelhop.vehicle.equilibrium import require_rest, state_at_rest, static_equilibrium
from wheelhop.vehicle.fleet import fleet_simulator
from wheelhop.vehicle.full_vehicle import FullVehicle, Surroundings
from wheelhop.vehicle.full_vehicle_parameters import as_arrays, suv, with_payload
from wheelhop.vehicle.maneuver import straight
from wheelhop.vehicle.pressure_course import PressureCourse
from wheelhop.vehicle.quarter_car import Accelerations
from wheelhop.vehicle.road import Envelope, Profile, surface_from_tracks
from wheelhop.vehicle.road.build import SPACING, START, lines_of, measured_tracks
from wheelhop.vehicle.road.envelope import HALF_LENGTHS
from wheelhop.vehicle.road.isotropic import draw_tracks, prepare_isotropic
from wheelhop.vehicle.road.tracks import grid_points, with_lead_in

RATE = 500.0
"""Sampling rate [Hz] of logs and filters."""

SUBSTEPS = 2
"""Runge-Kutta steps of the vehicle per sample."""

_POINT = (0.001, 0.002, 0.003)
_FARTHER = 7.0


@dataclass(frozen=True)
class Road:
    """A random road, or a measured one.

    Attributes:
        name: for tables and figures.
        level: Gd(W0) of a random road [m^3/rad].
        waviness: w of a random road [-].
        tracks: left and right profile of a measured road, the same twice where it has one track;
            the road is driven there and back where it is too short.
    """

    name: str
    level: float = 0.0
    waviness: float = 2.0
    tracks: tuple[Profile, Profile] | None = None


@dataclass(frozen=True)
class VehicleDrive:
    """One straight drive at constant speed; what deviates from the design is the budget's.

    Attributes:
        number: of the random road and sensors; drives of one number share both.
        road: under the car.
        speed: v [m/s].
        pressures: of the tyres FL, FR, RL, RR [Pa].
        payload: added to the body [kg]; negative for a lighter one.
        damper: factor on the dampers' force [-].
        noise: of the accelerometers [m/s^2].
        patch: whether the contact patch averages the road.
        stiffening: whether the tyres stiffen with load and speed.
    """

    number: int
    road: Road
    speed: float
    pressures: tuple[float, float, float, float]
    payload: float = 0.0
    damper: float = 1.0
    noise: float = 0.5
    patch: bool = True
    stiffening: bool = False


@dataclass(frozen=True)
class VehicleLogs:
    """What the sensors of four corners report, and the truth behind it.

    Attributes:
        measured: accelerations [m/s^2], entries [runs, time, 4].
        speed: of the car [m/s], [runs, time].
        elevation: of the road under the wheels [m], [runs, time, 4].
        pressure: of the tyres [Pa], [runs, 4].
        dt: sampling interval [s].
    """

    measured: Accelerations
    speed: np.ndarray
    elevation: np.ndarray
    pressure: np.ndarray
    dt: float = 1.0 / RATE


def drive_vehicles(
    drives: Sequence[VehicleDrive],
    duration: float,
    fastest: float,
    fleet: int,
    seed: int = 0,
    on_progress: Callable[[int, int], None] | None = None,
) -> VehicleLogs:
    """Drive, in fleets of one compiled shape.

    Args:
        drives: each one run.
        duration: of each [s].
        fastest: highest speed [m/s], for which the roads are long enough.
        fleet: cars in one call.
        seed: of roads and sensors.
        on_progress: called with drives done and in all.

    Raises:
        InputError: for a drive that is out of range.
        DivergenceError: naming the run that left the finite numbers.
    """
    for drive in drives:
        _check(drive, fastest)
    parts = []
    for first in range(0, len(drives), fleet):
        part = list(drives[first : first + fleet])
        logs = _drive_fleet(part + [part[-1]] * (fleet - len(part)), duration, fastest, seed)
        parts.append(jax.tree.map(lambda a, n=len(part): a[:n], logs))
        if on_progress is not None:
            on_progress(first + len(part), len(drives))
    a_s, a_u, speed, elevation = (np.concatenate(leaf) for leaf in zip(*parts, strict=True))
    pressure = np.array([d.pressures for d in drives], float)
    return VehicleLogs(Accelerations(a_s, a_u), speed, elevation, pressure)


def vehicle_of(drive: VehicleDrive) -> FullVehicle:
    """The car of a drive."""
    car = with_payload(suv(load_and_speed=drive.stiffening), drive.payload)
    damper = car.strut.damper
    damper = replace(damper, damping=drive.damper * damper.damping)
    return as_arrays(replace(car, strut=replace(car.strut, damper=damper)))


def _check(drive: VehicleDrive, fastest: float) -> None:
    require_in_range("speed", drive.speed, 1.0, fastest, "m/s")
    for pressure in drive.pressures:
        require_in_range("pressure", pressure, 50e3, 1e6, "Pa")
    require_in_range("payload", drive.payload, -1000.0, 2000.0, "kg")
    require_in_range("damper", drive.damper, 0.1, 10.0, "(factor)")
    require_in_range("noise", drive.noise, 0.0, 100.0, "m/s^2")
    if drive.road.tracks is None:
        require_in_range("road level", drive.road.level, 1e-8, 1e-2, "m^3/rad")
    elif len(drive.road.tracks) != 2:
        raise InputError("road", f"{len(drive.road.tracks)} tracks", "Give left and right.")


def _drive_fleet(
    drives: list[VehicleDrive], duration: float, fastest: float, seed: int
) -> tuple[np.ndarray, ...]:
    vehicles = _stacked([vehicle_of(d) for d in drives])
    speeds = jnp.asarray([d.speed for d in drives], float)
    held = [np.asarray(d.pressures, float) for d in drives]
    courses = _stacked([PressureCourse(p, p, 0.0, 1.0) for p in held])
    around = jax.tree.map(lambda a: jnp.asarray(a, float), Surroundings())
    rest, start = _compiled_start()(vehicles, speeds, courses.start, around)
    require_rest(rest)
    x = grid_points(START, fastest * duration + 10.0, SPACING)
    roads = _stacked([_surface(d, x, seed) for d in drives])
    maneuvers = _stacked([straight(d.speed) for d in drives])
    samples = round(duration * RATE)
    simulate = _fleet(samples, len(drives))
    found = simulate(start, vehicles, maneuvers, roads, courses, around)
    a_s, a_u, speed, elevation = (np.asarray(a) for a in found)
    noise = np.stack([_noise(d, seed, samples) for d in drives]).astype(a_s.dtype)
    return a_s + noise[:, 0], a_u + noise[:, 1], speed, elevation


def _stacked(trees: list[Any]) -> Any:
    kind = jnp.asarray(0.0).dtype
    return jax.tree.map(
        lambda *a: jnp.asarray(np.stack([np.asarray(v, float) for v in a]), kind), *trees
    )


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
        keep=lambda s: (s.body_acceleration, s.wheel_acceleration, s.speed, s.elevation),
    )


def _noise(drive: VehicleDrive, seed: int, samples: int) -> np.ndarray:
    rng = np.random.default_rng((seed, 1, drive.number))
    return drive.noise * rng.standard_normal((2, samples, 4))


def _surface(drive: VehicleDrive, x: np.ndarray, seed: int) -> Any:
    # a patch of millimetres keeps the shapes of the compiled fleet
    envelope = Envelope("moving_average", HALF_LENGTHS if drive.patch else _POINT)
    return surface_from_tracks(road_tracks(drive, x, seed), SPACING, START, envelope)


def road_tracks(drive: VehicleDrive, x: np.ndarray, seed: int) -> Any:
    """Elevation under the four wheels [m], [4, points].

    Args:
        drive: whose road, and whose place on it.
        x: of the points [m], every `SPACING` from `START` on.
        seed: of random roads.
    """
    road = drive.road
    if road.tracks is None:
        key = jax.random.fold_in(jax.random.key(seed), drive.number)
        z = draw_tracks(key, _prepared(len(x), road.waviness), road.level)[:, : len(x)]
        return with_lead_in(z, jnp.asarray(x, z.dtype))
    # drives over one measured road begin at places of their own
    length = float(x[-1])
    left, right = (_from(p, _FARTHER * drive.number, length) for p in road.tracks)
    return jnp.asarray(measured_tracks(left, right, length))


def _from(profile: Profile, shift: float, length: float) -> Profile:
    """The road from a shift [m] on, there and back as often as a length [m] needs."""
    there = profile.elevation
    round_trip = np.concatenate([there, there[-2:0:-1]])
    rolled = np.roll(round_trip, -round(shift / profile.spacing))
    return replace(profile, elevation=np.resize(rolled, round(length / profile.spacing) + 2))


@lru_cache(maxsize=16)
def _prepared(points: int, waviness: float) -> Any:
    return prepare_isotropic(points * SPACING, SPACING, waviness, lines_of(suv()))
