"""`wheelhop reproduce stiffness`: every figure of the estimator of this package."""

from __future__ import annotations

import time
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from wheelhop.cli.findings import print_findings
from wheelhop.cli.reproduce_options import ReproduceOptions
from wheelhop.cli.session import (
    computing,
    console,
    progress_bar,
    provenance,
    say_files,
)
from wheelhop.errors import InputError
from wheelhop.io.results import output_directory
from wheelhop.studies.stiffness.frame import QUICK, StiffnessSettings
from wheelhop.studies.stiffness.report import write_stiffness_study
from wheelhop.studies.stiffness.study import stiffness_study, validate_settings

# rough seconds on two cores: compiling and bounds, and a run of every part
_FIXED = 180.0
_PER_RUN = 2.0

_OTHERS = ("classes", "duration", "starts", "measured_road")


def stiffness(options: ReproduceOptions, out: Path) -> None:
    """Tyre pressure at the Cramer-Rao bound, on a road nobody measured.

    Raises:
        InputError: naming the option that cannot be met.
    """
    settings = validate_settings(settings_of(options))
    begin = time.perf_counter()
    with computing(options.precision):
        directory = output_directory(out)
        console.print(
            f"{settings.runs} runs of everything take about {expected_minutes(settings):.0f} "
            "minutes on two cores; interrupted, the same command goes on.",
            soft_wrap=True,
        )
        study = stiffness_study(settings, directory / "kept", progress_bar)
        made_by = provenance(
            "reproduce stiffness", options.precision, quick=options.quick, **asdict(settings)
        )
        made_by["duration_s"] = round(time.perf_counter() - begin, 1)
        with progress_bar("writing", "chapters") as advance:
            names, findings = write_stiffness_study(
                study, directory, made_by, options.quick, advance
            )
        print_findings(findings)
        say_files(directory, *names[:3], f"and {len(names) - 3} files of figures")


def settings_of(options: ReproduceOptions) -> StiffnessSettings:
    """The settings that options ask for.

    Raises:
        InputError: for an option that this study does not have.
    """
    for option in _OTHERS:
        if getattr(options, option) is not None:
            name = f"--{option.replace('_', '-')}"
            raise InputError(name, "the stiffness study has none", "Leave it out.")
    settings = QUICK if options.quick else StiffnessSettings()
    known: dict[str, Any] = {"runs": options.runs, "noise": options.noise}
    changes = {name: value for name, value in known.items() if value is not None}
    return replace(settings, seed=options.seed, **changes)


def expected_minutes(settings: StiffnessSettings) -> float:
    """About how long it takes on two cores."""
    return (_FIXED + _PER_RUN * settings.runs) / 60.0
