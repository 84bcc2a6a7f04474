"""Figures of merit on the full vehicle: what is told, what is not, and what is told wrong."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from wheelhop.estimators.failure_modes import level_table
from wheelhop.estimators.lateral_vehicle import SURE, is_told
from wheelhop.evaluation.tracking import Interval
from wheelhop.plots.soft_tires import OUTCOME_COLOURS
from wheelhop.studies.solmaz.full_vehicle import BANK, FullVehicleResult, Outcome
from wheelhop.studies.solmaz.judges import EVERY, Verdicts
from wheelhop.studies.solmaz.outcomes import SOUND, detection_time, share, tires_right
from wheelhop.studies.solmaz.vehicle_conditions import MAIN, ONSET
from wheelhop.studies.solmaz.vehicle_drives import RATE

RIGHT = 0.95
"""Share of the runs from which on a method is said to work."""

PEAKS = (0.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, np.inf)
"""Edges of the bins of lateral acceleration [m/s^2]."""

_FEWEST = 10
_BINS = np.array([0.0, 0.5, 0.7, 0.8, 0.9, 0.95, 0.99, 1.0 + 1e-9])
_FEWEST_SAMPLES = 200


class Tally(NamedTuple):
    """Of a condition, runs that lost control left out; shares [-].

    Attributes:
        runs: that count.
        lost: runs that lost control.
        right: most probable at the end is the truth.
        switched: the switched models name the truth at the end.
        told: a combination is told at the end, as `lateral_vehicle.is_told` says.
        outcomes: by the names of `OUTCOME_COLOURS`, [5].
        wrong: something wrong is told at the end.
        tires: each tyre right in what is most probable at the end, [4].
        alarms: sound cars of which a soft tyre is told; NaN without sound cars.
        ever: runs of which something wrong was told at any time.
    """

    runs: int
    lost: int
    right: Interval
    switched: Interval
    told: float
    outcomes: np.ndarray
    wrong: float
    tires: np.ndarray
    alarms: float
    ever: float


def tally(outcome: Outcome, chosen: np.ndarray | None = None) -> Tally:
    """Of the runs of a condition.

    Args:
        outcome: of the condition.
        chosen: which runs to take, [runs]; all by default.
    """
    kept = ~outcome.lost if chosen is None else ~outcome.lost & chosen
    true = outcome.true[kept]
    last = outcome.bank.selected[kept, -1]
    right = last == true
    telling = told_over_time(outcome)[kept]
    wrong = telling & (outcome.bank.selected[kept] != true[:, None])
    is_told = telling[:, -1]
    sound = true == SOUND
    alarms = float(np.mean(wrong[sound, -1])) if sound.any() else float("nan")
    soft = level_table(2) == 0
    accused = (soft[last] & ~soft[true]).any(axis=1)
    parts = (
        is_told & right,
        ~is_told & right,
        ~is_told & ~right,
        is_told & ~right & ~accused,
        is_told & accused,
    )
    lost = outcome.lost if chosen is None else outcome.lost & chosen
    return Tally(
        int(kept.sum()),
        int(lost.sum()),
        share(right),
        share(outcome.switched.selected[kept, -1] == true),
        float(is_told.mean()),
        np.array([part.mean() for part in parts]),
        float((is_told & ~right).mean()),
        tires_right(true, last),
        alarms,
        float(wrong.any(axis=1).mean()),
    )


def told_over_time(outcome: Outcome) -> np.ndarray:
    """Whether the bank tells what is most probable, [runs, time]."""
    bank = outcome.bank
    return is_told(bank.selected, bank.probability, outcome.cornered, EVERY / RATE)


def by_peak(outcome: Outcome) -> list[tuple[str, Tally]]:
    """Tallies by the lateral acceleration reached.

    Args:
        outcome: of a condition.
    """
    found = []
    for low, high, chosen in _bins(outcome):
        name = f"below {high:g}" if low == 0.0 else f"above {low:g}"
        name = name if low == 0.0 or np.isinf(high) else f"{low:g} to {high:g}"
        found.append(
            ("all" if high - low == np.inf and low == 0.0 else name, tally(outcome, chosen))
        )
    return found


def works_from(outcome: Outcome) -> float:
    """Least edge of a bin [m/s^2] from which on every bin has `RIGHT` of its runs right; infinite
    if the last has not.

    Args:
        outcome: of a condition.
    """
    edge = float("inf")
    for low, _, chosen in reversed(_bins(outcome)):
        if tally(outcome, chosen).right.value < RIGHT:
            break
        edge = low
    return edge


def _bins(outcome: Outcome) -> list[tuple[float, float, np.ndarray]]:
    """Edges [m/s^2] and runs of the bins that have enough; everything where none has."""
    found = []
    for low, high in pairwise(PEAKS):
        chosen = (outcome.peak >= low) & (outcome.peak < high)
        if (chosen & ~outcome.lost).sum() >= _FEWEST:
            found.append((low, high, chosen))
    return found or [(0.0, float("inf"), np.ones(len(outcome.peak), bool))]


def times(result: FullVehicleResult, who: str, condition: str = MAIN) -> np.ndarray:
    """From the onset of steering until the truth is most probable for good [s], [runs kept]."""
    outcome = result.outcomes[condition]
    kept = ~outcome.lost
    found = verdicts_of(outcome, who).selected[kept]
    return detection_time(result.time, found, outcome.true[kept], ONSET)


def verdicts_of(outcome: Outcome, who: str) -> Verdicts:
    """Of one of the two contenders."""
    return outcome.bank if who == BANK else outcome.switched


def selected_at(result: FullVehicleResult, who: str, after: float) -> np.ndarray:
    """Mode believed so long after the onset of steering [s], runs that lost control left out."""
    outcome = result.outcomes[MAIN]
    at = int(np.argmin(np.abs(result.time - (ONSET + after))))
    return np.asarray(verdicts_of(outcome, who).selected[~outcome.lost, at])


def reliability(result: FullVehicleResult) -> tuple[np.ndarray, np.ndarray]:
    """Mean probability that the bank states [-], and share in which it is right [-], by bins, over
    all samples from the onset of steering on; bins of few samples left out."""
    outcome = result.outcomes[MAIN]
    kept, later = ~outcome.lost, result.time > ONSET
    p = outcome.bank.probability[kept][:, later].ravel()
    right = (outcome.bank.selected == outcome.true[:, None])[kept][:, later].ravel()
    place = np.clip(np.digitize(p, _BINS) - 1, 0, len(_BINS) - 2)
    count = np.bincount(place, minlength=len(_BINS) - 1)
    full = count >= _FEWEST_SAMPLES
    stated, observed = (
        np.bincount(place, weights, minlength=len(count))[full] / count[full]
        for weights in (p.astype(float), right.astype(float))
    )
    return stated, observed


def false_names(outcome: Outcome, who: str) -> float:
    """Share of the runs in which a sound tyre is called soft at the end by what is most probable,
    or by the switched models [-].

    Args:
        outcome: of a condition.
        who: the contender.
    """
    soft = level_table(2) == 0
    last = verdicts_of(outcome, who).selected[~outcome.lost, -1]
    return float(np.mean((soft[last] & ~soft[outcome.true[~outcome.lost]]).any(axis=1)))


def sure_and_wrong(outcome: Outcome) -> float:
    """Share of the runs in which the bank is sure of something wrong at the end, told or not [-].

    Args:
        outcome: of a condition.
    """
    bank, kept = outcome.bank, ~outcome.lost
    wrong = bank.selected[:, -1] != outcome.true
    return float(np.mean((wrong & (bank.probability[:, -1] >= SURE))[kept]))


def outcome_shares(tallies: list[Tally]) -> dict[str, np.ndarray]:
    """What becomes of the runs by the names of `OUTCOME_COLOURS`, each [tallies]."""
    table = np.array([t.outcomes for t in tallies])
    return dict(zip(OUTCOME_COLOURS, table.T, strict=True))
