"""Fig. 8 and 9 of Filipozzi et al. 2021: loads with wrong springs and dampers."""

from __future__ import annotations

from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.plots.load_robustness import (
    LoadPair,
    plot_damping_robustness,
    plot_stiffness_robustness,
)
from wheelhop.studies.filipozzi.drives import BRAKE_DAMPING, BRAKE_DIGRESSIVE, BRAKE_STIFFNESS
from wheelhop.studies.filipozzi.maneuvers import JOINT
from wheelhop.studies.filipozzi.methods import YOULA
from wheelhop.studies.filipozzi.robustness import FITTED, FREE, REST, Robustness
from wheelhop.studies.filipozzi.robustness_measures import (
    apart,
    damping_swing,
    damping_transfer,
    fitted_transfer,
    joint_transfer,
    stiffness_transfer,
)
from wheelhop.studies.filipozzi.settings import BRAKE_BEGIN, FACTORS
from wheelhop.studies.frame import StudyFigure
from wheelhop.vehicle.strut import damper_force

_SPEEDS = np.linspace(-0.5, 0.5, 201)

_SETTLED = 0.5


def robustness_figures(result: Robustness) -> Iterator[StudyFigure]:
    """Fig. 8 and 9."""
    yield stiffness_figure(result)
    yield damping_figure(result)


def stiffness_figure(result: Robustness) -> StudyFigure:
    """The paper's figure, the same with deflections counted from rest, and the joint filters."""
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
    shown.append(
        (
            f"{FITTED}, deflection counted {REST}",
            "fitted",
            {f: fitted_transfer(result, f) for f in FACTORS},
            {f: result.fitted[f].load for f in FACTORS},
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
        "that is zeroed at rest, the joint filter with that sensor, and the joint filter that is "
        "told a_x and a_y and finds how stiff the springs are.",
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
