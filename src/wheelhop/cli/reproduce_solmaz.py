"""`wheelhop reproduce solmaz`: which tyre went soft, in a corner."""

from __future__ import annotations

import time
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from wheelhop.cli.findings import print_findings
from wheelhop.cli.reproduce_options import ReproduceOptions
from wheelhop.cli.session import computing, console, progress_bar, provenance, say_files
from wheelhop.errors import InputError
from wheelhop.io.results import output_directory
from wheelhop.studies.solmaz.settings import QUICK, SolmazSettings, validate_settings
from wheelhop.studies.solmaz.study import solmaz_study, write_solmaz_study

# rough seconds on two cores: compiling, and a run of every part
_FIXED = 110.0
_PER_RUN = 1.15

_OTHERS = ("classes", "duration", "starts", "measured_road")


def solmaz(options: ReproduceOptions, out: Path) -> None:
    """Solmaz's switched models: his figures, and what noise and bias do to them.

    Raises:
        InputError: naming the option that cannot be met.
    """
    settings = validate_settings(settings_of(options))
    begin = time.perf_counter()
    with computing(options.precision):
        directory = output_directory(out)
        console.print(
            f"{settings.runs} runs of everything take about {expected_minutes(settings):.1g} "
            "minutes on two cores; interrupted, the same command goes on.",
            soft_wrap=True,
        )
        study = solmaz_study(settings, directory / "kept", progress_bar)
        made_by = provenance("reproduce solmaz", options.precision, **asdict(settings))
        made_by["duration_s"] = round(time.perf_counter() - begin, 1)
        with progress_bar("writing", "chapters") as advance:
            names, findings = write_solmaz_study(study, directory, made_by, advance)
        print_findings(findings)
        say_files(directory, *names[:3], f"and {len(names) - 3} files of figures")


def settings_of(options: ReproduceOptions) -> SolmazSettings:
    """The settings that options ask for.

    Raises:
        InputError: for an option that this study does not have.
    """
    for option in _OTHERS:
        if getattr(options, option) is not None:
            name = f"--{option.replace('_', '-')}"
            raise InputError(name, "the Solmaz study has none", "Leave it out.")
    settings = QUICK if options.quick else SolmazSettings()
    known: dict[str, Any] = {"runs": options.runs, "noise": options.noise}
    changes = {name: value for name, value in known.items() if value is not None}
    return replace(settings, seed=options.seed, **changes)


def expected_minutes(settings: SolmazSettings) -> float:
    """About how long it takes on two cores."""
    return (_FIXED + _PER_RUN * settings.runs) / 60.0
