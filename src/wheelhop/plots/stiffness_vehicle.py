"""Figures of the pressure estimates on the full vehicle."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from wheelhop.plots.panels import legend_below, note_cut, panel_grid
from wheelhop.plots.style import ALERT, BAND, ESTIMATE, MUTED, TRUTH

_CASES = (ESTIMATE, "#ef6c00", "#2e7d32", "#8e24aa")
_ROWS = (MUTED, "#ef6c00", "#74b3e0", ESTIMATE)
_MARKERS = ("x", "s", "^", "o")
_LIMITS = (-40.0, 40.0)
_SETTLED = 20.0


def plot_vehicle_errors(
    time: Float[np.ndarray, " time"],
    error: Float[np.ndarray, "cases time 4"],
    kinds: Sequence[str],
    names: Sequence[str],
    limit: float,
    title: str = "",
) -> Figure:
    """Error of every tyre's pressure over time, a panel for each kind of road.

    Args:
        time: [s].
        error: of the pressure, relative [-].
        kinds: of the roads, [cases].
        names: of the drives, [cases]; told where a kind has few of them.
        limit: error that is allowed [-].
        title: headline.
    """
    each = list(dict.fromkeys(kinds))
    figure, axes = panel_grid(-(-len(each) // 2), min(2, len(each)), height=3.0)
    for ax in axes.flat[len(each) :]:
        ax.set_visible(False)
    for ax, kind in zip(axes.flat, each, strict=False):
        rows = [k for k, other in enumerate(kinds) if other == kind]
        many = len(rows) > len(_CASES)
        ax.axhspan(-100 * limit, 100 * limit, color=BAND, alpha=0.5, linewidth=0)
        ax.axhline(0.0, color=TRUTH, linewidth=0.6)
        for place, row in enumerate(rows):
            colour = MUTED if many else _CASES[place]
            style = {"color": colour, "linewidth": 0.6 if many else 1.1, "alpha": 0.8}
            ax.plot(time, 100 * error[row], **style)
            if not many:
                label = names[row].split(", ", 1)[-1]
                ax.plot([], [], color=colour, label=label)
        if many:
            rms = 100 * np.sqrt(np.mean(error[rows] ** 2, axis=(0, 2)))
            ax.plot(time, rms, color=ESTIMATE, linewidth=1.8, label=f"rms of {len(rows)} roads")
        ax.set_ylim(*_LIMITS)
        settled = time >= min(_SETTLED, float(time[-1]))
        told = {"" if many else names[r].split(", ", 1)[-1]: error[r] for r in rows}
        note_cut(ax, {n: 100 * e[settled] for n, e in told.items()}, _LIMITS, "%")
        ax.set_title(kind, loc="left", fontsize=10)
        ax.legend(fontsize=8, loc="upper right", framealpha=0.85)
    for ax in axes[-1]:
        ax.set_xlabel("time [s]")
    for row in axes:
        row[0].set_ylabel("error of the pressure [%]")
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    return figure


def plot_what_helps(
    errors: Mapping[str, Float[np.ndarray, " cases"]],
    names: Sequence[str],
    limit: float,
    reach: float = 0.8,
    title: str = "",
) -> Figure:
    """Error after a drive, the mean of the four tyres, by what the estimator's model holds.

    Args:
        errors: of the pressure by model, relative [-].
        names: of the drives.
        limit: error that is allowed [-].
        reach: of the axis [-]; what lies beyond is drawn at its edge.
        title: headline.
    """
    figure = Figure(figsize=(9.0, 1.4 + 0.3 * len(names)), layout="constrained")
    ax = figure.subplots()
    y = np.arange(len(names))[::-1]
    ax.axvspan(-100 * limit, 100 * limit, color=BAND, alpha=0.5, linewidth=0)
    ax.axvline(0.0, color=TRUTH, linewidth=0.6)
    for (label, error), colour, marker in zip(errors.items(), _ROWS, _MARKERS, strict=False):
        x = np.clip(100 * error, -100 * reach, 100 * reach)
        ax.plot(x, y, marker, color=colour, markersize=6, label=label, linestyle="none")
    ax.set_yticks(y, names, fontsize=8)
    ax.set_xlim(-105 * reach, 105 * reach)
    ax.grid(True, alpha=0.25, linewidth=0.6)
    ax.spines[["top", "right"]].set_visible(False)
    ax.set_xlabel(
        f"error of the pressure, mean of four tyres [%]; beyond {100 * reach:g} at the edge"
    )
    legend_below(figure, [ax], 2)
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    return figure


def plot_budget(
    moves: Mapping[str, Float[np.ndarray, "disturbances 4"]],
    names: Sequence[str],
    limit: float,
    title: str = "",
) -> Figure:
    """How far each disturbance moves the pressure: mean of the four tyres, and their range.

    Args:
        moves: of the pressure, relative [-], by when the estimator was calibrated.
        names: of the disturbances.
        limit: error that is allowed [-].
        title: headline.
    """
    figure = Figure(figsize=(9.0, 1.3 + 0.5 * len(names)), layout="constrained")
    ax = figure.subplots()
    y = np.arange(len(names))[::-1].astype(float)
    ax.axvspan(-100 * limit, 100 * limit, color=BAND, alpha=0.5, linewidth=0)
    ax.axvline(0.0, color=TRUTH, linewidth=0.6)
    shift = 0.38 / len(moves)
    for k, ((label, move), colour) in enumerate(
        zip(moves.items(), (ALERT, ESTIMATE), strict=False)
    ):
        middle, at = 100 * move.mean(axis=1), y + shift * (len(moves) - 1 - 2 * k)
        spread = np.abs(100 * np.stack([move.min(axis=1), move.max(axis=1)]) - middle)
        bars: dict[str, Any] = {"color": colour, "alpha": 0.75, "label": label}
        ax.barh(at, middle, height=1.7 * shift, xerr=spread, error_kw={"elinewidth": 1.0}, **bars)
    ax.set_yticks(y, names, fontsize=9)
    ax.grid(True, axis="x", alpha=0.25, linewidth=0.6)
    ax.spines[["top", "right"]].set_visible(False)
    ax.set_xlabel("the pressure moves by [%]; whiskers: the four tyres")
    legend_below(figure, [ax], 2)
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    return figure
