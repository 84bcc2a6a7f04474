"""`wheelhop cornering`: which tyre is soft, from steering, lateral acceleration and yaw rate."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import jax.numpy as jnp
import numpy as np
import typer

from wheelhop.cli.session import (
    OutDirectory,
    Precision,
    UnusedSeed,
    command,
    computing,
    console,
    headed_table,
    messages,
    provenance,
    say_files,
)
from wheelhop.errors import InputError, require_in_range
from wheelhop.estimators.lateral_vehicle import SoftTires, which_tires_are_soft
from wheelhop.io.lateral_logs import read_lateral_log
from wheelhop.io.results import (
    output_directory,
    require_writable,
    write_figure,
    write_json,
    write_table,
)
from wheelhop.plots.soft_tires import plot_soft_tires
from wheelhop.vehicle.full_vehicle_parameters import CORNERS, VEHICLES
from wheelhop.vehicle.full_vehicle_state import STANDARD_GRAVITY
from wheelhop.vehicle.lateral_tire import (
    ARCTANGENT,
    MAGIC_FORMULA,
    NOMINAL_TIRE,
    SOFT_TIRE,
    TireLaw,
)
from wheelhop.vehicle.two_track import SOLMAZ_CAR, TwoTrack, Wheels
from wheelhop.vehicle.two_track_of import tires_of, two_track_of

PAPER_CAR = "solmaz"

_RATIO = 16.0


@dataclass(frozen=True)
class Known:
    """The vehicle as the estimator knows it: car, tyres of both levels, and their law."""

    car: TwoTrack
    levels: Wheels
    law: TireLaw


@command
def cornering(
    log: Annotated[
        Path,
        typer.Argument(help="CSV or Parquet: t, v, a_y, yaw_rate, steering_wheel or steer."),
    ],
    vehicle: Annotated[
        str, typer.Option(help=f"{', '.join(VEHICLES)}, or {PAPER_CAR}, the paper's.")
    ] = "suv",
    lost: Annotated[
        float, typer.Option(help="Share of its cornering stiffness that a soft tyre has lost.")
    ] = 0.3,
    placard: Annotated[
        float | None, typer.Option(help="Pressure of sound tyres [kPa]; default the vehicle's.")
    ] = None,
    soft: Annotated[
        float | None,
        typer.Option(help="Pressure of a soft tyre [kPa], instead of --lost; needs --ppy1."),
    ] = None,
    ppy1: Annotated[
        float | None,
        typer.Option("--ppy1", help="Change of cornering stiffness with pressure, as 0.9."),
    ] = None,
    steering_ratio: Annotated[
        float, typer.Option(help="Steering-wheel angle per angle of the front wheels.")
    ] = _RATIO,
    friction: Annotated[
        float, typer.Option(help="Road friction expected, of the tyres' data.")
    ] = 1.0,
    units: Annotated[
        Path | None,
        typer.Option(help="TOML with [units] and [columns]; default LOG.toml if there."),
    ] = None,
    out: OutDirectory = Path("wheelhop-cornering"),
    seed: UnusedSeed = 0,
    precision: Precision = "float64",
) -> None:
    """Say which tyre is soft from what stability control measures while cornering.

    Sixteen filters, one for each combination of soft tyres, and the probability of each. Straight
    ahead nothing is told; a soft tyre that corners as a sound one cannot be seen.

    Example: wheelhop cornering drive/log.parquet --vehicle suv --lost 0.3 --out result

    Another: wheelhop simulate --vehicle suv --maneuver lane-change --speed 80 --peak 0.35
    --pressures 150,230,230,230 --ppy1 0.9 --rate 100 --duration 20 --out drive, then
    wheelhop cornering drive/log.parquet --ppy1 0.9 --placard 230 --soft 150 --out result
    """
    require_writable(out)
    require_in_range("--lost", lost, 0.02, 0.9, "(share)")
    require_in_range("--friction", friction, 0.05, 2.0, "(no unit)")
    with computing(precision):
        known = known_vehicle(vehicle, lost, placard, soft, ppy1)
        record = read_lateral_log(log, steering_ratio, units)
        console.print(
            f"{log.name}: {record.t[-1] - record.t[0]:.4g} s at {1.0 / record.dt:.4g} Hz, "
            f"{3.6 * np.nanmean(record.sample.speed):.4g} km/h",
            soft_wrap=True,
        )
        with messages.status("filtering (the first record compiles for about a minute)"):
            found = which_tires_are_soft(
                record.sample, record.dt, known.car, known.levels, known.law, friction=friction
            )
    results = summary_of(found)
    print_verdict(results)
    directory = output_directory(out)
    write_table(directory / "soft_tires.parquet", *columns_of(found, float(record.t[0])))
    title = f"{log.name}: {results['verdict']}"
    write_figure(directory / "soft_tires.png", plot_soft_tires(record, found, title))
    made_by = provenance(
        "cornering",
        precision,
        log=str(log),
        vehicle=vehicle,
        lost=lost,
        placard_kPa=placard,
        soft_kPa=soft,
        ppy1=ppy1,
        steering_ratio=steering_ratio,
        friction=friction,
        seed=seed,
    )
    write_json(directory / "summary.json", {**made_by, "results": results})
    say_files(directory, "soft_tires.png", "soft_tires.parquet", "summary.json")


def known_vehicle(
    name: str, lost: float, placard: float | None, soft: float | None, ppy1: float | None
) -> Known:
    """The vehicle of a name with sound and soft tyres.

    Args:
        name: a key of `VEHICLES`, or the paper's car.
        lost: share of the cornering stiffness that a soft tyre has lost.
        placard: pressure of sound tyres [kPa]; None for the vehicle's own.
        soft: pressure of a soft tyre [kPa], in place of `lost`.
        ppy1: change of cornering stiffness with pressure.

    Raises:
        InputError: for an unknown vehicle, or options that do not go together.
    """
    if name == PAPER_CAR:
        for option, value in (("--placard", placard), ("--soft", soft), ("--ppy1", ppy1)):
            if value is not None:
                raise InputError(
                    option, f"the tyres of {name} know no pressure", "Leave it out, use --lost."
                )
        scale = (1.0 - lost) / _paper_loss()
        worse = replace(SOFT_TIRE, k3=SOFT_TIRE.k3 * scale)
        return Known(SOLMAZ_CAR, Wheels(*[(worse, NOMINAL_TIRE)] * 4), ARCTANGENT)
    if name not in VEHICLES:
        raise InputError(
            "--vehicle", f"{name!r} is unknown", f"Use {', '.join(VEHICLES)} or {PAPER_CAR}."
        )
    car = VEHICLES[name]()
    nominal = float(car.nominal_pressure[0])
    pressure = nominal if placard is None else 1e3 * placard
    require_in_range("--placard", 1e-3 * pressure, 20.0, 1500.0, "kPa")
    if ppy1 is not None:
        require_in_range("--ppy1", ppy1, -2.0, 2.0, "(no unit)")
        slip = replace(car.tire.slip, ppy1=ppy1 + jnp.zeros_like(car.tire.slip.pky1))
        car = replace(car, tire=replace(car.tire, slip=slip))
    held = jnp.full(4, pressure, jnp.result_type(float))
    sound = tires_of(car, held)
    if soft is not None:
        require_in_range("--soft", soft, 20.0, 1500.0, "kPa")
        if not ppy1:
            raise InputError(
                "--soft", "without --ppy1 pressure changes no lateral force", "Give --ppy1 too."
            )
        worse_tires = tires_of(car, jnp.full(4, 1e3 * soft, jnp.result_type(float)))
    else:
        worse_tires = Wheels(
            *(replace(t, slip=replace(t.slip, lky=t.slip.lky * (1.0 - lost))) for t in sound)
        )
    levels = Wheels(*((a, b) for a, b in zip(worse_tires, sound, strict=True)))
    return Known(two_track_of(car, held), levels, MAGIC_FORMULA)


def _paper_loss() -> float:
    """Cornering stiffness of the paper's soft tyre per sound one at the car's mean wheel load."""
    load = 0.25 * SOLMAZ_CAR.mass * STANDARD_GRAVITY
    soft, sound = (float(ARCTANGENT.stiffness(load, t)) for t in (SOFT_TIRE, NOMINAL_TIRE))
    return soft / sound


def summary_of(found: SoftTires) -> dict[str, Any]:
    """What is believed at the end; SI units."""
    best = int(found.probabilities[-1].argmax())
    return {
        "verdict": found.told,
        "probability_soft": dict(zip(CORNERS, found.soft[-1], strict=True)),
        "most_probable": found.modes[best],
        "its_probability": found.probabilities[-1, best],
        "peak_lateral_acceleration_m_per_s2": found.peak[-1],
        "friction": found.friction[-1],
        "friction_sigma_of_logarithm": found.friction_sigma[-1],
        "mass_kg": found.mass[-1],
        "mean_nis": float(np.nanmean(found.nis)),
    }


def print_verdict(results: dict[str, Any]) -> None:
    """The probabilities of the tyres, and in words what they are worth."""
    table = headed_table("tyre", "probability that it is soft", title=results["verdict"])
    for corner, p in results["probability_soft"].items():
        table.add_row(corner, f"{p:.3f}")
    console.print(table)
    console.print(
        f"cornered at up to {results['peak_lateral_acceleration_m_per_s2']:.2f} m/s^2; friction "
        f"{results['friction']:.2f} of the tyres' data; innovations: mean NIS "
        f"{results['mean_nis']:.1f} (about 2 where the model fits)",
        soft_wrap=True,
    )


def columns_of(found: SoftTires, start: float) -> tuple[dict[str, Any], dict[str, str]]:
    """Columns of the result by name, and their units."""
    columns: dict[str, Any] = {"t": start + found.t}
    units = {"t": "s"}
    for k, corner in enumerate(CORNERS):
        columns[f"probability_soft_{corner}"] = found.soft[:, k]
    for k, mode in enumerate(found.modes):
        columns[f"probability_{mode}"] = found.probabilities[:, k]
    columns |= {"friction": found.friction, "side_slip": found.side_slip, "mass": found.mass}
    columns |= {"nis": found.nis, "peak": found.peak}
    units |= {"side_slip": "rad", "mass": "kg", "peak": "m/s^2"}
    return columns, {name: units.get(name, "1") for name in columns}
