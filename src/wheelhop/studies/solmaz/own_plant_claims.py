"""Where the method works on the paper's own car and where it does not: findings with verdicts."""

from __future__ import annotations

import numpy as np

from wheelhop.estimators.failure_modes import mode_names
from wheelhop.evaluation.tracking import Interval
from wheelhop.io.report import Finding
from wheelhop.studies.frame import verdict_of
from wheelhop.studies.solmaz.outcomes import SOUND
from wheelhop.studies.solmaz.own_plant import BANK, OBSERVER, PRINTED, OwnPlant
from wheelhop.studies.solmaz.own_plant_cases import EXACT_STEER, MAIN, SECOND
from wheelhop.studies.solmaz.own_plant_disturbed import disturbed_findings
from wheelhop.studies.solmaz.own_plant_measures import (
    RARE,
    RIGHT,
    SURE,
    quantile,
    score,
    straight,
    swept,
    works,
)

SOON = 1.0
"""Time by which the paper's model is selected [s]."""


def own_plant_findings(result: OwnPlant) -> list[Finding]:
    """All 16 failures, straight ahead, the lateral acceleration needed, and what disturbs."""
    contenders = (PRINTED, OBSERVER, BANK)
    return [
        *(_where(result, who) for who in contenders),
        *(_all_modes(result, who) for who in contenders),
        *(_soon(result, who) for who in contenders),
        *(_straight(result, who) for who in contenders),
        *disturbed_findings(result),
    ]


def _where(result: OwnPlant, who: str) -> Finding:
    every = swept(result)
    peaks, shares = every.peaks, every.shares
    low, high = works(peaks, shares[who])
    top = float(peaks[-1])
    found = ", ".join(f"{s.value:.0%} at {a:.2g}" for a, s in zip(peaks, shares[who], strict=True))
    if np.isnan(low):
        words = f"nowhere from {peaks[0]:.2g} to {top:.2g} m/s^2 are {RIGHT:.0%} of the runs right"
    elif low == high:
        words = f"at least {RIGHT:.0%} of the runs are right at {low:.2g} m/s^2 only"
    else:
        words = f"at least {RIGHT:.0%} of the runs are right from {low:.2g} to {high:.2g} m/s^2"
    lost = every.beyond > 0
    law = (
        f" From {peaks[lost][0]:.2g} m/s^2 on, {every.beyond[lost][0]} to {every.beyond.max()} of "
        "the 16 cars corner so hard that a tyre leaves the range of the law."
        if lost.any()
        else ""
    )
    in_corners = [s.value >= RIGHT for a, s in zip(peaks, shares[who], strict=True) if a >= 1.0]
    return Finding(
        "Section V",
        f"the method works in corners, here of 1 m/s^2 and more: {who}",
        words,
        verdict_of(in_corners),
        f"Share of runs in which all four tyres are told right at the end of the drive, over the "
        f"sound car's largest lateral acceleration [m/s^2]: {found}. All 16 combinations "
        f"equally.{law}",
    )


def _all_modes(result: OwnPlant, who: str) -> Finding:
    one, two = score(result, MAIN, who), score(result, SECOND, who)
    names = np.array(mode_names())
    lost = np.flatnonzero(one.truths < RIGHT)
    which = (
        "Below that: " + ", ".join(f"{names[k]} {one.truths[k]:.0%}" for k in lost) + ". "
        if lost.size
        else ""
    )
    amplitudes = [result.cases[name].amplitude for name in (MAIN, SECOND)]
    return Finding(
        "Section III, step 1",
        f"16 models tell all combinations of soft tyres apart: {who}",
        f"at the end of the drive {_interval(one.right)} of the runs are right, "
        f"{one.steered:.1%} when the steering ends; steered twice as far {_interval(two.right)}",
        verdict_of(one.truths >= RIGHT),
        f"Each combination should be told right in {RIGHT:.0%} of its runs. {which}Steered by "
        f"{amplitudes[0]:g} and {amplitudes[1]:g} rad at the wheels, by a driver who also corrects "
        "the yaw rate. The paper shows one combination, without noise.",
    )


def _soon(result: OwnPlant, who: str) -> Finding:
    found = score(result, MAIN, who)
    soft = np.arange(len(found.truths)) != SOUND
    never = float(np.mean(np.isinf(found.times)))
    soon = found.slowest[soft] <= SOON
    return Finding(
        "Section IV, Fig. 7",
        f"the right model is selected within {SOON:g} s of the onset of steering: {who}",
        f"half of the runs are right for good after {_seconds(quantile(found.times, 0.5))}, 90 % "
        f"after {_seconds(quantile(found.times, 0.9))}; {never:.1%} are not right in the end",
        verdict_of(soon),
        f"Within {SOON:g} s in 90 % of the runs for {soon.sum()} of 15 combinations with a soft "
        "tyre. Right for good means until the end of the drive, 15 s after the onset.",
    )


def _straight(result: OwnPlant, who: str) -> Finding:
    found = straight(result, who)
    bank = who == BANK
    shares = (found.sound_sure, found.soft_sure) if bank else (found.sound, found.soft)
    exact = straight(result, who, EXACT_STEER)
    sure = (
        f"; with a probability beyond {SURE:.0%} in {found.sound_sure:.1%} and "
        f"{found.soft_sure:.1%}, and on {found.sound_end:.0%} of the sound cars in the end; with a "
        f"steering sensor without noise on {exact.sound_end:.0%}"
        if bank
        else ""
    )
    return Finding(
        "Section V",
        f"straight ahead the method says nothing wrong: {who}",
        f"a soft tyre is named in {found.sound:.1%} of the time on a sound car; a sound tyre is "
        f"called soft in {found.soft:.1%} of the time on cars with a soft one{sure}",
        verdict_of([s <= RARE for s in shares]),
        f"20 s straight ahead; {found.switches:.1f} changes of mind a minute on the sound car. "
        + {
            PRINTED: "Nothing distinguishes the models, and the noise decides.",
            OBSERVER: "Below a lateral acceleration of 0.3 m/s^2 it keeps its last opinion, here "
            "the one it began with: it does not see a soft tyre either.",
            BANK: "Judged is what it is sure of. The filters take the steering angle as exact: the "
            "noise of its sensor moves the models but not the car, and models with soft front "
            "tyres, which it moves least, fit best; so a sample counts for the less the less "
            "the car corners (gate).",
        }[who],
    )


def _interval(found: Interval) -> str:
    return f"{found.value:.1%} ({found.low:.1%} to {found.high:.1%})"


def _seconds(time: float) -> str:
    return f"{time:.1f} s" if np.isfinite(time) else "more than 15 s"
