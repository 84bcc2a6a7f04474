"""Figures of one estimate and of one log."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from scipy.ndimage import uniform_filter1d

from wheelhop.estimators.estimate import PressureEstimate
from wheelhop.evaluation.consistency import mean_band
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

_CONSISTENCY_WINDOW = 1.0


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

    middle.stackplot(
        t,
        estimate.mode_probabilities.T,
        colors=[CLASS_COLOURS.get(m, MUTED) for m in estimate.modes],
        labels=[f"class {m}" for m in estimate.modes],
        alpha=0.85,
    )
    middle.set_ylim(0, 1)
    middle.set_ylabel("road class\nprobability [-]")
    legend(middle, ncols=len(estimate.modes), loc="lower right")

    _plot_nis(bottom, estimate)
    bottom.set_xlabel("time [s]")
    return figure


def _plot_nis(ax, estimate: PressureEstimate) -> None:
    """Moving average of the NIS of fully measured samples against its 95 % band."""
    t = estimate.t
    dt = float(np.median(np.diff(t)))
    window = max(1, min(int(round(_CONSISTENCY_WINDOW / dt)), len(t)))
    low, high = mean_band(2, window)
    complete = (estimate.missing == 0).astype(float)
    weight = uniform_filter1d(complete, window, mode="nearest")
    total = uniform_filter1d(estimate.nis * complete, window, mode="nearest")
    average = np.divide(total, weight, out=np.full_like(total, np.nan), where=weight > 0.5)
    ax.axhspan(low, high, color=BAND, alpha=0.5, label="95 % band of a consistent filter")
    ax.plot(t, average, color=ALERT, linewidth=1.2, label=f"mean over {window * dt:.2g} s")
    ax.set_ylabel("innovation\nNIS [-]")
    ax.set_ylim(0, max(4.0, 1.1 * np.nanmax(average)) if np.isfinite(average).any() else 4.0)
    legend(ax, ncols=2, loc="best")


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
