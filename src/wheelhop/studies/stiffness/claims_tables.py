"""Tables of the stiffness study, and its figures by name for results.json."""

from __future__ import annotations

from typing import Any

import numpy as np

from wheelhop.io.report import DataTable
from wheelhop.studies.stiffness import continuous as lone
from wheelhop.studies.stiffness import several_wheels as four
from wheelhop.studies.stiffness.claims import (
    at_time,
    nees_over_time,
    percent,
    ratio_at,
    rms,
    wheel_errors,
    wheel_nees,
    wheel_stated,
)
from wheelhop.studies.stiffness.claims_classes import SETTLED, case_name
from wheelhop.studies.stiffness.continuous import Continuous
from wheelhop.studies.stiffness.exact_classes import CASES, CHANGE, ExactClasses, lag
from wheelhop.studies.stiffness.runs import at, reported
from wheelhop.studies.stiffness.several_wheels import SeveralWheels

CLASS_TIMES = (0.5, 1.0, 2.0, 5.0, 10.0)


def class_tables(result: ExactClasses) -> list[DataTable]:
    """Errors of the twelve cases beside their bounds."""
    late = result.time >= SETTLED - 1e-9
    columns: dict[str, list[Any]] = {"case": [case_name(c) for c in CASES]}
    for t in CLASS_TIMES:
        found = [at_time(e, result.time, t) for e in result.error]
        best = result.bound[:, at(result.time, t)] / 1e3
        columns[f"{t:g} s: rms [kPa] / bound"] = [
            f"{f.value / 1e3:.1f} ({f.low / 1e3:.1f} to {f.high / 1e3:.1f}) / {b:.1f}"
            for f, b in zip(found, best, strict=True)
        ]
    over_time = rms(result.error)[:, late]
    columns["largest rms from 2 s [kPa]"] = [f"{v / 1e3:.1f}" for v in over_time.max(axis=1)]
    largest = np.abs(result.error[:, :, late]).max(axis=(1, 2))
    columns["largest error of a run from 2 s [kPa]"] = [f"{v / 1e3:.0f}" for v in largest]
    note = (
        "In brackets the 95 % bootstrap interval. The bound is the posterior Cramer-Rao bound with "
        "the class known and the filter's prior, over the speeds of the runs."
    )
    return [DataTable("Pressure on exact classes, the class unknown", columns, note)]


def class_numbers(result: ExactClasses) -> dict[str, Any]:
    """Every figure of the exact classes; Pa, s."""
    late = result.time >= SETTLED - 1e-9
    cases = {}
    for case, error, best in zip(CASES, result.error, result.bound, strict=True):
        cases[case_name(case)] = {
            "rms": _at_times(error, result.time, CLASS_TIMES),
            "bound": {f"{t:g} s": best[at(result.time, t)] for t in CLASS_TIMES},
            "largest_rms_from_2_s": rms(error)[late].max(),
            "largest_error_from_2_s": np.abs(error[:, late]).max(),
        }
    shift, left = lag(result.time, result.leak_truth, result.leak, CHANGE)
    after = (CHANGE + 0.5, CHANGE + 1.0, CHANGE + 2.0, float(result.time[-1]))
    return {
        "cases": cases,
        "changes": {
            name: _at_times(error, result.time, (*CLASS_TIMES[:4], *after))
            for name, error in result.change_error.items()
        },
        "leak": {"lag_s": shift._asdict(), "rms_left_Pa": left},
    }


def continuous_tables(result: Continuous) -> list[DataTable]:
    """Every row's error over the bound, and NEES."""
    shown = reported(float(result.time[-1]), lone.REPORTED)
    columns: dict[str, list[Any]] = {"filter": [*result.tracks, "Cramer-Rao bound"]}
    for t in shown:
        k = at(result.time, t)
        entries = []
        for track in result.tracks.values():
            f = ratio_at(result, track, t)
            error = at_time(track.error, result.time, t)
            entries.append(
                f"{100 * error.value:.2f} %, {f.value:.2f} ({f.low:.2f} to {f.high:.2f}), "
                f"NEES {nees_over_time(track)[k]:.3g}"
            )
        columns[f"{t:g} s"] = [*entries, f"{100 * result.bound[k]:.2f} %"]
    note = " ".join(f"{name}: {row.words}." for name, row in lone.ROWS.items())
    title = "Error of ln k_t: rms, over its bound (95 % interval), NEES"
    return [DataTable(title, columns, note)]


def continuous_numbers(result: Continuous) -> dict[str, Any]:
    """Every figure of the continuous roughness; ln k_t, no unit."""
    shown = reported(float(result.time[-1]), lone.REPORTED)
    return {
        "bound": {f"{t:g} s": result.bound[at(result.time, t)] for t in shown},
        "filters": {
            name: {
                "rms": _at_times(track.error, result.time, shown),
                "over_bound": {f"{t:g} s": ratio_at(result, track, t)._asdict() for t in shown},
                "bias": {f"{t:g} s": track.error[:, at(result.time, t)].mean() for t in shown},
                "nees": {f"{t:g} s": nees_over_time(track)[at(result.time, t)] for t in shown},
            }
            for name, track in result.tracks.items()
        },
    }


def wheels_tables(result: SeveralWheels) -> list[DataTable]:
    """Errors of one wheel and of differences beside their bounds."""
    shown = reported(float(result.time[-1]), four.REPORTED)
    columns: dict[str, list[Any]] = {"what": [*four.COMBINATIONS, "NEES / 4"]}
    for t in shown:
        k = at(result.time, t)
        entries = []
        for name in four.COMBINATIONS:
            found = at_time(wheel_errors(result, name), result.time, t)
            entries.append(
                f"{percent(found)}, stated {100 * wheel_stated(result, name)[k]:.2f} %, bound "
                f"{100 * result.bound[name][k]:.2f} %"
            )
        columns[f"{t:g} s"] = [*entries, f"{wheel_nees(result)[k] / 4:.2f}"]
    return [DataTable("Errors of the four ln k_t", columns)]


def wheels_numbers(result: SeveralWheels) -> dict[str, Any]:
    """Every figure of the four corners; ln k_t, no unit."""
    shown = reported(float(result.time[-1]), four.REPORTED)
    found: dict[str, Any] = {
        name: {
            "rms": _at_times(wheel_errors(result, name), result.time, shown),
            "bound": {f"{t:g} s": result.bound[name][at(result.time, t)] for t in shown},
        }
        for name in four.COMBINATIONS
    }
    found["nees"] = {f"{t:g} s": wheel_nees(result)[at(result.time, t)] for t in shown}
    return found


def _at_times(error: np.ndarray, time: np.ndarray, wanted: tuple[float, ...]) -> dict[str, Any]:
    return {f"{t:g} s": at_time(error, time, t)._asdict() for t in wanted}
