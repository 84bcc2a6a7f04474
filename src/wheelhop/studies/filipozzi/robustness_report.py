"""Chapter on wrong springs and dampers: words, tables, Fig. 8 and 9 and numbers."""

from __future__ import annotations

from typing import Any

import numpy as np

from wheelhop.io.report import DataTable
from wheelhop.studies.filipozzi.drives import (
    BRAKE_DAMPING,
    BRAKE_DIGRESSIVE,
    BRAKE_STIFFNESS,
    Drive,
)
from wheelhop.studies.filipozzi.maneuvers import JOINT
from wheelhop.studies.filipozzi.robustness import (
    FITTED,
    FREE,
    METHODS,
    REST,
    JointBelief,
    Robustness,
    transfer,
)
from wheelhop.studies.filipozzi.robustness_measures import (
    LINEAR_JOINT,
    apart,
    axis_error,
    damping_transfer,
    fitted_transfer,
    joint_rms,
    joint_transfer,
    static_offset,
    stiffness_transfer,
    swing,
)
from wheelhop.studies.filipozzi.settings import (
    BRAKE_BEGIN,
    BRAKE_TORQUE,
    FACTORS,
    SPEED,
    FilipozziSettings,
)


def robustness_in_words(settings: FilipozziSettings) -> tuple[str, ...]:
    """What was done."""
    return (
        f"The braking of Fig. 5a, {BRAKE_TORQUE:g} Nm in all at {BRAKE_BEGIN:g} s from "
        f"{3.6 * SPEED:g} km/h, by vehicles whose springs or dampers are "
        + ", ".join(f"{factor:g}" for factor in FACTORS)
        + " times as stiff as the estimators believe, and by one with nonlinear dampers. Sensors "
        f"are perfect, the estimators' bandwidth is {settings.bandwidth:g} Hz at "
        f"{settings.rate:g} Hz.",
        "Other springs carry the same body at the same height; they differ in their free length "
        "alone. A sensor that counts from the free spring therefore shows another deflection at "
        "rest, which the estimator takes for another mass. Beside that, deflections are counted "
        "from rest.",
    )


def robustness_tables(result: Robustness) -> list[DataTable]:
    """Springs, and dampers."""
    return [_springs(result), _dampers(result)]


def _springs(result: Robustness) -> DataTable:
    rows = [(c, f, m) for c in (FREE, REST) for f in FACTORS for m in METHODS]
    found = [stiffness_transfer(result, *row) for row in rows]
    for method, moved in ((JOINT, joint_transfer), (FITTED, fitted_transfer)):
        rows += [(REST, f, method) for f in FACTORS]
        found += [moved(result, f) for f in FACTORS]
    columns: dict[str, list[Any]] = {
        "deflection counted": [counted for counted, _, _ in rows],
        "springs x": [f"{factor:g}" for _, factor, _ in rows],
        "estimator": [method for _, _, method in rows],
        "offset before braking [N]": [f"{round(one.offset) + 0}" for one in found],
        "true transfer [N]": [f"{one.true:.0f}" for one in found],
        "estimated transfer [N]": [f"{one.estimated:.0f}" for one in found],
        "estimated per true [-]": [f"{one.estimated / one.true:.3f}" for one in found],
        "rms error of the change, first second [N]": [f"{one.transient:.0f}" for one in found],
    }
    note = (
        "Front left wheel. Transfer: mean over the last half second less that before braking. "
        f"'{JOINT}' believes in the whole vehicle with the springs x 1, '{FITTED}' begins so and "
        "finds them."
    )
    return DataTable("Springs of another stiffness than believed", columns, note)


def _dampers(result: Robustness) -> DataTable:
    rows: list[tuple[str, str, Drive, np.ndarray]] = [
        (f"linear, x {f:g}", m, result.drives[BRAKE_DAMPING[f]], result.damping[f][m])
        for f in FACTORS
        for m in METHODS
    ]
    rows += [
        (f"linear, x {f:g}", FITTED, result.drives[BRAKE_DAMPING[f]], result.fitted_damping[f].load)
        for f in FACTORS
    ]
    nonlinear = result.drives[BRAKE_DIGRESSIVE]
    names = (*METHODS, LINEAR_JOINT, JOINT)
    rows += [("nonlinear", m, nonlinear, result.digressive[m]) for m in names]
    found = [transfer(drive, load) for _, _, drive, load in rows]
    columns: dict[str, list[Any]] = {
        "dampers": [damper for damper, *_ in rows],
        "estimator": [method for _, method, *_ in rows],
        "rms error while the brakes come on [N]": [
            f"{swing(drive, load):.0f}" for *_, drive, load in rows
        ],
        "steady error of the transfer [N]": [f"{one.steady:.1f}" for one in found],
        "true transfer [N]": [f"{one.true:.0f}" for one in found],
    }
    note = (
        "Front left wheel. While the brakes come on: the first second, about the steady error. "
        f"'{JOINT}' knows the nonlinear damper, '{LINEAR_JOINT}' believes in a linear one."
    )
    return DataTable("Dampers of another strength than believed", columns, note)


def robustness_numbers(result: Robustness) -> dict[str, Any]:
    """For results.json; SI units."""
    rms, largest = apart(result)
    nonlinear = result.drives[BRAKE_DIGRESSIVE]
    return {
        "stiffness": {
            counted: {
                f"{f:g}": {m: stiffness_transfer(result, counted, f, m)._asdict() for m in METHODS}
                for f in FACTORS
            }
            for counted in (FREE, REST)
        },
        "stiffness_joint": {
            f"{f:g}": joint_transfer(result, f)._asdict()
            | _quality(result.drives[BRAKE_STIFFNESS[f]], result.joint[f])
            for f in FACTORS
        },
        "stiffness_fitted": {
            f"{f:g}": fitted_transfer(result, f)._asdict()
            | _quality(result.drives[BRAKE_STIFFNESS[f]], result.fitted[f])
            for f in FACTORS
        },
        "damping_fitted": {
            f"{f:g}": {
                "swing": swing(result.drives[BRAKE_DAMPING[f]], result.fitted_damping[f].load),
                **_quality(result.drives[BRAKE_DAMPING[f]], result.fitted_damping[f]),
            }
            for f in FACTORS
        },
        "offset_computed": {f"{f:g}": static_offset(result, f) for f in FACTORS},
        "damping": {
            f"{f:g}": {
                m: {
                    **damping_transfer(result, f, m)._asdict(),
                    "swing": swing(result.drives[BRAKE_DAMPING[f]], result.damping[f][m]),
                }
                for m in METHODS
            }
            for f in FACTORS
        },
        "nonlinear_damper": {
            m: {**transfer(nonlinear, load)._asdict(), "swing": swing(nonlinear, load)}
            for m, load in result.digressive.items()
        },
        "axis_error": axis_error(result)._asdict(),
        "methods_apart": {"rms": rms, "largest": largest},
    }


def _quality(drive: Drive, one: JointBelief) -> dict[str, Any]:
    names = ("rmse", "stated", "nis_per_freedom")
    found: dict[str, Any] = dict(zip(names, joint_rms(drive, one), strict=True))
    found |= {"springs_scale": float(one.scale[0]), "dampers_scale": float(one.scale[1])}
    return found
