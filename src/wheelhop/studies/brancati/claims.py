"""Claims of the paper against measurements, for any number of filters and kinds of roads."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from wheelhop.evaluation.tracking import Interval, Tracking
from wheelhop.io.report import FAILS, HOLDS, IN_PART
from wheelhop.studies.brancati.contenders import CONTENDERS
from wheelhop.studies.brancati.study import ConventionResult, Validation

ROADS = {"iso8608": "ISO roads", "brancati2022": "roads of the printed variance"}
"""The conventions in words."""


Say = Callable[[ConventionResult, str], tuple[str, bool]]
"""(results, name of a filter) -> what was measured, and whether the claim holds."""


def verdict_of(passed: list[bool]) -> str:
    """Holds where all passed, in part where some did, and not where none did."""
    return HOLDS if all(passed) else IN_PART if any(passed) else FAILS


def judged(study: Validation, names: Iterable[str], say: Say) -> tuple[str, list[bool]]:
    """Texts and verdicts of filters over all conventions."""
    texts, passed = [], []
    for convention, result in study.conventions.items():
        parts = []
        for name in names:
            text, ok = say(result, name)
            parts.append(f"{name}: {text}")
            passed.append(ok)
        texts.append(f"On {ROADS[convention]}, " + "; ".join(parts))
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


def gain_text(gain: Interval) -> str:
    """A smaller error with its interval, or a larger one."""
    word = "better" if gain.value >= 0 else "worse"
    return (
        f"{abs(gain.value) / 1e3:.1f} kPa {word} ({gain.low / 1e3:+.1f} to {gain.high / 1e3:+.1f})"
    )
