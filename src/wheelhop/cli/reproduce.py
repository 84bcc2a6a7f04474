"""`wheelhop reproduce`: a paper's validation, whole or a table of it, computed anew."""

from __future__ import annotations

import warnings
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated

import typer

from wheelhop.cli.estimate import road_classes
from wheelhop.cli.reproduce_brancati import brancati_validation
from wheelhop.cli.reproduce_filipozzi import filipozzi
from wheelhop.cli.reproduce_options import ReproduceOptions, Reproduction
from wheelhop.cli.reproduce_solmaz import solmaz
from wheelhop.cli.reproduce_stiffness import stiffness
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
from wheelhop.studies.brancati.identification import (
    QUICK,
    StudySettings,
    identification_study,
    validate_study,
)
from wheelhop.studies.brancati.records import drive_classes, stored_drives


@command
def reproduce(
    paper: Annotated[str, typer.Argument(help="What: brancati, filipozzi, solmaz or stiffness.")],
    table: Annotated[
        int | None, typer.Option(help="Number of a table; without it the whole validation.")
    ] = None,
    runs: Annotated[int | None, typer.Option(help="Runs of the Monte Carlo.")] = None,
    measured_road: Annotated[
        Path | None, typer.Option("--measured-road", help="Profile of the paper's measured road.")
    ] = None,
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
    """Compute a paper's validation anew, beside what the paper says, or this package's own.

    brancati: roads, identification, tuning, Monte Carlo and every single drive of Brancati &
    Tufano 2022, sections 2 to 5, on the full vehicle; a report says which claims hold. With
    --table 3 the identification alone. Drives of the identification, tunings and Monte Carlo runs
    are kept in OUT, and the same command resumes an interrupted run.

    filipozzi: wheel load from accelerometers and deflections: figures 4 to 10 of Filipozzi et al.
    2021 on the full vehicle, every method beside the others.

    solmaz: which tyre went soft, in a corner: figures 5 to 7 of Solmaz's switched two-track models
    as printed, and what noise and bias of the sensors do to them.

    stiffness: the estimator of this package against the Cramer-Rao bound, on exact classes, on
    roads of any roughness, over four corners and over an axle pair.

    Example: wheelhop reproduce brancati --quick --out brancati-quick

    Others: wheelhop reproduce brancati --runs 10000 --out brancati;
    wheelhop reproduce brancati --table 3 --out table3;
    wheelhop reproduce filipozzi --out filipozzi; wheelhop reproduce solmaz --out solmaz;
    wheelhop reproduce stiffness --out stiffness
    """
    chosen = _chosen(paper, table)
    name = f"wheelhop-{paper}" if table is None else f"wheelhop-{paper}-table-{table}"
    place = Path(name) if out is None else out
    require_writable(place)
    options = ReproduceOptions(
        classes, duration, noise, starts, runs, measured_road, seed, precision, quick
    )
    chosen(options, place)


def brancati_table_3(options: ReproduceOptions, out: Path) -> None:
    """Identification of Brancati & Tufano 2022, Table 3.

    Raises:
        InputError: naming the option that cannot be met, or for a directory of other drives.
        DivergenceError: naming the drive or fit that left the finite numbers.
    """
    for option in ("runs", "measured_road"):
        if getattr(options, option) is not None:
            name = f"--{option.replace('_', '-')}"
            raise InputError(name, "table 3 has none", "Leave it out, or leave out --table.")
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


REPRODUCTIONS: dict[str, dict[int | None, Reproduction]] = {
    "brancati": {None: brancati_validation, 3: brancati_table_3},
    "filipozzi": {None: filipozzi},
    "solmaz": {None: solmaz},
    "stiffness": {None: stiffness},
}
"""What can be reproduced by paper: tables by number, and under None the whole."""


def _chosen(paper: str, table: int | None) -> Reproduction:
    known = "; ".join(
        name if number is None else f"{name} --table {number}"
        for name, tables in REPRODUCTIONS.items()
        for number in tables
    )
    if paper not in REPRODUCTIONS:
        raise InputError("PAPER", f"{paper!r} is unknown", f"There is: {known}.")
    if table not in REPRODUCTIONS[paper]:
        problem = f"{table} of {paper} is not reproduced by itself"
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
