"""What the study must show on exact classes, against what it measured."""

from __future__ import annotations

import numpy as np
from scipy.stats import norm

from wheelhop.evaluation.tracking import Interval
from wheelhop.io.report import FAILS, HOLDS, Finding
from wheelhop.studies.frame import verdict_of
from wheelhop.studies.stiffness.claims import at_time, rms
from wheelhop.studies.stiffness.exact_classes import CASES, CHANGE, ExactClasses, lag
from wheelhop.studies.stiffness.runs import at

LARGEST_RMS = 7e3
"""Of the pressure on exact classes from `SETTLED` on [Pa]."""

LARGEST_ERROR = 30e3
"""Of a single run from `SETTLED` on [Pa]."""

SETTLED = 2.0
"""[s]."""

LARGEST_AT_CHANGE = 15e3
"""Rms of the pressure through a change of the road [Pa]."""

BLIND = 0.5
"""Time [s] that is not judged, from the start and from a change of the road."""

LONGEST_LAG = 1.0
"""[s]."""


def kpa(interval: Interval) -> str:
    """A pressure with its interval, as people read it."""
    return f"{interval.value / 1e3:.1f} kPa ({interval.low / 1e3:.1f} to {interval.high / 1e3:.1f})"


def case_name(case: tuple[float, str]) -> str:
    """A case in words."""
    return f"{case[0] / 1e3:.0f} kPa, class {case[1]}"


def class_findings(result: ExactClasses) -> list[Finding]:
    """Claims on exact classes, the class unknown."""
    late = result.time >= SETTLED - 1e-9
    return [
        _rms_at(result, "rms error of the pressure at most 7 kPa at 2 s", SETTLED),
        _rms_from(result, late),
        _every_run(result, late),
        *(_change(result, name) for name in result.change_error),
        _leak(result),
    ]


def _rms_at(result: ExactClasses, claim: str, wanted: float) -> Finding:
    k = at(result.time, wanted)
    found = [at_time(e, result.time, wanted) for e in result.error]
    values = np.array([f.value for f in found])
    best = result.bound[:, k]
    worst = int(np.argmax(values))
    return Finding(
        "exact classes",
        f"{claim}, in all 12 combinations of 130, 180, 230 kPa and classes A to D",
        f"{values.min() / 1e3:.1f} to {values.max() / 1e3:.1f} kPa; the largest is "
        f"{kpa(found[worst])} at {case_name(CASES[worst])}; "
        f"{np.sum(values <= LARGEST_RMS)} of 12 within it",
        verdict_of(values <= LARGEST_RMS),
        _why_bound(best, wanted) + _over_bound(values, best),
    )


def _why_bound(best: np.ndarray, wanted: float) -> str:
    above = int(np.sum(best > LARGEST_RMS))
    text = (
        f"The posterior Cramer-Rao bound after {wanted:g} s with the class known lies between "
        f"{best.min() / 1e3:.1f} and {best.max() / 1e3:.1f} kPa"
    )
    if above:
        return (
            f"{text}, above 7 kPa in {above} of 12: there no estimator without more prior "
            "knowledge can meet it. "
        )
    return f"{text}. "


def _over_bound(values: np.ndarray, best: np.ndarray) -> str:
    ratio = values / best
    return f"Measured over bound: {ratio.min():.2f} to {ratio.max():.2f}."


def _rms_from(result: ExactClasses, late: np.ndarray) -> Finding:
    over_time = rms(result.error)
    values = over_time[:, late].max(axis=1)
    worst = int(np.argmax(values))
    when = float(result.time[late][np.argmax(over_time[worst, late])])
    met = [
        result.time[late][np.flatnonzero(row > LARGEST_RMS)[-1]] if (row > LARGEST_RMS).any() else 2
        for row in over_time[:, late]
    ]
    allowed = [
        result.time[np.flatnonzero(row > LARGEST_RMS)[-1]] if (row > LARGEST_RMS).any() else 0.0
        for row in result.bound
    ]
    return Finding(
        "exact classes",
        "rms error of the pressure at most 7 kPa at every time from 2 s on, in all 12 combinations",
        f"largest of all times {values.min() / 1e3:.1f} to {values.max() / 1e3:.1f} kPa, the last "
        f"at {case_name(CASES[worst])}, {when:.1f} s; all 12 within it from {max(met):.1f} s on; "
        f"{np.sum(values <= LARGEST_RMS)} of 12 from 2 s on",
        verdict_of(values <= LARGEST_RMS),
        f"The bound with the class known falls below 7 kPa between {min(allowed):.1f} and "
        f"{max(allowed):.1f} s after the start, by case.",
    )


