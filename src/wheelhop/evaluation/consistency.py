"""Is a filter's covariance honest? NEES and NIS against their chi-square bands."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.stats import chi2

from wheelhop.filtering import Gaussian, normalised_square


def nees(belief: Gaussian, truth: Any) -> Any:
    """Normalised estimation error squared (x - m)^T P^-1 (x - m).

    Chi-square with n degrees of freedom if the filter is consistent (Bar-Shalom, Li &
    Kirubarajan 2001, section 5.4).

    Args:
        belief: estimate, entries of any one shape.
        truth: the true state, the same NamedTuple.
    """
    deviation = type(belief.mean)(*(t - m for t, m in zip(truth, belief.mean, strict=True)))
    return normalised_square(deviation, belief.cov)


def mean_band(dof: int, runs: int, probability: float = 0.95) -> tuple[float, float]:
    """Interval that the mean over independent runs of a chi-square(dof) figure stays in."""
    tail = 0.5 * (1.0 - probability)
    low, high = chi2.ppf([tail, 1.0 - tail], dof * runs) / runs
    return float(low), float(high)


def inside_fraction(
    error: Float[np.ndarray, "..."], sigma: Float[np.ndarray, "..."], bound: float = 1.0
) -> float:
    """Share of errors within `bound` standard deviations (0.683 at 1 if consistent)."""
    return float(np.mean(np.abs(error) <= bound * sigma))
