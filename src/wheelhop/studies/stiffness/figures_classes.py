"""Figures of the stiffness study on exact classes, with the numbers behind them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from matplotlib.figure import Figure

from wheelhop.plots.panels import legend_below, panel_grid
from wheelhop.plots.style import ALERT, BAND, CLASS_COLOURS, ESTIMATE, MUTED, TRUTH
from wheelhop.studies.frame import StudyFigure
from wheelhop.studies.stiffness.claims import rms
from wheelhop.studies.stiffness.claims_classes import LARGEST_AT_CHANGE, LARGEST_RMS
from wheelhop.studies.stiffness.exact_classes import CASES, CHANGE, ExactClasses
from wheelhop.studies.stiffness.figures import headline, log_time, plain_log


def class_figures(result: ExactClasses) -> Iterator[StudyFigure]:
    """The twelve cases, and what happens at changes."""
    columns = {
        "time": np.tile(result.time, len(CASES)),
        "pressure": np.repeat([p for p, _ in CASES], len(result.time)),
        "road_class": np.repeat([c for _, c in CASES], len(result.time)),
        "rms": rms(result.error).ravel(),
        "bound": result.bound.ravel(),
    }
    yield StudyFigure(
        "exact_classes",
        draw_classes(result),
        columns,
        {"time": "s", "pressure": "Pa", "rms": "Pa", "bound": "Pa"},
        "Rms error of the pressure on exact classes, the class unknown, and the bound with the "
        "class known (dashed).",
    )
    middle, low, high = np.quantile(result.leak, [0.5, 0.1, 0.9], axis=0)
    columns = {"time": result.time, "leak_truth": result.leak_truth, "leak_median": middle}
    columns |= {"leak_low": low, "leak_high": high}
    for name, error in result.change_error.items():
        columns[f"rms_{name.replace(' ', '_')}"] = rms(error)
        columns[f"bound_{name.replace(' ', '_')}"] = result.change_bound[name]
    units = {name: "s" if name == "time" else "Pa" for name in columns}
    yield StudyFigure(
        "changes",
        draw_changes(result),
        columns,
        units,
        "Rms error of the pressure through changes of the road, and a tyre that loses 50 kPa "
        "within 1.5 s.",
    )


def draw_classes(result: ExactClasses) -> Figure:
    """Rms error of the pressure over time, a panel for each pressure."""
    pressures = list(dict.fromkeys(p for p, _ in CASES))
    figure, axes = panel_grid(1, len(pressures), height=3.2, sharey=True)
    over_time = rms(result.error) / 1e3
    for ax, pressure in zip(axes[0], pressures, strict=True):
        for (p, letter), error, best in zip(CASES, over_time, result.bound / 1e3, strict=True):
            if p == pressure:
                colour = CLASS_COLOURS[letter]
                ax.plot(result.time, error, color=colour, linewidth=1.4, label=f"class {letter}")
                ax.plot(result.time, best, color=colour, linewidth=1.0, linestyle="--")
        ax.plot([], [], color=MUTED, linestyle="--", label="bound, class known")
        ax.plot(
            [2.0, result.time[-1]],
            [LARGEST_RMS / 1e3] * 2,
            color=ALERT,
            linewidth=2.0,
            label="target, 7 kPa from 2 s on",
        )
        ax.set_title(f"{pressure / 1e3:.0f} kPa", loc="left", fontsize=10)
        ax.set(yscale="log", ylim=(2.0, 60.0))
        log_time(ax, 0.2, result.time[-1])
        plain_log(ax.yaxis, (2, 5, 7, 10, 20, 50))
    axes[0, 0].set_ylabel("rms error of pressure [kPa]")
    legend_below(figure, axes.flat, 6)
    headline(figure, "Pressure on a road of an exact class that nobody named")
    return figure


def draw_changes(result: ExactClasses) -> Figure:
    """Rms error through changes of the road, and the leak."""
    figure, axes = panel_grid(1, 3, height=3.2)
    for ax, (name, error) in zip(axes[0], result.change_error.items(), strict=False):
        ax.plot(result.time, rms(error) / 1e3, color=ESTIMATE, linewidth=1.4, label="rms error")
        best = result.change_bound[name] / 1e3
        ax.plot(result.time, best, color=MUTED, linestyle="--", label="bound, class known")
        target = LARGEST_AT_CHANGE / 1e3
        for low, high in ((0.5, CHANGE), (CHANGE + 0.5, result.time[-1])):
            ax.plot([low, high], [target] * 2, color=ALERT, linewidth=2.0, label="target, 15 kPa")
        ax.axvline(CHANGE, color=TRUTH, linewidth=0.8, linestyle=":")
        ax.set(ylim=(0.0, 25.0), xlim=(0.0, result.time[-1]))
        ax.set_title(f"road from class {name}", loc="left", fontsize=10)
        ax.set_xlabel("time [s]")
    axes[0, 0].set_ylabel("rms error of pressure [kPa]")
    ax = axes[0, 2]
    middle, low, high = np.quantile(result.leak, [0.5, 0.1, 0.9], axis=0) / 1e3
    ax.fill_between(
        result.time, low, high, color=BAND, alpha=0.6, linewidth=0, label="80 % of runs"
    )
    ax.plot(result.time, middle, color=ESTIMATE, linewidth=1.4, label="median estimate")
    ax.plot(result.time, result.leak_truth / 1e3, color=TRUTH, linewidth=1.4, label="truth")
    ax.set(ylim=(150.0, 260.0), xlim=(3.0, result.time[-1]))
    ax.set_title("50 kPa lost within 1.5 s", loc="left", fontsize=10)
    ax.set_xlabel("time [s]")
    ax.set_ylabel("pressure [kPa]")
    legend_below(figure, axes.flat, 6)
    headline(figure, "A road that changes, and a tyre that leaks, the class unknown")
    return figure
