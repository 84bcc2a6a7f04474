"""Figure of four pressures as two estimators see them, alone and together."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from wheelhop.plots.panels import legend_below, note_cut
from wheelhop.plots.style import ALERT, ESTIMATE, MUTED, TRUTH
from wheelhop.vehicle.full_vehicle_parameters import CORNERS

_COLOURS = ("#7a8fa6", "#ef6c00", ESTIMATE)
_BANDS = (0.28, 0.16, 0.25)
_WIDTHS = (1.2, 1.2, 2.0)
_LIMITS = (130.0, 270.0)
_NAMES = ("front left", "front right", "rear left", "rear right")


def plot_lateral_fusion(
    time: Float[np.ndarray, " time"],
    lateral_acceleration: Float[np.ndarray, " time"],
    true: Float[np.ndarray, " 4"],
    pressure: Mapping[str, Float[np.ndarray, "time 4"]],
    pressure_sd: Mapping[str, Float[np.ndarray, "time 4"]],
    agreement: Float[np.ndarray, " time"],
    title: str = "",
) -> Figure:
    """Pressure of every tyre by each estimator and by both, and whether these two agree.

    Args:
        time: [s].
        lateral_acceleration: [m/s^2].
        true: pressures FL, FR, RL, RR [Pa].
        pressure: mean by estimator [Pa]; the last is the one of both.
        pressure_sd: standard deviation by estimator [Pa], the half width of its band.
        agreement: ln Bayes factor of the two estimators.
        title: headline.
    """
    figure = Figure(figsize=(9.0, 8.2), layout="constrained")
    grid = figure.add_gridspec(3, 2, height_ratios=(1.0, 1.0, 0.62))
    panels: list[Any] = []
    for k, (name, short) in enumerate(zip(_NAMES, CORNERS, strict=True)):
        shared = {"sharex": panels[0], "sharey": panels[0]} if panels else {}
        ax = figure.add_subplot(grid[k // 2, k % 2], **shared)
        panels.append(ax)
        for label, colour, alpha, width in zip(pressure, _COLOURS, _BANDS, _WIDTHS, strict=False):
            p, sd = 1e-3 * pressure[label][:, k], 1e-3 * pressure_sd[label][:, k]
            ax.fill_between(time, p - sd, p + sd, color=colour, alpha=alpha, linewidth=0)
            ax.plot(time, p, color=colour, linewidth=width, label=label)
        ax.axhline(
            1e-3 * true[k],
            color=TRUTH,
            linewidth=1.0,
            linestyle="--",
            label="truth (bands: one standard deviation)",
        )
        note_cut(ax, {n: 1e-3 * p[:, k] for n, p in pressure.items()}, _LIMITS, "kPa")
        ax.set_title(f"{name} ({short}), {1e-3 * true[k]:.0f} kPa", loc="left", fontsize=10)
        ax.set_ylim(*_LIMITS)
        if k % 2 == 0:
            ax.set_ylabel("pressure [kPa]")
    below = figure.add_subplot(grid[2, 0], sharex=panels[0])
    below.plot(time, lateral_acceleration, color=MUTED, linewidth=1.0)
    below.set_ylabel("lateral acceleration\n[m/s²]")
    below.set_title("what the car did: straight on, and lane changes", loc="left", fontsize=10)
    beside = figure.add_subplot(grid[2, 1], sharex=panels[0])
    beside.axhline(0.0, color=TRUTH, linewidth=0.6)
    beside.plot(time, agreement, color=ESTIMATE, linewidth=1.4)
    worse = np.minimum(agreement, 0.0)
    beside.fill_between(time, worse, 0.0, color=ALERT, alpha=0.35, linewidth=0)
    beside.set_ylabel("ln Bayes factor [-]")
    beside.set_title("do both agree? below zero they contradict", loc="left", fontsize=10)
    for ax in (*panels, below, beside):
        ax.grid(True, alpha=0.25, linewidth=0.6)
        ax.spines[["top", "right"]].set_visible(False)
        ax.set_xlim(float(time[0]), float(time[-1]))
    for ax in (below, beside):
        ax.set_xlabel("time [s]")
    legend_below(figure, panels, 4)
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    return figure
