"""Figures of who names the soft tyre: confusion of the modes, and under what conditions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from wheelhop.evaluation.tracking import Interval
from wheelhop.plots.panels import legend_below, panel_grid, plain
from wheelhop.plots.style import ALERT, ESTIMATE, MUTED, TRUTH

_COLOURS = (ALERT, ESTIMATE, "#2e7d32", "#8e24aa")
_MARKS = ("s", "o", "D", "^")
_TICKS = (0.1, 0.2, 0.5, 1.0, 2.0, 4.0)


def plot_confusion(
    matrices: Mapping[str, np.ndarray],
    names: Sequence[str],
    tires: Mapping[str, np.ndarray],
    corners: Sequence[str],
    title: str = "",
) -> Figure:
    """What is told of every true mode, and how often each tyre is told right.

    Args:
        matrices: share of the runs of a true mode (rows) told as each (columns) [-], of three
            contenders by name.
        names: of the modes.
        tires: share of runs in which each tyre is told right [-], of the contenders, [corners].
        corners: names of the tyres.
        title: headline of the figure.
    """
    figure = Figure(figsize=(9.0, 9.4), layout="constrained")
    axes = figure.subplots(2, 2)
    for ax, (name, matrix) in zip(axes.flat, matrices.items(), strict=False):
        right = float(np.mean(np.diag(matrix)))
        _matrix(ax, matrix, names, f"{name}: {right:.1%} right", 7.0, 5.5)
    last = axes.flat[-1]
    plain(last)
    width = 0.8 / len(tires)
    for k, (name, shares) in enumerate(tires.items()):
        x = np.arange(len(corners)) + (k - 0.5 * (len(tires) - 1)) * width
        bars = last.bar(x, 100 * shares, 0.92 * width, color=_COLOURS[k], label=name)
        last.bar_label(bars, fmt="%.0f", fontsize=7)
    last.set_xticks(np.arange(len(corners)), corners)
    last.set_ylabel("runs in which the tyre is told right [%]")
    last.set_ylim(0.0, 118.0)
    last.set_yticks(np.arange(0, 101, 20))
    last.grid(False, axis="x")
    last.set_title("tyre by tyre", loc="left", fontsize=10)
    last.legend(fontsize=8, ncols=3, loc="upper left", framealpha=0.0)
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    return figure


def plot_levels(
    matrices: Mapping[str, np.ndarray], names: Sequence[str], title: str = ""
) -> Figure:
    """What is told of a tyre at each level.

    Args:
        matrices: share of the tyres of a true level (rows) told as each (columns) [-], by
            contender; NaN where no tyre was.
        names: of the levels.
        title: headline of the figure.
    """
    rows = -(-len(matrices) // 2)
    figure = Figure(figsize=(9.0, 2.9 * rows + 0.4), layout="constrained")
    axes = figure.subplots(rows, 2, squeeze=False).flat
    for ax, (name, matrix) in zip(axes, matrices.items(), strict=False):
        _matrix(ax, matrix, names, name, 9.0, 10.0)
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    return figure


def _matrix(
    ax: Any, matrix: np.ndarray, names: Sequence[str], title: str, size: float, inner: float
) -> None:
    """Shares as a coloured table with the percentages in it."""
    ax.imshow(np.nan_to_num(matrix), cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
    places = np.arange(len(names))
    turned = 90 if len(names) > 4 else 0
    ax.set_xticks(places, names, rotation=turned, fontsize=size)
    ax.set_yticks(places, names, fontsize=size)
    ax.set_xlabel("told", fontsize=9)
    ax.set_ylabel("truly soft" if len(names) > 4 else "true", fontsize=9)
    for (row, column), share in np.ndenumerate(matrix):
        if np.isfinite(share) and share >= 0.005:
            colour = "white" if share > 0.5 else TRUTH
            text = f"{100 * share:.0f}"
            ax.text(column, row, text, ha="center", va="center", fontsize=inner, color=colour)
    ax.set_xticks(places[:-1] + 0.5, minor=True)
    ax.set_yticks(places[:-1] + 0.5, minor=True)
    ax.grid(which="minor", color="white", linewidth=0.8)
    ax.tick_params(which="both", length=0)
    ax.spines[:].set_visible(False)
    ax.set_title(title, loc="left", fontsize=10)


def plot_over_acceleration(
    peaks: np.ndarray,
    shares: Mapping[str, Sequence[Interval]],
    demanded: float,
    floors: Mapping[str, float],
    title: str = "",
) -> Figure:
    """Share of runs told right over the lateral acceleration of the lane change.

    Args:
        peaks: largest lateral acceleration of the sound car [m/s^2], [levels].
        shares: of each contender, at each level.
        demanded: share from which on a method is said to work [-].
        floors: lateral acceleration from which each does [m/s^2]; NaN for no mark.
        title: headline of the figure.
    """
    figure, grid = panel_grid(1, 1, height=4.0)
    ax = grid[0, 0]
    for k, (name, found) in enumerate(shares.items()):
        low, middle, high = (
            100 * np.array([getattr(s, part) for s in found]) for part in ("low", "value", "high")
        )
        colour = _COLOURS[k]
        ax.fill_between(peaks, low, high, color=colour, alpha=0.15, linewidth=0)
        ax.plot(peaks, middle, color=colour, marker=_MARKS[k], markersize=5, label=name)
        floor = floors[name]
        if np.isfinite(floor):
            ax.axvline(floor, color=colour, linestyle=":", linewidth=1.2)
            ax.annotate(
                f"{floor:.2g}",
                (floor, 3.0),
                xytext=(3, 0),
                textcoords="offset points",
                color=colour,
                fontsize=9,
            )
    ax.axhline(100 * demanded, color=MUTED, linestyle="--", linewidth=1.0)
    ax.annotate(
        f"{demanded:.0%}",
        (1.0, 100 * demanded),
        xycoords=("axes fraction", "data"),
        xytext=(3, -3),
        textcoords="offset points",
        fontsize=8,
        color=MUTED,
    )
    ax.set_xscale("log")
    ax.xaxis.set_major_locator(FixedLocator(_TICKS))
    ax.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    ax.xaxis.set_minor_locator(NullLocator())
    ax.set(ylim=(0.0, 102.0))
    ax.set_xlabel("largest lateral acceleration of the sound car in the lane change [m/s²]")
    ax.set_ylabel("runs in which all four tyres\nare told right [%]")
    legend_below(figure, [ax], 3)
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    return figure


def plot_conditions(
    rows: Sequence[str],
    right: Mapping[str, Sequence[Interval]],
    alarms: Mapping[str, Sequence[Interval]],
    title: str = "",
) -> Figure:
    """Condition by condition: soft cars told right, and the sound car called soft.

    Args:
        rows: names of the conditions, from the top.
        right: share of runs with soft tyres that are told right, of each contender.
        alarms: share of runs of the sound car in which a soft tyre is named.
        title: headline of the figure.
    """
    figure, grid = panel_grid(1, 2, height=0.42 * len(rows), sharey=True)
    panels = (
        ("soft tyres: all four told right [%]", right),
        ("no soft tyre: one is named all the same [%]", alarms),
    )
    places = np.arange(len(rows))
    for ax, (label, found) in zip(grid[0], panels, strict=True):
        for k, (name, shares) in enumerate(found.items()):
            low, value, high = (
                100 * np.array([getattr(s, part) for s in shares])
                for part in ("low", "value", "high")
            )
            y = places + 0.22 * (k - 0.5 * (len(found) - 1))
            ax.hlines(y, low, high, color=_COLOURS[k], linewidth=1.6, alpha=0.5)
            ax.plot(value, y, _MARKS[k], color=_COLOURS[k], markersize=5, label=name)
        ax.set_xlabel(label)
        ax.set_xlim(-2.0, 102.0)
        ax.grid(False, axis="y")
        for place in places[:-1]:
            ax.axhline(place + 0.5, color=MUTED, linewidth=0.4, alpha=0.5)
    grid[0, 0].set_yticks(places, rows, fontsize=9)
    grid[0, 0].set_ylim(len(rows) - 0.5, -0.5)
    legend_below(figure, grid[0], 3)
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    return figure


def plot_detection(
    times: Mapping[str, np.ndarray],
    stated: np.ndarray,
    observed: np.ndarray,
    span: float,
    title: str = "",
) -> Figure:
    """How soon the right mode is named for good, and how far probabilities can be trusted.

    Args:
        times: of each contender from the onset of steering [s], infinite if never, [runs].
        stated: mean probability that the bank states of what it names [-], [bins].
        observed: share in which it is right [-], [bins].
        span: from the onset to the end of the drive [s].
        title: headline of the figure.
    """
    figure, grid = panel_grid(1, 2, height=3.6)
    left, right = grid[0]
    steps = np.arange(0.0, span + 0.05, 0.1)
    for k, (name, found) in enumerate(times.items()):
        share = [100 * np.mean(found <= t + 1e-6) for t in steps]
        left.plot(steps, share, color=_COLOURS[k], drawstyle="steps-post", label=name)
    left.set(ylim=(0.0, 102.0), xlabel="time since steering began [s]")
    left.set_ylabel("runs told right from then on [%]")
    left.margins(x=0)
    right.plot([0, 100], [0, 100], color=MUTED, linestyle="--", linewidth=1.0)
    right.plot(100 * stated, 100 * observed, color=_COLOURS[2], marker=_MARKS[2], label="_")
    right.set(xlim=(0, 102), ylim=(0, 102))
    right.set_xlabel("probability that the bank states [%]")
    right.set_ylabel("share in which it is right [%]")
    legend_below(figure, [left], 3)
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    return figure
