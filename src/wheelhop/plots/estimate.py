"""Figures of one estimate and of one log."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from wheelhop.estimators.pressure_estimate import PressureEstimate
from wheelhop.plots.style import (
    ALERT,
    BAND,
    CLASS_COLOURS,
    ESTIMATE,
    MUTED,
    TRUTH,
    legend,
    new_figure,
)
from wheelhop.vehicle.record import CornerRecord
from wheelhop.vehicle.road import class_level

_CONSISTENCY_WINDOW = 1.0
_PROBABILITY_WINDOW = 0.25


def plot_estimate(
    estimate: PressureEstimate, record: CornerRecord | None = None, title: str = ""
) -> Figure:
    """Pressure with its stated sigma, road class probabilities and innovation consistency.

    Args:
        estimate: what the filter found.
        record: the log; its true pressure is drawn where it is known.
        title: headline of the figure.
    """
    figure, (top, middle, bottom) = new_figure(3, sharex=True)
    t, kpa, sigma = estimate.t, estimate.pressure / 1e3, estimate.pressure_sigma / 1e3
    for width, alpha in ((2, 0.35), (1, 0.6)):
        top.fill_between(
            t,
            kpa - width * sigma,
            kpa + width * sigma,
            color=BAND,
            alpha=alpha,
            linewidth=0,
            label=f"stated {width} sigma",
        )
    top.plot(t, kpa, color=ESTIMATE, linewidth=1.5, label="estimate")
    if record is not None and record.pressure is not None:
        top.plot(t, record.pressure / 1e3, color=TRUTH, linestyle="--", label="true")
    top.set_ylabel("tyre pressure [kPa]")
    top.set_title(title or "Tyre pressure from two accelerometers", loc="left", fontsize=11)
    legend(top, ncols=4, loc="best")

    dt = float(np.median(np.diff(t)))
    window = _samples(_PROBABILITY_WINDOW, dt, len(t))
    if estimate.level is not None and estimate.level_sigma is not None:
        _plot_level(middle, t, estimate.level, estimate.level_sigma)
        _plot_nis(bottom, estimate)
        bottom.set_xlabel("time [s]")
        return figure
    share = np.stack([moving_average(p, window) for p in estimate.mode_probabilities.T])
    middle.stackplot(
        t,
        share,
        colors=[CLASS_COLOURS.get(m, MUTED) for m in estimate.modes],
        labels=[f"class {m}" for m in estimate.modes],
        alpha=0.85,
    )
    middle.set_ylim(0, 1)
    middle.set_ylabel(f"road class\nprobability [-]\n(mean over {window * dt:.2g} s)")
    legend(middle, ncols=len(estimate.modes), loc="lower right")

    _plot_nis(bottom, estimate)
    bottom.set_xlabel("time [s]")
    return figure


def _plot_level(ax: Any, t: np.ndarray, level: np.ndarray, sigma: np.ndarray) -> None:
    """Road level with its stated sigma over the levels of the ISO 8608 classes."""
    low, high = level * np.exp(-2 * sigma), level * np.exp(2 * sigma)
    ax.fill_between(t, low, high, color=BAND, alpha=0.5, linewidth=0, label="stated 2 sigma")
    ax.plot(t, level, color=ESTIMATE, linewidth=1.5, label="estimate")
    ax.set_yscale("log")
    settled = slice(len(t) // 10, None)
    bottom, top = 0.4 * float(low[settled].min()), 2.5 * float(high[settled].max())
    for name, colour in CLASS_COLOURS.items():
        centre = class_level(name)
        if bottom < centre < top:
            ax.axhline(centre, color=colour, linestyle="--", linewidth=1)
            ax.annotate(
                f"class {name}",
                (1.0, centre),
                xycoords=("axes fraction", "data"),
                xytext=(-4, 2),
                textcoords="offset points",
                ha="right",
                fontsize=8,
                color=colour,
            )
    ax.set_ylim(bottom, top)
    ax.set_ylabel("road level\n$G_d$(1 rad/m) [m³/rad]")
    legend(ax, ncols=2, loc="upper left")


def _plot_nis(ax: Any, estimate: PressureEstimate) -> None:
    """Moving average of the NIS of complete samples against a fitting single filter's mean."""
    t = estimate.t
    dt = float(np.median(np.diff(t)))
    window = _samples(_CONSISTENCY_WINDOW, dt, len(t))
    average = moving_average(np.where(estimate.missing == 0, estimate.nis, np.nan), window)
    ax.axhline(2.0, color=TRUTH, linestyle=":", label="2: a single filter whose model fits")
    ax.plot(t, average, color=ALERT, linewidth=1.2, label=f"mean over {window * dt:.2g} s")
    ax.set_ylabel("innovation\nNIS [-]")
    top = np.nanmax(average) if np.isfinite(average).any() else 0.0
    ax.set_ylim(0, max(4.0, 1.3 * top))
    legend(ax, ncols=2, loc="upper right")


def moving_average(values: np.ndarray, window: int) -> np.ndarray:
    """Centred mean over up to `window` finite samples, shorter at the ends, [time]."""
    finite = np.isfinite(values)
    kernel = np.ones(window)
    total = np.convolve(np.where(finite, values, 0.0), kernel, mode="same")
    count = np.convolve(finite.astype(float), kernel, mode="same")
    return np.divide(total, count, out=np.full(len(values), np.nan), where=count > 0.25 * window)


def _samples(seconds: float, dt: float, most: int) -> int:
    return max(1, min(round(seconds / dt), most))


def plot_log(record: CornerRecord, title: str = "") -> Figure:
    """The two accelerations of a log, and its true pressure where that is known."""
    known = record.pressure is not None
    figure, axes = new_figure(3 if known else 2, height=2.2, sharex=True)
    axes[0].plot(record.t, record.a_s, color=ESTIMATE, linewidth=0.5)
    axes[0].set_ylabel("body $a_s$ [m/s²]")
    axes[0].set_title(title or "Log of one corner", loc="left", fontsize=11)
    axes[1].plot(record.t, record.a_u, color=ALERT, linewidth=0.5)
    axes[1].set_ylabel("wheel $a_u$ [m/s²]")
    if known:
        axes[2].plot(record.t, np.asarray(record.pressure) / 1e3, color=TRUTH)
        axes[2].set_ylabel("true pressure [kPa]")
    axes[-1].set_xlabel("time [s]")
    return figure
