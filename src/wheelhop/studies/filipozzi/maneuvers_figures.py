"""Figures 5, 6 and 7 in the paper's layout, and what goes beyond, with the numbers behind them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from wheelhop.plots.load_maneuvers import (
    plot_load_amplitude,
    plot_load_delay,
    plot_load_errors,
    plot_load_maneuver,
    plot_load_sum,
)
from wheelhop.studies.filipozzi.drives import (
    BRAKE,
    LANE_CHANGE,
    LANE_CHANGE_BARRED,
    ROAD,
    SLOPE,
    SWEEP,
)
from wheelhop.studies.filipozzi.maneuvers import (
    ALGEBRAIC,
    JOINT,
    LONGEST_DELAY,
    METHODS,
    SETTLED,
    WORDS,
    Maneuvers,
    Score,
    scores,
)
from wheelhop.studies.filipozzi.maneuvers_measures import (
    body_frequency,
    delay_in_words,
    short,
    tilt_error,
    waves,
)
from wheelhop.studies.filipozzi.methods import DERIVATIVE, HALF_CAR, UNBIASED, YOULA
from wheelhop.studies.filipozzi.settings import GRADIENT
from wheelhop.studies.frame import StudyFigure
from wheelhop.vehicle.full_vehicle_parameters import CORNERS

_SHOWN = (YOULA, UNBIASED, ALGEBRAIC, JOINT)
_CORNERS = (0, 2)
_STRETCH = (3.0, 3.6)
"""Of the rough road [s], in which the delay can be seen."""


def maneuvers_figures(result: Maneuvers) -> Iterator[StudyFigure]:
    """In the order of the paper, then what goes beyond."""
    headlines = {
        "figure_5a": (BRAKE, "Braking"),
        "figure_5b": (LANE_CHANGE, "Double lane change"),
        "figure_6": (SWEEP, "Bounce sine sweep"),
        "figure_7": (SLOPE, f"{GRADIENT:.0%} slope"),
    }
    found = scores(result)
    for name, (drive, words) in headlines.items():
        number = name.removeprefix("figure_")
        yield _maneuver(
            result,
            drive,
            name,
            f"{words}: {_errors_in_words(found[drive], (YOULA, ALGEBRAIC, JOINT))}",
            _SHOWN,
            f"Fig. {number}, {short(drive)}: wheel loads FL and RL, their errors, and the "
            "uninitialised first 0.2 s enlarged (the joint filter begins with the vehicle in its "
            "place but without loads).",
        )
        if drive == SWEEP:
            yield _amplitudes(result)
    yield _maneuver(
        result,
        LANE_CHANGE_BARRED,
        "half_car",
        "Lane change with bars: "
        + _errors_in_words(found[LANE_CHANGE_BARRED], (YOULA, HALF_CAR, JOINT)),
        (YOULA, HALF_CAR, JOINT),
        "Double lane change with the SUV's anti-roll bars: Youla observers of four quarter cars "
        "and of two half cars, and the joint filter.",
    )
    yield _delay(result, found[ROAD])
    yield _errors(result)
    yield _sums(result)


def _maneuver(
    result: Maneuvers, name: str, file: str, title: str, methods: tuple[str, ...], caption: str
) -> StudyFigure:
    drive, loads = result.drives[name], {m: result.loads[name][m] for m in methods}
    columns: dict[str, Any] = {"time": drive.t}
    for k in _CORNERS:
        columns[f"true_{CORNERS[k]}"] = drive.load[:, k]
        columns |= {f"{_key(m)}_{CORNERS[k]}": load[:, k] for m, load in loads.items()}
        columns[f"road_{CORNERS[k]}"] = drive.elevation[:, k]
    units = {c: "m" if c.startswith("road") else "N" for c in columns} | {"time": "s"}
    road = drive.elevation if np.ptp(drive.elevation) > 0.0 else None
    figure = plot_load_maneuver(drive.t, drive.load, loads, title, corners=_CORNERS, road=road)
    return StudyFigure(file, figure, columns, units, caption)


def _amplitudes(result: Maneuvers) -> StudyFigure:
    drive, loads = result.drives[SWEEP], result.loads[SWEEP]
    true = waves(drive, drive.load, 0)
    found = {"true": true.load} | {m: waves(drive, loads[m], 0).load for m in _SHOWN}
    columns = {"time": true.time, "frequency": true.frequency, "road": true.road}
    columns |= {_key(m): values for m, values in found.items()}
    return StudyFigure(
        "sweep_amplitude",
        plot_load_amplitude(
            true.frequency,
            true.road,
            found,
            body_frequency(0),
            f"Front left, wave by wave: most load at {true.frequency[np.argmax(true.load)]:.2f} Hz",
        ),
        columns,
        {"time": "s", "frequency": "Hz", "road": "m"} | {_key(m): "N" for m in found},
        "Amplitude of the front left load in every wave of the sweep, and per amplitude of the "
        "road. The road's amplitude falls with its wavelength.",
    )


def _delay(result: Maneuvers, found: dict[str, Score]) -> StudyFigure:
    drive, loads = result.drives[ROAD], result.loads[ROAD]
    dt = float(drive.t[1] - drive.t[0])
    shifts = np.arange(round(LONGEST_DELAY / dt) + 1)
    chosen = {m: loads[m] for m in (YOULA, UNBIASED, DERIVATIVE, JOINT)}
    late = drive.t >= SETTLED
    errors = {
        m: np.array([_shifted_error(drive.load, load, late, int(k)) for k in shifts])
        for m, load in chosen.items()
    }
    part = (drive.t >= _STRETCH[0]) & (drive.t < _STRETCH[1])
    return StudyFigure(
        "wheel_hop_delay",
        plot_load_delay(
            drive.t[part],
            drive.load[part],
            {m: load[part] for m, load in chosen.items()},
            shifts * dt,
            errors,
            "Class C road at 80 km/h: the estimates come late by "
            + ", ".join(f"{delay_in_words(found[m])} ms ({m})" for m in (YOULA, UNBIASED, JOINT)),
        ),
        {"shift": shifts * dt} | {_key(m): e for m, e in errors.items()},
        {"shift": "s"} | {_key(m): "N" for m in errors},
        "Load of the front left wheel on a class C road, and the rms error of all four as the "
        f"estimates are moved ahead in time; observers of {result.settings.bandwidth:g} Hz.",
    )


def _shifted_error(truth: np.ndarray, load: np.ndarray, late: np.ndarray, k: int) -> float:
    end = len(truth) - k
    off = (load[k:] - truth[:end])[late[:end]]
    return float(np.sqrt(np.nanmean(off**2)))


def _errors(result: Maneuvers) -> StudyFigure:
    found = scores(result)
    rmse = {WORDS[n]: {m: s.rmse for m, s in by.items()} for n, by in found.items()}
    change = {WORDS[n]: next(iter(by.values())).change for n, by in found.items()}
    columns: dict[str, Any] = {
        "drive": [n for n in found for _ in METHODS],
        "method": [m for _ in found for m in METHODS],
        "rms_error": [found[n][m].rmse for n in found for m in METHODS],
        "change": [found[n][m].change for n in found for m in METHODS],
    }
    ordered = {d: {m: by[m] for m in METHODS} for d, by in rmse.items()}
    return StudyFigure(
        "maneuver_errors",
        plot_load_errors(ordered, change, "Rms error of a wheel's load [N], by method and drive"),
        columns,
        {"rms_error": "N", "change": "N"},
        "Rms error of a wheel's load by method and drive, in brackets the rms of the load's own "
        "change; the colour is the one per the other.",
    )


def _sums(result: Maneuvers) -> StudyFigure:
    curves, columns = {}, {}
    for name in (BRAKE, LANE_CHANGE):
        drive = result.drives[name]
        # without the start, which is not settled, and the end, which a delay leaves open
        part = (drive.t >= SETTLED) & (drive.t < drive.t[-1] - 0.05)
        error = (result.loads[name][YOULA] - drive.load).sum(1)
        curves[WORDS[name]] = (drive.t[part], error[part], tilt_error(drive)[part])
    longest = max(len(t) for t, _, _ in curves.values())
    for name, entries in zip((BRAKE, LANE_CHANGE), curves.values(), strict=True):
        for what, values in zip(("time", "error", "computed"), entries, strict=True):
            gap = np.full(longest - len(values), np.nan)
            columns[f"{name}_{what}"] = np.concatenate([values, gap])
    units = {c: "s" if c.endswith("time") else "N" for c in columns}
    return StudyFigure(
        "lean",
        plot_load_sum(curves, "Brake and cornering forces along the leaning body's axis"),
        columns,
        units,
        "Error of the sum of the four loads by the Youla observer, and m (a_x sin(pitch) - a_y "
        "sin(roll)) + m g (1 - cos cos) computed from the drive.",
    )


def _errors_in_words(found: dict[str, Score], methods: tuple[str, ...]) -> str:
    return "rms error " + ", ".join(f"{found[m].rmse:.0f} N ({m})" for m in methods)


def _key(name: str) -> str:
    return name.replace(",", "").replace(" ", "_")
