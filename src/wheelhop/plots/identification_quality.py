"""Figures of an identification itself: its descent, and how well it knows the parameters."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import LogFormatterSciNotation, LogLocator

from wheelhop.identification.identify import Identification
from wheelhop.identification.summary import AnyIdentification, descent_norms, relative_errors
from wheelhop.identification.uncertainty import WEAK
from wheelhop.plots.style import ALERT, BAND, ESTIMATE, MUTED, TRUTH, legend, new_figure

_MOST_PERCENT = 1e4


def plot_descent(found: Identification, title: str = "") -> Figure:
    """Loss norm of every start over iterations and over time, the warm-up shaded.

    Args:
        found: the identification.
        title: headline of the figure.
    """
    figure, axes = new_figure(2, height=3.2, sharey=True)
    norms, seconds = descent_norms(found), np.asarray(found.descent.seconds)
    iterations = np.arange(len(norms))
    best = int(np.argmin(found.descent.loss))
    warm = min(found.descent.warm_up, len(norms) - 1)
    measured = float(np.linalg.norm(found.measured_rms))
    for ax, x in zip(axes, (iterations, seconds), strict=True):
        ax.axvspan(x[0], x[warm], color=BAND, alpha=0.3, linewidth=0, label="warm-up (Adam)")
        ax.axhline(measured, color=TRUTH, linestyle=":", label="norm of the measurements")
        for k in range(norms.shape[1]):
            if k != best:
                others = "other starts" if k == (1 if best == 0 else 0) else None
                ax.plot(x, norms[:, k], color=MUTED, linewidth=1.0, alpha=0.8, label=others)
        ax.plot(
            x,
            norms[:, best],
            color=ESTIMATE,
            linewidth=2.0,
            marker=".",
            label=f"best start: {found.loss:.4g} m/s²",
        )
        ax.set_yscale("log")
        ax.set_ylabel("norm of the rms\nerrors [m/s²]")
        ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        ax.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        ax.yaxis.set_minor_formatter(lambda value, _: "")
    axes[0].set_xlabel("iteration [-]")
    axes[1].set_xlabel("time, compiling included [s]")
    axes[1].set_xlim(left=0.0)
    axes[0].set_title(
        title or f"Descent from {norms.shape[1]} starting points", loc="left", fontsize=11
    )
    legend(axes[0], loc="upper right")
    return figure


def plot_correlation(found: Identification, title: str = "") -> Figure:
    """Correlation of the estimates, and their relative standard errors.

    Args:
        found: the identification.
        title: headline of the figure.
    """
    n = len(found.space.names)
    labels = parameter_labels(found)
    size = 2.4 + 0.75 * n
    figure = Figure(
        figsize=(size + 6.0, max(size - 0.4, 3.6)), layout=ConstrainedLayoutEngine(wspace=0.06)
    )
    left, right = figure.subplots(1, 2, width_ratios=[1.25, 1.0])
    _matrix(figure, left, found.uncertainty.correlation, labels)
    draw_relative_errors(right, found)
    figure.suptitle(title or "How well the records determine the parameters", fontsize=11)
    return figure


def _matrix(figure: Figure, ax: Any, correlation: np.ndarray, labels: list[str]) -> None:
    n = len(labels)
    image = ax.imshow(correlation, vmin=-1.0, vmax=1.0, cmap="RdBu_r")
    for i in range(n):
        for j in range(n):
            value = correlation[i, j]
            text = f"{value:+.2f}" if np.isfinite(value) else "held"
            dark = np.isfinite(value) and abs(value) > 0.6
            ax.text(j, i, text, ha="center", va="center", color="white" if dark else TRUTH)
    ax.set_xticks(range(n), labels, rotation=35, ha="right", rotation_mode="anchor", fontsize=8)
    ax.set_yticks(range(n), labels, fontsize=8)
    ax.set_title("correlation of the estimates", fontsize=10)
    figure.colorbar(image, ax=ax, label="correlation [-]", shrink=0.85)


def draw_relative_errors(
    ax: Any, found: AnyIdentification, plain: str = "for white residuals", below: float = 0.16
) -> None:
    """Bars of relative errors on a logarithmic axis; words where there is no number.

    Args:
        ax: to draw on.
        found: the identification.
        plain: what the standard errors that are not robust hold for.
        below: distance of the legend from the axes, in heights of these.
    """
    labels = parameter_labels(found)
    known, size = found.uncertainty, np.abs(found.values)
    n = len(size)
    place = np.arange(len(labels))
    with np.errstate(divide="ignore", invalid="ignore"):
        percent = [100.0 * e[:n] / size for e in (known.standard_errors, known.robust_errors)]
    both = [np.where(np.isfinite(p), np.minimum(p, _MOST_PERCENT), np.nan) for p in percent]
    shown = np.concatenate(both)
    shown = shown[np.isfinite(shown) & (shown > 0)]
    low, high = (shown.min(), shown.max()) if shown.size else (0.1, 10.0)
    floor, roof = low / 10.0, max(10.0 * high, 200.0 * WEAK)
    looks = ((ESTIMATE, plain, -0.2), (ALERT, "robust, by blocks", 0.2))
    for values, (colour, label, shift) in zip(both, looks, strict=True):
        drawn = np.isfinite(values) & (values > 0)
        ax.barh(
            place[drawn] + shift,
            values[drawn] - floor,
            0.36,
            left=floor,
            color=colour,
            alpha=0.85,
            label=label,
        )
        for y, value in zip(place[drawn] + shift, values[drawn], strict=True):
            ax.text(1.15 * value, y, _percent(value), va="center", fontsize=8)
    for k, error in enumerate(relative_errors(found)):
        if not np.isfinite(error):
            word = f"at its {found.at_bound[k]} bound" if found.at_bound[k] else "not determined"
            ax.text(1.3 * floor, k, word, va="center", fontsize=9, color=ALERT)
    ax.axvline(100.0 * WEAK, color=TRUTH, linestyle=":", label="hardly determined beyond")
    ax.set_xscale("log")
    ax.set_xlim(floor, roof)
    ax.xaxis.set_major_formatter(LogFormatterSciNotation())
    ax.set_ylim(len(labels) - 0.4, -0.6)
    ax.set_yticks(place, labels, fontsize=8)
    ax.set_xlabel("standard error over the value [%]")
    ax.set_title("relative standard errors", fontsize=10)
    ax.grid(True, axis="x", alpha=0.25, linewidth=0.6)
    ax.spines[["top", "right"]].set_visible(False)
    legend(ax, loc="upper center", bbox_to_anchor=(0.5, -below), ncols=3)


def parameter_labels(found: AnyIdentification) -> list[str]:
    """Names of the car's fitted parameters in two lines."""
    return [_label(name) for name in found.space.names]


def _label(name: str) -> str:
    part, _, field = name.rpartition(".")
    return f"{part}\n{field}".strip().replace("_", " ")


def _percent(value: float) -> str:
    if value >= _MOST_PERCENT:
        return f"> {_MOST_PERCENT:.0f} %"
    return f"{value:.2g} %" if value < 100 else f"{value:.0f} %"
