"""`wheelhop reproduce brancati`: the paper's whole validation."""

from __future__ import annotations

import os
import time
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from wheelhop.cli.estimate import road_classes
from wheelhop.cli.reproduce_options import ReproduceOptions
from wheelhop.cli.session import (
    computing,
    console,
    escape,
    headed_table,
    progress_bar,
    provenance,
    say_files,
)
from wheelhop.errors import InputError
from wheelhop.io.results import output_directory
from wheelhop.studies.brancati.report import write_validation
from wheelhop.studies.brancati.study import (
    QUICK,
    Validation,
    ValidationSettings,
    refuse_other_store,
    validate_validation,
    validation,
)

ROAD = Path("roads/michalsorel_iri/profile_1.txt")
"""The measured road below the directory that WHEELHOP_DATA names."""

# rough seconds on two cores: fixed parts, an iteration and training run, a run
_FIXED = 420.0
_PER_ITERATION_AND_RUN = 0.06
_PER_RUN = 0.35


def brancati_validation(options: ReproduceOptions, out: Path) -> None:
    """Brancati & Tufano 2022, sections 2 to 5.

    Raises:
        InputError: naming the option that cannot be met, or for a directory of other drives.
        DivergenceError: naming the drive or filter that left the finite numbers.
    """
    settings = validate_validation(settings_of(options))
    begin = time.perf_counter()
    with computing(options.precision):
        refuse_other_store(settings, out / "kept")
        directory = output_directory(out)
        console.print(_announcement(settings), soft_wrap=True)
        study = validation(settings, directory / "kept", progress_bar)
        made_by = provenance(
            "reproduce brancati",
            options.precision,
            quick=options.quick,
            **_shown(settings),
        )
        made_by["duration_s"] = round(time.perf_counter() - begin, 1)
        with progress_bar("writing", "figures") as advance:
            names = write_validation(study, directory, made_by, options.quick, advance)
        print_validation(study)
        say_files(directory, *names[:4], f"and {len(names) - 4} files of figures")


def settings_of(options: ReproduceOptions) -> ValidationSettings:
    """The settings that options ask for."""
    settings = QUICK if options.quick else ValidationSettings()
    changes: dict[str, Any] = {
        "runs": options.runs,
        "duration": options.duration,
        "noise": options.noise,
        "measured": measured_file(options.measured_road),
    }
    known = {name: value for name, value in changes.items() if value is not None}
    settings = replace(settings, seed=options.seed, **known)
    identification = settings.identification
    if options.classes is not None:
        identification = replace(identification, classes=road_classes(options.classes))
    if options.starts is not None:
        identification = replace(identification, starts=options.starts)
    return replace(settings, identification=identification)


def measured_file(chosen: Path | None) -> Path | None:
    """The measured road that was named, or that lies where WHEELHOP_DATA says."""
    if chosen is not None:
        if not chosen.is_file():
            raise InputError("--measured-road", f"{chosen} is no file", "Name a road profile.")
        return chosen
    place = os.environ.get("WHEELHOP_DATA")
    file = None if place is None else Path(place) / ROAD
    return file if file is not None and file.is_file() else None


def expected_minutes(settings: ValidationSettings) -> float:
    """About how long it takes on two cores."""
    filters = 4 if settings.tune_singles else 2
    passes = filters + (2 if settings.second_objective else 0)
    work = _PER_ITERATION_AND_RUN * settings.tuning.iterations * settings.training * passes
    share = settings.duration / 10.0
    small = settings.runs + settings.training + 8 * settings.repetitions
    each = share * (work + _PER_RUN * small)
    fixed = _FIXED if settings.tune_singles else 0.25 * _FIXED
    return (fixed + len(settings.conventions) * each) / 60.0


def _announcement(settings: ValidationSettings) -> str:
    minutes = expected_minutes(settings)
    missing = "" if settings.measured else " (no measured road: Fig. 12 and 13 are left out)"
    return (
        f"The whole validation with {settings.runs} runs takes about {minutes:.0f} minutes on two "
        f"cores{missing}; interrupted, the same command goes on."
    )


def _shown(settings: ValidationSettings) -> dict[str, Any]:
    content = asdict(settings)
    content["measured"] = None if settings.measured is None else settings.measured.name
    return content


def print_validation(study: Validation) -> None:
    """All filters on the Monte Carlo of each convention."""
    for convention, result in study.conventions.items():
        table = headed_table(
            "filter",
            "final RMSE [kPa]",
            "95 % interval",
            "inside one sigma",
            "NEES",
            title=f"Monte Carlo, {len(result.monte_carlo.truth)} runs, {convention}",
        )
        for name, f in result.monte_carlo.figures.items():
            rmse = f.final_rmse
            table.add_row(
                escape(name),
                f"{rmse.value / 1e3:.1f}",
                f"{rmse.low / 1e3:.1f} to {rmse.high / 1e3:.1f}",
                f"{f.inside:.0%}",
                f"{f.nees[-1]:.3g}",
            )
        console.print(table)
