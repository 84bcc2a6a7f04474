"""Figures of Solmaz's paper on soft tyres in a corner: his Fig. 5, 6 and 7, and what noise does."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator

from wheelhop.plots.panels import legend_below, panel_grid
from wheelhop.plots.style import ALERT, BAND, ESTIMATE, MUTED, TRUTH, legend, new_figure

MODEL_COLOURS = {"as printed": ALERT, "observer": ESTIMATE}
_FALLBACK = "#2e7d32"


def plot_tire_force(
    slip: np.ndarray,
    load: np.ndarray,
    forces: Mapping[str, np.ndarray],
    static_load: float,
    title: str = "",
) -> Figure:
    """Lateral force over slip angle and over load, a column for each tyre, as his Fig. 5.

    Args:
        slip: slip angles [rad], [slips].
        load: loads [N], [loads].
        forces: of each tyre by name [N], [loads, slips].
        static_load: of a front wheel at rest [N], marked.
        title: headline of the figure.
    """
    figure, axes = panel_grid(2, len(forces), height=2.7, sharey=True)
    colours = matplotlib.colormaps["viridis"]
    shown_loads = _spread(load[1:], 6)
    shown_slips = _spread(slip[1:], 5)
    for (upper, lower), (name, force) in zip(axes.T, forces.items(), strict=True):
        for k, f in enumerate(shown_loads):
            at = int(np.argmin(np.abs(load - f)))
            colour = colours(0.9 * k / (len(shown_loads) - 1))
            upper.plot(np.degrees(slip), force[at] / 1e3, color=colour, label=f"{f / 1e3:.3g}")
        for k, a in enumerate(shown_slips):
            at = int(np.argmin(np.abs(slip - a)))
            colour = colours(0.9 * k / (len(shown_slips) - 1))
            label = f"{np.degrees(a):.2g}"
            lower.plot(load / 1e3, force[:, at] / 1e3, color=colour, label=label)
        lower.axvline(static_load / 1e3, color=MUTED, linestyle=":", linewidth=1.2)
        lower.annotate(
            "front wheel at rest",
            (static_load / 1e3, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(4, -10),
            textcoords="offset points",
            fontsize=8,
            color=MUTED,
        )
        upper.set_title(name, loc="left", fontsize=10)
        upper.set_xlabel("slip angle [°]")
        lower.set_xlabel("load [kN]")
        upper.margins(x=0)
        lower.margins(x=0)
    for ax, what in ((axes[0, -1], "load [kN]"), (axes[1, -1], "slip angle [°]")):
        ax.legend(
            title=what, fontsize=8, title_fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5)
        )
    for ax in axes[:, 0]:
        ax.set_ylabel("lateral force [kN]")
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    return figure


def plot_inputs(time: np.ndarray, steer: np.ndarray, speed: np.ndarray, title: str = "") -> Figure:
    """Angle of the front wheels and speed over time, as his Fig. 6.

    Args:
        time: [s], [time].
        steer: [rad], [time].
        speed: [m/s], [time].
        title: headline of the figure.
    """
    figure, (top, bottom) = new_figure(2, height=2.2, sharex=True)
    top.plot(time, np.degrees(steer), color=ESTIMATE, linewidth=1.5)
    top.set_ylabel("steering angle\nof the wheels [°]")
    bottom.plot(time, 3.6 * speed, color=ESTIMATE, linewidth=1.5)
    bottom.set(ylim=(0.0, 1.25 * 3.6 * float(speed.max())), xlabel="time [s]")
    bottom.set_ylabel("speed [km/h]")
    bottom.margins(x=0)
    top.set_title(title, loc="left", fontsize=11)
    return figure


def plot_selection(
    time: np.ndarray,
    measured: Sequence[np.ndarray],
    estimated: Sequence[np.ndarray],
    selected: np.ndarray,
    cost: np.ndarray,
    onset: float,
    title: str = "",
) -> Figure:
    """Signals of the model selected, its number, and the costs of all, as his Fig. 7.

    Args:
        time: [s], [time].
        measured: lateral acceleration [m/s^2] and yaw rate [rad/s], two of [time].
        estimated: the same of the model selected.
        selected: number of the model, from 1, [time].
        cost: of the models, [time, models].
        onset: of the steering [s], marked.
        title: headline of the figure.
    """
    figure, axes = panel_grid(2, 2, height=2.6, sharex=True)
    labels = ("lateral acceleration [m/s²]", "yaw rate [°/s]")
    scales = (1.0, np.degrees(1.0))
    for ax, true, found, label, scale in zip(
        axes[0], measured, estimated, labels, scales, strict=True
    ):
        ax.plot(time, scale * true, color=TRUTH, linewidth=2.4, alpha=0.35, label="measured")
        ax.plot(time, scale * found, color=ESTIMATE, linewidth=1.1, label="selected model")
        ax.set_ylabel(label)
    ax = axes[1, 0]
    number_axis(ax, cost.shape[1])
    ax.plot(time, selected, color=ALERT, linewidth=1.6, drawstyle="steps-post")
    last = int(selected[-1])
    others = np.flatnonzero(selected != last)
    since = time[others[-1] + 1] if others.size else time[0]
    ax.annotate(
        f"model {last} from {since:.2f} s on",
        (time[-1], last),
        xytext=(-4, 5),
        textcoords="offset points",
        ha="right",
        fontsize=9,
        color=ALERT,
    )
    ax = axes[1, 1]
    ax.plot(time, cost, color=MUTED, linewidth=0.8, alpha=0.7)
    ax.plot([], [], color=MUTED, linewidth=0.8, label="costs of all models")
    chosen = cost[np.arange(len(time)), selected - 1]
    ax.plot(time, chosen, color=ALERT, linewidth=2.0, label="cost of the model selected")
    ax.set_ylabel("cost J [-]")
    for ax in axes.flat:
        ax.axvline(onset, color=TRUTH, linestyle=":", linewidth=0.8, label="steering begins")
        ax.margins(x=0)
    for ax in axes[1]:
        ax.set_xlabel("time [s]")
    legend_below(figure, axes.flat, 5)
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    return figure


def number_axis(ax: Any, models: int) -> None:
    """An axis of model numbers."""
    ax.set(ylim=(0.0, models + 1.0), ylabel="number of the model selected")
    ax.yaxis.set_major_locator(MultipleLocator(4))
    ax.yaxis.set_minor_locator(MultipleLocator(1))


def plot_drift(
    time: np.ndarray,
    right: Mapping[str, np.ndarray],
    side_slip: np.ndarray,
    noisy: Mapping[str, np.ndarray],
    biased: Mapping[str, np.ndarray],
    drift: np.ndarray,
    onset: float,
    title: str = "",
) -> Figure:
    """How often each method is right with noise, and what becomes of its side slip.

    Args:
        time: [s], [time].
        right: share of noisy runs in which each method names the right model [-], [time].
        side_slip: true [rad], [time].
        noisy: error of each method's side slip with noise [rad], [runs, time].
        biased: error of each method's side slip with a bias of the accelerometer [rad], [time].
        drift: what the bias is expected to do to an integral [rad], [time].
        onset: of the steering [s], marked.
        title: headline of the figure.
    """
    figure, (top, bottom) = new_figure(2, height=2.9, sharex=True)
    for name, share in right.items():
        colour = MODEL_COLOURS.get(name, _FALLBACK)
        top.plot(time, 100 * share, color=colour, linewidth=1.4, label=name)
    top.set(ylim=(0.0, 104.0))
    top.set_ylabel("noisy runs that name\nthe right model [%]")
    mrad = 1e3
    bottom.plot(time, mrad * side_slip, color=TRUTH, linewidth=1.0, label="true side slip")
    for name, error in noisy.items():
        colour = MODEL_COLOURS.get(name, _FALLBACK)
        low, high = np.quantile(error, [0.025, 0.975], axis=0)
        label = f"error with noise, 95 % of runs: {name}"
        bottom.fill_between(
            time,
            mrad * low,
            mrad * high,
            color=BAND if colour == ESTIMATE else colour,
            alpha=0.45,
            linewidth=0,
            label=label,
        )
        bottom.plot(
            time, mrad * biased[name], color=colour, linewidth=1.6, label=f"error with bias: {name}"
        )
    bottom.plot(
        time, mrad * drift, color=TRUTH, linestyle="--", linewidth=1.0, label="bias / speed x time"
    )
    bottom.set_ylabel("side slip angle [mrad]")
    bottom.set_xlabel("time [s]")
    bottom.margins(x=0)
    for ax in (top, bottom):
        ax.axvline(onset, color=TRUTH, linestyle=":", linewidth=0.8)
    legend(top, ncols=3, loc="lower right")
    figure.legend(
        *bottom.get_legend_handles_labels(),
        loc="outside lower left",
        fontsize=8,
        frameon=False,
        ncols=3,
    )
    top.set_title(title, loc="left", fontsize=11)
    return figure


def _spread(values: np.ndarray, count: int) -> np.ndarray:
    """So many of the values, evenly, the last among them."""
    at = np.round(np.linspace(0, len(values), count + 1)[1:]).astype(int) - 1
    return np.asarray(values[at])
