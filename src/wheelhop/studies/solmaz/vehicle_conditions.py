"""What is driven with the full vehicle: every combination of soft tyres, under many conditions."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from wheelhop.estimators.failure_modes import level_table
from wheelhop.studies.solmaz.outcomes import MODES
from wheelhop.studies.solmaz.settings import SolmazSettings
from wheelhop.studies.solmaz.vehicle_drives import CorneringRuns, lateral_suv
from wheelhop.studies.solmaz.vehicle_maneuvers import (
    followed_lane_change,
    slalom,
    steered_lane_change,
    straight_ahead,
)
from wheelhop.vehicle.maneuver import Maneuver
from wheelhop.vehicle.road import class_level

ASSUMED = 150e3
"""Pressure that the estimators believe a soft tyre to have [Pa]; a sound one has 230 kPa."""

MAIN, STRAIGHT, STRAIGHT_ROUGH, NO_EFFECT = (
    "as assumed",
    "straight ahead",
    "straight ahead, road class B",
    "pressure has no effect",
)
OPPOSITE, OPPOSITE_KNOWN = "opposite pressure sign, unknown", "opposite pressure sign, known"

ONSET = 5.0
"""When the steering begins [s]."""

FOLLOWED, STEERED, SLALOM, AHEAD = "followed", "steered", "slalom", "ahead"

_MOST, _SHARE, _MOST_OF_A_CONDITION = 48, 0.04, 8
_PIECE, _QUICK_PIECE = 64, 16


@dataclass(frozen=True)
class Condition:
    """One set of drives.

    Attributes:
        name: of the condition.
        number: of its random numbers.
        runs: of every combination of soft tyres.
        speeds: least and largest [m/s]; each drive has one of its own.
        peaks: lateral acceleration demanded, least and largest [m/s^2].
        maneuvers: drivers, taking turns.
        friction: of the road [-].
        load: body mass per the one believed [-].
        softened: pressure of the soft tyres [Pa].
        law: of the pressure, a key of `vehicle_drives.PRESSURE_LAWS`.
        believed: the law that the estimators believe.
        road: class of the road, or "" for a flat one.
        offsets: size of the sensors' offsets, in `full_vehicle.OFFSETS`.
    """

    name: str
    number: int
    runs: int
    speeds: tuple[float, float] = (18.0, 25.0)
    peaks: tuple[float, float] = (1.0, 4.5)
    maneuvers: tuple[str, ...] = (FOLLOWED,)
    friction: float = 1.0
    load: float = 1.0
    softened: float = ASSUMED
    law: str = "falling"
    believed: str = "falling"
    road: str = ""
    offsets: float = 1.0


@dataclass(frozen=True)
class Piece:
    """Some of the drives of a condition, so many as are simulated at once.

    Attributes:
        number: of the piece.
        true: mode of every run, [runs].
        speed: [m/s], [runs].
        runs: what is driven.
        seed: of the road and the sensors.
    """

    number: int
    true: np.ndarray
    speed: np.ndarray
    runs: CorneringRuns
    seed: int


def conditions(settings: SolmazSettings) -> dict[str, Condition]:
    """By name; a quick study has few."""
    few = max(1, min(round(_SHARE * settings.runs), _MOST_OF_A_CONDITION))
    usual = Condition("", 0, few)
    found = [replace(usual, name=MAIN, runs=min(settings.runs, _MOST))]
    found.append(replace(usual, name=STRAIGHT, maneuvers=(AHEAD,)))
    if settings.quick:
        found[0] = replace(found[0], runs=1)
    else:
        found += _more(usual)
    return {c.name: replace(c, number=k) for k, c in enumerate(found)}


def _more(usual: Condition) -> list[Condition]:
    def other(name: str, **changes: object) -> Condition:
        return replace(usual, name=name, **changes)  # type: ignore[arg-type]

    slippery = [
        other(f"friction {mu:g}", friction=mu, peaks=(min(1.0, 3.0 * mu), 6.0 * mu))
        for mu in (0.7, 0.5, 0.3)
    ]
    return [
        other(STRAIGHT_ROUGH, maneuvers=(AHEAD,), road="B"),
        other("open-loop steering", maneuvers=(STEERED, SLALOM), peaks=(1.0, 3.5)),
        *slippery,
        other("20 % less load", load=0.8),
        other("20 % more load", load=1.2),
        other("three times the offsets", offsets=3.0),
        other("road class B", road="B"),
        other("soft tyres of 184 kPa", softened=184e3),
        other("soft tyres of 115 kPa", softened=115e3, speeds=(18.0, 22.0), peaks=(1.0, 3.5)),
        other(OPPOSITE, law="published"),
        other(OPPOSITE_KNOWN, law="published", believed="published"),
        other(NO_EFFECT, law="none"),
    ]


def lanes_of(settings: SolmazSettings) -> int:
    """Drives simulated and judged at once."""
    return _QUICK_PIECE if settings.quick else _PIECE


def pieces(condition: Condition, settings: SolmazSettings) -> Iterator[Piece]:
    """The drives of a condition; those of a run depend on its number, its condition's and the seed.

    Args:
        condition: to drive.
        settings: seed and size.
    """
    lanes = lanes_of(settings)
    total = MODES * condition.runs
    for number, begin in enumerate(range(0, total, lanes)):
        chosen = np.arange(begin, min(begin + lanes, total))
        yield _piece(condition, number, chosen, settings.seed)


def _piece(condition: Condition, number: int, chosen: np.ndarray, seed: int) -> Piece:
    drawn = np.array(
        [np.random.default_rng([seed, 7, condition.number, run]).random(2) for run in chosen]
    )
    low, high = np.array([condition.speeds, condition.peaks]).T
    speed, peak = (low + drawn * (high - low)).T
    true = chosen % MODES
    count = len(chosen)
    turn = (chosen // MODES) % len(condition.maneuvers)
    maneuvers = tuple(
        _maneuver(condition.maneuvers[k], float(v), float(a), condition.law)
        for k, v, a in zip(turn, speed, peak, strict=True)
    )
    runs = CorneringRuns(
        level_table(2)[true] == 0,
        maneuvers,
        np.full(count, condition.friction),
        np.full(count, condition.load),
        softened=condition.softened,
        law=condition.law,
        road_level=float(class_level(condition.road)) if condition.road else 0.0,
    )
    own = int(np.random.default_rng([seed, 8, condition.number, number]).integers(2**31))
    return Piece(number, true, speed, runs, own)


def _maneuver(kind: str, speed: float, peak: float, law: str) -> Maneuver:
    if kind == AHEAD:
        return straight_ahead(speed)
    if kind == FOLLOWED:
        return followed_lane_change(speed, peak, begin=ONSET)
    steer = steered_lane_change if kind == STEERED else slalom
    return steer(speed, peak, lateral_suv(law), begin=ONSET)
