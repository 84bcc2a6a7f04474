"""Error statistics over Monte Carlo runs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from wheelhop.errors import InputError


class ErrorStatistics(NamedTuple):
    """Statistics over runs at every time, each [time].

    Attributes:
        mean: mean error; Brancati & Tufano 2022, Eq. 23.
        std: standard deviation of the errors; Eq. 24.
        sigma: mean of the filter's own standard deviations; Eq. 25.
        rms: root mean square error.
    """

    mean: np.ndarray
    std: np.ndarray
    sigma: np.ndarray
    rms: np.ndarray


def error_statistics(
    error: Float[np.ndarray, "runs time"], sigma: Float[np.ndarray, "runs time"]
) -> ErrorStatistics:
    """Mean, spread and stated sigma of the errors of independent runs.

    Args:
        error: estimate minus truth.
        sigma: the filter's standard deviation of it.

    Raises:
        InputError: for fewer than two runs, whose spread is not defined.
    """
    if error.shape[0] < 2:
        raise InputError("runs", f"{error.shape[0]} run has no spread", "Use at least 2 runs.")
    return ErrorStatistics(
        mean=error.mean(axis=0),
        std=error.std(axis=0, ddof=1),
        sigma=sigma.mean(axis=0),
        rms=np.sqrt(np.mean(error**2, axis=0)),
    )
