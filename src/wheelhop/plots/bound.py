"""Figure of the best accuracy of pressure over time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from wheelhop.errors import InputError
from wheelhop.evaluation.bound_cases import BoundCase
from wheelhop.plots.style import ALERT, ESTIMATE, MUTED, TRUTH

_BLUES = ("#08306b", "#2171b5", "#6baed6", "#9e9ac8")
_COLOURS = {"known": "#2e7d32", "unknown": ALERT, "more": MUTED, "four": TRUTH}
_APART = 0.048


def plot_bound(
    time: np.ndarray, cases: Sequence[BoundCase], pascal: float, title: str = ""
) -> Figure:
    """Best accuracy of one pressure, and of a difference of two, over time, on log axes.

    Every curve's label ends with what it reaches, as pressure and as stiffness.

    Args:
        time: since the start [s], positive, increasing, [time].
        cases: bounds at these times.
        pascal: standard deviation of the pressure per one of ln k_t [Pa].
        title: headline of the figure.

    Raises:
        InputError: without a case, or where none is finite.
    """
    kinds = [[c for c in cases if c.difference is kind] for kind in (False, True)]
    kinds = [kind for kind in kinds if kind]
    drawn = np.concatenate([c.relative for c in cases]) if cases else np.array([])
    drawn = drawn[np.isfinite(drawn) & (drawn > 0)]
    if not drawn.size:
        raise InputError("cases", "hold no finite bound", "Give a prior, or fewer unknowns.")
    kpa = pascal / 1e3
    limits = 0.75 * kpa * drawn.min(), 1.3 * kpa * drawn.max()
    figure = Figure(figsize=(5.3 * len(kinds), 4.6), layout="constrained")
    axes = figure.subplots(1, len(kinds), sharey=True, squeeze=False)[0]
    for ax, kind in zip(axes, kinds, strict=True):
        _panel(ax, time, kind, kpa, limits)
        ax.set_title(
            "difference between two wheels" if kind[0].difference else "one pressure",
            loc="left",
            fontsize=10,
        )
        ax.set_xlabel("time [s]")
    axes[0].set_ylabel("smallest standard deviation\nof pressure [kPa]")
    _plain(axes[0].yaxis)
    figure.suptitle(
        title or "The best accuracy any estimator can have", x=0.01, ha="left", fontsize=11
    )
    return figure


def _panel(
    ax: Any,
    time: np.ndarray,
    cases: Sequence[BoundCase],
    kpa: float,
    limits: tuple[float, float],
) -> None:
    ax.set(xscale="log", yscale="log", ylim=limits, xlim=(time[0], time[-1]))
    ax.grid(True, which="both", alpha=0.22, linewidth=0.6)
    ax.spines[["top", "right"]].set_visible(False)
    pairs = [c.key for c in cases if c.key.startswith("pair")]
    ends, colours = [], []
    for case in cases:
        stem = case.key.removesuffix("_difference")
        colour = _COLOURS.get(stem, ESTIMATE)
        if case.key in pairs:
            colour = _BLUES[min(pairs.index(case.key), len(_BLUES) - 1)]
        dash = "--" if case.key in pairs else "-"
        ax.plot(time, kpa * case.relative, color=colour, linewidth=1.8, linestyle=dash)
        ends.append(float(kpa * case.relative[-1]))
        colours.append(colour)
    span = np.log(limits[1] / limits[0])
    heights = np.log(np.clip(np.nan_to_num(ends, posinf=limits[1]), *limits) / limits[0]) / span
    for case, height, place, end, colour in zip(
        cases, heights, _spread(heights), ends, colours, strict=True
    ):
        value = f"{end:.2g} kPa, {100 * end / kpa:.2g} %" if np.isfinite(end) else "not seen"
        ax.annotate(
            f"{case.label}: {value}",
            (1.0, height),
            (1.06, place),
            xycoords="axes fraction",
            textcoords="axes fraction",
            fontsize=8,
            color=colour,
            va="center",
            arrowprops={
                "arrowstyle": "-",
                "color": colour,
                "linewidth": 0.6,
                "shrinkA": 0,
                "shrinkB": 0,
                "relpos": (0.0, 0.5),
            },
        )
    _plain(ax.xaxis)


def _spread(heights: np.ndarray) -> np.ndarray:
    """Heights moved apart, as little as it takes, in the same order."""
    order = np.argsort(heights, kind="stable")
    placed = np.array(heights, float)[order]
    for _ in range(200):
        gaps = _APART - np.diff(placed)
        if np.all(gaps < 1e-4):
            break
        for i in np.flatnonzero(gaps > 0):
            push = 0.5 * (_APART - (placed[i + 1] - placed[i]))
            if push > 0:
                placed[i] -= push
                placed[i + 1] += push
    result = np.empty_like(placed)
    result[order] = placed
    return result


def _plain(axis: Any) -> None:
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    axis.set_minor_formatter(NullFormatter())
