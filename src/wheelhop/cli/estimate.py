"""`wheelhop estimate` and `wheelhop demo`: pressure from a log, and from a simulated leak."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated, Any

import typer

from wheelhop.cli.estimate_vehicle import demo_of_four, estimate_four
from wheelhop.cli.report import report
from wheelhop.cli.session import (
    OutDirectory,
    Precision,
    Seed,
    UnusedSeed,
    command,
    computing,
    progress_bar,
    provenance,
)
from wheelhop.cli.vehicle import VehicleFile, load_vehicle
from wheelhop.errors import InputError
from wheelhop.estimators.changing import EXACT_CLASSES, ChangeTuning
from wheelhop.estimators.estimate import estimate_pressure
from wheelhop.estimators.estimate_immuf import estimate_by_immuf
from wheelhop.estimators.immuf import ROAD_CLASSES, Tuning
from wheelhop.estimators.immuf import validate_tuning as validate_immuf
from wheelhop.estimators.stiffness import EXTRA, StiffnessTuning, validate_tuning
from wheelhop.io.logs import corners_of_log, read_log
from wheelhop.io.results import require_writable
from wheelhop.vehicle.road import class_level

METHODS = ("rml", "hop", "immuf")


@command
def estimate(
    log: Annotated[Path, typer.Argument(help="CSV or Parquet: t, a_s, a_u, v with units.")],
    corner: Annotated[
        str | None,
        typer.Option(help="FL, FR, RL or RR alone of a log of four; without it all four."),
    ] = None,
    vehicle: VehicleFile = None,
    rear: Annotated[
        Path | None,
        typer.Option("--rear-vehicle", help="TOML of a rear corner, for four tyres."),
    ] = None,
    method: Annotated[
        str, typer.Option(help="rml; hop for four tyres of a real car; or immuf, the paper's.")
    ] = "rml",
    classes: Annotated[
        str | None,
        typer.Option(help="ISO 8608 classes, as ABCD, one of which the road has exactly."),
    ] = None,
    free: Annotated[
        str, typer.Option(help=f"Also estimate, separated by commas: {', '.join(EXTRA)}.")
    ] = "",
    placard: Annotated[
        float, typer.Option(help="Recommended pressure [kPa], for alarms on four tyres.")
    ] = 230.0,
    calibration: Annotated[
        Path | None, typer.Option(help="Calibration of this vehicle (JSON), for four tyres.")
    ] = None,
    calibrate: Annotated[
        float | None,
        typer.Option(help="All four tyres hold this pressure [kPa]: write a calibration."),
    ] = None,
    units: Annotated[
        Path | None,
        typer.Option(help="TOML with [units] and [columns]; default LOG.toml if there."),
    ] = None,
    noise: Annotated[float, typer.Option(help="Accelerometer noise [m/s^2].")] = 0.5,
    walk: Annotated[float | None, typer.Option(help="Random walk of ln k_t [1/sqrt(s)].")] = None,
    out: OutDirectory = Path("wheelhop-estimate"),
    seed: UnusedSeed = 0,
    precision: Precision = "float64",
) -> None:
    """Estimate tyre pressure over time from accelerometers on body and wheels.

    By recursive maximum likelihood, on a road nobody measured. A log with columns of four
    corners (a_s_FL, ...) gives four pressures and the alarms on them.

    Example: wheelhop estimate drive.csv --vehicle front.toml --out result

    Others: wheelhop estimate drive/log.parquet --placard 230 --out result;
    wheelhop estimate drive/log.parquet --calibrate 230 --out reset
    """
    require_writable(out)
    if method not in METHODS:
        raise InputError("--method", f"{method!r} is unknown", f"Use one of {METHODS}.")
    chosen = tuple(name.strip() for name in free.split(",") if name.strip())
    for name in chosen:
        if name not in EXTRA or chosen.count(name) > 1:
            raise InputError("--free", f"{name!r} in {free!r}", f"Use some of {EXTRA}.")
    if method == "immuf" and chosen:
        raise InputError("--free", f"{free!r} with --method immuf", "Leave one of them out.")
    if classes is not None:
        road_classes(classes)
    if corner is None and corners_of_log(log):
        _refuse_for_four(method, classes, chosen)
        files = (vehicle, rear)
        reset = None if calibrate is None else 1e3 * calibrate
        estimate_four(
            log,
            units,
            files,
            method,
            1e3 * placard,
            calibration,
            reset,
            noise,
            walk,
            out,
            precision,
        )
        return
    if method == "hop":
        raise InputError("--method", "'hop' is for four tyres", "Leave --corner out, or use rml.")
    if calibrate is not None or calibration is not None or rear is not None:
        raise InputError(
            "--calibrate, --calibration, --rear-vehicle",
            "the estimate is of one corner",
            "Give a log of four corners, without --corner.",
        )
    settings: dict[str, Any] = {"log": str(log), "corner": corner, "method": method, "seed": seed}
    with computing(precision):
        record = read_log(log, units, corner)
        refuse_front_for_rear(corner, vehicle)
        car, settings["vehicle"] = load_vehicle(vehicle)
        with progress_bar("filtering", "samples") as advance:
            if method == "immuf":
                members = road_classes(classes or "".join(ROAD_CLASSES))
                old = Tuning(noise_a_s=noise, noise_a_u=noise)
                old = validate_immuf(old if walk is None else replace(old, stiffness_walk=walk))
                result = estimate_by_immuf(
                    record, car, tuning=old, classes=members, on_progress=advance
                )
                guess = old.prior_pressure
                settings |= {"classes": members, "tuning": asdict(old)}
            else:
                members = road_classes(classes) if classes else ()
                tuning = StiffnessTuning(noise_a_s=noise, noise_a_u=noise)
                tuning = tuning if walk is None else replace(tuning, stiffness_walk=walk)
                changes = EXACT_CLASSES if members else ChangeTuning()
                result = estimate_pressure(
                    record,
                    car,
                    tuning=validate_tuning(tuning),
                    changes=changes,
                    classes=members,
                    free=chosen,
                    on_progress=advance,
                )
                guess = tuning.prior_pressure
                settings |= {"classes": members, "free": chosen, "tuning": asdict(tuning)}
                settings |= {"changes": asdict(changes)}
    made_by = provenance("estimate", precision, **settings)
    title = Path(log).name if corner is None else f"{Path(log).name}, {corner}"
    report(result, record, car, guess, out, made_by, title)


@command
def demo(
    out: OutDirectory = Path("wheelhop-demo"),
    road: Annotated[str, typer.Option(help="ISO 8608 class of the true road.")] = "B",
    duration: Annotated[float, typer.Option(help="Length of the drive [s].")] = 60.0,
    seed: Seed = 0,
    precision: Precision = "float64",
) -> None:
    """Simulate an SUV at 60 km/h whose front right tyre leaks, and see the alarm.

    Four corners drive on random roads; the estimator knows neither the roads nor their class.

    Example: wheelhop demo --road C --seed 3 --out demo
    """
    require_writable(out)
    demo_of_four(out, road, duration, seed, precision)


def _refuse_for_four(method: str, classes: str | None, free: tuple[str, ...]) -> None:
    for name, given in (("--method", method == "immuf"), ("--classes", classes), ("--free", free)):
        if given:
            raise InputError(
                name, "the log holds four corners, estimated together", "Add --corner FL."
            )


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
