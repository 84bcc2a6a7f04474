"""What the study must show on the full vehicle, against what it measured."""

from __future__ import annotations

from typing import Any

import numpy as np

from wheelhop.io.report import OPEN, DataTable, Finding
from wheelhop.studies.frame import verdict_of
from wheelhop.studies.stiffness.budget import Budget, band_bound, error_budget
from wheelhop.studies.stiffness.frame import StiffnessSettings
from wheelhop.studies.stiffness.full_vehicle import (
    IDENTIFIED,
    VehicleStudy,
    corners,
    pressure_error,
)
from wheelhop.studies.stiffness.vehicle_cases import BLOCK, COURSE, DISTURBANCES, LIDAR, SYNTHETIC
from wheelhop.studies.stiffness.vehicle_estimators import BARE, MAIN, ROWS

LIMIT = 0.05
"""Largest relative error of a pressure."""

_WHY = {
    SYNTHETIC: "Front and rear wheel roll in one track, so that a car sees two roads and not four",
    LIDAR: "Both sides roll over the one measured track, so that a car sees one road",
    BLOCK: "Ten metres were measured and are driven there and back: however long the drive, it "
    "holds no more road, and the dampers leave the linear range",
    COURSE: "Both sides roll over one track which throws the wheels against their stops",
}
CALIBRATED = 3
"""Stretches of road of the calibration."""

_TRACKS = {SYNTHETIC: 2, LIDAR: 1, BLOCK: 2, COURSE: 1}


def vehicle_in_words(settings: StiffnessSettings) -> tuple[str, ...]:
    """What was done."""
    return (
        "The truth is the vehicle of fourteen degrees of freedom with contact patches that average "
        "the road. A front and a rear corner are identified from four drives over known roads of "
        "classes A to C; the estimator is calibrated on three stretches of a class B road at 230 "
        "kPa, and tried on roads of levels between the classes and of other waviness, and on "
        f"measured roads, {min(60.0, settings.longest):g} s each, every tyre at a pressure of its "
        "own.",
        "The estimator is recursive maximum likelihood over the four wheels' accelerations below "
        "30 Hz, averaged over 16 ms; the body's are not used. Road level, waviness and a factor on "
        "the dampers are common to the four corners and estimated too; the contact patch is a "
        "low-pass. Left out step by step, this tells what model error does.",
    )


def final_error(study: VehicleStudy, row: str = MAIN) -> np.ndarray:
    """Relative error of the pressure at the end, [cases, 4]."""
    return errors_over_time(study, row)[:, -1]


def errors_over_time(study: VehicleStudy, row: str = MAIN) -> np.ndarray:
    """Relative error of the pressure, [cases, time, 4]."""
    return pressure_error(study.estimates[row].theta[..., :4], study.pressure[:, None])


def rows_of(study: VehicleStudy, kind: str) -> list[int]:
    """Cases of one kind."""
    return [k for k, case in enumerate(study.cases) if case.kind == kind]


def budget_of(study: VehicleStudy) -> Budget:
    """The error budget with the calibration of the estimator."""
    return error_budget(study, study.offset[MAIN])


def vehicle_findings(study: VehicleStudy) -> list[Finding]:
    """Claims on roads and on disturbances."""
    found = [_on_roads(study, kind) for kind in (SYNTHETIC, LIDAR, BLOCK, COURSE)]
    return [*found, _on_disturbances(study)]


def _on_roads(study: VehicleStudy, kind: str) -> Finding:
    where, last = "full vehicle", float(study.time[-1])
    claim = f"{kind}: error of every tyre's pressure below 5 % after {last:g} s"
    rows = rows_of(study, kind)
    if not rows:
        why = "Set WHEELHOP_DATA to the directory of measured roads."
        return Finding(where, claim, "the measured road was not found", OPEN, why)
    error = final_error(study)[rows]
    inside = np.abs(error) < LIMIT
    plain = final_error(study, BARE)[rows]
    about = error - error.mean(axis=1, keepdims=True)
    cars, seen = corners(study.values), min(last, _seen(study, rows))
    best = band_bound(cars, seen, _TRACKS[kind])
    own = band_bound(cars, CALIBRATED * last, 2)
    return Finding(
        where,
        claim,
        f"rms {100 * _rms(error):.1f} %, largest {100 * np.abs(error).max():.0f} %, "
        f"{int(inside.sum())} of {inside.size} tyres within 5 %; about the mean of each car's four "
        f"rms {100 * _rms(about):.1f} %",
        verdict_of(inside.ravel().tolist()),
        f"{_WHY[kind]}. For reference, the bound for {seen:.3g} s between 2 and 31 Hz on a class B "
        f"road, {_TRACKS[kind]} track"
        f"{'s' if _TRACKS[kind] > 1 else ''} of unknown level and waviness is "
        f"{100 * best:.1f} %, with that of the calibration {100 * np.hypot(best, own):.1f} % "
        "(standard deviations), for wheels that are taken one by one. The estimator for quarter "
        f"cars, calibrated alike: rms {100 * _rms(plain):.0f} %.",
    )


