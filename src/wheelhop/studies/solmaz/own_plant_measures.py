"""Figures of merit of the contenders on the paper's own car, from their verdicts."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from wheelhop.evaluation.tracking import Interval
from wheelhop.studies.solmaz.outcomes import (
    MODES,
    SOUND,
    confusion,
    detection_time,
    share,
    switches_per_minute,
    tires_right,
)
from wheelhop.studies.solmaz.own_plant import BANK, LevelTrial, OwnPlant
from wheelhop.studies.solmaz.own_plant_cases import EXACT_STEER, MAIN, SECOND, STRAIGHT, truths
from wheelhop.studies.solmaz.paper_limits import mode_limits
from wheelhop.studies.solmaz.settings import ONSET, SPEED

RIGHT = 0.95
"""Share of runs told right from which on a method is said to work."""

RARE = 0.05
"""Share of false alarms up to which they are said to be rare."""

SURE = 0.9
"""Probability from which on the bank is said to be sure."""

_STEERED = 7.0
_BINS = np.array([0.0, 0.5, 0.7, 0.8, 0.9, 0.95, 0.99, 0.999, 1.0 + 1e-9])
_FEWEST = 200


class Score(NamedTuple):
    """Of a contender in a case.

    Attributes:
        confusion: share of the runs of a true mode (rows) told as each, in the end, [16, 16].
        right: share of all runs told right in the end.
        steered: the same when the steering ends.
        tires: share of runs in which each tyre is told right in the end, [4].
        times: from the onset until right for good [s], infinite if never, [runs].
        truths: share told right of every mode, [16].
        slowest: time by which 90 % of the runs of a mode are right for good [s], [16].
    """

    confusion: np.ndarray
    right: Interval
    steered: float
    tires: np.ndarray
    times: np.ndarray
    truths: np.ndarray
    slowest: np.ndarray


class Straight(NamedTuple):
    """Of a contender on a car that never turns; shares of time [-].

    Attributes:
        sound: a soft tyre is named on the sound car.
        sound_sure: the same with a probability beyond `SURE`.
        soft: a sound tyre is called soft on cars with a soft one.
        soft_sure: the same with a probability beyond `SURE`.
        sound_end: a soft tyre is named with that probability in the end, share of the sound runs.
        switches: changes of mind of the sound car [1/min].
    """

    sound: float
    sound_sure: float
    soft: float
    soft_sure: float
    sound_end: float
    switches: float


class Reliability(NamedTuple):
    """Of the bank's probabilities, by bins of them.

    Attributes:
        stated: mean [-], [bins].
        observed: share in which the mode named is the true one [-], [bins].
        samples: in each, [bins].
    """

    stated: np.ndarray
    observed: np.ndarray
    samples: np.ndarray


class Swept(NamedTuple):
    """Of the contenders over lane changes of different strength.

    Attributes:
        amplitudes: of the front wheels' angle [rad], [levels].
        peaks: largest lateral acceleration of the sound car [m/s^2], [levels].
        least, most: the same of all cars [m/s^2], [levels].
        beyond: number of cars that leave the range of their tyres' law, [levels].
        shares: told right in the end, of each contender, [levels].
    """

    amplitudes: np.ndarray
    peaks: np.ndarray
    least: np.ndarray
    most: np.ndarray
    beyond: np.ndarray
    shares: dict[str, list[Interval]]


def score(result: OwnPlant, case: str, who: str) -> Score:
    """Of one contender."""
    true, told = truths(result.cases[case]), result.verdicts[case][who].selected
    times = detection_time(result.time, told, true, ONSET)
    ended = int(np.argmin(np.abs(result.time - (ONSET + _STEERED))))
    matrix = confusion(true, told[:, -1])
    return Score(
        matrix,
        share(told[:, -1] == true),
        float(np.mean(told[:, ended] == true)),
        tires_right(true, told[:, -1]),
        times,
        np.diag(matrix),
        np.array([quantile(times[true == mode], 0.9) for mode in range(MODES)]),
    )


def quantile(times: np.ndarray, part: float) -> float:
    """Time by which a part of the runs is done [s]; infinite if it is not."""
    return float(np.quantile(times, part, method="inverted_cdf"))


def straight(result: OwnPlant, who: str, case: str = STRAIGHT) -> Straight:
    """Of one contender, over the whole drive."""
    true, found = truths(result.cases[case]), result.verdicts[case][who]
    is_sound = np.asarray(true == SOUND)
    sure = np.asarray((found.soft > SURE).any(axis=-1))
    innocent = ~_soft(true)[:, None, :]
    return Straight(
        float(np.mean(found.selected[is_sound] != SOUND)),
        float(np.mean(sure[is_sound])),
        float(np.mean((_soft(found.selected) & innocent).any(axis=-1)[~is_sound])),
        float(np.mean(((found.soft > SURE) & innocent).any(axis=-1)[~is_sound])),
        float(np.mean(sure[is_sound][:, -1])),
        float(np.mean(switches_per_minute(result.time, found.selected[is_sound]))),
    )


def _soft(modes: np.ndarray) -> np.ndarray:
    """Whether each tyre is soft, [..., 4]: digits of the mode in binary, one for a sound tyre."""
    sound = (modes[..., None] >> np.array([3, 2, 1, 0])) & 1
    return np.asarray(sound == 0)


def reliability(result: OwnPlant, case: str = MAIN) -> Reliability:
    """Of the bank, over all samples from the onset of steering on; bins of few are left out."""
    true, found = truths(result.cases[case]), result.verdicts[case][BANK]
    later = result.time > ONSET
    p = found.probability[:, later].ravel()
    right = (found.selected == true[:, None])[:, later].ravel()
    place = np.clip(np.digitize(p, _BINS) - 1, 0, len(_BINS) - 2)
    count = np.bincount(place, minlength=len(_BINS) - 1)
    full = count >= _FEWEST
    sums = (np.bincount(place, w, minlength=len(count)) for w in (p, right.astype(float)))
    stated, observed = (total[full] / count[full] for total in sums)
    return Reliability(stated, observed, count[full])


def swept(result: OwnPlant) -> Swept:
    """The lane changes of different strength, from the mildest."""
    names = [name for name in result.cases if name.startswith("sweep")]
    peaks = np.array([result.peaks[name] for name in names])
    beyond = (peaks > mode_limits(SPEED).guard).sum(axis=1)
    amplitudes = np.array([result.cases[name].amplitude for name in names])
    shares = {
        who: [
            share(result.verdicts[n][who].selected[:, -1] == truths(result.cases[n])) for n in names
        ]
        for who in result.verdicts[MAIN]
    }
    ends = (peaks.min(axis=1), peaks.max(axis=1))
    return Swept(amplitudes, peaks[:, SOUND], *ends, beyond, shares)


def works(peaks: np.ndarray, shares: list[Interval]) -> tuple[float, float]:
    """Least and largest lateral acceleration [m/s^2] of the longest stretch of levels in which at
    least `RIGHT` of the runs are told right; NaN if there is none."""
    good = [s.value >= RIGHT for s in shares]
    best, begin = (0, 0), 0
    for k in range(len(good) + 1):
        if k == len(good) or not good[k]:
            best = max(best, (k - begin, begin))
            begin = k + 1
    length, begin = best
    nothing = float("nan")
    return (float(peaks[begin]), float(peaks[begin + length - 1])) if length else (nothing, nothing)


def condition_names(result: OwnPlant) -> list[str]:
    """Cases that hold something the estimators do not know of, and the usual one first."""
    others = (MAIN, SECOND, STRAIGHT, EXACT_STEER)
    return [MAIN] + [n for n in result.cases if n not in others and not n.startswith("sweep")]


def soft_right(result: OwnPlant, case: str, who: str) -> Interval:
    """Share of the runs with soft tyres that are told right in the end."""
    true, last = truths(result.cases[case]), result.verdicts[case][who].selected[:, -1]
    return share((last == true)[true != SOUND])


def false_alarms(result: OwnPlant, case: str, who: str) -> Interval:
    """Share of the runs of the sound car in which a soft tyre is named in the end."""
    true, last = truths(result.cases[case]), result.verdicts[case][who].selected[:, -1]
    return share(last[true == SOUND] != SOUND)


def sure_alarms(result: OwnPlant, case: str) -> float:
    """Share of the sound car's runs in which the bank is sure of a soft tyre in the end."""
    true, found = truths(result.cases[case]), result.verdicts[case][BANK]
    return float(np.mean((found.soft[true == SOUND, -1] > SURE).any(axis=-1)))


def level_shares(trial: LevelTrial, who: str) -> tuple[np.ndarray, float, float]:
    """Share of the tyres of each level told as each [levels, levels], NaN where there is none;
    share of runs with all levels right; share with all tyres below the sound level found."""
    true, told = trial.true, trial.told[who]
    sound = 2
    counts = np.zeros((sound + 1, sound + 1))
    np.add.at(counts, (true.ravel(), told.ravel()), 1.0)
    total = counts.sum(axis=1, keepdims=True)
    shares = np.divide(counts, total, out=np.full(counts.shape, np.nan), where=total > 0)
    found = ((true < sound) == (told < sound)).all(axis=1)
    return shares, float((true == told).all(axis=1).mean()), float(found.mean())
