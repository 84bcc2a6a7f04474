"""Figure of a Monte Carlo campaign, in the layout of Brancati & Tufano 2022, Fig. 6."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from wheelhop.evaluation.consistency import mean_band
from wheelhop.evaluation.errors import ErrorStatistics
from wheelhop.plots.style import ALERT, ESTIMATE, MUTED, TRUTH, legend, new_figure

_SHOWN_RUNS = 60


def plot_campaign(
    t: np.ndarray,
    error: np.ndarray,
    statistics: ErrorStatistics,
    nees: np.ndarray,
    nees_stiffness: np.ndarray,
    title: str = "",
) -> Figure:
    """Pressure errors with their spread and stated sigma, and NEES with its 95 % band.

    Args:
        t: time [s], [time].
        error: pressure errors [Pa], [runs, time].
        statistics: of these errors.
        nees: of the five states, mean over runs, [time].
        nees_stiffness: of ln k_t alone, mean over runs, [time].
        title: headline of the figure.
    """
    figure, (top, bottom) = new_figure(2, height=3.3, sharex=True)
    top.plot(t, error[:_SHOWN_RUNS].T / 1e3, color=MUTED, linewidth=0.4, alpha=0.5)
    top.plot([], [], color=MUTED, linewidth=0.8, label="single runs")
    for sign in (1, -1):
        top.plot(
            t,
            sign * statistics.std / 1e3,
            color=ESTIMATE,
            linestyle="--",
            label="standard deviation of the errors" if sign > 0 else None,
        )
        top.plot(
            t,
            sign * statistics.sigma / 1e3,
            color=TRUTH,
            linestyle=":",
            linewidth=2,
            label="sigma the filter states" if sign > 0 else None,
        )
    top.plot(t, statistics.mean / 1e3, color=ALERT, linewidth=2, label="mean error")
    limit = 1.15 * float(np.percentile(np.abs(error), 99)) / 1e3
    top.set_ylim(-limit, limit)
    top.set_ylabel("pressure error [kPa]")
    top.set_title(title or f"{len(error)} Monte Carlo runs", loc="left", fontsize=11)
    legend(top, ncols=2, loc="upper right")

    runs = len(error)
    curves = (
        (nees, 5, ESTIMATE, "whole state, 5 degrees of freedom"),
        (nees_stiffness, 1, ALERT, "stiffness alone, 1 degree of freedom"),
    )
    for values, dof, colour, label in curves:
        low, high = mean_band(dof, runs)
        bottom.axhspan(low, high, color=colour, alpha=0.25, linewidth=0)
        bottom.plot(t, values, color=colour, label=f"{label} (band: 95 %)")
    bottom.set_yscale("log")
    bottom.set_ylabel("mean NEES [-]")
    bottom.set_xlabel("time [s]")
    legend(bottom, loc="best")
    return figure