def _seen(study: VehicleStudy, rows: list[int]) -> float:
    """Shortest time [s] after which a road of these cases repeats itself."""
    drives = [study.cases[k].drive for k in rows]
    return min(
        (d.road.tracks[0].length / d.speed for d in drives if d.road.tracks is not None),
        default=float("inf"),
    )


def _on_disturbances(study: VehicleStudy) -> Finding:
    budget = budget_of(study)
    # the first is as identified; the stiffening tyre has a figure of its own
    known = [k for k, name in enumerate(budget.names) if k > 0 and "stiffens" not in name]
    largest = np.abs(budget.before).max(axis=1)
    worst = max(known, key=lambda k: float(largest[k]))
    return Finding(
        "full vehicle",
        "load and dampers 20 % off, speed 1 % off, sensor noise doubled or a road that the contact "
        "patch does not average move the pressure by less than 5 % each",
        "; ".join(
            f"{budget.names[k]}: mean {100 * budget.before[k].mean():+.1f} %, largest of a tyre "
            f"{100 * largest[k]:.1f} %"
            for k in known
        ),
        verdict_of([bool(largest[k] < LIMIT) for k in known]),
        f"Every tyre is judged, on one road; most moves: {budget.names[worst]}. A tyre that "
        "stiffens with load and speed, to which no correction was applied, moves it by "
        f"{100 * _stiffening(budget.before):+.1f} %, and by "
        f"{100 * _stiffening(budget.with_it):+.1f} % where it was there at the calibration.",
    )


def _stiffening(moves: np.ndarray) -> float:
    return float(moves[len(DISTURBANCES) - 1].mean())


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def vehicle_tables(study: VehicleStudy) -> list[DataTable]:
    """Every drive, the identified corners and the budget."""
    columns: dict[str, list[Any]] = {"drive": [c.name for c in study.cases]}
    for k, wheel in enumerate(("FL", "FR", "RL", "RR")):
        columns[f"{wheel} [%]"] = [f"{100 * e:+.1f}" for e in final_error(study)[:, k]]
    theta = study.estimates[MAIN].theta[:, -1]
    columns["stated sd of ln k_t [%]"] = [
        f"{100 * np.sqrt(c[0, 0]):.1f}" for c in study.estimates[MAIN].cov[:, -1]
    ]
    columns["waviness found"] = [f"{2.0 + w:.2f}" for w in theta[:, 5]]
    columns["dampers found"] = [f"{np.exp(c):.2f}" for c in theta[:, 6]]
    for row in list(ROWS)[:-1]:
        columns[f"{row} [%]"] = [f"{100 * e:+.0f}" for e in final_error(study, row).mean(axis=1)]
    tried = DataTable(
        "Error of the pressure at the end of every drive",
        columns,
        "The last columns, means of the four tyres, leave out what the later ones add. The stated "
        "deviation takes the four wheels' roads as independent.",
    )
    corner = DataTable(
        "Corners identified on other roads",
        {
            "parameter": list(IDENTIFIED),
            "front": [f"{v:.4g}" for v in study.values[0]],
            "rear": [f"{v:.4g}" for v in study.values[1]],
        },
    )
    budget = budget_of(study)
    moved = DataTable(
        "What moves the pressure on a class B road of waviness 2.3, 1 dB below its centre",
        {
            "disturbance": list(budget.names),
            "calibrated before it, or not at all [%]": _percent(budget.before),
            "it was there at the calibration [%]": _percent(budget.with_it),
            "error, not calibrated [%]": _percent(budget.plain),
            "error, calibrated before [%]": _percent(budget.calibrated),
        },
        "Mean of the four tyres and their range. The first two columns are relative to the "
        "undisturbed drive with the same road and sensor noise.",
    )
    return [tried, corner, moved]


def _percent(values: np.ndarray) -> list[str]:
    return [f"{100 * v.mean():+.1f} ({100 * v.min():+.1f} to {100 * v.max():+.1f})" for v in values]


def vehicle_numbers(study: VehicleStudy) -> dict[str, Any]:
    """Every figure of the full vehicle; relative errors, SI units."""
    last, cars = float(study.time[-1]), corners(study.values)
    wheels = ("FL", "FR", "RL", "RR")
    budget = budget_of(study)
    return {
        "corners": {
            axle: dict(zip(IDENTIFIED, values.tolist(), strict=True))
            for axle, values in zip(("front", "rear"), study.values, strict=True)
        },
        "unexplained": study.unexplained.tolist(),
        "error_at_the_end": {
            case.name: {
                row: dict(zip(wheels, final_error(study, row)[k].tolist(), strict=True))
                for row in ROWS
            }
            for k, case in enumerate(study.cases)
        },
        "bound": {f"{n} tracks": band_bound(cars, last, n) for n in (1, 2, 4)},
        "budget": {
            name: {
                "calibrated_before": budget.before[k].tolist(),
                "there_at_calibration": budget.with_it[k].tolist(),
                "error_without_calibration": budget.plain[k].tolist(),
                "error_with_calibration": budget.calibrated[k].tolist(),
            }
            for k, name in enumerate(budget.names)
        },
    }
