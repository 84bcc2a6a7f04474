"""The stiffness study: every part run, and what they found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from wheelhop.errors import require_in_range
from wheelhop.studies.stiffness.frame import Bar, Part, StiffnessSettings, Store
from wheelhop.studies.stiffness.parts import PARTS


@dataclass(frozen=True)
class StiffnessStudy:
    """All results.

    Attributes:
        settings: that made them.
        parts: in the order of the report.
        results: of the parts, by their names.
    """

    settings: StiffnessSettings
    parts: tuple[Part, ...]
    results: dict[str, Any]


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
    settings: StiffnessSettings, place: Path | None, bar: Bar, parts: Sequence[Part] = PARTS
) -> StiffnessStudy:
    """Run every part; what is finished in `place` is not computed again.

    Args:
        settings: of the study.
        place: directory for finished work, or None.
        bar: makes a progress bar.
        parts: to run.

    Raises:
        InputError: for settings out of range.
    """
    validate_settings(settings)
    results = {}
    for part in parts:
        with bar(part.title, "steps") as advance:
            results[part.name] = part.run(settings, Store(place), advance)
    return StiffnessStudy(settings, tuple(parts), results)
