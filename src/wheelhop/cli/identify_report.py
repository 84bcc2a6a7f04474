"""What `identify` prints of an identification, and what it is worth."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from wheelhop.cli.identify_files import number, write_identification
from wheelhop.cli.session import console, escape, headed_table
from wheelhop.identification import Identification
from wheelhop.identification.parameters import value_of
from wheelhop.identification.replay import Replay
from wheelhop.identification.summary import (
    AnyIdentification,
    parameter_note,
    physical_reading,
    relative_errors,
    starts_at_best,
)

_COLOURED = 2.0
_WORSE = 1.01
_MOST_PERCENT = 1000


def report_identification(
    found: Identification, replays: Sequence[Replay], out: Path, made_by: dict[str, Any]
) -> None:
    """Print the tables and what they are worth; write vehicle, data, summary and figures.

    Args:
        found: the identification.
        replays: its records with start and fit beside them.
        out: directory to write to.
        made_by: what made it, for the summary and the vehicle.
    """
    readings = _readings(found, replays)
    for table in (parameter_table(found), _errors(found, replays), _physical(readings)):
        console.print(table)
    say_worth(found, _verdict(found))
    write_identification(found, replays, readings, out, made_by)


def say_worth(found: AnyIdentification, lines: Sequence[str]) -> None:
    """Print these lines, what the errors say, and the problems.

    Args:
        found: the identification.
        lines: what the fit is worth, in plain words.
    """
    for line in (*lines, *_worth_of_errors(found)):
        console.print(line, soft_wrap=True, markup=False, highlight=False)
    for problem in found.problems:
        console.print(f"[yellow]problem[/] {escape(problem)}", soft_wrap=True)


def parameter_table(found: AnyIdentification) -> Table:
    """The car's parameters: start, fit and errors.

    Narrow enough for 80 columns: names break at their dot, notes stand below the number.
    """
    known = found.uncertainty
    table = headed_table(
        "parameter",
        "unit",
        "start",
        "fit",
        "std. error",
        "robust error",
        "rel. error [%]",
        title="parameters",
    )
    for column in table.columns[:4]:
        column.no_wrap = True
    for column in table.columns[2:]:
        column.justify = "right"
    relative = relative_errors(found)
    for k, name in enumerate(found.space.names):
        share, note = percent(relative[k]), parameter_note(found, k)
        table.add_row(
            name.replace(".", ".\n"),
            found.space.units[k],
            number(float(value_of(found.start, name))),
            number(found.values[k]),
            number(known.standard_errors[k], 3),
            number(known.robust_errors[k], 3),
            "\n".join(part for part in (share, note) if part not in ("", "-")),
        )
    return table


def _errors(found: Identification, replays: Sequence[Replay]) -> Table:
    signals = ("a_s", "a_u")
    heads = [f"{signal} {what}" for signal in signals for what in ("rms", "start", "fit")]
    table = headed_table(
        "log",
        "kPa, km/h",
        *heads,
        title="measured rms, and rms errors of start and fit, m/s^2",
    )
    for column in table.columns[:2]:
        column.no_wrap = True
    for column in table.columns[1:]:
        column.justify = "right"
    for k, one in enumerate(replays):
        cells = [
            f"{values[k, c]:.2f}"
            for c in range(len(signals))
            for values in (found.measured_rms, found.start_rmse, found.rmse)
        ]
        kpa, kmh = _pressure(one) / 1e3, 3.6 * float(np.mean(one.record.v))
        table.add_row(one.name, f"{kpa:.0f}, {kmh:.0f}", *cells)
    return table


def _readings(found: Identification, replays: Sequence[Replay]) -> dict[str, Any]:
    """Physical meaning of start and fit at the middle of the logs' pressures."""
    pressure = float(np.median([_pressure(one) for one in replays]))
    velocities = {
        "start": [one.start_velocity[one.judged] for one in replays],
        "fit": [one.fit_velocity[one.judged] for one in replays],
    }
    cars = {"start": found.start, "fit": found.car}
    readings: dict[str, Any] = {"pressure_Pa": pressure}
    for which, car in cars.items():
        velocity = float(np.sqrt(np.mean(np.concatenate(velocities[which]) ** 2)))
        readings[which] = {
            "suspension_velocity_rms_m_per_s": velocity,
            **physical_reading(car, pressure, velocity),
        }
    return readings


def _physical(readings: dict[str, Any]) -> Table:
    title = f"what they mean, at {readings['pressure_Pa'] / 1e3:.0f} kPa"
    table = headed_table("quantity", "start", "fit", "unit", title=title)
    for column in table.columns[1:3]:
        column.justify = "right"
    for key, label, form, unit in (
        ("ride_frequency_Hz", "ride frequency", ".2f", "Hz"),
        ("ride_damping_ratio", "ride damping ratio", ".2f", "1"),
        ("wheel_hop_frequency_Hz", "wheel-hop frequency", ".2f", "Hz"),
        ("wheel_hop_damping_ratio", "wheel-hop damping ratio", ".2f", "1"),
        ("equivalent_damping_Ns_per_m", "damping, linear equivalent", ".0f", "Ns/m"),
        ("suspension_velocity_rms_m_per_s", "  at the suspension's rms velocity", ".3f", "m/s"),
        ("tire_stiffness_N_per_m", "tyre stiffness", ".0f", "N/m"),
    ):
        cells = [format(readings[which][key], form) for which in ("start", "fit")]
        table.add_row(label, *cells, unit)
    return table


def _verdict(found: Identification) -> list[str]:
    """What the fit is worth, in plain words."""
    descent = found.descent
    start = float(np.linalg.norm(found.start_rmse))
    seconds, simulations = descent.seconds[-1], int(descent.evaluations[-1])
    lines = [
        f"norm of all rms errors: {start:.4g} m/s^2 at the start, {found.loss:.4g} fitted; "
        f"{found.unexplained:.2%} of the mean square accelerations stay unexplained",
        f"{len(descent.seconds) - 1} iterations, {simulations} simulations of all logs in "
        f"{seconds:.1f} s, compiling included; {starts_at_best(found)} of {len(descent.loss)} "
        "starts ended at the best minimum",
    ]
    before, after = (np.linalg.norm(e, axis=0) for e in (found.start_rmse, found.rmse))
    for c, name in enumerate(("body", "wheel")):
        if after[c] > _WORSE * before[c]:
            lines.append(
                f"the {name} is followed worse than by the start ({before[c]:.3g} to "
                f"{after[c]:.3g} m/s^2): the larger errors, of the other one, decide"
            )
    return lines


def _worth_of_errors(found: AnyIdentification) -> list[str]:
    known, lines = found.uncertainty, []
    if known.directions:
        lines.append(f"least known combination: {known.directions[-1]}")
    with np.errstate(invalid="ignore"):
        ratio = known.robust_errors / known.standard_errors
    finite = ratio[np.isfinite(ratio)]
    if finite.size and finite.max() > _COLOURED:
        lines.append(
            f"robust errors are up to {finite.max():.1f} times the standard ones: what the fit "
            "leaves is no white noise, so trust the robust ones"
        )
    return lines


def percent(share: float) -> str:
    """A relative error in percent, to two digits."""
    value = 100.0 * share
    return f">{_MOST_PERCENT}" if value > _MOST_PERCENT else number(value, 2)


def _pressure(one: Replay) -> float:
    assert one.record.pressure is not None
    return float(np.nanmean(one.record.pressure))
