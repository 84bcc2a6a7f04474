"""Figures of which tyre is soft: one record over time, and what becomes of many."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from wheelhop.estimators.lateral_vehicle import NOT_ENOUGH, UNDECIDED, SoftTires
from wheelhop.plots.panels import legend_below, panel_grid
from wheelhop.plots.style import BAND, CORNER_COLOURS, ESTIMATE, MUTED, TRUTH, legend, new_figure
from wheelhop.vehicle.lateral_record import LateralRecord

OUTCOME_COLOURS = {
    "told right": "#2e7d32",
    "right tyres most probable, not told": "#b7d9a8",
    "others most probable, not told": "#d9d9d9",
    "told, a soft tyre missed": "#ef9a3c",
    "told, a sound tyre called soft": "#c0392b",
}
"""Of the shares in `plot_outcomes`, from the left."""

_SPREAD = 1.96


def plot_soft_tires(record: LateralRecord, found: SoftTires, title: str = "") -> Figure:
    """What was measured, how probable each tyre is soft, and the road's friction.

    Args:
        record: of the sensors.
        found: what is believed; its time counts from the record's beginning.
        title: headline of the figure.
    """
    figure, (top, middle, bottom) = new_figure(3, height=2.3, sharex=True)
    start = float(record.t[0])
    t = start + found.t
    top.plot(
        record.t,
        record.sample.lateral_acceleration,
        color=ESTIMATE,
        linewidth=0.9,
        label="lateral acceleration [m/s²]",
    )
    top.plot(
        record.t,
        np.degrees(record.sample.yaw_rate) / 10.0,
        color=TRUTH,
        linewidth=0.9,
        label="yaw rate [10 °/s]",
    )
    top.set_ylabel("measured")
    legend(top, ncols=2, loc="lower right")
    for k, (corner, colour) in enumerate(CORNER_COLOURS.items()):
        # tyres of one side often go together: a dashed line shows the one below
        style = "-" if corner.endswith("L") else (0, (4, 3))
        middle.plot(
            t, 100 * found.soft[:, k], color=colour, linestyle=style, linewidth=2.0, label=corner
        )
    middle.set(ylim=(-3, 103))
    middle.set_ylabel("probability that the\ntyre is soft [%]")
    legend(middle, ncols=4, loc="center right")
    _verdicts(middle, t, found.verdict)
    spread = np.exp(_SPREAD * found.friction_sigma)
    bottom.fill_between(
        t,
        found.friction / spread,
        found.friction * spread,
        color=BAND,
        alpha=0.6,
        linewidth=0,
        label="95 %",
    )
    bottom.plot(t, found.friction, color=ESTIMATE, linewidth=1.4, label="mean")
    bottom.set(ylim=(0.0, 2.0), xlabel="time [s]")
    bottom.set_ylabel("road friction [-]")
    legend(bottom, ncols=2, loc="lower left")
    bottom.margins(x=0)
    top.set_title(title, loc="left", fontsize=11)
    return figure


def _verdicts(ax: Any, t: np.ndarray, verdict: np.ndarray) -> None:
    """Grey where nothing is told, and the last verdict where it begins to stay."""
    silent = np.isin(verdict, (NOT_ENOUGH, UNDECIDED))
    across = ax.get_xaxis_transform()
    ax.fill_between(
        t, 0, 1, where=silent, transform=across, step="post", color=MUTED, alpha=0.13, linewidth=0
    )
    other = np.flatnonzero(verdict != verdict[-1])
    begin = 0 if not other.size else min(int(other[-1]) + 1, len(t) - 1)
    last = str(verdict[-1])
    words = last if silent[-1] else f"told from {t[begin]:.1f} s on: {last}"
    late = begin > 0.6 * len(t)
    ax.annotate(
        words,
        (t[begin], 0.72),
        xycoords=("data", "axes fraction"),
        xytext=(-6 if late else 6, 0),
        textcoords="offset points",
        ha="right" if late else "left",
        fontsize=9,
        color=TRUTH,
    )


def plot_outcomes(
    rows: Sequence[str],
    shares: Mapping[str, np.ndarray],
    contender: np.ndarray,
    contender_name: str,
    title: str = "",
) -> Figure:
    """Row by row, what becomes of the runs: told right, not told, or told wrong in which way.

    Args:
        rows: names, from the top.
        shares: of the runs [-] by outcome, keys of `OUTCOME_COLOURS`, [rows].
        contender: share of runs that another method tells right [-], [rows]; NaN for none.
        contender_name: of that method.
        title: headline of the figure.
    """
    figure, grid = panel_grid(1, 1, height=0.42 * len(rows) + 0.6)
    ax = grid[0, 0]
    places = np.arange(len(rows))
    left = np.zeros(len(rows))
    for name, colour in OUTCOME_COLOURS.items():
        width = 100 * np.asarray(shares[name])
        bars = ax.barh(places, width, 0.72, left=left, color=colour, label=name)
        words = [f"{w:.0f}" if w >= 4.0 else "" for w in width]
        dark = name.startswith("told")
        ax.bar_label(bars, words, label_type="center", fontsize=8, color="white" if dark else TRUTH)
        left = left + width
    if np.isfinite(contender).any():
        ax.plot(
            100 * contender,
            places,
            linestyle="none",
            marker="|",
            markersize=15,
            markeredgewidth=2.4,
            color=TRUTH,
            label=f"{contender_name}: right",
        )
    ax.set_yticks(places, rows, fontsize=9)
    ax.set(ylim=(len(rows) - 0.5, -0.5), xlim=(0, 100), xlabel="runs [%]")
    ax.grid(False, axis="y")
    legend_below(figure, [ax], 3)
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    return figure
