"""`wheelhop road`: what kind of road a profile is."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, TypeVar

import typer
from rich.table import Table

from wheelhop.cli.session import OutDirectory, UnusedSeed, command, console, provenance, say_files
from wheelhop.errors import InputError
from wheelhop.io.results import (
    output_directory,
    require_writable,
    write_figure,
    write_json,
    write_table,
)
from wheelhop.io.roads import read_road
from wheelhop.plots import plot_road
from wheelhop.vehicle.road import fit_iso8608, iri, profile_psd

Result = TypeVar("Result")


@command
def road(
    profile: Annotated[Path, typer.Argument(help="x_m and one column a track, or .crg.")],
    track: Annotated[
        str | None, typer.Option(help="Elevation column, or lateral position [m] in a .crg.")
    ] = None,
    out: OutDirectory = Path("wheelhop-road"),
    seed: UnusedSeed = 0,
) -> None:
    """Measure a road profile: length, roughness index, ISO 8608 level, waviness and class.

    Example: wheelhop road road.csv --out road
    """
    require_writable(out)
    measured, name = read_road(profile, track)
    spectrum = profile_psd(measured)
    fit = _or_none(lambda: fit_iso8608(spectrum), "the ISO 8608 fit")
    roughness = _or_none(lambda: iri(measured), "the roughness index")
    results: dict[str, object] = {
        "track": name,
        "length_m": measured.length,
        "spacing_m": measured.spacing,
        "points": len(measured.elevation),
        "iri_m_per_km": roughness,
    }
    rows = [
        ("track", name),
        ("length", f"{measured.length:.2f} m"),
        ("spacing", f"{measured.spacing:.4g} m"),
        ("roughness index IRI", "-" if roughness is None else f"{roughness:.2f} m/km"),
    ]
    if fit is not None:
        results |= {
            "level_m3_per_rad": fit.level,
            "waviness": fit.waviness,
            "iso_level_at_waviness_2_m3_per_rad": fit.iso_level,
            "iso_class": fit.iso_class,
            "fitted_band_cycles_per_m": fit.band,
        }
        rows += [
            ("fitted level Gd(1 rad/m)", f"{1e6 * fit.level:.3g} x 1e-6 m^3/rad"),
            ("fitted waviness", f"{fit.waviness:.2f}"),
            ("level at waviness 2", f"{1e6 * fit.iso_level:.3g} x 1e-6 m^3/rad"),
            ("ISO 8608 class", fit.iso_class),
            ("fitted band", f"{fit.band[0]:.3g} to {fit.band[1]:.3g} cycles/m"),
        ]
    table = Table("quantity", "value", title=profile.name)
    for row in rows:
        table.add_row(*row)
    console.print(table)
    directory = output_directory(out)
    write_table(
        directory / "psd.parquet",
        {"frequency": spectrum.frequency, "density": spectrum.density},
        {"frequency": "1/m", "density": "m^3"},
    )
    write_figure(
        directory / "road.png", plot_road(measured, spectrum, fit, f"{profile.name}, {name}")
    )
    made_by = provenance("road", "float64", road=str(profile), track=track, seed=seed)
    write_json(directory / "summary.json", {**made_by, "results": results})
    say_files(directory, "road.png", "psd.parquet", "summary.json")


def _or_none(compute: Callable[[], Result], what: str) -> Result | None:
    """The figure, or None and a word why where the road does not hold it."""
    try:
        return compute()
    except InputError as error:
        console.print(f"no {what.removeprefix('the ')}: {error}", soft_wrap=True)
        return None
