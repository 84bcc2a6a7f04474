"""Loads from noisy sensors beside the truth, with what the estimators state: Fig. 10."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from wheelhop.errors import InputError
from wheelhop.plots.panels import legend_below, note_cut, panel_grid
from wheelhop.plots.style import BAND, ESTIMATE, TRUTH

_KILO = 1e-3
_ROOM = 0.15


class NoisyLoad(NamedTuple):
    """An estimate and the standard deviation that it states [N], [time]."""

    load: np.ndarray
    sigma: np.ndarray


def plot_noisy_loads(
    time: np.ndarray,
    true: np.ndarray,
    estimates: Mapping[str, NoisyLoad],
    window: tuple[float, float],
    title: str = "",
) -> Figure:
    """A panel for each estimator on one scale: truth, estimate, two standard deviations stated.

    A band that is wider than the panel is cut, and the panel says so.

    Args:
        time: [s], [time].
        true: load [N], [time].
        estimates: by the panel's headline.
        window: begin and end of what is drawn [s].
        title: headline of the figure.

    Raises:
        InputError: if there is no estimate, lengths differ, or the window is empty.
    """
    if not estimates:
        raise InputError("estimates", "there is none", "Give one or more.")
    for name, estimate in estimates.items():
        if {np.shape(true), *map(np.shape, estimate)} != {np.shape(time)}:
            raise InputError("estimates", f"{name!r} has another length", "Give one per time.")
    inside = (time >= window[0]) & (time <= window[1])
    if inside.sum() < 2:
        raise InputError("window", f"{window} holds no samples", "Choose it within the record.")
    t = time[inside]
    truth, curves = _KILO * true[inside], {}
    for name, estimate in estimates.items():
        curves[name] = NoisyLoad(_KILO * estimate.load[inside], _KILO * estimate.sigma[inside])
    limits = _limits([truth, *(curve.load for curve in curves.values())])
    figure, grid = panel_grid(len(curves), 1, width=9.0, height=2.05, sharex=True, sharey=True)
    axes = list(grid[:, 0])
    for ax, (name, curve) in zip(axes, curves.items(), strict=True):
        low, high = curve.load - 2.0 * curve.sigma, curve.load + 2.0 * curve.sigma
        ax.fill_between(
            t, low, high, color=BAND, alpha=0.5, linewidth=0, label="two standard deviations stated"
        )
        ax.plot(t, curve.load, color=ESTIMATE, linewidth=0.9, label="estimate")
        ax.plot(t, truth, color=TRUTH, linewidth=1.5, label="truth")
        # the last sample of an estimator with a delay is unknown, and nothing to speak of
        known = np.isfinite(low)
        note_cut(ax, {"band": np.concatenate([low[known], high[known]])}, limits, "kN")
        ax.set_title(name, loc="left", fontsize=10)
        ax.set_ylabel("load [kN]")
    axes[0].set_ylim(*limits)
    axes[0].set_xlim(float(t[0]), float(t[-1]))
    axes[-1].set_xlabel("time [s]")
    legend_below(figure, axes, 3)
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    return figure


def _limits(curves: list[np.ndarray]) -> tuple[float, float]:
    """Round the estimates and the truth, not their bands."""
    low = min(float(np.nanmin(curve)) for curve in curves)
    high = max(float(np.nanmax(curve)) for curve in curves)
    room = _ROOM * (high - low) or 1.0
    return low - room, high + room
