"""A fit without a road as plain numbers, with units in their names."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from wheelhop.identification.blind import BlindIdentification
from wheelhop.identification.summary import directions_of, parameters_of

SAME_MAXIMUM = 0.5
"""Starts within this log-likelihood of the best one ended at the same maximum."""


class Estimate(NamedTuple):
    """A number that was fitted beside the car.

    Attributes:
        value: in its unit.
        standard_error, robust_error: in that unit; infinite where the records say nothing.
    """

    value: float
    standard_error: float
    robust_error: float

    @property
    def relative_error(self) -> float:
        """The larger of both errors over the value, which is positive."""
        return max(self.standard_error, self.robust_error) / self.value


def estimate_of(found: BlindIdentification, label: str) -> Estimate | None:
    """What was fitted under one of the labels, or None where it was not fitted."""
    if label not in found.labels:
        return None
    return _estimate(found, found.labels.index(label))


def levels_of(found: BlindIdentification) -> list[Estimate]:
    """Gd(W0) of each record's road [m^3/rad]."""
    first = len(found.labels) - len(found.names)
    return [_estimate(found, k) for k in range(first, len(found.labels))]


def starts_at_top(found: BlindIdentification) -> int:
    """How many starts ended at the best maximum."""
    last = found.ascent.loss
    return int(np.sum(last <= last.min() + SAME_MAXIMUM))


def summarise_blind(found: BlindIdentification) -> dict[str, Any]:
    """What `summary.json` holds of a fit without a road: plain Python numbers, lists and text.

    Args:
        found: the identification.
    """
    ascent = found.ascent
    return {
        "parameters": parameters_of(found),
        "roads": [
            {
                "name": name,
                "level_m3_per_rad": level.value,
                "standard_error_m3_per_rad": level.standard_error,
                "robust_standard_error_m3_per_rad": level.robust_error,
                "relative_error": level.relative_error,
                "iso_8608_class": road_class,
                "mean_nis": nis,
            }
            for name, level, road_class, nis in zip(
                found.names, levels_of(found), found.classes, found.nis.tolist(), strict=True
            )
        ],
        "waviness": _beside(found, "waviness", found.waviness, ""),
        "noise_a_s": _beside(found, "noise_a_s", found.noise[0], "_m_per_s2"),
        "noise_a_u": _beside(found, "noise_a_u", found.noise[1], "_m_per_s2"),
        "labels": list(found.labels),
        "correlation": found.uncertainty.correlation.tolist(),
        "directions": directions_of(found),
        "log_likelihood": found.log_likelihood,
        "start_log_likelihood": found.start_log_likelihood,
        "ascent": {
            "iterations": len(ascent.seconds) - 1,
            "evaluations": int(ascent.evaluations[-1]),
            "duration_s": float(ascent.seconds[-1]),
            "converged": ascent.converged.tolist(),
            "log_likelihood": (-ascent.loss).tolist(),
            "starts_at_the_best_maximum": starts_at_top(found),
        },
        "problems": list(found.problems),
    }


def _beside(found: BlindIdentification, label: str, value: float, unit: str) -> dict[str, Any]:
    """A number that may have been fitted beside the car, with its errors if it was."""
    fitted = estimate_of(found, label)
    known: dict[str, Any] = {f"value{unit}": value, "fitted": fitted is not None}
    if fitted is not None:
        known[f"standard_error{unit}"] = fitted.standard_error
        known[f"robust_standard_error{unit}"] = fitted.robust_error
        known["relative_error"] = fitted.relative_error
    return known


def _estimate(found: BlindIdentification, k: int) -> Estimate:
    known = found.uncertainty
    numbers = (found.estimates[k], known.standard_errors[k], known.robust_errors[k])
    return Estimate(*(float(number) for number in numbers))
