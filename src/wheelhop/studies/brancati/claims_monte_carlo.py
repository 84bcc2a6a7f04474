"""What the paper says of its Monte Carlo, beside what was measured."""

from __future__ import annotations

import numpy as np

from wheelhop.io.report import Finding
from wheelhop.studies.brancati.claims import (
    ROADS,
    judged,
    kpa,
    over_all,
    rmse_text,
    verdict_of,
)
from wheelhop.studies.brancati.contenders import CONTENDERS, FLOOR, UNTUNED
from wheelhop.studies.brancati.study import ConventionResult, Validation

_HONEST = (0.8, 1.25)
_SMALL_BIAS = 0.25


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

    text, passed = judged(study, names, say)
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

    text, passed = judged(study, names, say)
    honest = [
        f"{f.name} {rmse_text(r.second_monte_carlo.figures[f.name])}, NEES "
        f"{np.mean(_late(r, r.second_monte_carlo.figures[f.name].nees)):.3g} on "
        f"{ROADS[r.convention]}"
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

    text, passed = judged(study, names, say)
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
        texts.append(f"On {ROADS[convention]}, " + "; ".join(parts))
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
        before = result.untuned_monte_carlo.figures[name + UNTUNED]
        text = f"{rmse_text(f[name])} against {rmse_text(f[FLOOR])} of a constant 180 kPa"
        text += f" (before tuning {kpa(before.final_rmse.value)})"
        return text, f[name].final_rmse.high < f[FLOOR].final_rmse.low

    text, passed = judged(study, names, say)
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
