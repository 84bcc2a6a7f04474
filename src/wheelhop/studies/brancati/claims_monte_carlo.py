"""What the paper says of its Monte Carlo, beside what was measured."""

from __future__ import annotations

import numpy as np

from wheelhop.io.report import Finding
from wheelhop.studies.brancati.claims import (
    ROADS,
    gain_text,
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
        f"Around zero: within {_SMALL_BIAS:.0%} of the standard deviation. That asks little, since "
        "pressures are drawn around the prior's mean: the constant prior has no mean error either.",
    )


def _honesty(study: Validation, names: list[str]) -> Finding:
    def say(result: ConventionResult, name: str) -> tuple[str, bool]:
        f = result.monte_carlo.figures[name]
        ratio = float(
            np.mean(_late(result, f.statistics.std)) / np.mean(_late(result, f.statistics.sigma))
        )
        low, high = f.nees_band
        text = (
            f"errors {ratio:.3g} times the stated sigma; at the end NEES {f.nees[-1]:.3g} (95 % "
            f"band {low:.2f} to {high:.2f})"
        )
        return text, _HONEST[0] < ratio < _HONEST[1]

    text, passed = judged(study, names, say)
    honest = [
        f"{f.name} {rmse_text(r.second_monte_carlo.figures[f.name])}, NEES "
        f"{r.second_monte_carlo.figures[f.name].nees[-1]:.3g} on {ROADS[r.convention]}"
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
        f"Asked: a ratio of {_HONEST[0]} to {_HONEST[1]}. The variance of a joint state shrinks "
        "with every sample as if each told of k_t alone; errors of model and road are taken for "
        "news of it. Tuning on the mean-square error does not care for the variance, tuning on "
        "the log score does, as far as Q and P0 reach.",
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
        "Asked of nine runs in ten. Gaussian errors of an honest filter leave one sigma a third "
        "of the time, so that staying inside throughout would itself say that sigma is wrong.",
    )


def _against_single(study: Validation) -> Finding:
    result = next(iter(study.conventions.values()))
    pairs = [
        (result.filters[c.parent].name, result.filters[k].name)
        for k, c in enumerate(CONTENDERS)
        if c.parent is not None
    ]
    texts, passed = [], []
    for convention, result in study.conventions.items():
        parts = []
        for parent, single in pairs:
            gain = result.monte_carlo.gain(parent, single)
            figures = result.monte_carlo.figures
            parts.append(
                f"{parent} {kpa(figures[parent].final_rmse.value)}, {single} "
                f"{kpa(figures[single].final_rmse.value)}: {gain_text(gain)}"
            )
            passed.append(gain.low > 0)
        texts.append(f"On {ROADS[convention]}, " + "; ".join(parts))
    return Finding(
        "Section 5.3, Fig. 6",
        "The interacting multiple model outperforms the single class A filter.",
        "final RMSE and gain with its 95 % interval: " + ". ".join(texts) + ".",
        verdict_of(passed),
        "Asked: a gain whose interval, over the same runs in pairs, lies above zero. A bank helps "
        "as far as the filter lets the records move its stiffness at all; beside the constant "
        "guess (next row) the gain tells how much that is.",
    )


def _against_floor(study: Validation, names: list[str]) -> Finding:
    def say(result: ConventionResult, name: str) -> tuple[str, bool]:
        figures = result.monte_carlo.figures
        before = result.untuned_monte_carlo.figures.get(name + UNTUNED)
        gain = result.monte_carlo.gain(name, FLOOR)
        text = (
            f"{rmse_text(figures[name])} against {kpa(figures[FLOOR].final_rmse.value)} of a "
            f"constant 180 kPa: {gain_text(gain)}"
        )
        if before is not None:
            text += f" (before tuning {kpa(before.final_rmse.value)})"
        return text, gain.low > 0

    text, passed = judged(study, names, say)
    return Finding(
        "Section 5.3 (not asked there)",
        "The estimate is better than guessing the middle of the range.",
        "final RMSE (95 % interval) and gain: " + text,
        verdict_of(passed),
        "Asked: a gain whose interval, over the same runs in pairs, lies above zero. A state and "
        "the parameter that multiplies it, estimated jointly by a gain that does not know how it "
        "depends on the parameter, give a biased estimate (Ljung 1979); Q and P0 can only make "
        "the filter heed the records less.",
    )
