"""What the paper says of single drives, beside what was measured over their repetitions."""

from __future__ import annotations

import numpy as np

from wheelhop.evaluation.tracking import TOLERANCE
from wheelhop.io.report import Finding
from wheelhop.studies.brancati.claims import judged, kpa, over_all, verdict_of
from wheelhop.studies.brancati.scenarios import CHANGE, CaseResult
from wheelhop.studies.brancati.study import ConventionResult, Validation

_FROM_2_S = 3.0
_NEAR = 0.05

PRIOR_WHY = (
    "An estimate that stays near the prior is right only where the truth lies near it: the figures "
    "show whether it moves."
)


def case_findings(study: Validation) -> list[Finding]:
    """Section 5.4: Fig. 7 to 11 and 13."""
    names = over_all(study)
    found = [
        *_one_class(study, names, 7, "A"),
        *_one_class(study, names, 8, "D"),
        _class_change(study, names),
        _leak(study, names),
        _masses(study, names),
    ]
    if any(c.case.figure == 13 for r in study.conventions.values() for c in r.cases):
        found.append(_measured(study, names))
    return found


def case_of(result: ConventionResult, figure: int) -> CaseResult:
    """The case of a figure."""
    return next(c for c in result.cases if c.case.figure == figure)


def accuracy(case: CaseResult, name: str) -> str:
    """How near the truth the repetitions end, and when."""
    f = case.figures[name]
    since = " after the change" if case.case.end_pressure is not None else ""
    when = "" if np.isnan(f.convergence_time) else f" from {f.convergence_time:.1f} s{since} on"
    return (
        f"{f.converged:.0%} of the drives within {TOLERANCE / 1e3:g} kPa{when}, final RMSE "
        f"{kpa(f.final_rmse.value)}, bias {kpa(f.final_bias)}"
    )


def mean_probability(case: CaseResult, name: str, mode: str, part: slice) -> float | None:
    """Probability of a mode over a part of the samples, averaged; None for a filter without it."""
    modes = case.courses[name].modes
    if mode not in modes or len(modes) < 2:
        return None
    return float(case.probabilities[name][:, part, modes.index(mode)].mean())


def _one_class(
    study: Validation, names: list[str], figure: int, road_class: str
) -> tuple[Finding, Finding]:
    def near(result: ConventionResult, name: str) -> tuple[str, bool]:
        case = case_of(result, figure)
        f = case.figures[name]
        return accuracy(case, name), f.converged > 0.5 and f.convergence_time <= _FROM_2_S

    def trusted(result: ConventionResult, name: str) -> tuple[str, bool]:
        case = case_of(result, figure)
        late = slice(len(case.truth) // 2, None)
        share = mean_probability(case, name, road_class, late)
        if share is None:
            return "it has no modes", False
        return f"mean probability of class {road_class} {share:.2f}", share > 0.5

    text, passed = judged(study, names, near)
    modes, right = judged(study, names, trusted)
    return (
        Finding(
            f"Section 5.4, Fig. {figure}",
            f"On a class {road_class} road the estimate is acceptable after about 2 s.",
            text,
            verdict_of(passed),
            f"Asked of more than half of the drives, by {_FROM_2_S:g} s. {PRIOR_WHY}",
        ),
        Finding(
            f"Section 5.4, Fig. {figure}",
            f"On a class {road_class} road the mode of class {road_class} has the probability.",
            modes + " In the second half of the drives.",
            verdict_of(right),
            "Modes differ in the size of the road they expect. Process noise that tuning makes "
            "large covers every road alike, and then the mode that expects least is as good as "
            "any.",
        ),
    )


def _class_change(study: Validation, names: list[str]) -> Finding:
    def say(result: ConventionResult, name: str) -> tuple[str, bool]:
        case = case_of(result, 9)
        change = int(CHANGE * len(case.truth))
        # the second half of the time before and of that after the change
        before = mean_probability(case, name, "A", slice(change // 2, change))
        after = mean_probability(case, name, "D", slice(change + change // 2, None))
        if before is None or after is None:
            return "it has no modes", False
        text = f"mean probability of A {before:.2f} before the change, of D {after:.2f} after it"
        return text, before > 0.5 and after > 0.5

    text, passed = judged(study, names, say)
    return Finding(
        "Section 5.4, Fig. 9",
        "When the road changes from class A to D, mode 1 is most trusted before and mode 4 after.",
        text,
        verdict_of(passed),
        "The size of the innovations tells the classes apart as far as the filter's process noise "
        "lets it; the stiffness plays no part in it.",
    )


def _leak(study: Validation, names: list[str]) -> Finding:
    def say(result: ConventionResult, name: str) -> tuple[str, bool]:
        case = case_of(result, 10)
        t, change = case.courses[name].t, CHANGE * case.courses[name].t[-1]
        early, late = (t > change - 1.0) & (t <= change), t > t[-1] - 1.0
        pressure = case.pressure[name]
        drop = float(np.mean(pressure[:, late]) - np.mean(pressure[:, early]))
        true = float(case.truth[-1] - case.truth[0])
        text = (
            f"on average the estimate moves by {drop / 1e3:+.1f} kPa where the truth moves by "
            f"{true / 1e3:+.0f}; {accuracy(case, name)}"
        )
        f = case.figures[name]
        return text, 0.5 < drop / true < 1.5 and f.converged > 0.5

    text, passed = judged(study, names, say)
    return Finding(
        "Section 5.4, Fig. 10",
        "A loss from 230 to 180 kPa within 1.5 s is followed without significant delay.",
        text,
        verdict_of(passed),
        "Asked: half to one and a half times the loss on average, and most drives near the truth "
        "at the end. A small final error alone is no proof: the loss ends where the prior is.",
    )


def _masses(study: Validation, names: list[str]) -> Finding:
    def say(result: ConventionResult, name: str) -> tuple[str, bool]:
        cases = [c for c in result.cases if c.case.figure == 11]
        shares = []
        for c in cases:
            late = c.courses[name].t > 0.2 * c.courses[name].t[-1]
            shares.append(float(np.mean(np.abs(c.pressure[name] / c.truth - 1.0)[:, late])))
        figures = ", ".join(f"{100 * s:.0f} %" for s in shares)
        masses = ", ".join(c.case.title.split(",")[0].split()[-2] for c in cases)
        return f"mean error {figures} at {masses} kg", max(shares) < _NEAR

    text, passed = judged(study, names, say)
    return Finding(
        "Section 5.4, Fig. 11",
        "The mean error stays below 5 % when the body is 8 % or 24 % heavier than assumed.",
        text,
        verdict_of(passed),
        "The first figure is the error of the empty vehicle, so that the differences are what the "
        "mass does. The plant's tyre does not stiffen with its load here, which is kind to the "
        "filters.",
    )


def _measured(study: Validation, names: list[str]) -> Finding:
    def say(result: ConventionResult, name: str) -> tuple[str, bool]:
        case = case_of(result, 13)
        others = [case_of(result, k).figures[name].final_rmse.value for k in (7, 8)]
        text = (
            f"{accuracy(case, name)} (class A {kpa(others[0])}, class D {kpa(others[1])} at the "
            "same pressure)"
        )
        own = case.figures[name]
        return text, own.converged > 0.5 and own.final_rmse.value < 1.2 * max(others)

    text, passed = judged(study, names, say)
    return Finding(
        "Section 5.4, Fig. 13",
        "On a measured road the pressure is estimated successfully, as on random ones.",
        text,
        verdict_of(passed),
        "The repetitions are overlapping stretches of one road of 544 m, the same for both "
        "conventions, which here only say what roads the filters expect. " + PRIOR_WHY,
    )
