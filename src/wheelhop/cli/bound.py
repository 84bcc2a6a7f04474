"""`wheelhop bound`: the best accuracy of pressure that any estimator can have."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from wheelhop.cli.session import (
    OutDirectory,
    UnusedSeed,
    command,
    console,
    escape,
    headed_table,
    provenance,
    say_files,
)
from wheelhop.cli.vehicle import VehicleFile, load_vehicle
from wheelhop.errors import InputError, require_in_range
from wheelhop.evaluation.bound_cases import BoundCase, BoundSettings, bound_cases, shown_times
from wheelhop.evaluation.bounds import pressure_deviation
from wheelhop.evaluation.spectra import CORNER_UNKNOWNS, ROAD_UNKNOWNS, IsoRoad
from wheelhop.io.results import (
    output_directory,
    require_writable,
    write_figure,
    write_json,
    write_table,
)
from wheelhop.io.vehicles import read_vehicle
from wheelhop.plots.bound import plot_bound
from wheelhop.vehicle.parameters import BRANCATI_TABLE_1, QuarterCar, brancati_suv
from wheelhop.vehicle.road.iso8608 import level_of
from wheelhop.vehicle.scenario import RATE

WHEELBASE = BRANCATI_TABLE_1.front_semi_wheelbase + BRANCATI_TABLE_1.rear_semi_wheelbase

_POINTS = 81
_FIRST = 0.5


@command
def bound(
    speed: Annotated[float, typer.Option(help="Speed [km/h].")] = 60.0,
    road_class: Annotated[
        str, typer.Option("--class", help="ISO 8608 class A to H, or level Gd(W0) [m^3/rad].")
    ] = "B",
    time: Annotated[float, typer.Option(help="Length of the drive [s].")] = 10.0,
    pressure: Annotated[float, typer.Option(help="Tyre pressure, in front [kPa].")] = 180.0,
    rear_pressure: Annotated[
        float | None, typer.Option(help="Tyre pressure at the rear [kPa]; default as in front.")
    ] = None,
    waviness: Annotated[float, typer.Option(help="Waviness of the road.")] = 2.0,
    noise: Annotated[float, typer.Option(help="Noise of the accelerometers [m/s^2].")] = 0.5,
    rate: Annotated[float, typer.Option(help="Sampling rate [Hz].")] = RATE,
    unknown: Annotated[
        str,
        typer.Option(help="More unknowns for one corner, of level,waviness,m_s,k_s,c_s,m_u."),
    ] = "level,m_s,k_s,c_s",
    prior_pressure_sigma: Annotated[
        float | None, typer.Option(help="What is known of each pressure beforehand [kPa].")
    ] = None,
    walk: Annotated[
        float | None, typer.Option(help="Random walk of each pressure [kPa per root second].")
    ] = None,
    vehicle: VehicleFile = None,
    rear_vehicle: Annotated[
        Path | None, typer.Option(help="TOML of the rear corner; default as in front.")
    ] = None,
    wheelbase: Annotated[float, typer.Option(help="Wheelbase [m].")] = WHEELBASE,
    out: OutDirectory = Path("wheelhop-bound"),
    seed: UnusedSeed = 0,
) -> None:
    """Show the best accuracy of pressure that any estimator can have (Cramér-Rao bound).

    Example: wheelhop bound --speed 60 --class B --time 10 --out bound
    """
    require_writable(out)
    require_in_range("--speed", speed, 3.6, 360.0, "km/h")
    require_in_range("--time", time, 2 * _FIRST, 1e5, "s")
    require_in_range("--pressure", pressure, 20.0, 1500.0, "kPa")
    rear_pressure = pressure if rear_pressure is None else rear_pressure
    require_in_range("--rear-pressure", rear_pressure, 20.0, 1500.0, "kPa")
    require_in_range("--wheelbase", wheelbase, 0.5, 20.0, "m")
    require_in_range("--noise", noise, 1e-6, 1e3, "m/s^2")
    require_in_range("--waviness", waviness, 1.2, 3.5, "(no unit)")
    require_in_range("--rate", rate, 50.0, 20e3, "Hz")
    for option, value in (("--prior-pressure-sigma", prior_pressure_sigma), ("--walk", walk)):
        if value is not None:
            require_in_range(option, value, 1e-6, 1e4, "kPa")
    road = IsoRoad(level_of(road_class), waviness)
    more = _more_unknowns(unknown)
    cars, names = _cars(vehicle, rear_vehicle)
    pascal = float(pressure_deviation(np.ones(1), cars[0], 1e3 * pressure)[0])
    settings = BoundSettings(
        cars,
        (1e3 * pressure, 1e3 * rear_pressure),
        road,
        speed / 3.6,
        wheelbase,
        (noise, noise),
        rate,
        more,
        None if prior_pressure_sigma is None else 1e3 * prior_pressure_sigma / pascal,
        None if walk is None else 1e3 * walk / pascal,
    )
    shown = shown_times(time, 3)
    grid = np.geomspace(_FIRST, time, _POINTS)
    times = np.unique(np.concatenate([grid, shown]))
    cases = bound_cases(settings, times)
    rows = {case.key: np.interp(shown, times, case.relative) for case in cases}

    _print(cases, rows, shown, pascal)
    directory = output_directory(out)
    columns = {f"{c.key}_pressure": pascal * c.relative for c in cases}
    columns |= {f"{c.key}_stiffness": c.relative for c in cases}
    units = {n: "Pa" if n.endswith("_pressure") else "1" for n in columns}
    write_table(directory / "bound.parquet", {"time": times, **columns}, {"time": "s", **units})
    where = f"{speed:g} km/h, class {road_class}, {pressure:g} kPa, {noise:g} m/s²"
    title = f"The best any estimator can do: {where}, {rate:g} Hz"
    write_figure(directory / "bound.png", plot_bound(times, cases, pascal, title))
    made_by = provenance(
        "bound",
        "float64",
        vehicles=names,
        seed=seed,
        pressure_per_ln_stiffness=pascal,
        **asdict(settings),
    )
    results = {
        case.key: {
            "what": case.label + (", difference of two wheels" if case.difference else ""),
            "pressure_Pa": pascal * rows[case.key],
            "stiffness": rows[case.key],
        }
        for case in cases
    }
    write_json(directory / "summary.json", {**made_by, "time_s": shown, "results": results})
    say_files(directory, "bound.png", "bound.parquet", "summary.json")


def _more_unknowns(text: str) -> tuple[str, ...]:
    """Names of an option's list; the level is unknown in any case."""
    allowed = (*ROAD_UNKNOWNS, *CORNER_UNKNOWNS)
    names = [name.strip() for name in text.split(",") if name.strip()]
    for name in names:
        if name not in allowed:
            raise InputError(
                "--unknown", f"{name!r} is no parameter here", f"Use {', '.join(allowed)}."
            )
    return tuple(n for n in dict.fromkeys(names) if n not in ("k_t", "level"))


def _cars(
    front: Path | None, rear: Path | None
) -> tuple[tuple[QuarterCar, QuarterCar], tuple[str, str]]:
    """Front and rear corner and their names; without files those of the default vehicle."""
    car, name = load_vehicle(front)
    if rear is not None:
        return (car, read_vehicle(rear)), (name, str(rear))
    if front is None:
        return (car, brancati_suv("rear")), (name, name.replace("front-left", "rear-left"))
    return (car, car), (name, name)


def _print(
    cases: Sequence[BoundCase],
    rows: dict[str, np.ndarray],
    shown: Sequence[float],
    pascal: float,
) -> None:
    units = "[kPa] (stiffness [%])"
    for difference, what in ((False, "one pressure"), (True, "difference of two wheels")):
        table = headed_table(
            what, *(f"{t:g} s" for t in shown), title=escape(f"smallest deviation {units}")
        )
        for case in cases:
            if case.difference is difference:
                table.add_row(case.label, *(_cell(v, pascal) for v in rows[case.key]))
        console.print(table)


def _cell(relative: Any, pascal: float) -> str:
    if not np.isfinite(relative):
        return "not seen"
    return f"{relative * pascal / 1e3:.1f} ({100 * relative:.1f})"
