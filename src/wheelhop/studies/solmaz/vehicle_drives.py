"""Cornering drives of the full vehicle on soft tyres, many at once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.errors import InputError, require_in_range
from wheelhop.staging import staged_jit
from wheelhop.vehicle.equilibrium import require_rest, state_at_rest, static_equilibrium
from wheelhop.vehicle.fleet import fleet_simulator
from wheelhop.vehicle.full_vehicle import FullVehicle, Surroundings
from wheelhop.vehicle.full_vehicle_parameters import as_arrays, suv, with_payload, with_tire
from wheelhop.vehicle.magic_formula_parameters import generic_passenger_tire
from wheelhop.vehicle.maneuver import Maneuver
from wheelhop.vehicle.pressure_course import PressureCourse
from wheelhop.vehicle.road import surface_from_tracks
from wheelhop.vehicle.road.build import SPACING, START, lines_of
from wheelhop.vehicle.road.envelope import HALF_LENGTHS, Envelope
from wheelhop.vehicle.road.isotropic import draw_tracks, prepare_isotropic
from wheelhop.vehicle.road.surface import flat_surface
from wheelhop.vehicle.road.tracks import grid_points, with_lead_in
from wheelhop.vehicle.simulation import Signals
from wheelhop.vehicle.two_track_of import common_centre

RATE = 100.0
"""Sampling rate [Hz] of the signals."""

SUBSTEPS = 5
"""Runge-Kutta steps per sample: 2 ms. Against 0.5 ms every signal of double lane changes, slaloms
and straight drives on a flat road of full friction stays within 7e-4 of its largest value."""

SOUND = 230e3
"""Pressure of a sound tyre [Pa]."""

SOFT = 115e3
"""Pressure of a soft tyre [Pa]."""

PRESSURE_LAWS: dict[str, dict[str, float]] = {
    "falling": {"ppy1": 0.9},
    "published": {"ppy1": -0.63, "ppy2": -0.065, "ppy3": -0.16, "ppy4": 0.28},
    "none": {},
}
"""Lateral pressure coefficients. "falling": cornering stiffness goes with pressure, the paper's
premise (45 % lost from 230 to 115 kPa). "published": a passenger tyre of the kind Besselink,
Schmeitz & Pacejka 2010 describe, which stiffens as it loses pressure; rounded numbers, not of a
measured tyre's file. "none": no effect."""

_FASTEST = 45.0


@dataclass(frozen=True)
class CorneringRuns:
    """What differs between the drives.

    Attributes:
        soft: which tyres are soft, FL, FR, RL, RR, [runs, 4].
        maneuvers: the drivers, of `vehicle_maneuvers`, one each run.
        friction: of the road relative to the tyres' data [-], [runs]; 1 by default.
        load: body mass per nominal one [-], [runs]; 1 by default.
        sound, softened: pressures of the tyres [Pa].
        law: of the pressure, a key of `PRESSURE_LAWS`.
        road_level: Gd(W0) of the random road [m^3/rad]; 0 for a flat one.
    """

    soft: np.ndarray
    maneuvers: tuple[Maneuver, ...]
    friction: np.ndarray | None = None
    load: np.ndarray | None = None
    sound: float = SOUND
    softened: float = SOFT
    law: str = "falling"
    road_level: float = 0.0


class LateralSignals(NamedTuple):
    """What happens in the vehicle, noise-free, [runs, time], or [runs, time, 4] for the tyres.

    Attributes:
        steer: mean angle of the front wheels [rad].
        speed: [m/s].
        lateral_acceleration: what an accelerometer on the rolling body shows [m/s^2].
        yaw_rate: [rad/s].
        side_slip: of the common centre of mass [rad].
        roll: of the body [rad].
        load: of the tyres [N].
        lateral: forces of the tyres [N].
    """

    steer: Any
    speed: Any
    lateral_acceleration: Any
    yaw_rate: Any
    side_slip: Any
    roll: Any
    load: Any
    lateral: Any


def lateral_suv(law: str = "falling") -> FullVehicle:
    """The SUV on tyres whose cornering stiffness knows the pressure.

    Args:
        law: a key of `PRESSURE_LAWS`.

    Raises:
        InputError: for another law.
    """
    if law not in PRESSURE_LAWS:
        raise InputError("law", f"{law!r} is unknown", f"Use one of {tuple(PRESSURE_LAWS)}.")
    return with_tire(suv(), generic_passenger_tire(**PRESSURE_LAWS[law]))


