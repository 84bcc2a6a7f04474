"""`wheelhop reproduce filipozzi`: wheel load from accelerometers and deflections."""

from __future__ import annotations

import time
from dataclasses import asdict, replace
from pathlib import Path

from wheelhop.cli.findings import print_findings
from wheelhop.cli.reproduce_options import ReproduceOptions
from wheelhop.cli.session import computing, console, progress_bar, provenance, say_files
from wheelhop.errors import InputError
from wheelhop.io.results import output_directory
from wheelhop.studies.filipozzi.settings import QUICK, FilipozziSettings, validate_settings
from wheelhop.studies.filipozzi.study import filipozzi_study, write_filipozzi_study

_MINUTES, _MINUTES_QUICK = 6, 4

_OTHERS = ("classes", "duration", "starts", "noise", "measured_road")


def filipozzi(options: ReproduceOptions, out: Path) -> None:
    """Filipozzi's observers: figures 4 to 10, mass at rest and coupling of the wheels.

    Raises:
        InputError: naming the option that cannot be met.
    """
    settings = validate_settings(settings_of(options))
    begin = time.perf_counter()
    with computing(options.precision):
        directory = output_directory(out)
        minutes = _MINUTES_QUICK if settings.quick else _MINUTES
        console.print(
            f"about {minutes} minutes on two cores, most of it compiling; interrupted, the same "
            "command goes on.",
            soft_wrap=True,
        )
        study = filipozzi_study(settings, directory / "kept", progress_bar)
        made_by = provenance("reproduce filipozzi", options.precision, **asdict(settings))
        made_by["duration_s"] = round(time.perf_counter() - begin, 1)
        with progress_bar("writing", "chapters") as advance:
            names, findings = write_filipozzi_study(study, directory, made_by, advance)
        print_findings(findings)
        say_files(directory, *names[:3], f"and {len(names) - 3} files of figures")


def settings_of(options: ReproduceOptions) -> FilipozziSettings:
    """The settings that options ask for.

    Raises:
        InputError: for an option that this study does not have.
    """
    for option in _OTHERS:
        if getattr(options, option) is not None:
            name = f"--{option.replace('_', '-')}"
            raise InputError(name, "the Filipozzi study has none", "Leave it out.")
    settings = QUICK if options.quick else FilipozziSettings()
    runs = settings.runs if options.runs is None else options.runs
    return replace(settings, seed=options.seed, runs=runs)
