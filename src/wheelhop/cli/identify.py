"""`wheelhop identify`: a quarter car's parameters from logs, with a known road or without."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from wheelhop.cli.estimate import refuse_front_for_rear
from wheelhop.cli.identify_blind import blind_options, fit_blind, refuse_blind_only, say_unused
from wheelhop.cli.identify_blind_report import report_blind
from wheelhop.cli.identify_logs import (
    each_once,
    read_named_log,
    require_pressures,
    short_names,
    with_elevation,
    with_pressure,
)
from wheelhop.cli.identify_progress import fit_bar
from wheelhop.cli.identify_report import report_identification
from wheelhop.cli.session import (
    OutDirectory,
    Precision,
    Seed,
    command,
    computing,
    provenance,
)
from wheelhop.cli.vehicle import VehicleFile, load_vehicle
from wheelhop.errors import InputError, require_in_range
from wheelhop.identification import SUSPENSION, Settings, search_space
from wheelhop.identification import identify as fit
from wheelhop.identification.blind import NOISE
from wheelhop.identification.blind import STARTS as BLIND_STARTS
from wheelhop.identification.drives import SETTLING, prepare
from wheelhop.identification.identify import STARTS
from wheelhop.identification.replay import replay
from wheelhop.identification.scoring import Ascent
from wheelhop.identification.unknown_road import SETTLING as BLIND_SETTLING
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
    blind: Annotated[
        bool, typer.Option("--blind", help="Fit without a road, and each log's road level too.")
    ] = False,
    waviness: Annotated[
        str | None,
        typer.Option(metavar="W|fit", help="With --blind: of all roads, 1 to 3; default 2."),
    ] = None,
    noise: Annotated[
        str | None,
        typer.Option(
            metavar="A_S,A_U|fit",
            help=f"With --blind: of the accelerometers [m/s^2]; default {NOISE:g},{NOISE:g}.",
        ),
    ] = None,
    starts: Annotated[
        int | None,
        typer.Option(
            help="Starting points: the vehicle's values and random ones around; "
            f"default {STARTS}, blind {BLIND_STARTS}."
        ),
    ] = None,
    iterations: Annotated[
        int | None,
        typer.Option(
            help=f"Most L-BFGS iterations, after the warm-up; default {Settings().iterations}. "
            f"Blind: most scoring iterations; default {Ascent().iterations}."
        ),
    ] = None,
    settling: Annotated[
        float | None,
        typer.Option(
            help="Time at each log's start that is not judged [s]; "
            f"default {SETTLING:g}, blind {BLIND_SETTLING:g}."
        ),
    ] = None,
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

    Without a road, --blind maximises the likelihood that a filter gives the accelerations, over
    the car and the level of each log's road, and is less certain.

    Example: wheelhop identify drive-130.parquet drive-230.parquet --out fit

    Example: wheelhop identify drive-130.parquet drive-230.parquet --blind --noise fit --out fit

    Then: wheelhop estimate drive.csv --vehicle fit/vehicle.toml
    """
    require_writable(out)
    space = search_space(_names(parameters), _bounds(bounds or []))
    options = None
    usual: tuple[int, int, float] = (STARTS, Settings().iterations, SETTLING)
    if blind:
        options = blind_options(space, waviness, noise, road, track, reflect)
        usual = BLIND_STARTS, Ascent().iterations, BLIND_SETTLING
    else:
        refuse_blind_only(waviness, noise)
    starts = usual[0] if starts is None else starts
    iterations = usual[1] if iterations is None else iterations
    settling = usual[2] if settling is None else settling
    require_in_range("--starts", starts, 1, 1000, "starting points")
    require_in_range("--iterations", iterations, 1, 10_000, "iterations")
    with computing(precision):
        paths = each_once(log or [])
        refuse_front_for_rear(corner, vehicle)
        records = [read_named_log(path, units, corner) for path in paths]
        names = short_names(paths)
        records = with_pressure(records, names, pressure)
        if options is None:
            records = with_elevation(records, names, road, track, reflect)
        car, start_name = load_vehicle(vehicle)
        # refused here, before a progress bar begins
        require_pressures(records, names, car)
        space.free(car)
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
            **({} if options is None else options.settings()),
            starts=starts,
            iterations=iterations,
            settling_s=settling,
            seed=seed,
        )
        if options is not None:
            say_unused(records, names, car)
            found_blind = fit_blind(
                records, names, car, space, options, starts, iterations, settling, seed
            )
            report_blind(found_blind, out, made_by)
            return
        prepare(records, names, settling)
        with fit_bar("descending", lambda loss: f"leaves {loss:.3%} unexplained") as advance:
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
    report_identification(found, replays, out, made_by)


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
