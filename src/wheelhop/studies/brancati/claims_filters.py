"""What the paper says of its filter, beside what was measured on the plant."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from wheelhop.evaluation.tracking import TOLERANCE, Tracking
from wheelhop.io.report import HOLDS, DataTable, Finding
from wheelhop.studies.brancati.claims_roads import verdict_of
from wheelhop.studies.brancati.contenders import CONTENDERS, FLOOR
from wheelhop.studies.brancati.scenarios import CHANGE, CaseResult
from wheelhop.studies.brancati.study import ConventionResult, Validation

_HONEST = (0.8, 1.25)
_SMALL_BIAS = 0.25
_ROADS = {"iso8608": "ISO roads", "brancati2022": "roads of the printed variance"}

Say = Callable[[ConventionResult, str], tuple[str, bool]]
"""(results, name of a filter) -> what was measured, and whether the claim holds."""


def _judged(study: Validation, names: Iterable[str], say: Say) -> tuple[str, list[bool]]:
    """Texts and verdicts of filters over all conventions."""
    texts, passed = [], []
    for convention, result in study.conventions.items():
        parts = []
        for name in names:
            text, ok = say(result, name)
            parts.append(f"{name}: {text}")
            passed.append(ok)
        texts.append(f"On {_ROADS[convention]}, " + "; ".join(parts))
    return ". ".join(texts) + ".", passed


def over_all(study: Validation) -> list[str]:
    """Names of the filters over all classes."""
    result = next(iter(study.conventions.values()))
    return [f.name for f, c in zip(result.filters, CONTENDERS, strict=True) if c.parent is None]


def kpa(pressure: float) -> str:
    """A pressure as people read it."""
    return f"{pressure / 1e3:.1f} kPa" if abs(pressure) < 1e6 else f"{pressure / 1e3:.3g} kPa"


def rmse_text(figures: Tracking) -> str:
    """Final error with its interval."""
    f = figures.final_rmse
    return f"{f.value / 1e3:.1f} kPa ({f.low / 1e3:.1f} to {f.high / 1e3:.1f})"


def monte_carlo_findings(study: Validation) -> list[Finding]:
    """Section 5.3 and Fig. 6."""
    names = over_all(study)
    return [
        _mean_error(study, names),
        _honesty(study, names),
        _inside(study, names),
        _against_single(study),
        _against_floor(study, names),
    ]


def _late(result: ConventionResult, values: np.ndarray) -> np.ndarray:
    return values[result.monte_carlo.t > 0.5 * result.monte_carlo.t[-1]]


def _mean_error(study: Validation, names: list[str]) -> Finding:
    def say(result: ConventionResult, name: str) -> tuple[str, bool]:
        s = result.monte_carlo.figures[name].statistics
        mean, spread = float(np.mean(_late(result, s.mean))), float(np.mean(_late(result, s.std)))
        text = f"mean error {mean / 1e3:+.1f} kN/m, standard deviation {spread / 1e3:.1f} kN/m"
        return text, abs(mean) < _SMALL_BIAS * spread

    text, passed = _judged(study, names, say)
    return Finding(
        "Section 5.3, Fig. 6",
        "The mean error of k_t over the runs is around zero.",
        text,
        verdict_of(passed),
        "A mean around zero says little here: pressures are drawn around the prior's mean, so the "
        "constant prior has none either. Tuning keeps the filters near that prior."
        if all(passed)
        else "Stiffness and state are estimated jointly; what the gain does not know of how it "
        "depends on k_t shows as a bias.",
    )


def _honesty(study: Validation, names: list[str]) -> Finding:
    def say(result: ConventionResult, name: str) -> tuple[str, bool]:
        f = result.monte_carlo.figures[name]
        ratio = float(
            np.mean(_late(result, f.statistics.std)) / np.mean(_late(result, f.statistics.sigma))
        )
        nees = float(np.mean(_late(result, f.nees)))
        low, high = f.nees_band
        text = (
            f"errors {ratio:.3g} times the stated sigma, NEES {nees:.3g} (95 % band {low:.2f} to "
            f"{high:.2f})"
        )
        return text, _HONEST[0] < ratio < _HONEST[1]

    text, passed = _judged(study, names, say)
    honest = [
        f"{f.name} {rmse_text(r.second_monte_carlo.figures[f.name])}, NEES "
        f"{np.mean(_late(r, r.second_monte_carlo.figures[f.name].nees)):.3g} on "
        f"{_ROADS[r.convention]}"
        for r in study.conventions.values()
        if r.second_monte_carlo is not None
        for f in r.second
    ]
    if honest:
        text += " Tuned for an honest sigma instead: " + "; ".join(honest) + "."
    return Finding(
        "Section 5.3, Fig. 6",
        "The standard deviation of the errors converges to the sigma bound of the filter.",
        text,
        verdict_of(passed),
        "The stated variance agrees with the errors."
        if all(passed)
        else "The filter's variance shrinks with every sample as if each told something of k_t; "
        "what it mostly takes in is the error of its model and of its road. Tuning on the error "
        "alone then chooses a small variance from the start.",
    )


def _inside(study: Validation, names: list[str]) -> Finding:
    def say(result: ConventionResult, name: str) -> tuple[str, bool]:
        f = result.monte_carlo.figures[name]
        text = (
            f"{f.inside:.0%} of the samples inside one sigma (68 % if honest), "
            f"{f.inside_by_run:.0%} of the runs never outside"
        )
        return text, f.inside_by_run > 0.9

    text, passed = _judged(study, names, say)
    return Finding(
        "Section 5.3, Fig. 6",
        "The sample errors stay inside the one-sigma bounds for the whole simulation.",
        text,
        verdict_of(passed),
        "Gaussian errors of an honest filter leave one sigma a third of the time; staying inside "
        "throughout would itself say that sigma is wrong. The bound here is too narrow."
        if not all(passed)
        else "The bound is wide enough.",
    )


def _against_single(study: Validation) -> Finding:
    result = next(iter(study.conventions.values()))
    singles = {
        result.filters[k].name: result.filters[c.parent].name
        for k, c in enumerate(CONTENDERS)
        if c.parent is not None
    }
    texts, passed = [], []
    for convention, result in study.conventions.items():
        figures = result.monte_carlo.figures
        parts = []
        for single, parent in singles.items():
            parts.append(
                f"{parent} {rmse_text(figures[parent])}, {single} {rmse_text(figures[single])}"
            )
            passed.append(figures[parent].final_rmse.high < figures[single].final_rmse.low)
        texts.append(f"On {_ROADS[convention]}, " + "; ".join(parts))
    return Finding(
        "Section 5.3, Fig. 6",
        "The interacting multiple model outperforms the single class A filter.",
        "final RMSE (95 % interval): " + ". ".join(texts) + ".",
        verdict_of(passed),
        "The bank finds the road's class, and that helps."
        if all(passed)
        else "Tuned on the same runs, neither learns enough of k_t for the class to matter: the "
        "intervals overlap. A bank helps a filter that uses the spectrum's level; a joint state "
        "does not.",
    )


def _against_floor(study: Validation, names: list[str]) -> Finding:
    def say(result: ConventionResult, name: str) -> tuple[str, bool]:
        f = result.monte_carlo.figures
        before = result.untuned_monte_carlo.figures[name]
        text = f"{rmse_text(f[name])} against {rmse_text(f[FLOOR])} of a constant 180 kPa"
        text += f" (before tuning {kpa(before.final_rmse.value)})"
        return text, f[name].final_rmse.high < f[FLOOR].final_rmse.low

    text, passed = _judged(study, names, say)
    return Finding(
        "Section 5.3 (not asked there)",
        "The estimate is better than guessing the middle of the range.",
        "final RMSE (95 % interval): " + text,
        verdict_of(passed),
        "It learns from the records."
        if all(passed)
        else "Before tuning the filters are far worse than that guess; tuning by "
        "gradient makes them distrust the records until they repeat it. Joint estimation of a "
        "state and the parameter that multiplies it is biased by construction (Ljung 1979).",
    )


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

    text, passed = _judged(study, names, say)
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

    text, passed = _judged(study, names, say)
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

    text, passed = _judged(study, names, say)
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

    text, passed = _judged(study, names, say)
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

    text, passed = _judged(study, names, say)
    return Finding(
        "Section 5.4, Fig. 13",
        "On a measured road the pressure is estimated as well as on random ones.",
        text,
        verdict_of(passed),
        "It comes near the truth."
        if all(passed)
        else "As on the random roads, and for the same reason.",
    )


def misprint_findings(study: Validation) -> list[Finding]:
    """Section 3 as printed."""
    texts, works = [], []
    for convention, result in study.conventions.items():
        literal = result.misprints[0]
        texts.append(
            f"on {_ROADS[convention]} median error {kpa(literal.median_error)} at the end, "
            f"{literal.finite:.0%} of the runs finite"
        )
        works.append(literal.finite == 1.0 and literal.median_error < 60e3)
    return [
        Finding(
            "Section 3, Eq. 9-12",
            "The interacting multiple model is given by the printed equations.",
            "taken literally: " + "; ".join(texts),
            verdict_of(works),
            "The printed weights of Eq. 10 and 11 do not sum to one: an improbable mode's state "
            "is nearly doubled in every step, the stiffness with it. The filter compared here as "
            "printed keeps every misprint but this one."
            if not all(works)
            else "The printed forms happen to do little harm with this tuning.",
        )
    ]


def misprint_table(result: ConventionResult) -> DataTable:
    """What each misprint does by itself."""
    effects = result.misprints
    return DataTable(
        f"Misprints one by one, {result.convention}",
        {
            "misprints kept": [e.name for e in effects],
            "finite runs [%]": [100.0 * e.finite for e in effects],
            "final RMSE [kPa]": [e.final_rmse / 1e3 for e in effects],
            "median error [kPa]": [e.median_error / 1e3 for e in effects],
            "stated sigma [kPa]": [e.sigma / 1e3 for e in effects],
            "NEES [-]": [e.nees for e in effects],
        },
        "All variants have the tuning of the filter as printed.",
    )


def comparison_table(result: ConventionResult) -> DataTable:
    """All filters on the Monte Carlo."""
    figures = dict(result.monte_carlo.figures)
    figures |= {
        f"{name}, before tuning": f
        for name, f in result.untuned_monte_carlo.figures.items()
        if name != FLOOR
    }
    if result.second_monte_carlo is not None:
        figures |= {
            f"{name}, tuned for honest errors": f
            for name, f in result.second_monte_carlo.figures.items()
            if name != FLOOR
        }
    names = list(figures)
    return DataTable(
        f"All filters on {len(result.monte_carlo.truth)} runs, {result.convention}",
        {
            "filter": names,
            "final RMSE [kPa]": [figures[n].final_rmse.value / 1e3 for n in names],
            "low [kPa]": [figures[n].final_rmse.low / 1e3 for n in names],
            "high [kPa]": [figures[n].final_rmse.high / 1e3 for n in names],
            "bias [kPa]": [figures[n].final_bias / 1e3 for n in names],
            "inside one sigma [%]": [100 * figures[n].inside for n in names],
            "NEES at the end [-]": [float(figures[n].nees[-1]) for n in names],
            "converged [%]": [100 * figures[n].converged for n in names],
            "convergence time [s]": [figures[n].convergence_time for n in names],
        },
        f"Converged: within {TOLERANCE / 1e3:g} kPa to the end; the constant guess does so where "
        "the truth happens to lie there.",
    )


def tuning_table(result: ConventionResult) -> DataTable:
    """What tuning did."""
    shown = [(f.name, f.tuned) for f in result.filters]
    shown += [(f"{f.name}, for honest errors", f.tuned) for f in result.second]
    return DataTable(
        f"Tuning by gradient, {result.convention}",
        {
            "filter": [n for n, _ in shown],
            "objective": [t.settings.objective for _, t in shown],
            "training, start": [t.start_train for _, t in shown],
            "training, tuned": [t.train for _, t in shown],
            "test, start": [t.start_test for _, t in shown],
            "test, tuned": [t.test for _, t in shown],
        },
        'In (kN/m)^2 for "mse", in nats per sample for "log_score". The test runs are those of '
        "the Monte Carlo.",
    )
