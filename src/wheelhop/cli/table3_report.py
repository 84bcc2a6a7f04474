"""The tables that `reproduce brancati --table 3` prints."""

from __future__ import annotations

from rich.markup import escape
from rich.table import Table

from wheelhop.cli.session import console, headed_table
from wheelhop.identification.identify import Identification
from wheelhop.identification.parameters import SUSPENSION, value_of
from wheelhop.studies.brancati.identification import (
    ALL,
    MORE,
    READING_PRESSURE,
    START,
    IdentificationStudy,
    plant_damping_on,
)
from wheelhop.vehicle.parameters import QuarterCar


def print_study(study: IdentificationStudy) -> None:
    """The sets, their errors, what they mean as a car, and each set on the others' roads."""
    console.print(_parameters(study))
    if MORE in study.fits:
        console.print(_extended(study.fits[MORE]))
    for table in (_norms(study), _cross(study), _readings(study)):
        console.print(table)
    for name, fit in study.fits.items():
        for problem in fit.problems:
            console.print(f"{name}: {problem}", soft_wrap=True, markup=False, highlight=False)


def _parameters(study: IdentificationStudy) -> Table:
    table = _table(
        "suspension; below the estimate its standard error (robust error)",
        "set",
        "c_s [Ns/m]",
        "c_snl [Ns^2/m^2]",
        "k_s [N/m]",
        "k_snl [N/m^3]",
    )
    for name, car in study.cars.items():
        if name != MORE:
            table.add_row(name, *_cells(car, study.fits.get(name)))
    return table


def _cells(car: QuarterCar, fit: Identification | None) -> list[str]:
    """The four suspension parameters, with what is known of their errors."""
    cells = []
    for k, name in enumerate(SUSPENSION):
        text = f"{float(value_of(car, name)):,.0f}"
        if fit is not None and fit.at_bound[k]:
            text += f"\n{fit.at_bound[k]} bound"
        elif fit is not None:
            known = fit.uncertainty
            text += f"\n{known.standard_errors[k]:,.2g} ({known.robust_errors[k]:,.2g})"
        cells.append(text)
    return cells


def _extended(fit: Identification) -> Table:
    table = _table(
        "extended set on all roads", "parameter", "start", "estimate", "standard error", "robust"
    )
    known = fit.uncertainty
    for k, name in enumerate(fit.space.names):
        bound = f" ({fit.at_bound[k]} bound)" if fit.at_bound[k] else ""
        table.add_row(
            escape(f"{name} [{fit.space.units[k]}]"),
            f"{float(value_of(fit.start, name)):.5g}",
            f"{fit.values[k]:.5g}{bound}",
            f"{known.standard_errors[k]:.2g}",
            f"{known.robust_errors[k]:.2g}",
        )
    return table


def _norms(study: IdentificationStudy) -> Table:
    shared = [name for name in (ALL, MORE) if name in study.cars]
    table = _table(
        "norm of the RMSE of both accelerations over a class's drives [m/s^2]",
        "road class",
        "measured",
        START,
        "paper",
        "ours",
        *shared,
        "unexplained by ours",
    )
    for c in study.settings.classes:
        names = (START, f"paper {c}", f"ours {c}", *shared)
        share = (study.norm(f"ours {c}", c) / study.measured_norm(c)) ** 2
        norms = (study.measured_norm(c), *(study.norm(name, c) for name in names))
        table.add_row(c, *(f"{norm:.3f}" for norm in norms), f"{share:.1%}")
    return table


def _cross(study: IdentificationStudy) -> Table:
    classes = study.settings.classes
    table = _table(
        "each set on every class: norm of the RMSE [m/s^2]", "set", *(f"on {c}" for c in classes)
    )
    for name in study.cars:
        table.add_row(name, *(f"{study.norm(name, c):.3f}" for c in classes))
    return table


def _readings(study: IdentificationStudy) -> Table:
    table = _table(
        f"the sets as a car at {READING_PRESSURE / 1e3:g} kPa: damping c at the suspension's rms "
        "velocity, over critical for body and wheel alone, and the modes",
        "set",
        "rms [m/s]",
        "c [Ns/m]",
        "body",
        "wheel",
        "ride [Hz]",
        "ratio",
        "hop [Hz]",
        "ratio",
    )
    for name, r in study.readings.items():
        numbers = (*r.ratio, *r.modes)
        table.add_row(
            name, f"{r.velocity_rms:.3f}", f"{r.damping:.0f}", *(f"{x:.2f}" for x in numbers)
        )
    for c in study.settings.classes:
        rms = study.readings[f"ours {c}"].velocity_rms
        damping = plant_damping_on(study, c)
        table.add_row(f"vehicle {c}", f"{rms:.3f}", f"{damping:.0f}", *[""] * 6)
    return table


def _table(title: str, *headings: str) -> Table:
    table = headed_table(*headings, title=escape(title))
    table.columns[0].no_wrap = True
    for column in table.columns[1:]:
        column.justify = "right"
    return table
