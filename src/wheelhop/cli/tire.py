"""`wheelhop tire`: what a tyre property file holds."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import jax.numpy as jnp
import numpy as np
import typer
from rich.table import Table

from wheelhop.cli.session import (
    OutDirectory,
    UnusedSeed,
    command,
    computing,
    console,
    messages,
    provenance,
    say_files,
)
from wheelhop.io.results import (
    output_directory,
    require_writable,
    write_figure,
    write_json,
    write_table,
)
from wheelhop.io.tires import TireFile, read_tire
from wheelhop.plots.tire import plot_tire
from wheelhop.vehicle.magic_formula import relaxation_lengths, slip_forces, slip_stiffness
from wheelhop.vehicle.vertical_tire import (
    contact_half_length,
    deflection_at_load,
    effective_radius,
    nominal_stiffness,
)

LOADS = (0.25, 0.5, 1.0, 1.5)


@command
def tire(
    file: Annotated[Path, typer.Argument(help="Tyre property file (.tir), PAC2002 or MF_05.")],
    out: OutDirectory = Path("wheelhop-tire"),
    seed: UnusedSeed = 0,
) -> None:
    """Show a tyre: stiffnesses, peak friction and relaxation lengths at its rated load.

    Example: wheelhop tire car.tir --out tire
    """
    require_writable(out)
    read = read_tire(file)
    for warning in read.warnings:
        messages.print(f"[yellow]note[/] {warning}", soft_wrap=True)
    with computing("float64"):
        results, curves = _results(read), _curves(read)
        figure = plot_tire(read.magic_formula, read.vertical, read.name)
    table = Table("quantity", "value", title=file.name)
    for row in _rows(read, results):
        table.add_row(*row)
    console.print(table)
    directory = output_directory(out)
    write_table(directory / "tire.parquet", *curves)
    write_figure(directory / "tire.png", figure)
    made_by = provenance("tire", "float64", tire=str(file), seed=seed)
    write_json(
        directory / "summary.json",
        {**made_by, "results": results, "warnings": list(read.warnings)},
    )
    say_files(directory, "tire.png", "tire.parquet", "summary.json")


def _results(read: TireFile) -> dict[str, float | str | None]:
    """Figures of the tyre at its rated load and nominal pressure, standing."""
    slip, vertical = read.magic_formula, read.vertical
    load, pressure = slip.rated_load, slip.nominal_pressure
    longitudinal, lateral = slip_stiffness(load, pressure, slip)
    sigma_kappa, sigma_alpha = relaxation_lengths(load, slip)
    deflection = deflection_at_load(load, 0.0, vertical.nominal_pressure, vertical)
    peak_x, peak_y = _peak_friction(read)
    return {
        "format": read.format,
        "side": read.side,
        "combined_slip": "friction ellipse" if slip.friction_ellipse else "weighting functions",
        "inflation_pressure_Pa": read.inflation_pressure,
        "rated_load_N": load,
        "smallest_load_N": read.load_range[0],
        "largest_load_N": read.load_range[1],
        "unloaded_radius_m": slip.unloaded_radius,
        "loaded_radius_m": slip.unloaded_radius - float(deflection),
        "effective_radius_m": float(effective_radius(deflection, vertical)),
        "contact_length_m": 2.0 * float(contact_half_length(deflection, vertical)),
        "vertical_stiffness_N_per_m": nominal_stiffness(vertical),
        "pressure_coefficient": vertical.pressure_coefficient,
        "cornering_stiffness_N_per_rad": -float(lateral),
        "slip_stiffness_N": float(longitudinal),
        "peak_friction_longitudinal": peak_x,
        "peak_friction_lateral": peak_y,
        "relaxation_length_longitudinal_m": float(sigma_kappa),
        "relaxation_length_lateral_m": float(sigma_alpha),
    }


def _peak_friction(read: TireFile) -> tuple[float, float]:
    """Largest driving and cornering force over the rated load; the mean of both directions."""
    slip = jnp.linspace(-1.0, 1.0, 2001)
    zero = jnp.zeros_like(slip)
    tire = read.magic_formula
    load, pressure = zero + tire.rated_load, zero + tire.nominal_pressure
    x = np.asarray(slip_forces(slip, zero, load, zero, pressure, tire).longitudinal)
    y = np.asarray(slip_forces(zero, slip, load, zero, pressure, tire).lateral)
    return float(np.ptp(x)) / 2 / tire.rated_load, float(np.ptp(y)) / 2 / tire.rated_load


def _curves(read: TireFile) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """Pure-slip curves at several loads, one row a load and slip, with their units."""
    tire = read.magic_formula
    slip = np.linspace(-0.5, 0.5, 201)
    loads = np.repeat(np.asarray(LOADS) * tire.rated_load, slip.size)
    slips = np.tile(slip, len(LOADS))
    load, s = jnp.asarray(loads), jnp.asarray(slips)
    zero = jnp.zeros_like(s)
    pressure = zero + tire.nominal_pressure
    columns = {
        "load": loads,
        "slip": slips,
        "longitudinal_force": slip_forces(s, zero, load, zero, pressure, tire).longitudinal,
        "lateral_force": slip_forces(zero, s, load, zero, pressure, tire).lateral,
    }
    units = {"load": "N", "slip": "1", "longitudinal_force": "N", "lateral_force": "N"}
    return {name: np.asarray(column) for name, column in columns.items()}, units


def _rows(read: TireFile, results: dict[str, float | str | None]) -> list[tuple[str, str]]:
    r = {k: v for k, v in results.items() if isinstance(v, float)}
    pressure = read.inflation_pressure
    return [
        ("format", f"{read.format}, {results['combined_slip']}"),
        ("inflation pressure", "-" if pressure is None else f"{pressure / 1e3:.0f} kPa"),
        ("rated load", f"{r['rated_load_N']:.0f} N"),
        (
            "radius unloaded, effective, loaded",
            f"{r['unloaded_radius_m']:.4f}, {r['effective_radius_m']:.4f}, "
            f"{r['loaded_radius_m']:.4f} m",
        ),
        ("contact length", f"{1e3 * r['contact_length_m']:.0f} mm"),
        ("vertical stiffness", f"{r['vertical_stiffness_N_per_m'] / 1e3:.1f} kN/m"),
        ("cornering stiffness", f"{r['cornering_stiffness_N_per_rad'] / 1e3:.1f} kN/rad"),
        ("longitudinal slip stiffness", f"{r['slip_stiffness_N'] / 1e3:.1f} kN"),
        (
            "peak friction longitudinal, lateral",
            f"{r['peak_friction_longitudinal']:.2f}, {r['peak_friction_lateral']:.2f}",
        ),
        (
            "relaxation length longitudinal, lateral",
            f"{r['relaxation_length_longitudinal_m']:.2f}, "
            f"{r['relaxation_length_lateral_m']:.2f} m",
        ),
    ]
