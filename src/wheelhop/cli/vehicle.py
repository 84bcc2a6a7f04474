"""`wheelhop vehicle` and the vehicle that the other commands use."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from wheelhop.cli.session import command, console
from wheelhop.errors import InputError
from wheelhop.io.vehicles import read_vehicle, write_vehicle
from wheelhop.vehicle.parameters import QuarterCar, brancati_suv, validate
from wheelhop.vehicle.tire import stiffness_from_pressure

DEFAULT_VEHICLE = "Brancati & Tufano 2022 SUV, front-left corner"

VehicleFile = Annotated[
    Path | None, typer.Option("--vehicle", help="TOML of the corner; see `wheelhop vehicle`.")
]


def load_vehicle(path: Path | None) -> tuple[QuarterCar, str]:
    """The corner of a file, or the default one, said aloud; and its name for the summary."""
    if path is None:
        console.print(f"vehicle: {DEFAULT_VEHICLE} (no --vehicle given)")
        return brancati_suv(), DEFAULT_VEHICLE
    return read_vehicle(path), str(path)


@command
def vehicle(
    axle: Annotated[str, typer.Option(help="front or rear.")] = "front",
    load: Annotated[float, typer.Option(help="Payload [kg].", min=0.0)] = 0.0,
    out: Annotated[Path | None, typer.Option("--out", help="TOML file to write.")] = None,
) -> None:
    """Show the default corner's parameters and resonances, and write them as TOML.

    Example: wheelhop vehicle --axle rear --load 140 --out rear.toml
    """
    car = validate(brancati_suv(axle, load))
    table = Table("quantity", "value", "unit", title=f"{axle} corner, payload {load:g} kg")
    rows = [
        ("sprung mass", f"{car.sprung_mass:.1f}", "kg"),
        ("unsprung mass", f"{car.unsprung_mass:.2f}", "kg"),
        ("suspension stiffness", f"{car.suspension.stiffness:g}", "N/m"),
        ("suspension damping", f"{car.suspension.damping:g}", "Ns/m"),
    ]
    for kpa in (130, 180, 230):
        k_t = float(stiffness_from_pressure(1e3 * kpa, car.tire))
        hop = math.sqrt((k_t + car.suspension.stiffness) / car.unsprung_mass) / (2 * math.pi)
        rows.append((f"tyre stiffness at {kpa} kPa", f"{k_t:.0f}", "N/m"))
        rows.append((f"wheel hop at {kpa} kPa (body held)", f"{hop:.2f}", "Hz"))
    for row in rows:
        table.add_row(*row)
    console.print(table)
    if out is not None:
        if not out.parent.is_dir():
            raise InputError("--out", f"{out.parent} is no directory", "Make it first.")
        if out.is_dir():
            raise InputError("--out", f"{out} is a directory", "Name a file, as corner.toml.")
        write_vehicle(out, car, f"wheelhop quarter car: {axle} corner, payload {load:g} kg")
        console.print(f"wrote {out}", soft_wrap=True)
