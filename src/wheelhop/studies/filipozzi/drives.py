"""The drives behind the paper's figures, by the 14-degree-of-freedom vehicle, and sensor noise."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.studies.filipozzi.settings import (
    BRAKE_BEGIN,
    BRAKE_TORQUE,
    FACTORS,
    GRADIENT,
    LANE_CHANGE_PEAK,
    SHORTEST_WAVE,
    SPEED,
    SWEEP_END,
    SWEEP_SPEED,
    FilipozziSettings,
)
from wheelhop.studies.filipozzi.vehicles import (
    barred_vehicle,
    digressive_vehicle,
    paper_vehicle,
    scaled,
    standing,
)
from wheelhop.studies.frame import Advance, Store
from wheelhop.vehicle.equilibrium import state_at_rest
from wheelhop.vehicle.fleet import fleet_simulator
from wheelhop.vehicle.full_vehicle import FullVehicle, Surroundings
from wheelhop.vehicle.maneuver import Maneuver, brake_step, double_lane_change, straight
from wheelhop.vehicle.pressure_course import held
from wheelhop.vehicle.road.build import build_surface, flat_tracks, lines_of, random_tracks
from wheelhop.vehicle.road.iso8608 import class_level
from wheelhop.vehicle.road.obstacles import Obstacle, SineSweep, Slope
from wheelhop.vehicle.simulation import Signals

BRAKE, LANE_CHANGE, SWEEP, SLOPE, ROAD = "brake", "lane_change", "sweep", "slope", "road"
BRAKE_DIGRESSIVE = "brake_digressive"
BRAKE_BARRED, LANE_CHANGE_BARRED = "brake_barred", "lane_change_barred"
BRAKE_STIFFNESS = {f: BRAKE if f == 1.0 else f"brake_stiffness_{f:g}" for f in FACTORS}
"""Names of the drives by the factor of the plant's stiffness."""
BRAKE_DAMPING = {f: BRAKE if f == 1.0 else f"brake_damping_{f:g}" for f in FACTORS}
"""Names of the drives by the factor of the plant's damping."""

SWEEP_AMPLITUDE, LONGEST_WAVE = 0.08, 25.0
"""Of the longest wave and its length [m]; the paper prints neither."""

SLOPE_SPEED, SLOPE_BEGIN, SLOPE_TRANSITION = 30 / 3.6, 2.0, 10.0
"""Speed [m/s], time at which the front wheels meet the slope [s], and length of the transition from
the level [m]; the paper prints none of them."""

ROAD_CLASS, ROAD_SPEED = "C", 80 / 3.6
"""Of the random road, which the paper does not drive; [m/s]."""


_STEP = 5e-4
_QUICK_SWEEP = 8.0
_AFTER_SWEEP = 1.0
_LEAD = 3.0


@dataclass(frozen=True)
class DriveCase:
    """What is driven.

    Attributes:
        vehicle: the plant.
        maneuver: of the driver.
        duration: of the record [s].
        obstacles: on a flat road.
        level: Gd(W0) of a random road [m^3/rad]; 0 for none.
    """

    vehicle: FullVehicle
    maneuver: Maneuver
    duration: float
    obstacles: tuple[Obstacle, ...] = ()
    level: float = 0.0


class Drive(NamedTuple):
    """What truly happens, [time, 4] at the corners FL, FR, RL, RR, else [time].

    Attributes:
        t: [s].
        body_acceleration, wheel_acceleration: what vertical accelerometers on the body above each
            wheel and on the carriers show, less standard gravity [m/s^2], 4.
        compression, compression_rate: of the struts from their design place [m], [m/s], 4.
        a_x, a_y: what accelerometers at the body's centre of mass show [m/s^2].
        speed: [m/s].
        load: normal forces of the tyres [N], 4.
        strut: forces of springs, dampers, stops and bars on the body [N], 4.
        elevation: of the road under the wheels [m], 4.
        lateral: forces of the tyres [N], 4.
        roll, pitch: of the body [rad]; pitch positive nose down.
    """

    t: Any
    body_acceleration: Any
    wheel_acceleration: Any
    compression: Any
    compression_rate: Any
    a_x: Any
    a_y: Any
    speed: Any
    load: Any
    strut: Any
    elevation: Any
    lateral: Any
    roll: Any
    pitch: Any


