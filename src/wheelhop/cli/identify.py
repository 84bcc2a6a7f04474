"""`wheelhop identify`: a quarter car's parameters from logs with a known road."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from wheelhop.cli.estimate import refuse_front_for_rear
from wheelhop.cli.identify_logs import (
    each_once,
    read_named_log,
    require_pressures,
    short_names,
    with_elevation,
    with_pressure,
)
from wheelhop.cli.identify_report import report_identification
from wheelhop.cli.session import (
    OutDirectory,
    Precision,
    Seed,
    command,
    computing,
    messages,
    provenance,
)
from wheelhop.cli.vehicle import VehicleFile, load_vehicle
from wheelhop.errors import InputError, InputWarning, require_in_range
from wheelhop.identification import SUSPENSION, Settings, search_space
from wheelhop.identification import identify as fit
from wheelhop.identification.drives import SETTLING, prepare
from wheelhop.identification.identify import STARTS
from wheelhop.identification.replay import replay
from wheelhop.io.results import require_writable


@command
def identify(
    log: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="LOG...", help="CSV or Parquet: t, a_s, a_u, v, pressure, elevation with units."
        ),
    ] = None,
    vehicle: VehicleFile = None,
    corner: Annotated[
        str | None, typer.Option(help="Corner of logs of four: FL, FR, RL or RR.")
    ] = None,
    parameters: Annotated[
        str, typer.Option(help="What to fit, comma-separated; all else keeps the start's values.")
    ] = ",".join(SUSPENSION),
    bounds: Annotated[
        list[str] | None,
        typer.Option(help="NAME=LOW:HIGH in SI units, as suspension.damping=500:8000; repeatable."),
    ] = None,
    pressure: Annotated[
        float | None, typer.Option(help="Tyre pressure [kPa] of logs without the column.")
    ] = None,
    road: Annotated[
        Path | None,
        typer.Option(help="Measured profile driven from x = 0, for logs without elevation."),
    ] = None,
    track: Annotated[str | None, typer.Option(help="Elevation column of the road.")] = None,
    reflect: Annotated[
        bool, typer.Option("--reflect", help="Continue a short road there and back.")
    ] = False,
    starts: Annotated[
        int, typer.Option(help="Starting points: the vehicle's values and random ones around.")
    ] = STARTS,
    iterations: Annotated[
        int, typer.Option(help="Most L-BFGS iterations, after the warm-up.")
    ] = Settings().iterations,
    settling: Annotated[
        float, typer.Option(help="Time at each log's start that is not judged [s].")
    ] = SETTLING,
    units: Annotated[
        Path | None,
        typer.Option(help="TOML with [units] and [columns]; default LOG.toml if there."),
    ] = None,
    out: OutDirectory = Path("wheelhop-identification"),
    seed: Seed = 0,
    precision: Precision = "float64",
) -> None:
    """Fit a quarter car to logs of two accelerometers whose road and pressure are known.

    Minimises the rms errors of both accelerations over all logs by gradient descent from several
    starting points, and says how well the logs determine each parameter. Logs at several pressures
    and speeds tell more than one long log.

    Example: wheelhop identify drive-130.parquet drive-230.parquet --out fit

    Then: wheelhop estimate drive.csv --vehicle fit/vehicle.toml
    """
    require_writable(out)
    space = search_space(_names(parameters), _bounds(bounds or []))
    require_in_range("--starts", starts, 1, 1000, "starting points")
    require_in_range("--iterations", iterations, 1, 10_000, "iterations")
    with computing(precision):
        paths = each_once(log or [])
        refuse_front_for_rear(corner, vehicle)
        records = [read_named_log(path, units, corner) for path in paths]
        names = short_names(paths)
        records = with_pressure(records, names, pressure)
        records = with_elevation(records, names, road, track, reflect)
        car, start_name = load_vehicle(vehicle)
        # refused here, before a progress bar begins
        require_pressures(records, names, car)
        space.free(car)
        prepare(records, names, settling)
        with descent_bar() as advance, warnings.catch_warnings():
            # the report tells the same problems
            warnings.filterwarnings("ignore", "identification: ", InputWarning)
            found = fit(
                records,
                car,
                names=names,
                space=space,
                starts=starts,
                seed=seed,
                settling=settling,
                settings=Settings(iterations=iterations),
                on_progress=advance,
            )
        replays = replay(records, found.start, found.car, names, settling)
    made_by = provenance(
        "identify",
        precision,
        logs=[str(path) for path in paths],
        corner=corner,
        vehicle=start_name,
        parameters=space.names,
        bounds=dict(zip(space.names, zip(space.lower, space.upper, strict=True), strict=True)),
        pressure_kPa=pressure,
        road=None if road is None else str(road),
        track=track,
        reflect=reflect,
        starts=starts,
        iterations=iterations,
        settling_s=settling,
        seed=seed,
    )
    report_identification(found, replays, out, made_by)


@contextmanager
def descent_bar() -> Iterator[Callable[[int, int, float], None]]:
    """A progress bar; yields a function of iterations done, at most, and the unexplained share."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("iterations{task.fields[best]}"),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=messages) as bar:
        task = bar.add_task("compiling", total=None, best="")

        def advance(done: int, most: int, best: float) -> None:
            told = f", best start leaves {best:.3%} unexplained"
            bar.update(
                task, description="descending", completed=done, total=max(done, most), best=told
            )

        yield advance


def _names(text: str) -> tuple[str, ...]:
    return tuple(part.strip() for part in text.split(",") if part.strip())


def _bounds(texts: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Bounds by parameter, from texts as suspension.damping=500:8000."""
    found: dict[str, tuple[float, float]] = {}
    for text in texts:
        name, _, interval = text.partition("=")
        low, _, high = interval.partition(":")
        try:
            pair = float(low), float(high)
        except ValueError:
            raise InputError(
                "--bounds",
                f"{text!r} is not NAME=LOW:HIGH",
                "Write numbers in SI units, as suspension.damping=500:8000.",
            ) from None
        if name.strip() in found:
            raise InputError("--bounds", f"{name.strip()!r} is given twice", "Give it once.")
        found[name.strip()] = pair
    return found
