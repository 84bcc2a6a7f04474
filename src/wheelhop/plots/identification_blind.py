"""Figure of a fit without a road: the roads' levels, and how well the car is known."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from wheelhop.identification.blind import MISFIT, BlindIdentification
from wheelhop.identification.blind_summary import levels_of
from wheelhop.plots.identification_quality import draw_relative_errors
from wheelhop.plots.style import ALERT, CLASS_COLOURS, ESTIMATE, TRUTH, legend
from wheelhop.vehicle.road import CLASSES, class_level

_SIGMAS = 2.0
_WIDEST = 64.0
_MICRO = 1e6
_LEGEND_BELOW = 0.5


def plot_blind_roads(found: BlindIdentification, title: str = "") -> Figure:
    """Levels of the records' roads among the ISO 8608 classes, and the car's relative errors.

    Args:
        found: the identification.
        title: headline of the figure.
    """
    rows = len(found.names), len(found.space.names)
    heights = [0.7 + 0.35 * rows[0], 0.7 + 0.45 * rows[1]]
    figure = Figure(figsize=(8.5, sum(heights) + 3.2), layout=ConstrainedLayoutEngine(h_pad=0.1))
    top, bottom = figure.subplots(2, 1, height_ratios=heights)
    # both legends stand as far below their axes, which are of different heights
    below = [_LEGEND_BELOW / height for height in heights]
    _levels(top, found, below[0])
    draw_relative_errors(bottom, found, plain="if the model is right", below=below[1])
    figure.suptitle(title or "Roads and car, from accelerations alone", fontsize=11)
    return figure


def _levels(ax: Any, found: BlindIdentification, below: float) -> None:
    """Levels with error bars; those of logs that the model does not fit stand out."""
    levels = levels_of(found)
    values = _MICRO * np.array([level.value for level in levels])
    relative = np.array([level.relative_error for level in levels])
    # the logarithm of a level was fitted, and its errors are alike on both sides
    reach = np.where(np.isfinite(relative), np.exp(_SIGMAS * np.minimum(relative, 10.0)), 1.0)
    fits = np.abs(found.nis - 2.0) < MISFIT * 2.0
    looks = (
        (fits, ESTIMATE, "o", f"fit ± {_SIGMAS:g} standard errors"),
        (~fits, ALERT, "s", "the same, mean NIS far from 2"),
    )
    place = np.arange(len(values))
    for chosen, colour, marker, label in looks:
        if chosen.any():
            ax.errorbar(
                values[chosen],
                place[chosen],
                xerr=[(values - values / reach)[chosen], (values * reach - values)[chosen]],
                fmt=marker,
                color=colour,
                capsize=4,
                markersize=5,
                label=label,
            )
    for k in np.flatnonzero(~np.isfinite(relative)):
        ax.annotate("not determined", (values[k], k), (6, 6), textcoords="offset points")
    low = max((values / reach).min() / 4.0, values.min() / _WIDEST)
    high = min((values * reach).max() * 4.0, values.max() * _WIDEST)
    _bands(ax, low, high)
    ax.set_xscale("log", base=2)
    ax.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    ax.set_xlim(low, high)
    ax.set_ylim(len(values) - 0.4, -0.6)
    ax.set_yticks(place, found.names, fontsize=8)
    ax.set_xlabel("road level Gd(W0) at W0 = 1 rad/m [10⁻⁶ m³/rad]")
    ax.set_title("roads, and ISO 8608 classes by their range at waviness 2", fontsize=10, pad=16)
    ax.grid(True, axis="x", alpha=0.25, linewidth=0.6)
    ax.spines[["top", "right"]].set_visible(False)
    legend(ax, loc="upper center", bbox_to_anchor=(0.5, -below), ncols=2)


def _bands(ax: Any, low: float, high: float) -> None:
    """Ranges of the classes as bands, their centres as lines; A and H are open-ended."""
    for name in CLASSES:
        center, colour = _MICRO * class_level(name), CLASS_COLOURS[name]
        left = low if name == CLASSES[0] else max(0.5 * center, low)
        right = high if name == CLASSES[-1] else min(2.0 * center, high)
        if left >= right:
            continue
        ax.axvspan(left, right, color=colour, alpha=0.16, linewidth=0)
        if left < center < right:
            ax.axvline(center, color=colour, linestyle=":", linewidth=1.0)
        middle = float(np.sqrt(left * right))
        text = {"color": TRUTH if name == "H" else colour, "fontweight": "bold"}
        where = ax.get_xaxis_transform()
        ax.text(middle, 1.01, name, transform=where, ha="center", va="bottom", **text)