def cases(settings: FilipozziSettings) -> dict[str, DriveCase]:
    """Every drive by name.

    Fig. 5a `BRAKE`, 5b `LANE_CHANGE`, 6 `SWEEP`, 7 `SLOPE`, 8 `BRAKE_STIFFNESS`, 9
    `BRAKE_DAMPING` and `BRAKE_DIGRESSIVE`; beyond the paper `ROAD` and the barred ones.

    Args:
        settings: of the study; a quick one has a shorter sweep.
    """
    car = paper_vehicle()
    stepped = brake_step(SPEED, BRAKE_TORQUE, BRAKE_BEGIN)
    changing = double_lane_change(SPEED, LANE_CHANGE_PEAK)

    def braked(vehicle: FullVehicle) -> DriveCase:
        return DriveCase(vehicle, stepped, 4.0)

    found = {BRAKE: braked(car), LANE_CHANGE: DriveCase(car, changing, 7.0)}
    end = _QUICK_SWEEP if settings.quick else SWEEP_END
    sweep = _sweep(end, float(car.chassis.front_arm))
    found[SWEEP] = DriveCase(car, straight(SWEEP_SPEED), end + _AFTER_SWEEP, (sweep,))
    foot = SLOPE_SPEED * SLOPE_BEGIN + float(car.chassis.front_arm)
    slope = Slope(foot, GRADIENT, SLOPE_TRANSITION)
    found[SLOPE] = DriveCase(car, straight(SLOPE_SPEED), 8.0, (slope,))
    for factor in (f for f in FACTORS if f != 1.0):
        found[BRAKE_STIFFNESS[factor]] = braked(scaled(car, stiffness=factor))
        found[BRAKE_DAMPING[factor]] = braked(scaled(car, damping=factor))
    found[BRAKE_DIGRESSIVE] = braked(digressive_vehicle())
    barred = barred_vehicle()
    found[BRAKE_BARRED] = braked(barred)
    found[LANE_CHANGE_BARRED] = DriveCase(barred, changing, 7.0)
    found[ROAD] = DriveCase(car, straight(ROAD_SPEED), 8.0, level=class_level(ROAD_CLASS))
    return found


def drives(settings: FilipozziSettings, store: Store, advance: Advance) -> dict[str, Drive]:
    """Every drive of `cases`, simulated as one fleet or read from the store.

    Args:
        settings: of the study.
        store: of what is finished.
        advance: told of the steps.
    """
    depends = {"seed": settings.seed, "rate": settings.rate, "quick": settings.quick}
    advance(0, 1)
    every = cases(settings)
    flat = store.arrays("drives", depends, lambda: _flattened(simulate(every, settings)))
    advance(1, 1)
    return {n: Drive(*(flat[f"{n}.{field}"] for field in Drive._fields)) for n in every}


def simulate(every: Mapping[str, DriveCase], settings: FilipozziSettings) -> dict[str, Drive]:
    """Drive all cases side by side for as long as the longest, and keep of each its own time.

    Steps of 0.5 ms or just below.

    Args:
        every: the cases; at least one.
        settings: seed of the random road, rate.

    Raises:
        DivergenceError: naming the run that left the finite numbers.
    """
    chosen = list(every.values())
    vehicles = _stacked([case.vehicle for case in chosen])
    maneuvers = _stacked([case.maneuver for case in chosen])
    pressure = _stacked([held(case.vehicle.nominal_pressure) for case in chosen])
    around = _stacked([Surroundings() for _ in chosen])
    rests = _stacked([standing(case.vehicle) for case in chosen])
    start = jax.jit(jax.vmap(state_at_rest))(rests, maneuvers.speed, vehicles)
    roads = _stacked(_roads(chosen, settings.seed))
    duration = max(case.duration for case in chosen)
    fleet = fleet_simulator(
        round(duration * settings.rate),
        settings.rate,
        math.ceil(1.0 / (settings.rate * _STEP) - 1e-9),
        in_axes=(0, 0, 0, 0, 0, 0),
        keep=_kept,
        lanes=len(chosen),
    )
    found = [np.asarray(a) for a in fleet(start, vehicles, maneuvers, roads, pressure, around)]
    drives = {}
    for k, (name, case) in enumerate(every.items()):
        samples = round(case.duration * settings.rate)
        t = np.arange(1, samples + 1) / settings.rate
        drives[name] = Drive(t, *(a[k, :samples] for a in found))
    return drives


def _sweep(end: float, ahead: float) -> SineSweep:
    """A sweep whose shortest wave the front wheels reach at a time [s]."""
    length = SWEEP_SPEED * end + ahead - _LEAD
    return SineSweep(_LEAD, length, SWEEP_AMPLITUDE, LONGEST_WAVE, SHORTEST_WAVE)


def _roads(chosen: list[DriveCase], seed: int) -> list[Any]:
    """Surfaces of one length; cases on the same road share it."""
    length = max(float(case.maneuver.speed) * case.duration for case in chosen) + 20.0
    built: dict[tuple[Any, float], Any] = {}
    for case in chosen:
        place = (case.obstacles, case.level)
        if place not in built:
            rough = case.level > 0.0
            lines = lines_of(case.vehicle)
            tracks = (
                random_tracks(jax.random.key(seed), case.level, length, lines)
                if rough
                else flat_tracks(length)
            )
            built[place] = build_surface(tracks, case.obstacles)
    return [built[case.obstacles, case.level] for case in chosen]


def _kept(s: Signals) -> tuple[Any, ...]:
    return tuple(getattr(s, field) for field in Drive._fields[1:])


def _flattened(found: Mapping[str, Drive]) -> dict[str, np.ndarray]:
    return {f"{n}.{f}": getattr(d, f) for n, d in found.items() for f in Drive._fields}


def _stacked(trees: list[Any]) -> Any:
    kind = jnp.asarray(0.0).dtype
    return jax.tree.map(
        lambda *a: jnp.asarray(np.stack([np.asarray(v, float) for v in a]), kind), *trees
    )
