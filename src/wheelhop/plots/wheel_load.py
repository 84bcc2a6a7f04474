"""Figure of the four wheels' loads."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from wheelhop.estimators.load_methods import LoadsFound
from wheelhop.plots.panels import legend_below, note_cut, plain
from wheelhop.plots.style import ALERT, BAND, ESTIMATE, MUTED, TRUTH
from wheelhop.vehicle.full_vehicle_parameters import CORNERS

_NAMES = {"FL": "front left", "FR": "front right", "RL": "rear left", "RR": "rear right"}
_LAYOUT: list[Any] = [["FL", "FR"], ["RL", "RR"], ["sum", "sum"]]


def plot_wheel_load(
    found: LoadsFound,
    truth: np.ndarray | None = None,
    settled: float = 0.0,
    title: str = "",
) -> Figure:
    """Load of each wheel where it is on the car, with 2 sigma, and their sum beside the weight.

    Args:
        found: the loads.
        truth: true loads FL, FR, RL, RR [N], [time, 4], if known.
        settled: time from which the loads count [s]; the lowest after it is marked.
        title: headline of the figure.
    """
    figure = Figure(figsize=(9.5, 8.4), layout="constrained")
    axes = figure.subplot_mosaic(_LAYOUT, height_ratios=(1.0, 1.0, 0.8))
    load, sigma, static = (1e-3 * a for a in (found.load, found.sigma, found.static))
    true = None if truth is None else 1e-3 * np.asarray(truth)
    counts = found.t >= settled
    limits = _limits(load[counts], sigma[counts], true, static)
    lowest = _lowest(load, counts)
    for k, corner in enumerate(CORNERS):
        ax = axes[corner]
        _curves(ax, found.t, load[:, k], sigma[:, k], None if true is None else true[:, k])
        ax.axhline(static[k], color=MUTED, linewidth=0.9, label="at rest on level ground")
        ax.axhline(0.0, color=ALERT, linewidth=0.9, label="0: the wheel lifts")
        ax.set_title(_NAMES[corner], loc="left", fontsize=10)
        ax.set_ylim(limits)
        if corner in ("FL", "RL"):
            ax.set_ylabel("load [kN]")
        else:
            ax.tick_params(labelleft=False)
        note_cut(ax, {"": load[counts, k]}, limits, "kN")
        if lowest is not None and lowest[1] == k:
            _mark(ax, found.t, lowest[0], load[lowest[0], k])
    _sum(axes["sum"], found, true, counts)
    for ax in axes.values():
        plain(ax)
        ax.set_xlim(found.t[0], found.t[-1])
    for corner in ("FL", "FR"):
        axes[corner].tick_params(labelbottom=False)
    axes["sum"].set_xlabel("time [s]")
    legend_below(figure, [axes["FL"]], 5)
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    return figure


def _curves(
    ax: Any, t: np.ndarray, load: np.ndarray, sigma: np.ndarray, true: np.ndarray | None
) -> None:
    if np.isfinite(sigma).any():
        ax.fill_between(
            t,
            load - 2.0 * sigma,
            load + 2.0 * sigma,
            color=BAND,
            alpha=0.6,
            linewidth=0,
            label="2 sigma",
        )
    ax.plot(t, load, color=ESTIMATE, linewidth=1.2, label="estimate")
    if true is not None:
        ax.plot(t, true, color=TRUTH, linewidth=0.9, linestyle=(0, (3, 2)), label="true")


def _sum(ax: Any, found: LoadsFound, true: np.ndarray | None, counts: np.ndarray) -> None:
    total, sigma, weight = 1e-3 * found.total, 1e-3 * found.total_sigma, 1e-3 * found.static.sum()
    summed = None if true is None else true.sum(1)
    _curves(ax, found.t, total, sigma, summed)
    ax.axhline(weight, color=MUTED, linewidth=0.9)
    mean = float(np.nanmean(total[counts]))
    ax.set_title(
        f"sum of the loads: on average {mean:.2f} kN, the weight is {weight:.2f} kN",
        loc="left",
        fontsize=10,
    )
    ax.set_ylabel("sum of loads [kN]")
    column = None if summed is None else summed[:, None]
    limits = _limits(total[counts, None], sigma[counts, None], column, np.array([weight]), False)
    ax.set_ylim(limits)


def _limits(
    load: np.ndarray,
    sigma: np.ndarray,
    true: np.ndarray | None,
    static: np.ndarray,
    ground: bool = True,
) -> tuple[float, float]:
    """Room for the loads, the truth and nearly all of the band; for zero where it is asked for."""
    spread = np.nan_to_num(sigma)
    band = np.concatenate([load - 2.0 * spread, load + 2.0 * spread])
    seen = band[np.isfinite(band)]
    edges = list(np.quantile(seen, (0.01, 0.99))) if seen.size else []
    shown = [load[np.isfinite(load)], static] + ([] if true is None else [true[np.isfinite(true)]])
    edges += [bound for part in shown if part.size for bound in (part.min(), part.max())]
    low, high = float(min(edges)), float(max(edges))
    low = min(low, 0.0) if ground else low
    margin = 0.06 * max(high - low, 0.02 * abs(high))
    return low - margin, high + margin


def _lowest(load: np.ndarray, counts: np.ndarray) -> tuple[int, int] | None:
    """Sample and corner of the lowest load that counts."""
    values = np.where(counts[:, None] & np.isfinite(load), load, np.inf)
    if not np.isfinite(values).any():
        return None
    row, corner = np.unravel_index(int(values.argmin()), values.shape)
    return int(row), int(corner)


def _mark(ax: Any, t: np.ndarray, row: int, value: float) -> None:
    ax.plot([t[row]], [value], "o", color=ALERT, markersize=6, zorder=5)
    high = value > 0.4 * ax.get_ylim()[1]
    late = t[row] > 0.5 * (t[0] + t[-1])
    ax.annotate(
        f"lowest: {value:.2f} kN at {t[row]:.2f} s",
        (t[row], value),
        (-8 if late else 8, -3 if high else 6),
        textcoords="offset points",
        ha="right" if late else "left",
        va="top" if high else "bottom",
        fontsize=8,
        color=ALERT,
        bbox={"facecolor": "white", "alpha": 0.8, "edgecolor": "none", "pad": 1.5},
    )
