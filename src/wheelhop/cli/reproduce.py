"""`wheelhop reproduce`: tables of a paper, computed anew."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated

import typer

from wheelhop.cli.estimate import road_classes
from wheelhop.cli.session import (
    Precision,
    Seed,
    command,
    computing,
    console,
    progress_bar,
    provenance,
)
from wheelhop.cli.table3_files import write_study
from wheelhop.cli.table3_report import print_study
from wheelhop.errors import InputError, InputWarning
from wheelhop.io.results import output_directory, require_writable
from wheelhop.studies.brancati_identification import (
    QUICK,
    StudySettings,
    identification_study,
    validate_study,
)
from wheelhop.studies.brancati_records import drive_classes, stored_drives


@dataclass(frozen=True)
class ReproduceOptions:
    """Options of a reproduction; None where the table decides.

    Units are those of the command line: s, m/s^2.
    """

    classes: str | None
    duration: float | None
    noise: float | None
    starts: int | None
    seed: int
    precision: str
    quick: bool


Reproduction = Callable[[ReproduceOptions, Path], None]


@command
def reproduce(
    paper: Annotated[str, typer.Argument(help="The paper: brancati.")],
    table: Annotated[int | None, typer.Option(help="Number of the table.")] = None,
    classes: Annotated[
        str | None, typer.Option(help="ISO 8608 classes of the roads, as letters.")
    ] = None,
    duration: Annotated[float | None, typer.Option(help="Length of each drive [s].")] = None,
    noise: Annotated[float | None, typer.Option(help="Accelerometer noise [m/s^2].")] = None,
    starts: Annotated[int | None, typer.Option(help="Starting points of each fit.")] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Small: to see that all works.")] = False,
    out: Annotated[Path | None, typer.Option("--out", help="Directory for the results.")] = None,
    seed: Seed = 0,
    precision: Precision = "float64",
) -> None:
    """Compute a table of a paper anew, beside what the paper prints.

    brancati, table 3: one suspension per road class, fitted to nine drives of the full vehicle on
    a known road (Brancati & Tufano 2022, section 5.2). Finished drives are kept in OUT/records;
    the same command resumes an interrupted run.

    Example: wheelhop reproduce brancati --table 3 --out table3
    """
    chosen = _chosen(paper, table)
    place = Path(f"wheelhop-{paper}-table-{table}") if out is None else out
    require_writable(place)
    chosen(ReproduceOptions(classes, duration, noise, starts, seed, precision, quick), place)


def brancati_table_3(options: ReproduceOptions, out: Path) -> None:
    """Identification of Brancati & Tufano 2022, Table 3.

    Raises:
        InputError: naming the option that cannot be met, or for a directory of other drives.
        DivergenceError: naming the drive or fit that left the finite numbers.
    """
    settings = validate_study(_study_settings(options))
    classes, drives = settings.classes, settings.drives
    with computing(options.precision):
        store = out / "records"
        total = len(classes) * len(drives.speeds) * len(drives.pressures)
        if done := stored_drives(store, drives, classes):
            console.print(f"resuming: {done} of {total} drives are in {store} already")
        directory = output_directory(out)
        with progress_bar("driving", "drives") as advance:
            records = drive_classes(drives, classes, store, advance)
        with progress_bar("fitting", "iterations at most") as advance, warnings.catch_warnings():
            # what speaks against a fit is printed below, with the name of its set
            warnings.simplefilter("ignore", InputWarning)
            study = identification_study(settings, records, advance)
        print_study(study)
        made_by = provenance(
            "reproduce brancati --table 3",
            options.precision,
            quick=options.quick,
            **asdict(settings),
        )
        write_study(study, records, directory, made_by)


REPRODUCTIONS: dict[str, dict[int, Reproduction]] = {"brancati": {3: brancati_table_3}}
"""What can be reproduced: tables by paper and number."""


def _chosen(paper: str, table: int | None) -> Reproduction:
    known = "; ".join(
        f"{name} --table {' or '.join(str(n) for n in tables)}"
        for name, tables in REPRODUCTIONS.items()
    )
    if paper not in REPRODUCTIONS:
        raise InputError("PAPER", f"{paper!r} is unknown", f"There is: {known}.")
    if table not in REPRODUCTIONS[paper]:
        problem = "it is missing" if table is None else f"{table} of {paper} is not reproduced"
        raise InputError("--table", problem, f"There is: {known}.")
    return REPRODUCTIONS[paper][table]


def _study_settings(options: ReproduceOptions) -> StudySettings:
    settings = QUICK if options.quick else StudySettings()
    drives = replace(settings.drives, seed=options.seed)
    if options.duration is not None:
        drives = replace(drives, duration=options.duration)
    if options.noise is not None:
        drives = replace(drives, noise=options.noise)
    settings = replace(settings, drives=drives)
    if options.classes is not None:
        settings = replace(settings, classes=road_classes(options.classes))
    if options.starts is not None:
        settings = replace(settings, starts=options.starts)
    return settings
