"""All 16 combinations of soft tyres on the paper's own car: who names them, and under what.

Three contenders get the same sensors: the paper's method as it is printed, its models with an
observer of the side slip, and the same hypotheses as a bank of filters with probabilities.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from wheelhop.estimators.failure_modes import level_table
from wheelhop.estimators.lateral import STEADY_TUNING, LateralSample, SwitchTuning
from wheelhop.estimators.lateral_model import LateralTuning
from wheelhop.studies.frame import Advance, Store
from wheelhop.studies.solmaz.judges import EVERY, LANES, Verdicts, by_filters, by_switching
from wheelhop.studies.solmaz.own_plant_cases import (
    LEVEL_CASES,
    LEVELS,
    Case,
    cases,
    drive,
    driven,
    sensed,
    truths,
)
from wheelhop.studies.solmaz.settings import DURATION, SolmazSettings
from wheelhop.vehicle.cornering import DT
from wheelhop.vehicle.lateral_tire import NOMINAL_TIRE
from wheelhop.vehicle.two_track import SOLMAZ_CAR, Wheels

PRINTED, OBSERVER, BANK = "as printed", "observer", "bank of filters"

QUICK_LANES = 16
"""Runs judged at once in a quick study."""

_LEVEL_LANES = 16
_LEVEL_SHARE = 0.04

LEVEL_TRUTHS = (
    (2, 2, 2, 2),
    (1, 2, 2, 2),
    (2, 1, 2, 2),
    (2, 2, 1, 2),
    (2, 2, 2, 1),
    (0, 2, 2, 2),
    (2, 0, 2, 2),
    (2, 2, 0, 2),
    (2, 2, 2, 0),
    (1, 1, 2, 2),
    (0, 2, 1, 2),
    (1, 2, 2, 0),
)
"""Levels of the tyres that the version with three levels is tried on: 0 soft, 1 half, 2 sound."""


class LevelTrial(NamedTuple):
    """Of the version with three levels in one case.

    Attributes:
        true: levels of the tyres, [runs, 4].
        told: levels in the end by each contender, [runs, 4].
    """

    true: np.ndarray
    told: dict[str, np.ndarray]


class OwnPlant(NamedTuple):
    """Results.

    Attributes:
        settings: that made them.
        time: of the verdicts [s], [time].
        cases: by name.
        peaks: largest lateral acceleration of every mode [m/s^2], [16], of each case.
        verdicts: of each case, by contender.
        levels: the version with three levels, of `LEVEL_CASES`.
    """

    settings: SolmazSettings
    time: np.ndarray
    cases: dict[str, Case]
    peaks: dict[str, np.ndarray]
    verdicts: dict[str, dict[str, Verdicts]]
    levels: dict[str, LevelTrial]


Judge = Callable[[LateralSample, Sequence[Any], int], Verdicts]


def _by_switching(
    tuning: SwitchTuning, slip: str, printed: bool, y: LateralSample, levels: Any, lanes: int
) -> Verdicts:
    return by_switching(y, DT, SOLMAZ_CAR, levels, tuning, slip, printed, lanes=lanes)


def _by_filters(y: LateralSample, levels: Any, lanes: int) -> Verdicts:
    return by_filters(y, DT, SOLMAZ_CAR, levels, LateralTuning(), lanes=lanes)


CONTENDERS: Mapping[str, Judge] = {
    PRINTED: partial(_by_switching, SwitchTuning(), "integrated", True),
    OBSERVER: partial(_by_switching, STEADY_TUNING, "observer", False),
    BANK: _by_filters,
}
"""What judges samples with the tyres it believes in, so many runs at once."""


def own_plant(settings: SolmazSettings, store: Store, advance: Advance) -> OwnPlant:
    """Drive every case and let every contender judge it.

    Args:
        settings: of the study.
        store: of what is finished.
        advance: told of the cases.
    """
    every = cases(settings)
    total = len(every) + len(LEVEL_CASES)
    lanes = QUICK_LANES if settings.quick else LANES
    peaks, verdicts = {}, {}
    for done, (name, case) in enumerate(every.items()):
        advance(done, total)
        work = partial(judged, case, settings, lanes)
        found = store.arrays(f"own_plant_{done}", _depends(case, settings), work)
        peaks[name] = found.pop("peak")
        verdicts[name] = {who: _unpacked(found, who) for who in CONTENDERS}
    levels = {}
    for k, name in enumerate(LEVEL_CASES):
        advance(len(every) + k, total)
        work = partial(_level_trial, every[name], settings)
        found = store.arrays(f"own_plant_levels_{k}", _depends(every[name], settings), work)
        levels[name] = LevelTrial(found.pop("true"), found)
    advance(total, total)
    time = DT * np.arange(EVERY, round(DURATION / DT) + 1, EVERY)
    return OwnPlant(settings, time, every, peaks, verdicts, levels)


def _depends(case: Case, settings: SolmazSettings) -> dict[str, Any]:
    noise = {"noise": settings.noise, "yaw_rate_noise": settings.yaw_rate_noise}
    return (
        asdict(case)
        | noise
        | {"seed": settings.seed, "runs of main": settings.runs, "quick": settings.quick}
    )


def judged(
    case: Case, settings: SolmazSettings, lanes: int, samples: int = round(DURATION / DT)
) -> dict[str, np.ndarray]:
    """Verdicts of every contender on a case, and the peaks of its drives.

    Args:
        case: to drive.
        settings: noise and seed.
        lanes: runs judged at once.
        samples: of a drive.
    """
    drives = driven(case, samples)
    y = sensed(drives, truths(case), case, settings)
    found = {"peak": np.abs(drives.lateral_acceleration).max(axis=1)}
    for who, judge in CONTENDERS.items():
        verdicts = judge(y, (case.believed, NOMINAL_TIRE), lanes)
        found |= {f"{who} {n}": v for n, v in zip(Verdicts._fields, _small(verdicts), strict=True)}
    return found


def _small(verdicts: Verdicts) -> Verdicts:
    """The same in few bytes; what is told without probabilities is not kept twice."""
    return Verdicts(
        verdicts.selected.astype(np.int8), *(a.astype(np.float32) for a in verdicts[1:])
    )


def _unpacked(found: Mapping[str, np.ndarray], who: str) -> Verdicts:
    selected, *rest = (found[f"{who} {name}"] for name in Verdicts._fields)
    return Verdicts(selected.astype(int), *rest)


def _level_trial(case: Case, settings: SolmazSettings) -> dict[str, np.ndarray]:
    """Levels told of `LEVEL_TRUTHS` by the two that do without integration."""
    table = np.array(LEVEL_TRUTHS[::4] if settings.quick else LEVEL_TRUTHS)
    tires = Wheels(*(_of_levels(column) for column in table.T))
    each = max(1, round(_LEVEL_SHARE * settings.runs))
    rows = np.repeat(np.arange(len(table)), each)
    y = sensed(drive(tires, case), rows, case, settings)
    found = {"true": table[rows]}
    # 81 filters take as long to compile as all the rest of a quick study
    for who in (OBSERVER,) if settings.quick else (OBSERVER, BANK):
        told = CONTENDERS[who](y, LEVELS, _LEVEL_LANES).selected[:, -1]
        found[who] = level_table(len(LEVELS))[told]
    return found


def _of_levels(column: np.ndarray) -> Any:
    k1, k2, k3 = (np.array([getattr(LEVELS[n], k) for n in column]) for k in ("k1", "k2", "k3"))
    return type(NOMINAL_TIRE)(k1, k2, k3)
