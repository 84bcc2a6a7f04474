"""Axes of pressure and of its error: how far they reach, and what counts as near the truth."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from matplotlib.figure import Figure

from wheelhop.evaluation.tracking import TOLERANCE
from wheelhop.plots.panels import reach

TOLERATED_KPA = TOLERANCE / 1e3
"""Error within which an estimate counts as converged [kPa]."""

TOLERATED_LABEL = f"± {TOLERATED_KPA:g} kPa: counts as converged"
ERROR_LABEL = "estimate minus\ntruth [kPa]"

SETTLING = 2.0
"""Time [s] that is not judged at the start."""

_PLAUSIBLE = (0.0, 400.0)
_LARGEST_ERROR = 200.0


def pressure_limits(
    curves: Iterable[np.ndarray], keep: Iterable[np.ndarray]
) -> tuple[float, float]:
    """Of an axis [kPa]: the curves as far as they are plausible, and all of what is kept."""
    seen = np.concatenate([np.ravel(values) for values in curves])
    kept = np.concatenate(list(keep))
    seen, kept = seen[np.isfinite(seen)], kept[np.isfinite(kept)]
    must = (float(kept.min()), float(kept.max())) if kept.size else (100.0, 300.0)
    ends = (float(seen.min()), float(seen.max())) if seen.size else must
    low = min(must[0] - 10.0, max(ends[0], _PLAUSIBLE[0]))
    high = max(must[1] + 10.0, min(ends[1], _PLAUSIBLE[1]))
    pad = 0.06 * (high - low)
    return low - pad, high + pad


def error_limits(curves: Iterable[np.ndarray]) -> tuple[float, float]:
    """Of an axis of errors [kPa]: symmetric, at least the tolerance, at most what is plausible."""
    need = max(reach(values) for values in curves)
    limit = 1.1 * min(max(need, 1.3 * TOLERATED_KPA), _LARGEST_ERROR)
    return -limit, limit


def within(values: np.ndarray, limits: tuple[float, float]) -> np.ndarray:
    """The curve with its far excursions cut short, well outside of what is seen."""
    span = limits[1] - limits[0]
    return np.clip(values, limits[0] - 10 * span, limits[1] + 10 * span)


def late(t: np.ndarray, values: np.ndarray) -> np.ndarray:
    """The finite values after settling; of the whole course where it is shorter."""
    settled = t > SETTLING if t[-1] > SETTLING else np.ones(len(t), bool)
    return values[settled & np.isfinite(values)]


def titled(figure: Figure, title: str) -> Figure:
    """The figure with its headline on the left."""
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    return figure


def all_curves(nested: Mapping[str, Mapping[str, np.ndarray]]) -> list[np.ndarray]:
    """Curves of all filters and cases."""
    return [values for inner in nested.values() for values in inner.values()]