def drive_cornering(
    runs: CorneringRuns,
    duration: float = 20.0,
    seed: int = 0,
    rate: float = RATE,
    substeps: int = SUBSTEPS,
) -> LateralSignals:
    """Drive all runs in lanes.

    Args:
        runs: what differs between them.
        duration: of each drive [s].
        seed: of the random roads.
        rate: of the signals [Hz].
        substeps: Runge-Kutta steps per sample.

    Raises:
        InputError: for entries out of range or of unequal length.
        DivergenceError: naming the run that left the finite numbers.
    """
    friction, load = _checked(runs)
    car = lateral_suv(runs.law)
    mass = float(car.chassis.body_mass)
    vehicles = _stacked([with_payload(car, mass * (factor - 1.0)) for factor in load])
    maneuvers = _stacked(list(runs.maneuvers))
    pressure = np.where(runs.soft, runs.softened, runs.sound).astype(float)
    courses = _stacked([PressureCourse(p, p, 0.0, 1.0) for p in pressure])
    around = _stacked([Surroundings(friction=float(mu)) for mu in friction])
    rest, start = _compiled_start()(vehicles, maneuvers.speed, courses.start, around)
    require_rest(rest)
    rough = runs.road_level > 0.0
    road = _roads(runs, duration, seed) if rough else flat_surface(dtype=jnp.asarray(0.0).dtype)
    simulate = _fleet(round(duration * rate), len(load), rate, substeps, rough)
    found = simulate(start, vehicles, maneuvers, road, courses, around)
    return _signals(vehicles, courses.start, *(np.asarray(a, float) for a in found))


def _checked(runs: CorneringRuns) -> tuple[np.ndarray, np.ndarray]:
    count = len(runs.maneuvers)
    if np.shape(runs.soft) != (count, 4):
        raise InputError(
            "soft", f"{np.shape(runs.soft)} entries of {count} runs", "Give [runs, 4]."
        )
    found = []
    for name, low, high in (("friction", 0.05, 1.5), ("load", 0.5, 1.5)):
        entries = getattr(runs, name)
        entries = np.ones(count) if entries is None else np.asarray(entries, float)
        if entries.shape != (count,):
            raise InputError(name, f"{entries.shape} entries of {count} runs", "Give one a run.")
        for entry in entries:
            require_in_range(name, entry, low, high, "(factor)")
        found.append(entries)
    for name in ("sound", "softened"):
        require_in_range(name, getattr(runs, name), 50e3, 500e3, "Pa")
    require_in_range("road_level", runs.road_level, 0.0, 1e-2, "m^3/rad")
    for maneuver in runs.maneuvers:
        require_in_range("speed", float(maneuver.speed), 5.0, _FASTEST, "m/s")
    return found[0], found[1]


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

    return staged_jit(jax.vmap(start))


def _kept(s: Signals) -> tuple[Any, ...]:
    steer = 0.5 * (s.steer[:, 0] + s.steer[:, 1])
    slip = (s.lateral_speed, s.roll_rate, s.roll)
    return steer, s.speed, s.a_y, s.yaw_rate, *slip, s.load, s.lateral


@lru_cache(maxsize=8)
def _fleet(samples: int, lanes: int, rate: float, substeps: int, rough: bool) -> Any:
    axes = (0, 0, 0, 0 if rough else None, 0, 0)
    return fleet_simulator(samples, rate, substeps, in_axes=axes, lanes=min(lanes, 64), keep=_kept)


def _roads(runs: CorneringRuns, duration: float, seed: int) -> Any:
    fastest = max(float(m.speed) for m in runs.maneuvers)
    x = grid_points(START, fastest * duration + 20.0, SPACING)
    prepared = prepare_isotropic(len(x) * SPACING, SPACING, 2.0, lines_of(suv()))
    envelope = Envelope("moving_average", HALF_LENGTHS)

    def one(number: int) -> Any:
        key = jax.random.fold_in(jax.random.key(seed), number)
        z = draw_tracks(key, prepared, runs.road_level)[:, : len(x)]
        tracks = with_lead_in(z, jnp.asarray(x, z.dtype))
        return surface_from_tracks(tracks, SPACING, START, envelope)

    return _stacked([one(k) for k in range(len(runs.maneuvers))])


def _signals(
    vehicles: FullVehicle,
    pressure: Any,
    steer: Any,
    speed: Any,
    a_y: Any,
    yaw_rate: Any,
    lateral_speed: Any,
    roll_rate: Any,
    roll: Any,
    load: Any,
    lateral: Any,
) -> LateralSignals:
    centre = jax.vmap(common_centre)(vehicles, pressure)
    ahead, below = (np.asarray(part, float)[:, None] for part in (centre.ahead, centre.below))
    sideways = lateral_speed + yaw_rate * ahead + roll_rate * below
    slip = np.arctan2(sideways, speed)
    return LateralSignals(steer, speed, a_y, yaw_rate, slip, roll, load, lateral)


def sound_vehicle(law: str = "falling", load: float = 1.0) -> FullVehicle:
    """The vehicle as it is driven, with a body mass [per nominal one], for `two_track_of`."""
    car = lateral_suv(law)
    return as_arrays(with_payload(car, float(car.chassis.body_mass) * (load - 1.0)))
