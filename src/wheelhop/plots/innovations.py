"""Figure that validates a filter from its innovations alone."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import chi2

from wheelhop.evaluation.innovations import InnovationReport
from wheelhop.plots.style import ALERT, BAND, ESTIMATE, TRUTH, legend, new_figure

_COLOURS = (ESTIMATE, ALERT, "#2e7d32", "#8e24aa", "#ef6c00", "#607d8b")


def plot_innovations(
    report: InnovationReport, dt: float, title: str = "", window: float | None = None
) -> Figure:
    """Normalised innovations, their autocorrelation, and the NIS in its chi-square band.

    Args:
        report: from `evaluation.innovations.innovation_report`.
        dt: sampling interval [s].
        title: headline of the figure.
        window: span [s] over which the NIS is averaged; a fiftieth of the record by default.
    """
    figure, (top, middle, bottom) = new_figure(3)
    samples = len(report.nis)
    t = dt * np.arange(1, samples + 1)
    for k, (name, colour) in enumerate(zip(report.names, _cycle(report), strict=True)):
        top.plot(t, report.normalised[:, k], color=colour, linewidth=0.5, alpha=0.8, label=name)
    for bound in (-2, 2):
        top.axhline(bound, color=TRUTH, linestyle=":", linewidth=0.9)
    top.set_ylabel("innovation /\nstated sigma [-]")
    top.set_xlabel("time [s]")
    top.set_xlim(0, t[-1])
    verdict = "consistent" if report.consistent else "not consistent"
    top.set_title(f"{title or 'Innovations'}: {verdict}", loc="left", fontsize=11)
    legend(top, ncols=len(report.names), loc="upper right")

    lags = dt * np.arange(len(report.autocorrelation))
    widest = report.whiteness_bound.max()
    middle.axhspan(-widest, widest, color=BAND, alpha=0.5, linewidth=0, label=_band_name(report))
    share = dt / (len(report.names) + 1)
    for k, (name, colour) in enumerate(zip(report.names, _cycle(report), strict=True)):
        middle.vlines(
            lags[1:] + k * share,
            0,
            report.autocorrelation[1:, k],
            color=colour,
            linewidth=1.5,
            label=f"{name}: {report.outside[k]:.0%} of lags outside",
        )
    middle.axhline(0, color=TRUTH, linewidth=0.6)
    middle.set_ylabel("autocorrelation [-]")
    middle.set_xlabel("lag [s]")
    legend(middle, loc="upper right")

    span = max(1, samples // 50 if window is None else round(window / dt))
    pieces = max(1, samples // span)
    nis = report.nis[: pieces * span].reshape(pieces, -1).sum(axis=1)
    dof = report.dof[: pieces * span].reshape(pieces, -1).sum(axis=1)
    used = dof > 0
    tail = 0.5 * (1.0 - report.probability)
    low, high = (chi2.ppf(q, dof[used]) / dof[used] for q in (tail, 1.0 - tail))
    middles = dt * (span * np.arange(pieces) + 0.5 * (span + 1))[used]
    mean = nis[used] / dof[used]
    bottom.fill_between(middles, low, high, color=BAND, alpha=0.5, label=_band_name(report))
    bottom.plot(
        middles,
        mean,
        color=ESTIMATE,
        marker=".",
        linewidth=1.0,
        label=f"mean over {span * dt:.3g} s",
    )
    bottom.axhline(1.0, color=TRUTH, linestyle=":", linewidth=0.9)
    bottom.set_xlim(0, t[-1])
    bottom.set_ylim(bottom=0)
    bottom.set_ylabel("NIS per degree\nof freedom [-]")
    bottom.set_xlabel("time [s]")
    low_all, high_all = report.mean_nis_band
    bottom.set_title(
        f"whole record {report.mean_nis:.3f}, consistent within {low_all:.3f} to {high_all:.3f}",
        loc="left",
        fontsize=9,
    )
    legend(bottom, ncols=2, loc="best")
    return figure


def _band_name(report: InnovationReport) -> str:
    return f"{report.probability:.0%} band if consistent"


def _cycle(report: InnovationReport) -> list[str]:
    return [_COLOURS[k % len(_COLOURS)] for k in range(len(report.names))]