def _every_run(result: ExactClasses, late: np.ndarray) -> Finding:
    largest = np.abs(result.error[:, :, late]).max(axis=2)
    outside = np.sum(~(largest <= LARGEST_ERROR), axis=1)
    total, runs = largest.size, largest.shape[1]
    best = result.bound[:, at(result.time, SETTLED)]
    expected = runs * 2.0 * norm.sf(LARGEST_ERROR / best).sum()
    worst = int(np.argmax(largest.max(axis=1)))
    return Finding(
        "exact classes",
        "every run within 30 kPa from 2 s on, in all 12 combinations",
        f"{outside.sum()} of {total} runs leave it, in {np.sum(outside > 0)} of 12 combinations; "
        f"the largest error is {largest.max() / 1e3:.0f} kPa at {case_name(CASES[worst])}",
        verdict_of(outside == 0),
        f"Gaussian errors as large as the bound allows at 2 s with the class known would leave it "
        f"in {expected:.1f} of {total} runs at that time.",
    )


def _change(result: ExactClasses, name: str) -> Finding:
    error, best = result.change_error[name], result.change_bound[name]
    t, over_time = result.time, rms(result.change_error[name])
    before = (t >= BLIND - 1e-9) & (t <= CHANGE)
    after = t >= CHANGE + BLIND - 1e-9
    between = (t > CHANGE) & ~after
    worst = t[after][np.argmax(over_time[after])]
    start = float(over_time[before].max())
    met = t[before][np.flatnonzero(over_time[before] > LARGEST_AT_CHANGE)]
    early = (
        f"before the change it is within 15 kPa from {met[-1]:.2f} s after the start on"
        if met.size
        else "before the change likewise from 0.5 s after the start on"
    )
    passed = [bool(over_time[after].max() <= LARGEST_AT_CHANGE), start <= LARGEST_AT_CHANGE]
    return Finding(
        "exact classes",
        f"road from class {name} at {CHANGE:g} s: rms error of the pressure never above 15 kPa "
        "from 0.5 s on, after the start and after the change",
        f"after the change at most {kpa(at_time(error, t, float(worst)))}, in the half second that "
        f"is left out at most {over_time[between].max() / 1e3:.1f} kPa; {early} "
        f"(at 0.5 s {kpa(at_time(error, t, BLIND))})",
        verdict_of(passed),
        f"With the class known the bound is {best[at(t, BLIND)] / 1e3:.1f} kPa at 0.5 s after the "
        f"start, on the mean of three pressures, and {best[after][0] / 1e3:.1f} kPa half a second "
        "after the change.",
    )


def _leak(result: ExactClasses) -> Finding:
    shift, left = lag(result.time, result.leak_truth, result.leak, CHANGE)
    passed = shift.value < LONGEST_LAG
    end = at(result.time, CHANGE + 1.5)
    behind = float(np.mean(result.leak[:, end] - result.leak_truth[end]))
    return Finding(
        "exact classes",
        "230 to 180 kPa within 1.5 s: followed with a lag below 1 s",
        f"{shift.value:.2f} s ({shift.low:.2f} to {shift.high:.2f}) fit best, with "
        f"{left / 1e3:.1f} kPa rms left; at the end of the leak the mean of the runs is "
        f"{behind / 1e3:.0f} kPa behind",
        HOLDS if passed else FAILS,
        "The lag is the shift in time of the true course that comes nearest to all estimates from "
        "the beginning of the leak on. No bound forbids a shorter one: it is paid for by the "
        "accuracy of a tyre that holds.",
    )
