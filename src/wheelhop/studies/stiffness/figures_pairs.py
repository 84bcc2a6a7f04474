"""The figure of the axle pairs, with the numbers behind it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from matplotlib.figure import Figure

from wheelhop.evaluation.consistency import mean_band
from wheelhop.plots.panels import legend_below, panel_grid
from wheelhop.plots.style import BAND, ESTIMATE, MUTED
from wheelhop.studies.frame import StudyFigure
from wheelhop.studies.stiffness.axle_pairs import AxlePairs, PairTrack
from wheelhop.studies.stiffness.claims_pairs import LARGEST_RATIO, pair_nees
from wheelhop.studies.stiffness.figures import PERCENT, headline, log_time, plain_log

_COLOURS = (ESTIMATE, "#ef6c00", "#2e7d32")


def pair_figures(result: AxlePairs) -> Iterator[StudyFigure]:
    """Errors of either wheel against the bound."""
    names, count = list(result.tracks), len(result.time)
    tracks = list(result.tracks.values())
    columns = {
        "time": np.tile(result.time, len(names)),
        "coherence": np.repeat(names, count),
        "rms": np.concatenate([_rms(t) for t in tracks]),
        "bound": np.concatenate([t.bound for t in tracks]),
        "nees": np.concatenate([pair_nees(t) for t in tracks]),
    }
    yield StudyFigure(
        "axle_pair",
        draw_pairs(result),
        columns,
        {"time": "s"},
        "Rms error of ln k_t of either wheel of an axle pair against its bound (dashed), level of "
        "the road and delay unknown.",
    )


def draw_pairs(result: AxlePairs) -> Figure:
    """Rms error of either wheel and NEES over time."""
    figure, axes = panel_grid(1, 2, height=3.6)
    errors, nees = axes[0]
    for (coherence, track), colour in zip(result.tracks.items(), _COLOURS, strict=False):
        label = f"coherence {coherence:g}"
        errors.plot(result.time, 100 * _rms(track), color=colour, linewidth=1.4, label=label)
        best = 100 * track.bound
        errors.plot(result.time, best, color=colour, linewidth=1.0, linestyle="--")
        band = {"color": colour, "alpha": 0.12, "linewidth": 0}
        errors.fill_between(result.time, best, LARGEST_RATIO * best, **band)
        nees.plot(result.time, pair_nees(track) / 2, color=colour, linewidth=1.4)
    errors.plot([], [], color=MUTED, linestyle="--", label="bound")
    errors.fill_between([], [], [], color=MUTED, alpha=0.2, label="target: bound to 1.5 times it")
    low, high = mean_band(2, len(next(iter(result.tracks.values())).error))
    nees.axhspan(low / 2, high / 2, color=BAND, alpha=0.7, linewidth=0, label="95 % band of NEES")
    largest = max(pair_nees(t).max() for t in result.tracks.values()) / 2
    errors.set(yscale="log", ylim=(1.0, 15.0))
    nees.set(yscale="log", ylim=(0.3, max(3.0, 1.3 * float(largest))))
    for ax in (errors, nees):
        log_time(ax, 0.2, result.time[-1])
    plain_log(errors.yaxis, PERCENT)
    plain_log(nees.yaxis, (0.3, 0.5, 1, 2, 3, 5, 10, 20, 50, 100))
    errors.set_ylabel("rms error of ln $k_t$ [%]")
    nees.set_ylabel("NEES per wheel (1 is honest)")
    legend_below(figure, axes.flat, 3)
    headline(figure, "Front and rear wheel in one track, level and delay unknown")
    return figure


def _rms(track: PairTrack) -> np.ndarray:
    return np.asarray(np.sqrt(np.mean(track.error**2, axis=(0, 2))))
