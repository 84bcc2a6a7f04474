"""The report of the stiffness study, and everything it writes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from wheelhop.io.report import Finding
from wheelhop.studies.frame import Study
from wheelhop.studies.frame_report import write_study
from wheelhop.studies.stiffness.frame import StiffnessSettings

TITLE = "Tyre pressure at the Cramer-Rao bound, on a road nobody measured"

_QUICK_WARNING = (
    "This was a quick run: a handful of short drives, to see that everything works. Its numbers "
    "and verdicts mean nothing."
)


def write_stiffness_study(
    study: Study[StiffnessSettings],
    directory: Path,
    made_by: Mapping[str, Any],
    quick: bool = False,
    on_progress: Callable[[int, int], None] | None = None,
) -> tuple[list[str], list[Finding]]:
    """Write figures, their data, results and report.

    Args:
        study: the results.
        directory: made if needed.
        made_by: command, versions, settings, for the report's end.
        quick: say that the numbers mean nothing.
        on_progress: called with parts done and in all.

    Returns:
        Names of the files, and all findings.
    """
    summary = partial(_summary, study.settings, quick)
    return write_study(study, directory, made_by, TITLE, summary, on_progress)


def _summary(settings: StiffnessSettings, quick: bool, verdicts: str) -> tuple[str, ...]:
    text = (
        "Tyre stiffness and pressure from the accelerations of body and wheel, by recursive "
        "maximum likelihood on a road that nobody measured, against the best that any estimator "
        "can do. The quarter cars are simulated at a finer step than the filter's, on roads of "
        f"the exact ISO 8608 spectrum, logged at 500 Hz with {settings.noise:g} m/s^2 of "
        "noise.",
        f"Rows by verdict: {verdicts}. Targets are given beforehand; verdicts follow from the "
        "figures, and intervals hold with 95 % probability.",
    )
    return (_QUICK_WARNING, *text) if quick else text
