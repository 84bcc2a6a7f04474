"""What the paper says of single drives, beside what was measured."""

from __future__ import annotations

import numpy as np

from wheelhop.evaluation.tracking import TOLERANCE
from wheelhop.io.report import HOLDS, Finding
from wheelhop.studies.brancati.claims import (
    judged,
    kpa,
    over_all,
    verdict_of,
)
from wheelhop.studies.brancati.scenarios import CHANGE, CaseResult
from wheelhop.studies.brancati.study import ConventionResult, Validation


def case_findings(study: Validation) -> list[Finding]:
    """Section 5.4: Fig. 7 to 11 and 13."""
    names = over_all(study)
    found = [
        _one_class(study, names, 7, "A"),
        _one_class(study, names, 8, "D"),
        _class_change(study, names),
        _leak(study, names),
        _masses(study, names),
    ]
    if any(c.case.figure == 13 for r in study.conventions.values() for c in r.cases):
        found.append(_measured(study, names))
    return found


def _case(result: ConventionResult, figure: int) -> CaseResult:
    return next(c for c in result.cases if c.case.figure == figure)


def _accuracy(case: CaseResult, name: str) -> str:
    f = case.figures[name]
    when = "" if np.isnan(f.convergence_time) else f" after {f.convergence_time:.1f} s"
    return (
        f"{f.converged:.0%} of the drives within {TOLERANCE / 1e3:g} kPa{when}, final RMSE "
        f"{kpa(f.final_rmse.value)}"
    )


def _one_class(study: Validation, names: list[str], figure: int, road_class: str) -> Finding:
    def say(result: ConventionResult, name: str) -> tuple[str, bool]:
        case = _case(result, figure)
        course = case.courses[name]
        share = course.probabilities[:, course.modes.index(road_class)]
        text = f"{_accuracy(case, name)}, probability of class {road_class} {share[-1]:.2f}"
        f = case.figures[name]
        return text, f.converged > 0.5 and f.convergence_time <= 3.0

    text, passed = judged(study, names, say)
    verdict = verdict_of(passed)
    return Finding(
        f"Section 5.4, Fig. {figure}",
        f"On a class {road_class} road the estimate is acceptable after about 2 s, and the filter "
        f"of class {road_class} has the probability.",
        text,
        verdict,
        "It comes near the truth in time."
        if verdict == HOLDS
        else "The estimate hardly leaves the prior, 40 kPa below the truth, or drifts with the "
        "model's error; which mode gets the probability depends on how well the artificial road's "
        "level fits the innovations, and that works better than the stiffness.",
    )


def _class_change(study: Validation, names: list[str]) -> Finding:
    def say(result: ConventionResult, name: str) -> tuple[str, bool]:
        course = _case(result, 9).courses[name]
        before = course.t <= CHANGE * course.t[-1]
        a, d = (course.probabilities[:, course.modes.index(c)] for c in ("A", "D"))
        first, last = float(a[before][-1]), float(d[-1])
        text = f"probability of A {first:.2f} before the change, of D {last:.2f} at the end"
        return text, first > 0.5 and last > 0.5

    text, passed = judged(study, names, say)
    return Finding(
        "Section 5.4, Fig. 9",
        "When the road changes from class A to D, mode 1 is most trusted before and mode 4 after.",
        text,
        verdict_of(passed),
        "The size of the innovations tells the classes apart, whatever k_t is."
        if any(passed)
        else "With its tuned noise the filter explains every road by the same mode.",
    )


def _leak(study: Validation, names: list[str]) -> Finding:
    def say(result: ConventionResult, name: str) -> tuple[str, bool]:
        case = _case(result, 10)
        course = case.courses[name]
        t, change = course.t, CHANGE * course.t[-1]
        drop = float(
            course.pressure[t > t[-1] - 1.0].mean()
            - course.pressure[(t > change - 1.0) & (t <= change)].mean()
        )
        true = float(case.truth[-1] - case.truth[0])
        text = f"the estimate moves by {drop / 1e3:+.1f} kPa where the truth falls by "
        return text + f"{-true / 1e3:.0f}; {_accuracy(case, name)}", 0.5 < drop / true < 1.5

    text, passed = judged(study, names, say)
    return Finding(
        "Section 5.4, Fig. 10",
        "A loss from 230 to 180 kPa within 1.5 s is followed without significant delay.",
        text,
        verdict_of(passed),
        "It follows."
        if all(passed)
        else "A small final error is no proof here: the pressure ends where the prior's mean is. "
        "The estimate does not move with the truth.",
    )


def _masses(study: Validation, names: list[str]) -> Finding:
    def say(result: ConventionResult, name: str) -> tuple[str, bool]:
        cases = [c for c in result.cases if c.case.figure == 11]
        late = [c.courses[name].t > 2.0 for c in cases]
        shares = [
            float(np.mean(np.abs(c.courses[name].pressure[k] / c.truth[k] - 1.0)))
            for c, k in zip(cases, late, strict=True)
        ]
        text = "mean error " + ", ".join(f"{100 * s:.0f} %" for s in shares)
        text += " at 1788, 1928 and 2218 kg"
        return text, max(shares) < 0.05

    text, passed = judged(study, names, say)
    return Finding(
        "Section 5.4, Fig. 11",
        "The mean error stays below 5 % when the body is 8 % or 24 % heavier than assumed.",
        text,
        verdict_of(passed),
        "The mass matters little."
        if all(passed)
        else "The error is that of the empty vehicle already; the mass changes it little, because "
        "the wheel hop hardly depends on the body.",
    )


def _measured(study: Validation, names: list[str]) -> Finding:
    def say(result: ConventionResult, name: str) -> tuple[str, bool]:
        case = _case(result, 13)
        return _accuracy(case, name), case.figures[name].converged > 0.5

    text, passed = judged(study, names, say)
    return Finding(
        "Section 5.4, Fig. 13",
        "On a measured road the pressure is estimated as well as on random ones.",
        text,
        verdict_of(passed),
        "It comes near the truth."
        if all(passed)
        else "As on the random roads, and for the same reason.",
    )
