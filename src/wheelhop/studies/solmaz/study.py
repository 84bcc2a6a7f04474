"""The Solmaz study: every part run, and its report."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from wheelhop.io.report import Finding
from wheelhop.studies.frame import Bar, Part, Study, run_parts
from wheelhop.studies.frame_report import write_study
from wheelhop.studies.solmaz.parts import PARTS
from wheelhop.studies.solmaz.settings import SolmazSettings, validate_settings

TITLE = "Which tyre went soft: Solmaz's switched models in a corner"

_QUICK_WARNING = (
    "This was a quick run: a handful of noisy runs, to see that everything works. Its numbers and "
    "verdicts mean nothing."
)


def solmaz_study(
    settings: SolmazSettings,
    place: Path | None,
    bar: Bar,
    parts: Sequence[Part[SolmazSettings]] = PARTS,
) -> Study[SolmazSettings]:
    """Run every part; what is finished in `place` is not computed again.

    Args:
        settings: of the study.
        place: directory for finished work, or None.
        bar: makes a progress bar.
        parts: to run.

    Raises:
        InputError: for settings out of range.
    """
    return run_parts(validate_settings(settings), place, bar, parts)


def write_solmaz_study(
    study: Study[SolmazSettings],
    directory: Path,
    made_by: Mapping[str, Any],
    on_progress: Callable[[int, int], None] | None = None,
) -> tuple[list[str], list[Finding]]:
    """Write figures, their data, results and report.

    Args:
        study: the results.
        directory: made if needed.
        made_by: command, versions, settings, for the report's end.
        on_progress: called with parts done and in all.

    Returns:
        Names of the files, and all findings.
    """
    summary = partial(_summary, study.settings)
    return write_study(study, directory, made_by, TITLE, summary, on_progress)


def _summary(settings: SolmazSettings, verdicts: str) -> tuple[str, ...]:
    text = (
        "Sixteen two-track models of a car, one for every combination of soft tyres, are driven by "
        "its steering angle, speed, lateral acceleration and yaw rate, and the one whose "
        "signals fit best names the soft tyres (Solmaz, A novel method for indirect estimation of "
        "tire pressure). The method needs lateral acceleration: straight ahead all models agree.",
        f"Rows by verdict: {verdicts}. Verdicts follow from the figures.",
    )
    return (_QUICK_WARNING, *text) if settings.quick else text
