"""Tables of the maneuvers beside the paper's words, and their figures by name for results.json."""

from __future__ import annotations

from typing import Any

import numpy as np

from wheelhop.io.report import DataTable
from wheelhop.studies.filipozzi.drives import (
    BRAKE,
    BRAKE_BARRED,
    LANE_CHANGE,
    LANE_CHANGE_BARRED,
    ROAD,
    SLOPE,
    SWEEP,
)
from wheelhop.studies.filipozzi.maneuvers import (
    ALGEBRAIC,
    CLOSE,
    JOINT,
    METHODS,
    SETTLED,
    WORDS,
    Maneuvers,
    Score,
    scores,
    total_error,
)
from wheelhop.studies.filipozzi.maneuvers_measures import (
    body_frequency,
    delay_in_words,
    missed_body,
    static_part,
    steady,
    tilt_error,
    waves,
)
from wheelhop.studies.filipozzi.methods import UNBIASED, YOULA
from wheelhop.studies.filipozzi.settings import (
    BRAKE_TORQUE,
    GRADIENT,
    LANE_CHANGE_PEAK,
    SHORTEST_WAVE,
    SPEED,
    SWEEP_SPEED,
    FilipozziSettings,
)
from wheelhop.vehicle.full_vehicle_parameters import CORNERS

_OBSERVERS = {
    BRAKE: "better than algebraic; converges in about 0.1 s",
    LANE_CHANGE: "good",
    SWEEP: "reproduces the response of the suspension",
    SLOPE: "captures the transfer; good in the transient",
}
_SAYS = {
    ALGEBRAIC: {
        BRAKE: "steady-state error",
        LANE_CHANGE: "does not capture the transient",
        SWEEP: "not accurate",
    },
    YOULA: _OBSERVERS,
    UNBIASED: _OBSERVERS,
}


def maneuvers_in_words(settings: FilipozziSettings) -> tuple[str, ...]:
    """What was done."""
    return (
        "The paper's maneuvers with a vehicle of 14 degrees of freedom and sensors without noise, "
        f"at {settings.rate:g} Hz: {BRAKE_TORQUE:g} Nm of brake torque from {3.6 * SPEED:g} km/h, "
        f"a double lane change to {LANE_CHANGE_PEAK:.2f} m/s^2, a bounce sine sweep at "
        f"{3.6 * SWEEP_SPEED:g} km/h with waves down to {SHORTEST_WAVE:g} m, and a slope of "
        f"{GRADIENT:.0%}. The vehicle is our SUV with linear dampers and without anti-roll bars, "
        "as the paper prints no parameters; beyond the paper braking and the lane change with the "
        "SUV's bars, and a random road of class C.",
        f"The observers know the vehicle and pass loads up to {settings.bandwidth:g} Hz (-3 dB). "
        "Quarter cars (Youla, unbiased, derivative filters) and the half car begin uninitialised, "
        "with wheels that hang from free springs; the joint filter begins with a vehicle in its "
        f"place but without loads. Errors count from {SETTLED:g} s on.",
    )


def maneuvers_tables(result: Maneuvers) -> list[DataTable]:
    """The paper's drives, the others, the corners' steady errors, and errors of the sum."""
    found = scores(result)
    beyond = (LANE_CHANGE_BARRED, BRAKE_BARRED, ROAD)
    paper = tuple(n for n in WORDS if n not in beyond)
    return [
        _scores("Errors in the maneuvers of the paper", found, paper, True),
        _scores("Errors beyond the paper", found, beyond, False),
        _steady(result),
        _sums(result),
    ]


