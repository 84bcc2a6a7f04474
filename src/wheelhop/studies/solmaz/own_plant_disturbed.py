"""What the paper leaves out: probabilities, roads, loads, offsets, the sign of the pressure.

Findings with verdicts, of the cases in which something is other than the estimators believe.
"""

from __future__ import annotations

import numpy as np

from wheelhop.io.report import Finding
from wheelhop.studies.frame import verdict_of
from wheelhop.studies.solmaz.outcomes import SOUND
from wheelhop.studies.solmaz.own_plant import BANK, OBSERVER, PRINTED, OwnPlant
from wheelhop.studies.solmaz.own_plant_cases import MAIN, OFFSETS
from wheelhop.studies.solmaz.own_plant_measures import (
    RARE,
    RIGHT,
    false_alarms,
    level_shares,
    reliability,
    soft_right,
    sure_alarms,
)

_BEYOND = "beyond the paper"
_CALIBRATED = 0.05


def disturbed_findings(result: OwnPlant) -> list[Finding]:
    """Probabilities, friction, offsets, load, missing samples, pressure sign, levels."""
    return [
        _probabilities(result),
        _road(result),
        *(_known(result, *row) for row in _KNOWN),
        _sign(result),
        _levels(result),
    ]


def _probabilities(result: OwnPlant) -> Finding:
    found = reliability(result)
    pairs = ", ".join(
        f"{s:.1%}: {o:.1%}" for s, o in zip(found.stated, found.observed, strict=True)
    )
    return Finding(
        _BEYOND,
        "the bank is right as often as its probabilities say",
        f"stated and observed: {pairs}",
        verdict_of(np.abs(found.stated - found.observed) <= _CALIBRATED),
        f"All times after the onset of steering, in bins of the probability; within "
        f"{100 * _CALIBRATED:.0f} points is taken as right. The car is the bank's own model here.",
    )


def _road(result: OwnPlant) -> Finding:
    names = [n for n in result.cases if n.startswith("friction")]
    words = "; ".join(
        f"{n}: {false_alarms(result, n, PRINTED).value:.0%} {PRINTED}, "
        f"{false_alarms(result, n, OBSERVER).value:.0%} {OBSERVER}, "
        f"{false_alarms(result, n, BANK).value:.0%} bank (sure: {sure_alarms(result, n):.0%})"
        for n in names
    )
    good = [false_alarms(result, n, BANK).value <= RARE for n in names]
    return Finding(
        _BEYOND,
        "a slippery road is not called a soft tyre by the bank, which estimates friction",
        f"runs of the sound car that end with a soft tyre named: {words}",
        verdict_of(good),
        f"Rare is taken as {RARE:.0%}. The switched models take the road as dry. The driver of a "
        "slippery road steers less, in proportion to the friction, but where it says as if dry.",
    )


_KNOWN = (
    (
        "offsets of the sensors of usual size do not matter to the bank, which estimates them",
        ("offsets of the sensors",),
        f"Standard deviations {OFFSETS[0]:g} m/s^2, {OFFSETS[1]:g} rad/s and {OFFSETS[2]:g} rad at "
        "the wheels, drawn for each run. A switched model has no place for them.",
    ),
    (
        "a load 20 % off does not matter to the bank, which estimates the mass",
        ("20 % less load", "20 % more load"),
        "A heavier car on the same tyres answers as a car on softer ones. Switched models know one "
        "mass only.",
    ),
    (
        "5 % of the samples missing do not matter to the bank",
        ("5 % of the samples missing",),
        "Each sensor loses them by itself.",
    ),
)


def _known(result: OwnPlant, claim: str, names: tuple[str, ...], why: str) -> Finding:
    rows = []
    for name in names:
        parts = [
            f"{who} {soft_right(result, name, who).value:.0%} and "
            f"{false_alarms(result, name, who).value:.0%}"
            for who in (PRINTED, OBSERVER, BANK)
        ]
        rows.append(f"{name}: {', '.join(parts)}")
    passed = [
        ok
        for name in names
        for ok in (
            soft_right(result, name, BANK).value >= RIGHT,
            false_alarms(result, name, BANK).value <= RARE,
        )
    ]
    return Finding(
        _BEYOND,
        claim,
        "soft tyres told right, and the sound car called soft; " + "; ".join(rows),
        verdict_of(passed),
        why,
    )


def _sign(result: OwnPlant) -> Finding:
    unknown, known = (f"opposite pressure sign, {word}" for word in ("unknown", "known"))
    words = [
        f"{who} {soft_right(result, unknown, who).value:.0%}, told of it "
        f"{soft_right(result, known, who).value:.0%}"
        for who in (PRINTED, OBSERVER, BANK)
    ]
    return Finding(
        "Section III",
        "the sign with which cornering stiffness follows pressure need not be known",
        f"soft tyres told right where a soft tyre grips more: {'; '.join(words)}",
        verdict_of(
            [soft_right(result, unknown, who).value >= RIGHT for who in (PRINTED, OBSERVER, BANK)]
        ),
        "Passenger tyres are measured with either sign near their usual load. Who believes the "
        "wrong one looks for the loss of grip on the wrong tyres; the law must be measured first.",
    )


def _levels(result: OwnPlant) -> Finding:
    found = {
        f"{who} at {result.peaks[case][SOUND]:.2g} m/s^2": level_shares(trial, who)
        for case, trial in result.levels.items()
        for who in trial.told
    }
    words = "; ".join(
        f"{what}: all levels right in {exact:.0%} of the runs, the tyres below the sound level "
        f"found in {which:.0%}"
        for what, (_, exact, which) in found.items()
    )
    return Finding(
        "Section III, step 1",
        "further sets of models tell how soft a tyre is",
        words,
        verdict_of([exact >= RIGHT for _, exact, _ in found.values()]),
        f"Three levels of every tyre make 81 models; half soft is half way between the paper's "
        f"tyres. {len(result.levels[MAIN].true)} runs of each lane change, with up to two tyres "
        "below the sound level.",
    )
