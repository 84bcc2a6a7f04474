"""Figures of the identification of Brancati & Tufano 2022, Table 3."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatter, LogLocator, NullFormatter

from wheelhop.plots.style import ALERT, ESTIMATE, MUTED, TRUTH, legend, new_figure

_MARKS = ("o", "s", "D", "^", "v", "P")
_COLOURS = (MUTED, ALERT, ESTIMATE, "#74b3e0", "#2e7d32", "#8e24aa")
_WINDOW = 2.0


def plot_overlay(
    t: np.ndarray,
    panels: Mapping[str, Mapping[str, np.ndarray]],
    window: float = _WINDOW,
    title: str = "",
) -> Figure:
    """Wheel acceleration over two seconds, in the manner of their Fig. 5.

    Args:
        t: time [s], [time].
        panels: by headline, three signals [m/s^2] by label, [time]: the vehicle's, the fitted
            model's, the printed set's.
        window: length of the stretch shown [s], from the middle of the record on.
        title: headline of the figure.
    """
    begin = t[0] + 0.5 * max(t[-1] - t[0] - window, 0.0)
    shown = (t >= begin) & (t <= begin + window)
    figure, axes = new_figure(len(panels), height=2.7, sharex=True, sharey=True)
    looks = (
        {"color": TRUTH, "linewidth": 1.6},
        {"color": ESTIMATE, "linewidth": 1.1},
        {"color": ALERT, "linewidth": 1.1, "linestyle": "--"},
    )
    for ax, (headline, signals) in zip(axes, panels.items(), strict=True):
        for (label, values), look in zip(signals.items(), looks, strict=True):
            ax.plot(t[shown], np.asarray(values)[shown], label=label, **look)
        ax.set_ylabel("wheel acceleration [m/s²]")
        ax.set_title(headline, loc="left", fontsize=9)
        ax.margins(x=0)
    legend(axes[0], ncols=3, loc="upper right")
    low, high = axes[0].get_ylim()
    axes[0].set_ylim(low, high + 0.2 * (high - low))
    axes[-1].set_xlabel("time [s]")
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    return figure


def plot_norms(
    classes: Sequence[str],
    norms: Mapping[str, Sequence[float]],
    measured: Sequence[float],
    title: str = "",
) -> Figure:
    """Norm of the acceleration errors of several sets, road class by road class.

    Args:
        classes: ISO 8608 classes.
        norms: of each set by label [m/s^2], [classes].
        measured: norm of the accelerations themselves [m/s^2], [classes].
        title: headline of the figure.
    """
    figure, (ax,) = new_figure(1, height=4.0)
    place = np.arange(len(classes))
    label = "measured: a model that predicts nothing"
    for k, value in enumerate(measured):
        ax.plot([k - 0.4, k + 0.4], [value] * 2, color=TRUTH, label=None if k else label)
    step = 0.6 / max(len(norms) - 1, 1)
    looks = zip(norms.items(), _MARKS, _COLOURS, strict=False)
    for k, ((label, values), mark, colour) in enumerate(looks):
        x = place + (k * step - 0.3 if len(norms) > 1 else 0.0)
        ax.vlines(x, values, measured, color=colour, linewidth=1.0, alpha=0.4)
        ax.plot(x, values, mark, color=colour, label=label, markersize=6)
        for a, b in zip(x, values, strict=True):
            ax.annotate(
                f"{b:.3g}",
                (a, b),
                (0, -6),
                textcoords="offset points",
                ha="center",
                va="top",
                fontsize=7,
                color=colour,
            )
    everything = np.concatenate([np.asarray(measured), *(np.asarray(v) for v in norms.values())])
    ax.set_yscale("log")
    ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    ax.yaxis.set_major_formatter(LogFormatter(minor_thresholds=(np.inf, np.inf)))
    ax.yaxis.set_minor_formatter(NullFormatter())
    ax.set_ylim(0.6 * everything.min(), 4.0 * everything.max())
    ax.set_xticks(place, [f"class {c}" for c in classes])
    ax.set_xlim(-0.6, len(classes) - 0.4)
    ax.set_ylabel("norm of the RMSE [m/s²]")
    ax.set_title(title, loc="left", fontsize=11)
    legend(ax, ncols=2, loc="upper left")
    return figure
