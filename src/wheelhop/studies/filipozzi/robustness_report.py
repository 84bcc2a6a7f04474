"""Chapter on wrong springs and dampers: words, tables, Fig. 8 and 9 and numbers."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.io.report import DataTable
from wheelhop.plots.load_robustness import (
    LoadPair,
    plot_damping_robustness,
    plot_stiffness_robustness,
)
from wheelhop.studies.filipozzi.drives import (
    BRAKE_DAMPING,
    BRAKE_DIGRESSIVE,
    BRAKE_STIFFNESS,
    Drive,
)
from wheelhop.studies.filipozzi.maneuvers import JOINT
from wheelhop.studies.filipozzi.methods import YOULA
from wheelhop.studies.filipozzi.robustness import FREE, METHODS, REST, Robustness, transfer
from wheelhop.studies.filipozzi.robustness_claims import robustness_findings
from wheelhop.studies.filipozzi.robustness_measures import (
    LINEAR_JOINT,
    apart,
    axis_error,
    damping_swing,
    damping_transfer,
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
from wheelhop.studies.frame import StudyFigure
from wheelhop.vehicle.strut import damper_force

__all__ = [
    "robustness_figures",
    "robustness_findings",
    "robustness_in_words",
    "robustness_numbers",
    "robustness_tables",
]

_SPEEDS = np.linspace(-0.5, 0.5, 201)

_SETTLED = 0.5


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
    rows += [(REST, f, JOINT) for f in FACTORS]
    found += [joint_transfer(result, f) for f in FACTORS]
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
        f"'{JOINT}' believes in the whole vehicle with the springs x 1."
    )
    return DataTable("Springs of another stiffness than believed", columns, note)


def _dampers(result: Robustness) -> DataTable:
    rows: list[tuple[str, str, Drive, np.ndarray]] = [
        (f"linear, x {f:g}", m, result.drives[BRAKE_DAMPING[f]], result.damping[f][m])
        for f in FACTORS
        for m in METHODS
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


def robustness_figures(result: Robustness) -> Iterator[StudyFigure]:
    """Fig. 8 and 9."""
    yield stiffness_figure(result)
    yield damping_figure(result)


def stiffness_figure(result: Robustness) -> StudyFigure:
    """The paper's figure, the same with deflections counted from rest, and the joint filter."""
    time = result.drives[BRAKE_STIFFNESS[1.0]].t
    panels: dict[str, dict[str, LoadPair]] = {}
    columns: dict[str, np.ndarray] = {"time": time}
    youla = {
        counted: {f: stiffness_transfer(result, counted, f, YOULA) for f in FACTORS}
        for counted in (FREE, REST)
    }
    shown = [
        (
            f"Youla observer, deflection counted {counted}",
            counted.split()[-1],
            youla[counted],
            {f: result.stiffness[counted][f][YOULA] for f in FACTORS},
        )
        for counted in (FREE, REST)
    ]
    shown.append(
        (
            f"joint filter, deflection counted {REST}",
            "joint",
            {f: joint_transfer(result, f) for f in FACTORS},
            {f: result.joint[f].load for f in FACTORS},
        )
    )
    for words, key, moved, loads in shown:
        listed = ", ".join(f"{moved[f].estimated:.0f}" for f in FACTORS)
        pairs = panels[f"{words}: {listed} N moved"] = {}
        for factor in FACTORS:
            true, estimated = result.drives[BRAKE_STIFFNESS[factor]].load[:, 0], loads[factor][:, 0]
            name = f"springs x {factor:g}: {moved[factor].true:.0f} N truly moved"
            pairs[name] = LoadPair(true, estimated)
            columns[f"true_x{factor:g}"] = true
            columns[f"{key}_x{factor:g}"] = estimated
    per_true = ", ".join(f"{one.estimated / one.true:.2f}" for one in youla[FREE].values())
    return StudyFigure(
        "figure_8",
        plot_stiffness_robustness(
            time,
            panels,
            BRAKE_BEGIN,
            (_SETTLED, float(time[-1])),
            f"Springs of another stiffness than believed: Youla finds {per_true} of the transfer",
        ),
        columns,
        {name: "s" if name == "time" else "N" for name in columns},
        "Fig. 8: front left load while braking, plant's springs x 0.5, 1 and 1.5 of those "
        "believed; Youla observer, from which the unbiased filter differs by "
        f"{apart(result)[0]:.1f} N rms at most. Below, not in the paper: the same with a sensor "
        "that is zeroed at rest, and the joint filter with that sensor.",
    )


def damping_figure(result: Robustness) -> StudyFigure:
    """Loads with wrong and nonlinear dampers, and the maps."""
    time, nonlinear = result.drives[BRAKE_DIGRESSIVE].t, result.drives[BRAKE_DIGRESSIVE]
    pairs = {
        f"dampers x {f:g}": LoadPair(
            result.drives[BRAKE_DAMPING[f]].load[:, 0], result.damping[f][YOULA][:, 0]
        )
        for f in FACTORS
    }
    transient = ", ".join(f"{damping_swing(result, f, YOULA):.0f}" for f in FACTORS)
    settled = ", ".join(f"{damping_transfer(result, f, YOULA).steady:.0f}" for f in FACTORS)
    shown = {
        "Youla observer, linear damper": YOULA,
        "joint filter that knows the damper": JOINT,
    }
    estimates = {name: result.digressive[method][:, 0] for name, method in shown.items()}
    true = nonlinear.load[:, 0]
    columns = {"time": time, "nonlinear_true": true}
    for factor, pair in zip(FACTORS, pairs.values(), strict=True):
        columns[f"true_x{factor:g}"], columns[f"youla_x{factor:g}"] = pair
    for method, load in result.digressive.items():
        columns[f"nonlinear_{method.replace(', ', '_').replace(' ', '_')}"] = load[:, 0]
    return StudyFigure(
        "figure_9",
        plot_damping_robustness(
            time,
            pairs,
            true,
            estimates,
            _SPEEDS,
            damper_maps(result),
            BRAKE_BEGIN,
            (BRAKE_BEGIN - 0.25, BRAKE_BEGIN + 1.75),
            f"Dampers of another strength than believed: {transient} N off in the transient, "
            f"{settled} N in the steady state",
        ),
        columns,
        {name: "s" if name == "time" else "N" for name in columns},
        "Fig. 9: front left load while braking with linear dampers x 0.5, 1 and 1.5 of those "
        "believed and with nonlinear ones, and the maps of both; positive speed compresses. "
        "The joint filter is not in the paper.",
    )


def damper_maps(result: Robustness) -> dict[str, np.ndarray]:
    """Forces of the front left dampers at compression speeds of -0.5 to 0.5 m/s [N]."""
    speeds = jnp.asarray(np.broadcast_to(_SPEEDS[:, None], (len(_SPEEDS), 4)))
    force = jax.vmap(lambda w: damper_force(w, result.plant.strut))(speeds)
    believed = float(result.linear.damping[0])
    return {"nonlinear": np.asarray(force, float)[:, 0], "linear, believed": believed * _SPEEDS}


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
            | dict(zip(("rmse", "stated", "nis_per_freedom"), joint_rms(result, f), strict=True))
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
