"""Figures of the stiffness study, with the numbers behind them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter

from wheelhop.evaluation.consistency import mean_band
from wheelhop.plots.panels import legend_below, panel_grid
from wheelhop.plots.style import ALERT, BAND, ESTIMATE, MUTED, TRUTH
from wheelhop.studies.frame import StudyFigure
from wheelhop.studies.stiffness import continuous as lone
from wheelhop.studies.stiffness import several_wheels as four
from wheelhop.studies.stiffness.claims import (
    LARGEST_BETWEEN,
    LARGEST_RATIO,
    nees_over_time,
    rms,
    wheel_errors,
    wheel_nees,
)
from wheelhop.studies.stiffness.continuous import Continuous
from wheelhop.studies.stiffness.several_wheels import SeveralWheels

TICKS = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 60)
"""Of time [s]."""

PERCENT = (0.5, 1, 2, 5, 10, 20, 50)
"""Of relative errors [%]."""

_COLOURS = {
    lone.MAIN: ESTIMATE,
    lone.DEFAULT: "#2e7d32",
    "IMM-UKF": ALERT,
    lone.SHAPED: "#ef6c00",
}
_WHEELS = {four.ABSOLUTE: ALERT, four.PAIRS: "#8e24aa", four.AGAINST_MEAN: ESTIMATE}


def continuous_figures(result: Continuous) -> Iterator[StudyFigure]:
    """Every row against the bound."""
    names, count = list(result.tracks), len(result.time)
    columns = {
        "time": np.tile(result.time, len(names)),
        "filter": np.repeat(names, count),
        "rms": np.concatenate([rms(t.error) for t in result.tracks.values()]),
        "nees": np.concatenate([nees_over_time(t) for t in result.tracks.values()]),
        "bound": np.tile(result.bound, len(names)),
    }
    yield StudyFigure(
        "continuous",
        draw_continuous(result),
        columns,
        {"time": "s"},
        "Rms error of ln k_t against the Cramer-Rao bound, road level unknown, and NEES.",
    )


def draw_continuous(result: Continuous) -> Figure:
    """Rms error and NEES of every row over time."""
    figure, axes = panel_grid(1, 2, height=3.6)
    errors, nees = axes[0]
    bound = 100 * result.bound
    errors.fill_between(
        result.time,
        bound,
        LARGEST_RATIO * bound,
        color=BAND,
        alpha=0.7,
        linewidth=0,
        label="target: bound to 1.1 times it",
    )
    errors.plot(result.time, bound, color=TRUTH, linewidth=1.2, linestyle="--", label="bound")
    for name, track in result.tracks.items():
        colour = _COLOURS.get(name, MUTED)
        errors.plot(result.time, 100 * rms(track.error), color=colour, linewidth=1.4, label=name)
        nees.plot(result.time, nees_over_time(track), color=colour, linewidth=1.4)
    runs = next(iter(result.tracks.values())).error.shape[0]
    low, high = mean_band(1, runs)
    nees.axhspan(low, high, color=BAND, alpha=0.7, linewidth=0, label="95 % band of NEES")
    errors.set(yscale="log", ylim=(0.8 * bound[-1], 20.0))
    largest = max(float(nees_over_time(t).max()) for t in result.tracks.values())
    nees.set(yscale="log", ylim=(0.3, min(300.0, max(3.0, 1.5 * largest))))
    for ax in (errors, nees):
        log_time(ax, 0.2, result.time[-1])
    plain_log(errors.yaxis, PERCENT)
    plain_log(nees.yaxis, (0.3, 1, 3, 10, 30, 100, 300))
    errors.set_ylabel("rms error of ln $k_t$ [%]")
    nees.set_ylabel("NEES (1 is honest)")
    legend_below(figure, axes.flat, 4)
    headline(figure, "One corner on a road of unknown roughness")
    return figure


def wheels_figures(result: SeveralWheels) -> Iterator[StudyFigure]:
    """Errors of one wheel and of differences."""
    names, count = list(four.COMBINATIONS), len(result.time)
    columns = {
        "time": np.tile(result.time, len(names)),
        "what": np.repeat(names, count),
        "rms": np.concatenate([_wheel_rms(result, n) for n in names]),
        "bound": np.concatenate([result.bound[n] for n in names]),
        "nees": np.tile(wheel_nees(result), len(names)),
    }
    yield StudyFigure(
        "four_corners",
        draw_wheels(result),
        columns,
        {"time": "s"},
        "Errors of four ln k_t whose roads are equally rough: absolute, and of differences, "
        "against their bounds (dashed).",
    )


def draw_wheels(result: SeveralWheels) -> Figure:
    """Rms of absolute and relative errors over time, and NEES."""
    figure, axes = panel_grid(1, 2, height=3.6)
    errors, nees = axes[0]
    for name in four.COMBINATIONS:
        found = 100 * _wheel_rms(result, name)
        errors.plot(result.time, found, color=_WHEELS[name], linewidth=1.4, label=name)
        best = 100 * result.bound[name]
        errors.plot(result.time, best, color=_WHEELS[name], linewidth=1.0, linestyle="--")
    errors.plot([], [], color=MUTED, linestyle="--", label="bounds")
    last = result.time[-1]
    target = [100 * LARGEST_BETWEEN] * 2
    errors.plot([min(10.0, 0.9 * last), last], target, color=TRUTH, linewidth=2.0, label="target")
    low, high = mean_band(4, len(result.error))
    nees.axhspan(low / 4, high / 4, color=BAND, alpha=0.7, linewidth=0, label="95 % band of NEES")
    nees.plot(result.time, wheel_nees(result) / 4, color=ESTIMATE, linewidth=1.4)
    errors.set(yscale="log", ylim=(0.5, 20.0))
    nees.set(ylim=(0.0, 2.0))
    for ax in (errors, nees):
        log_time(ax, 0.2, last)
    plain_log(errors.yaxis, PERCENT[:-1])
    errors.set_ylabel("rms error of ln $k_t$ [%]")
    nees.set_ylabel("NEES per wheel (1 is honest)")
    legend_below(figure, axes.flat, 3)
    headline(figure, "Four tyres on roads of one unknown roughness")
    return figure


def _wheel_rms(result: SeveralWheels, name: str) -> np.ndarray:
    return np.asarray(np.sqrt(np.mean(wheel_errors(result, name) ** 2, axis=(0, 2))))


def log_time(ax: Any, first: float, last: float) -> None:
    """A logarithmic axis of time [s]."""
    ax.set(xscale="log", xlim=(first, last), xlabel="time [s]")
    plain_log(ax.xaxis, [t for t in TICKS if first <= t <= last])


def plain_log(axis: Any, ticks: Any) -> None:
    """Plain numbers at these places of a logarithmic axis."""
    axis.set_major_locator(FixedLocator(list(ticks)))
    axis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    axis.set_minor_formatter(NullFormatter())


def headline(figure: Figure, text: str) -> None:
    """A headline of the whole figure."""
    figure.suptitle(text, x=0.01, ha="left", fontsize=11)
