"""The stiffness study: every part run, and what they found."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from wheelhop.errors import require_in_range
from wheelhop.studies.frame import Bar, Part, Study, run_parts
from wheelhop.studies.stiffness.frame import StiffnessSettings
from wheelhop.studies.stiffness.parts import PARTS


def validate_settings(settings: StiffnessSettings) -> StiffnessSettings:
    """The same settings, checked.

    Raises:
        InputError: naming the setting that is out of range.
    """
    require_in_range("--runs", settings.runs, 2, 100_000, "runs")
    require_in_range("--noise", settings.noise, 1e-3, 100.0, "m/s^2")
    require_in_range("substeps", settings.substeps, 1, 100, "steps")
    require_in_range("longest", settings.longest, 2.0, 600.0, "s")
    require_in_range("bound_runs", settings.bound_runs, 1, 100_000, "runs")
    return settings


def stiffness_study(
    settings: StiffnessSettings,
    place: Path | None,
    bar: Bar,
    parts: Sequence[Part[StiffnessSettings]] = PARTS,
) -> Study[StiffnessSettings]:
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
