"""Figures 5, 6 and 7 of the paper, and what noise and a bias do, with the numbers behind them."""

from __future__ import annotations

from collections.abc import Iterator

import jax.numpy as jnp
import numpy as np

from wheelhop.plots.solmaz import plot_drift, plot_inputs, plot_selection, plot_tire_force
from wheelhop.studies.frame import StudyFigure
from wheelhop.studies.solmaz.paper import BIAS, BIASED, CLEAN, NOISY, OBSERVER, PRINTED, Paper
from wheelhop.studies.solmaz.paper_limits import drift_rate, static_loads
from wheelhop.studies.solmaz.settings import FAILED, ONSET, SPEED
from wheelhop.vehicle.lateral_tire import NOMINAL_TIRE, SOFT_TIRE, arctangent_force

_SLIPS = np.linspace(0.0, np.radians(10.0), 51)
_LOADS = np.linspace(0.0, 6e3, 121)


def paper_figures(result: Paper) -> Iterator[StudyFigure]:
    """In the order of the paper."""
    yield tire_figure()
    yield inputs_figure(result)
    yield selection_figure(result)
    yield drift_figure(result)


def tire_figure() -> StudyFigure:
    """Lateral force of a sound and of a soft tyre."""
    slip, load = (np.asarray(a) for a in np.meshgrid(_SLIPS, _LOADS))
    forces = {
        f"{name}: $k_1$ = {tire.k1:g}, $k_2$ = {tire.k2:g} N, $k_3$ = {tire.k3:g}": np.asarray(
            arctangent_force(jnp.asarray(slip, float), jnp.asarray(load, float), tire)
        )
        for name, tire in (("Sound tyre", NOMINAL_TIRE), ("Soft tyre", SOFT_TIRE))
    }
    sound, soft = forces.values()
    return StudyFigure(
        "figure_5",
        plot_tire_force(
            _SLIPS,
            _LOADS,
            forces,
            static_loads()[0],
            "A soft tyre pushes less, and gives out at a smaller load",
        ),
        {
            "slip_angle": slip.ravel(),
            "load": load.ravel(),
            "sound": sound.ravel(),
            "soft": soft.ravel(),
        },
        {"slip_angle": "rad", "load": "N", "sound": "N", "soft": "N"},
        "Fig. 5: lateral force over slip angle and load by Eq. 3; none beyond a load of k1 k2, "
        "where the printed bracket turns negative.",
    )


def inputs_figure(result: Paper) -> StudyFigure:
    """What drives the car."""
    speed = np.full(len(result.time), SPEED)
    return StudyFigure(
        "figure_6",
        plot_inputs(
            result.time, result.steer, speed, "A mild double lane change at 120 km/h, from 5 s on"
        ),
        {"time": result.time, "steer": result.steer, "speed": speed},
        {"time": "s", "steer": "rad", "speed": "m/s"},
        "Fig. 6: steering angle and speed. The paper's text gives no amplitude.",
    )


def selection_figure(result: Paper) -> StudyFigure:
    """The selection as printed, with perfect sensors."""
    track = result.tracks[PRINTED]
    number = track.selected[CLEAN] + 1
    columns = {
        "time": result.time,
        "lateral_acceleration": result.lateral_acceleration,
        "selected_lateral_acceleration": track.lateral_acceleration,
        "yaw_rate": result.yaw_rate,
        "selected_yaw_rate": track.yaw_rate,
        "selected": number,
    }
    columns |= {f"cost_{k + 1}": track.cost[:, k] for k in range(track.cost.shape[1])}
    units = {name: "m/s^2" for name in columns if name.endswith("acceleration")}
    units |= {"time": "s", "yaw_rate": "rad/s", "selected_yaw_rate": "rad/s"}
    return StudyFigure(
        "figure_7",
        plot_selection(
            result.time,
            (result.lateral_acceleration, result.yaw_rate),
            (track.lateral_acceleration, track.yaw_rate),
            number,
            track.cost,
            ONSET,
            "Which of 16 models fits: number 8, a soft front left tyre, as soon as the car turns",
        ),
        columns,
        units,
        "Fig. 7: signals of the car and of the model selected, its number, and the costs of all; "
        "equations as printed, sensors perfect.",
    )


def drift_figure(result: Paper) -> StudyFigure:
    """Noise and bias, which the paper leaves out."""
    names = (PRINTED, OBSERVER)
    tracks = {name: result.tracks[name] for name in names}
    right = {n: np.mean(t.selected[NOISY:] == FAILED, axis=0) for n, t in tracks.items()}
    error = {n: t.side_slip - result.side_slip for n, t in tracks.items()}
    drift = drift_rate(BIAS, SPEED) * result.time
    columns = {"time": result.time, "side_slip": result.side_slip, "expected_drift": drift}
    for name in names:
        key = name.replace(" ", "_")
        columns[f"right_{key}"] = right[name]
        columns[f"bias_error_{key}"] = error[name][BIASED]
        columns[f"noise_error_sd_{key}"] = np.std(error[name][NOISY:], axis=0)
    units = {name: "rad" for name in columns if not name.startswith(("time", "right"))}
    return StudyFigure(
        "noise_and_bias",
        plot_drift(
            result.time,
            right,
            result.side_slip,
            {n: e[NOISY:] for n, e in error.items()},
            {n: e[BIASED] for n, e in error.items()},
            drift,
            ONSET,
            "With noise the integrated side slip drifts away, and the right model with it",
        ),
        columns,
        units | {"time": "s"},
        f"Share of {result.settings.runs} noisy runs that name the soft tyre, and the error of the "
        f"side slip with noise and with a bias of {BIAS:g} m/s^2.",
    )
