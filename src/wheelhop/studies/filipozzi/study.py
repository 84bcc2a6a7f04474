"""The Filipozzi study: every part run, and its report."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from wheelhop.io.report import Finding
from wheelhop.studies.filipozzi.parts import PARTS
from wheelhop.studies.filipozzi.settings import FilipozziSettings, validate_settings
from wheelhop.studies.frame import Bar, Part, Study, run_parts
from wheelhop.studies.frame_report import write_study

TITLE = "Wheel load from accelerometers and deflections: Filipozzi et al. 2021"

_QUICK_WARNING = (
    "This was a quick run: few noisy runs and a short bounce sweep, to see that everything works. "
    "Its numbers are no results."
)


def filipozzi_study(
    settings: FilipozziSettings,
    place: Path | None,
    bar: Bar,
    parts: Sequence[Part[FilipozziSettings]] = PARTS,
) -> Study[FilipozziSettings]:
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


def write_filipozzi_study(
    study: Study[FilipozziSettings],
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


def _summary(settings: FilipozziSettings, verdicts: str) -> tuple[str, ...]:
    text = (
        "The normal force of a tyre is an unknown input of its suspension. A Youla controller "
        "output observer and an unbiased minimum variance filter find it from the acceleration of "
        "the body and the deflection of the suspension (Filipozzi et al. 2021, Estimation of tire "
        "normal forces including suspension dynamics); here on a vehicle of fourteen degrees of "
        "freedom that shares no equation with these two, beside the algebraic load, derivative "
        "filters, a half car for anti-roll bars and a joint unscented filter of the whole vehicle. "
        "That last one calls the strut laws of the simulated vehicle itself, with its exact "
        "parameters wherever no mismatch is named: its errors there are the least it can have.",
        f"Rows by verdict: {verdicts}. Verdicts follow from the figures. The paper prints no "
        "parameters of its vehicle: forces are those of our SUV, and only relations compare.",
    )
    return (_QUICK_WARNING, *text) if settings.quick else text
