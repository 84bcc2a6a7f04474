"""How the tuning of filters went: objective by iteration, and what became of each knob."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from wheelhop.errors import InputError
from wheelhop.estimators.tuning import Tuned
from wheelhop.plots.panels import filter_colours, legend_below, note_cut, plain, tame
from wheelhop.plots.style import MUTED, TRUTH

_OBJECTIVES = {
    "mse": ("mean-square error of $k_t$", "(kN/m)²"),
    "nll": ("negative log-likelihood", "nats per sample"),
    "log_score": ("log score of $k_t$", "nats per sample"),
}


def plot_tuning(
    histories: Mapping[str, Tuned],
    title: str = "",
    *,
    floors: Mapping[str, float] | None = None,
) -> Figure:
    """Objective on the training runs by iteration, on the test runs at both ends, and the knobs.

    Args:
        histories: of the filters by name.
        title: headline of the figure.
        floors: what a constant prior scores, by name of the objective, in its unit.

    Raises:
        InputError: without a history.
    """
    if not histories:
        raise InputError("histories", "there are none", "Give at least one filter.")
    objectives = list(dict.fromkeys(tuned.settings.objective for tuned in histories.values()))
    knobs = list(dict.fromkeys(name for tuned in histories.values() for name in tuned.tuning))
    height = max(2.6 * len(objectives), 0.22 * len(knobs) + 0.8, 3.6) + 0.8
    figure = Figure(figsize=(9.0, height), layout="constrained")
    grid = figure.add_gridspec(len(objectives), 2, width_ratios=(1.5, 1.0))
    colours = filter_colours(histories)
    for row, objective in enumerate(objectives):
        ax = figure.add_subplot(grid[row, 0])
        chosen = {
            n: tuned for n, tuned in histories.items() if tuned.settings.objective == objective
        }
        label, unit = _OBJECTIVES.get(objective, (objective, "-"))
        _draw_objective(ax, chosen, colours, (floors or {}).get(objective), unit)
        ax.set_ylabel(f"{label}\n[{unit}]")
    ax.set_xlabel("iteration")
    tested = any(np.isfinite(tuned.test) for tuned in histories.values())
    for face, what in (("white", "start"), (MUTED, "best")) if tested else ():
        look: dict[str, Any] = {"color": MUTED, "markerfacecolor": face, "markersize": 6}
        ax.plot([], [], "D", label=f"{what} on the test runs", **look)
    _draw_knobs(figure.add_subplot(grid[:, 1]), histories, knobs, colours)
    legend_below(figure, figure.axes[:-1], 2)
    for ax in figure.axes:
        plain(ax)
    figure.suptitle(title or "Tuning through the filters", x=0.01, ha="left", fontsize=11)
    return figure


def _draw_objective(
    ax: Any,
    histories: Mapping[str, Tuned],
    colours: Mapping[str, str],
    floor: float | None,
    unit: str,
) -> None:
    """Curves of training, and the test values where tuning starts and at the best met."""
    curves = {name: tame(tuned.history) for name, tuned in histories.items()}
    tests = {
        name: (tame(tuned.start_test).item(), tame(tuned.test).item())
        for name, tuned in histories.items()
    }
    shown = [*curves.values(), *(np.array(ends) for ends in tests.values())]
    shown += [] if floor is None else [np.array([floor])]
    limits, logarithmic = _limits(shown)
    if logarithmic:
        ax.set_yscale("log")
    for name, curve in curves.items():
        colour, iteration = colours[name], np.arange(len(curve))
        bad = int(np.isnan(curve).sum())
        label = name + (f" (steps taken back: {bad})" if bad else "")
        ax.plot(iteration, _within(curve, limits, logarithmic), color=colour, lw=1.4, label=label)
        finite = np.isfinite(curve)
        best = int(np.argmin(np.where(finite, curve, np.inf))) if finite.any() else 0
        ends = ((0, tests[name][0], "white"), (best, tests[name][1], colour))
        for at, value, face in ends:
            if np.isfinite(value):
                spot = _within(np.array([value]), limits, logarithmic)
                ax.plot([at], spot, "D", color=colour, markerfacecolor=face, ms=6, zorder=4)
    if floor is not None:
        ax.axhline(floor, color=MUTED, linestyle=":", linewidth=1.5, label="constant prior")
    ax.set_ylim(limits)
    finite = np.concatenate([curve[np.isfinite(curve)] for curve in curves.values()])
    note_cut(ax, {"": finite}, limits, unit)
    ax.set_title("lines: training runs", loc="left", fontsize=9)


def _limits(curves: Iterable[np.ndarray]) -> tuple[tuple[float, float], bool]:
    """Of the axis, without the rare excursions of a descent; and whether it is logarithmic."""
    values = np.concatenate(list(curves))
    values = values[np.isfinite(values)]
    if not values.size:
        return (0.0, 1.0), False
    calm = float(np.quantile(values, 0.95))
    low, high = float(values.min()), float(values.max())
    if low > 0:
        return (low / 1.3, 1.3 * min(high, 10.0 * calm)), True
    spread = calm - low
    high = min(high, calm + spread)
    pad = 0.08 * (high - low) or 1.0
    return (low - pad, high + pad), False


def _within(values: np.ndarray, limits: tuple[float, float], logarithmic: bool) -> np.ndarray:
    """The values with far excursions cut short, well outside of what is seen."""
    span = limits[1] - limits[0]
    top = 1e3 * limits[1] if logarithmic else limits[1] + 10 * span
    return np.minimum(values, top)


def _draw_knobs(
    ax: Any, histories: Mapping[str, Tuned], knobs: list[str], colours: Mapping[str, str]
) -> None:
    """Tuned over start on an axis of powers of ten; knobs that were held are hollow."""
    ax.axvline(0, color=TRUTH, linewidth=0.8)
    lanes = max(len(histories), 1)
    furthest = 0.1
    for k, (name, tuned) in enumerate(histories.items()):
        for knob, value in tuned.tuning.items():
            with np.errstate(divide="ignore", invalid="ignore"):
                moved = float(np.subtract(*np.log10([value, tuned.start[knob]])))
            if not np.isfinite(moved):
                continue
            furthest = max(furthest, abs(moved))
            y = knobs.index(knob) + 0.5 * ((k + 0.5) / lanes - 0.5)
            ax.plot([0, moved], [y, y], color=colours[name], linewidth=1.2)
            face = "white" if knob in tuned.settings.held else colours[name]
            ax.plot([moved], [y], "o", color=colours[name], markerfacecolor=face, markersize=4.5)
    ax.set_yticks(range(len(knobs)), knobs, fontsize=8)
    ax.set_ylim(len(knobs) - 0.4, -0.6)
    ax.set_xlim(-1.1 * furthest, 1.1 * furthest)
    ax.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:+g}" if x else "0"))
    ax.set_xlabel("log10 of tuned over start [-]")
    ax.set_title("how far each knob moved", loc="left", fontsize=9)