def _scores(
    title: str, found: dict[str, dict[str, Score]], names: tuple[str, ...], says: bool
) -> DataTable:
    rows = [(n, m, found[n][m]) for n in names for m in METHODS]
    columns: dict[str, list[Any]] = {
        "drive (load's own change)": [f"{WORDS[n]} ({s.change:.0f} N)" for n, _, s in rows],
        "method": [m for _, m, _ in rows],
        "rms error [N]": [f"{s.rmse:.0f}" for _, _, s in rows],
        "bias [N]": [_signed(s.bias) for _, _, s in rows],
        "delay [ms]": [delay_in_words(s) for _, _, s in rows],
        "aligned rms error [N]": [f"{s.aligned:.0f}" for _, _, s in rows],
        "converged [s]": [_time(m, s) for _, m, s in rows],
    }
    if says:
        columns["paper"] = [_SAYS.get(m, {}).get(n, "") for n, m, _ in rows]
    note = (
        f"Delay: shift ahead at which the estimate fits best; converged: last time in the calm "
        f"first second at which an error exceeded {CLOSE:.0%} of a load. A dash: has nothing "
        "to converge from, or is never calm."
    )
    return DataTable(title, columns, note)


def _time(method: str, score: Score) -> str | None:
    at_once = method == ALGEBRAIC
    return None if at_once or np.isnan(score.converged) else f"{score.converged:.3f}"


def _steady(result: Maneuvers) -> DataTable:
    rows = [(n, m) for n in (BRAKE, SLOPE) for m in (ALGEBRAIC, YOULA, UNBIASED, JOINT)]
    columns: dict[str, list[Any]] = {
        "drive": [WORDS[n] for n, _ in rows],
        "method": [m for _, m in rows],
    }
    errors = [steady(result, n, m) for n, m in rows]
    for k, corner in enumerate(CORNERS):
        columns[f"{corner} [N]"] = [_signed(e[k]) for e in errors]
    columns["sum [N]"] = [_signed(e.sum()) for e in errors]
    columns["computed from the lean [N]"] = [
        _signed(_lean(result, n)) if m in (YOULA, UNBIASED) else None for n, m in rows
    ]
    note = "Mean error over the last half second; the lean: m a_x sin(pitch) + m g (1 - cos)."
    return DataTable("Steady errors by corner", columns, note)


def _lean(result: Maneuvers, name: str) -> float:
    drive = result.drives[name]
    return float(tilt_error(drive)[drive.t >= drive.t[-1] - 0.5].mean())


def _sums(result: Maneuvers) -> DataTable:
    columns: dict[str, list[Any]] = {"rms error of the sum [N]": list(METHODS)}
    for name, words in WORDS.items():
        drive, loads = result.drives[name], result.loads[name]
        columns[words] = [f"{total_error(drive, loads[m]):.0f}" for m in METHODS]
    return DataTable("Error of the sum of the four loads", columns)


def maneuvers_numbers(result: Maneuvers) -> dict[str, Any]:
    """For results.json; SI units."""
    found = scores(result)
    content: dict[str, Any] = {}
    for name, methods in found.items():
        drive = result.drives[name]
        content[name] = {
            m: s._asdict()
            | {
                "sum_error": total_error(drive, result.loads[name][m]),
                "steady_by_corner": steady(result, name, m).tolist(),
            }
            for m, s in methods.items()
        }
        difference, aligned, left = missed_body(result, name)
        content[name]["derivative_less_youla"] = {
            "rms": difference,
            "aligned": aligned,
            "aligned_without_body_acceleration": left,
        }
        content[name]["lean_at_end"] = _lean(result, name)
    static, transient = static_part(
        result.drives[LANE_CHANGE], result.loads[LANE_CHANGE][ALGEBRAIC]
    )
    content["lane_change_algebraic"] = {"static": static, "transient": transient}
    sweep = result.drives[SWEEP]
    content["sweep_waves"] = {
        CORNERS[k]: {"body_frequency": body_frequency(k)}
        | {m: a.tolist() for m, a in waves(sweep, sweep.load, k)._asdict().items()}
        for k in (0, 2)
    }
    return content


def _signed(value: float) -> str:
    return f"{round(value) + 0:+d}" if round(value) else "0"
