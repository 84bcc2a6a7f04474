"""The files that `reproduce brancati --table 3` writes."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np

from wheelhop.cli.session import say_files
from wheelhop.identification.identify import Identification
from wheelhop.identification.parameters import PARAMETERS, SUSPENSION, value_of
from wheelhop.io.results import write_atomically, write_figure, write_json, write_table
from wheelhop.io.vehicles import write_vehicle
from wheelhop.studies.brancati.identification import (
    READING_PRESSURE,
    IdentificationStudy,
    plant_damping_on,
)
from wheelhop.studies.brancati.identification_figures import (
    Records,
    norms_figure,
    overlay_figure,
)


def write_study(
    study: IdentificationStudy, records: Records, directory: Path, made_by: dict[str, Any]
) -> None:
    """Tables, vehicles, figures and summary into a directory that exists."""
    _write_sets(directory / "table3.csv", study)
    _write_errors(directory / "table3_rmse.parquet", study)
    vehicles = []
    for name, fit in study.fits.items():
        vehicles.append(f"suspension_{name.removeprefix('ours ').replace(' ', '_')}.toml")
        comment = f"Front-left corner fitted to drives of the full vehicle; set: {name}."
        write_vehicle(directory / vehicles[-1], fit.car, comment, _notes(fit))
    write_figure(directory / "table3_overlay.png", overlay_figure(study, records))
    write_figure(directory / "table3_rmse.png", norms_figure(study))
    write_json(directory / "summary.json", {**made_by, "results": summarise_study(study)})
    tables = ("table3.csv", "table3_rmse.parquet")
    say_files(
        directory, *tables, *vehicles, "table3_overlay.png", "table3_rmse.png", "summary.json"
    )


def summarise_study(study: IdentificationStudy) -> dict[str, Any]:
    """Every figure of the study by name, units in the names."""
    classes = study.settings.classes
    return {
        "measured_norm_m_per_s2": {c: study.measured_norm(c) for c in classes},
        "vehicle_damping_Ns_per_m": {c: plant_damping_on(study, c) for c in classes},
        "pressure_of_the_modes_Pa": READING_PRESSURE,
        "sets": {name: _summary_of(study, name) for name in study.cars},
    }


def _summary_of(study: IdentificationStudy, name: str) -> dict[str, Any]:
    car, reading = study.cars[name], study.readings[name]
    content: dict[str, Any] = {
        "parameters": {p: float(value_of(car, p)) for p in PARAMETERS},
        "units": {p: bounds.unit for p, bounds in PARAMETERS.items()},
        "norm_of_rmse_m_per_s2": {c: study.norm(name, c) for c in study.settings.classes},
        "suspension_velocity_rms_m_per_s": reading.velocity_rms,
        "equivalent_damping_Ns_per_m": reading.damping,
        "body_damping_ratio": reading.ratio.body,
        "wheel_damping_ratio": reading.ratio.wheel,
        "ride_frequency_Hz": reading.modes.ride_frequency,
        "ride_damping_ratio": reading.modes.ride_damping,
        "hop_frequency_Hz": reading.modes.hop_frequency,
        "hop_damping_ratio": reading.modes.hop_damping,
    }
    if name in study.fits:
        fit = study.fits[name]
        content |= {
            **_errors_by_name(fit),
            "at_bound": {n: b for n, b in zip(fit.space.names, fit.at_bound, strict=True) if b},
            "unexplained_share": fit.unexplained,
            "duration_s": float(fit.descent.seconds[-1]),
            "problems": list(fit.problems),
        }
    return content


def _errors_by_name(fit: Identification) -> dict[str, dict[str, float]]:
    """Both kinds of errors of the fitted parameters."""
    return {
        kind: dict(zip(fit.space.names, getattr(fit.uncertainty, kind).tolist(), strict=True))
        for kind in ("standard_errors", "robust_errors")
    }


def _notes(fit: Identification) -> dict[str, str]:
    """What stands behind each fitted parameter in a vehicle's file."""
    errors = fit.uncertainty.robust_errors
    prefix = {name: name if "." in name else f"quarter_car.{name}" for name in fit.space.names}
    return {
        prefix[name]: f"fitted, at its {side} bound" if side else f"fitted, +- {error:.2g}"
        for name, side, error in zip(fit.space.names, fit.at_bound, errors, strict=True)
    }


def _write_sets(path: Path, study: IdentificationStudy) -> None:
    """One row a set: the suspension and, of fitted ones, both kinds of errors."""
    kinds = ("standard_errors", "robust_errors")
    heads = [(name.removeprefix("suspension."), PARAMETERS[name].unit) for name in SUSPENSION]
    header = ["set", *(f"{n} [{u}]" for n, u in heads)]
    header += [f"{n}_{kind.removesuffix('s')} [{u}]" for kind in kinds for n, u in heads]
    rows = []
    for name, car in study.cars.items():
        numbers = [float(value_of(car, n)) for n in SUSPENSION]
        known = {} if name not in study.fits else _errors_by_name(study.fits[name])
        numbers += [known.get(kind, {}).get(n, np.nan) for kind in kinds for n in SUSPENSION]
        rows.append([name, *("" if np.isnan(x) else f"{x:.9g}" for x in numbers)])

    def write(place: Path) -> None:
        with place.open("w", newline="", encoding="utf-8") as stream:
            csv.writer(stream, lineterminator="\n").writerows([header, *rows])

    write_atomically(path, write)


def _write_errors(path: Path, study: IdentificationStudy) -> None:
    """One row a set and drive."""
    drives, names = study.scenarios, list(study.cars)
    columns: dict[str, Any] = {
        "set": np.repeat(names, len(drives)),
        "road_class": np.tile([s.road_class for s in drives], len(names)),
        "speed": np.tile([s.speed for s in drives], len(names)),
        "pressure": np.tile([s.pressure for s in drives], len(names)),
        "rmse_a_s": study.errors.rmse[:, :, 0].ravel(),
        "rmse_a_u": study.errors.rmse[:, :, 1].ravel(),
        "rms_a_s": np.tile(study.measured_rms[:, 0], len(names)),
        "rms_a_u": np.tile(study.measured_rms[:, 1], len(names)),
        "velocity_rms": study.errors.velocity_rms.ravel(),
    }
    units = {"speed": "m/s", "pressure": "Pa", "velocity_rms": "m/s"}
    units |= {name: "m/s^2" for name in columns if name.endswith(("a_s", "a_u"))}
    write_table(path, columns, units)
