"""What the study must show on axle pairs, against what it measured."""

from __future__ import annotations

from typing import Any

import numpy as np

from wheelhop.evaluation.consistency import mean_band
from wheelhop.evaluation.tracking import Interval
from wheelhop.io.report import DataTable, Finding
from wheelhop.studies.frame import verdict_of
from wheelhop.studies.stiffness.axle_pairs import REPORTED, AxlePairs, PairTrack
from wheelhop.studies.stiffness.claims import at_time, scaled
from wheelhop.studies.stiffness.runs import at, reported

LARGEST_RATIO = 1.5
"""Of the rms of ln k_t over its bound."""


def pair_findings(result: AxlePairs) -> list[Finding]:
    """Claims on a front and a rear corner in one track."""
    return [_finding(result, coherence) for coherence in result.tracks]


def _finding(result: AxlePairs, coherence: float) -> Finding:
    track = result.tracks[coherence]
    shown = reported(float(result.time[-1]), REPORTED)
    ratios = {t: pair_ratio(result, track, t) for t in shown}
    low, high = mean_band(2, len(track.error))
    nees = pair_nees(track)
    middle = {t: median_ratio(result, track, t) for t in shown}
    return Finding(
        "axle pair",
        f"coherence {coherence:g}: rms error of ln k_t within 1.5 of its bound",
        "; ".join(
            f"{r.value:.2f} ({r.low:.2f} to {r.high:.2f}) at {t:g} s" for t, r in ratios.items()
        ),
        verdict_of(r.value <= LARGEST_RATIO for r in ratios.values()),
        "The bound knows neither the road's level nor the delay between the wheels. "
        "By the median of the errors instead of their squares: "
        + "; ".join(f"{r:.2f} at {t:g} s" for t, r in middle.items())
        + ". NEES of both tyres: "
        + "; ".join(f"{nees[at(result.time, t)]:.2f} at {t:g} s" for t in shown)
        + f"; band {low:.2f} to {high:.2f}.",
    )


def pair_ratio(result: AxlePairs, track: PairTrack, wanted: float) -> Interval:
    """Rms of both ln k_t over the bound, with its interval."""
    best = float(track.bound[at(result.time, wanted)])
    return scaled(at_time(track.error, result.time, wanted), 1.0 / best)


def median_ratio(result: AxlePairs, track: PairTrack, wanted: float) -> float:
    """Standard deviation that the median error of a Gaussian would mean, over the bound."""
    k = at(result.time, wanted)
    return float(np.median(np.abs(track.error[:, k])) / 0.67449 / track.bound[k])


def pair_nees(track: PairTrack) -> np.ndarray:
    """Mean over the runs of the normalised square of both errors, [time]; 2 is honest."""
    solved = np.linalg.solve(track.cov, track.error[..., None])[..., 0]
    return np.asarray(np.mean(np.sum(track.error * solved, axis=-1), axis=0))


def pair_tables(result: AxlePairs) -> list[DataTable]:
    """Errors beside their bounds."""
    shown = reported(float(result.time[-1]), REPORTED)
    columns: dict[str, list[Any]] = {"coherence": [f"{c:g}" for c in result.tracks]}
    for t in shown:
        k, entries = at(result.time, t), []
        for track in result.tracks.values():
            error, ratio = at_time(track.error, result.time, t), pair_ratio(result, track, t)
            entries.append(
                f"{100 * error.value:.2f} %, bound {100 * track.bound[k]:.2f} %, ratio "
                f"{ratio.value:.2f} ({ratio.low:.2f} to {ratio.high:.2f}), "
                f"NEES / 2 {pair_nees(track)[k] / 2:.2f}"
            )
        columns[f"{t:g} s"] = entries
    return [DataTable("Error of ln k_t of either wheel of an axle pair", columns)]


def pair_numbers(result: AxlePairs) -> dict[str, Any]:
    """Every figure of the axle pairs; ln k_t, no unit."""
    shown = reported(float(result.time[-1]), REPORTED)
    return {
        f"coherence {coherence:g}": {
            f"{t:g} s": {
                "rms": at_time(track.error, result.time, t)._asdict(),
                "bound": track.bound[at(result.time, t)],
                "over_bound": pair_ratio(result, track, t)._asdict(),
                "median_over_bound": median_ratio(result, track, t),
                "rms_of_the_difference": at_time(
                    track.error[..., 0] - track.error[..., 1], result.time, t
                )._asdict(),
                "nees": pair_nees(track)[at(result.time, t)],
            }
            for t in shown
        }
        for coherence, track in result.tracks.items()
    }
