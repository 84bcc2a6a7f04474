"""Stiffness errors of filters over many runs, as Brancati & Tufano 2022 draw them in Fig. 6."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from wheelhop.errors import InputError
from wheelhop.evaluation.tracking import Tracking
from wheelhop.plots.panels import legend_below, note_cut, number, panel_grid, reach, tame
from wheelhop.plots.style import ALERT, CLASS_COLOURS, ESTIMATE, MUTED, TRUTH

_WIDEST = 4.0


class ErrorPanel(NamedTuple):
    """What is drawn of one filter.

    Attributes:
        tracking: figures of its runs; the statistics are in N/m.
        sample: error of one run, estimate minus truth [N/m], [time].
    """

    tracking: Tracking
    sample: np.ndarray


def plot_error_bounds(
    t: np.ndarray,
    panels: Mapping[str, ErrorPanel],
    title: str = "",
    *,
    prior: float | None = None,
    slope: float | None = None,
) -> Figure:
    """Errors of k_t against their bounds, a panel for each filter; Eq. 23-25.

    Args:
        t: time [s], [time].
        panels: what is drawn of each filter, by its name.
        title: headline of the figure.
        prior: root mean square error of a constant prior [N/m], the floor to beat.
        slope: dp/dk_t [Pa m/N]; adds an axis of pressure on the right.

    Raises:
        InputError: without a panel.
    """
    if not panels:
        raise InputError("panels", "there are none", "Give at least one filter.")
    columns = min(2, len(panels))
    rows = -(-len(panels) // columns)
    figure, axes = panel_grid(rows, columns, height=2.5, sharex=True, sharey=True)
    for ax in axes.flat[len(panels) :]:
        ax.set_visible(False)
    floor = None if prior is None else float(tame(prior)) / 1e3
    curves = {name: _curves(panel) for name, panel in panels.items()}
    limit = _common_limit(curves.values(), floor)
    for ax, (name, panel) in zip(axes.flat, panels.items(), strict=False):
        drawn = curves[name]
        _draw(ax, t, drawn, limit, floor)
        ax.set_title(f"{name}\n{_summary(panel.tracking)}", loc="left", fontsize=8.5)
        note_cut(ax, drawn, (-limit, limit), "kN/m")
    axes[0, 0].set_ylim(-limit, limit)
    for ax in axes[:, 0]:
        ax.set_ylabel("error of $k_t$, estimate\nminus truth [kN/m]")
    # an empty place leaves the panel above it without labels of time
    for ax in axes.flat[max(len(panels) - columns, 0) : len(panels)]:
        ax.set_xlabel("time [s]")
        ax.tick_params(labelbottom=True)
    if slope is not None:
        for ax in axes.flat[: len(panels)]:
            if ax in axes[:, -1]:
                _pressure_axis(ax, slope)
    legend_below(figure, axes.flat, 3)
    figure.suptitle(title or "Errors of the tyre's stiffness", x=0.01, ha="left", fontsize=11)
    return figure


def _curves(panel: ErrorPanel) -> dict[str, np.ndarray]:
    """What is drawn [kN/m], by name."""
    s = panel.tracking.statistics
    mean, std, sigma, sample = (tame(a) / 1e3 for a in (s.mean, s.std, s.sigma, panel.sample))
    return {
        "one run": sample,
        "mean": mean,
        "standard deviation": np.stack([mean - std, mean + std]),
        "sigma": sigma,
    }


def _draw(
    ax: Any, t: np.ndarray, curves: Mapping[str, np.ndarray], limit: float, floor: float | None
) -> None:
    shown = {name: np.clip(values, -20 * limit, 20 * limit) for name, values in curves.items()}
    if floor is not None:
        ax.axhspan(-floor, floor, color=MUTED, alpha=0.2, linewidth=0, label="rms of the prior")
    ax.axhline(0, color=TRUTH, linewidth=0.5)
    green = CLASS_COLOURS["A"]
    ax.plot(t, shown["one run"], color=green, linewidth=0.7, label="one run")
    blue = {"color": ESTIMATE, "linestyle": "--", "linewidth": 1.3}
    low, high = shown["standard deviation"]
    ax.plot(t, high, label="mean ± standard deviation of the errors", **blue)
    ax.plot(t, low, **blue)
    black = {"color": TRUTH, "linestyle": "--", "linewidth": 1.3}
    ax.plot(t, shown["sigma"], label="± sigma that the filter states", **black)
    ax.plot(t, -shown["sigma"], **black)
    ax.plot(t, shown["mean"], color=ALERT, linewidth=1.8, label="mean error")
    ax.set_xlim(0, t[-1])


def _summary(tracking: Tracking) -> str:
    rmse = tracking.final_rmse
    return (
        f"inside one sigma {100 * tracking.inside:.0f} % (honest: 68 %)\n"
        f"final RMSE {number(rmse.value / 1e3)} kPa "
        f"(95 %: {number(rmse.low / 1e3)} to {number(rmse.high / 1e3)})"
    )


def _common_limit(panels: Iterable[Mapping[str, np.ndarray]], floor: float | None) -> float:
    """Half the height of all panels [kN/m]: the worst one's, unless that dwarfs the others."""
    needs = [max(reach(values) for values in curves.values()) for curves in panels]
    least = min((need for need in needs if need > 0), default=1.0)
    # errors of several times the floor are useless, however large
    widest = _WIDEST * least if floor is None else max(_WIDEST * floor, 1.3 * least)
    limit = max(min(max(needs), widest), floor or 0.0)
    return 1.1 * limit if limit > 0 else 1.0


def _pressure_axis(ax: Any, slope: float) -> None:
    # kN/m times Pa m/N is kPa
    right = ax.secondary_yaxis("right", functions=(lambda k: slope * k, lambda p: p / slope))
    right.set_ylabel("as pressure [kPa]", fontsize=8)
    right.tick_params(labelsize=8)
