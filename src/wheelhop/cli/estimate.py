"""`wheelhop estimate` and `wheelhop demo`: pressure from a log, and from a simulated leak."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from wheelhop.cli.report import report
from wheelhop.cli.session import (
    OutDirectory,
    Precision,
    Seed,
    UnusedSeed,
    command,
    computing,
    console,
    progress_bar,
    provenance,
)
from wheelhop.cli.vehicle import DEFAULT_VEHICLE, VehicleFile, load_vehicle
from wheelhop.errors import InputError
from wheelhop.estimators.estimate import estimate_pressure
from wheelhop.estimators.immuf import ROAD_CLASSES, Tuning, validate_tuning
from wheelhop.io.logs import read_log
from wheelhop.io.results import require_writable
from wheelhop.studies.first_light import FirstLight, run_first_light
from wheelhop.vehicle.parameters import brancati_suv
from wheelhop.vehicle.road import class_level


@command
def estimate(
    log: Annotated[Path, typer.Argument(help="CSV or Parquet: t, a_s, a_u, v with units.")],
    corner: Annotated[
        str | None, typer.Option(help="Corner of a log of four: FL, FR, RL or RR.")
    ] = None,
    vehicle: VehicleFile = None,
    classes: Annotated[
        str, typer.Option(help="ISO 8608 classes of the members, as letters.")
    ] = "".join(ROAD_CLASSES),
    units: Annotated[
        Path | None,
        typer.Option(help="TOML with [units] and [columns]; default LOG.toml if there."),
    ] = None,
    noise: Annotated[float, typer.Option(help="Accelerometer noise [m/s^2].")] = 0.5,
    walk: Annotated[
        float, typer.Option(help="Random walk of the stiffness, relative per root second.")
    ] = Tuning.stiffness_walk,
    out: OutDirectory = Path("wheelhop-estimate"),
    seed: UnusedSeed = 0,
    precision: Precision = "float64",
) -> None:
    """Estimate tyre pressure over time from a log of two accelerometers.

    The estimator is an IMM of four unscented filters, one per ISO 8608 class A to D. On a
    road between the classes it can be wrong by tens of kPa: see the README's limits.

    Example: wheelhop estimate drive.csv --vehicle front.toml --out result
    """
    require_writable(out)
    members = road_classes(classes)
    with computing(precision):
        record = read_log(log, units, corner)
        refuse_front_for_rear(corner, vehicle)
        car, name = load_vehicle(vehicle)
        tuning = validate_tuning(Tuning(noise_a_s=noise, noise_a_u=noise, stiffness_walk=walk))
        with progress_bar("filtering", "samples") as advance:
            result = estimate_pressure(
                record, car, tuning=tuning, classes=members, on_progress=advance
            )
    settings = {
        "log": str(log),
        "corner": corner,
        "vehicle": name,
        "classes": members,
        "tuning": asdict(tuning),
        "seed": seed,
    }
    made_by = provenance("estimate", precision, **settings)
    title = Path(log).name if corner is None else f"{Path(log).name}, {corner}"
    report(result, record, car, tuning, out, made_by, title)


@command
def demo(
    out: OutDirectory = Path("wheelhop-demo"),
    road: Annotated[str, typer.Option(help="ISO 8608 class of the true road.")] = "B",
    seed: Seed = 0,
    precision: Precision = "float64",
) -> None:
    """Simulate an SUV's corner at 60 km/h whose tyre leaks from 230 to 180 kPa, and see it.

    Example: wheelhop demo --road C --seed 3 --out demo
    """
    require_writable(out)
    settings = FirstLight(road_class=road, seed=seed)
    tuning = Tuning()
    console.print(f"vehicle: {DEFAULT_VEHICLE}; road: ISO class {road}; 60 km/h; 500 Hz")
    with computing(precision), progress_bar("filtering", "samples") as advance:
        record, result = run_first_light(settings, tuning, on_progress=advance)
    made_by = provenance(
        "demo", precision, study=asdict(settings), tuning=asdict(tuning), vehicle=DEFAULT_VEHICLE
    )
    title = f"A tyre that leaks from 230 to 180 kPa, class {road} road, 60 km/h"
    report(result, record, brancati_suv(), tuning, out, made_by, title, log_too=True)


def refuse_front_for_rear(corner: str | None, vehicle: Path | None) -> None:
    """Raise `InputError` for a rear corner without a vehicle: the default one is a front corner."""
    if vehicle is None and corner is not None and corner.startswith("R"):
        raise InputError(
            "--vehicle",
            f"the default vehicle is a front corner, and {corner} is a rear one",
            "Write a rear one with `wheelhop vehicle --axle rear --out rear.toml`, and name it.",
        )


def road_classes(letters: str) -> tuple[str, ...]:
    """Classes of the members, from letters as "ABCD".

    Raises:
        InputError: if one is unknown or given twice, or none is given.
    """
    members = tuple(letters.replace(",", "").upper())
    if not members or len(set(members)) != len(members):
        raise InputError("--classes", f"{letters!r}", "Give each class once, as ABCD.")
    for member in members:
        class_level(member)
    return members
