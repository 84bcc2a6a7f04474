"""How well a tracked stiffness follows the truth over many runs: errors, honesty, convergence."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.stats import bootstrap

from wheelhop.errors import InputError
from wheelhop.evaluation.consistency import inside_fraction, mean_band
from wheelhop.evaluation.errors import ErrorStatistics, error_statistics

TOLERANCE = 15e3
"""Error [Pa] within which an estimate counts as converged: a third of what a 25 % loss is."""

LAST = 1.0
"""Length [s] of the end of a run over which its final error is averaged."""


_MANY = 1000


class Interval(NamedTuple):
    """A figure with the interval that holds it with 95 % probability."""

    value: float
    low: float
    high: float


class Tracking(NamedTuple):
    """Figures of many runs of one filter; SI units.

    Attributes:
        statistics: of the stiffness errors at every time [N/m], Brancati & Tufano 2022, Eq. 23
            to 25; errors are estimate minus truth.
        inside: share of errors within one stated sigma, after settling.
        inside_by_run: share of runs whose error never leaves one stated sigma after settling.
        nees: normalised error squared of k_t averaged over the runs, at every time [time].
        nees_band: where 95 % of such averages lie if sigma is honest.
        final_rmse: of the pressure over the last second of a run [Pa], and its bootstrap interval.
        final_bias: mean pressure error of the last second [Pa].
        converged: share of runs that end within `TOLERANCE`.
        convergence_time: median over these runs of the time after which the error, averaged over
            half a second, stays within `TOLERANCE` [s]; NaN where none does.
        lost: runs that left the finite numbers; the other figures leave them out.
    """

    statistics: ErrorStatistics
    inside: float
    inside_by_run: float
    nees: np.ndarray
    nees_band: tuple[float, float]
    final_rmse: Interval
    final_bias: float
    converged: float
    convergence_time: float
    lost: int = 0


def tracking(
    t: Float[np.ndarray, " time"],
    stiffness: Float[np.ndarray, "runs time"],
    sigma: Float[np.ndarray, "runs time"],
    truth: Float[np.ndarray, "runs time"],
    slope: float,
    *,
    settling: float = 2.0,
    since: float = 0.0,
    seed: int = 0,
) -> Tracking:
    """Figures of one filter over independent runs.

    Args:
        t: time [s].
        stiffness: estimated k_t [N/m].
        sigma: stated standard deviation [N/m].
        truth: true k_t [N/m].
        slope: dp/dk_t [Pa m/N].
        settling: time [s] that is not judged at the start.
        since: time [s] from which convergence is judged and counted, as after a change.
        seed: of the bootstrap.

    Raises:
        InputError: for fewer than two runs, or a settling time that leaves nothing.
    """
    late = t > settling
    if not late.any():
        raise InputError("settling", f"{settling:g} s leave nothing", "Judge a part of the runs.")
    error = stiffness - truth
    finite = (np.isfinite(error) & np.isfinite(sigma)).all(axis=1)
    if finite.sum() > 1:  # otherwise every figure is NaN
        error, sigma = error[finite], sigma[finite]
    statistics = error_statistics(error, sigma)
    within = np.abs(error[:, late]) <= sigma[:, late]
    final = slope * error[:, t > t[-1] - LAST]
    after = t > since
    times = convergence_times(t[after], slope * error[:, after]) - since
    settled = np.isfinite(times)
    return Tracking(
        statistics,
        inside_fraction(error[:, late], sigma[:, late]),
        float(within.all(axis=1).mean()),
        np.mean((error / sigma) ** 2, axis=0),
        mean_band(1, error.shape[0]),
        rms_interval(final, seed),
        float(final.mean()),
        float(settled.mean()),
        float(np.median(times[settled])) if settled.any() else float("nan"),
        int((~finite).sum()),
    )


def rms_interval(error: Float[np.ndarray, "runs time"], seed: int = 0) -> Interval:
    """Root mean square over runs and time, with the 95 % bootstrap interval over runs.

    Runs, not samples, are drawn anew, since the samples of a run hang together (bias-corrected
    and accelerated; Efron 1987).
    """
    square = np.mean(error**2, axis=1)
    value = float(np.sqrt(square.mean()))
    if not np.isfinite(value) or np.ptp(square) == 0:
        return Interval(value, value, value)
    low, high = _bootstrapped((square,), seed)
    return Interval(value, float(np.sqrt(low)), float(np.sqrt(high)))


def rms_gain(
    error: Float[np.ndarray, "runs time"], other: Float[np.ndarray, "runs time"], seed: int = 0
) -> Interval:
    """How much smaller the first rms error is than the other on the same runs, with its interval.

    Both filters saw the same runs, whose difficulty they share: runs are drawn anew in pairs. Runs
    that either lost are left out.
    """
    squares = [np.mean(e**2, axis=1) for e in (error, other)]
    finite = np.isfinite(squares[0]) & np.isfinite(squares[1])
    if finite.sum() < 2:
        return Interval(*[float("nan")] * 3)
    first, second = (s[finite] for s in squares)

    def gain(a: np.ndarray, b: np.ndarray, axis: int = -1) -> Any:
        return np.sqrt(b.mean(axis=axis)) - np.sqrt(a.mean(axis=axis))

    value = float(gain(first, second))
    if np.array_equal(first, second):
        return Interval(value, value, value)
    return Interval(value, *_bootstrapped((first, second), seed, gain))


def _bootstrapped(
    samples: tuple[np.ndarray, ...], seed: int, statistic: Any = np.mean
) -> tuple[float, float]:
    """Ends of the 95 % bootstrap interval; acceleration is left out where runs abound."""
    few = len(samples[0]) <= _MANY
    found = bootstrap(
        samples,
        statistic,
        n_resamples=2000,
        batch=None if few else max(1, 10**7 // len(samples[0])),
        paired=True,
        method="BCa" if few else "percentile",
        rng=np.random.default_rng(seed),
    ).confidence_interval
    return float(found.low), float(found.high)


def convergence_times(
    t: Float[np.ndarray, " time"],
    error: Float[np.ndarray, "runs time"],
    tolerance: float = TOLERANCE,
    window: float = 0.5,
) -> np.ndarray:
    """Time [s] of each run after which its error, averaged over a window, stays in tolerance.

    Args:
        t: time [s].
        error: of the pressure [Pa].
        tolerance: [Pa].
        window: of the average, which ends at the time it counts for [s].

    Returns:
        [runs]; NaN for a run that ends out of tolerance or has left the finite numbers.
    """
    width = max(1, round(window / float(np.median(np.diff(t)))))
    outside = ~(np.abs(moving_average(error, width)) <= tolerance)  # NaN is outside, too
    last = outside.shape[1] - 1 - np.argmax(outside[:, ::-1], axis=1)
    after = np.where(outside.any(axis=1), np.minimum(last + 1, len(t) - 1), 0)
    return np.where(outside[:, -1], np.nan, t[after])


def moving_average(
    values: Float[np.ndarray, "runs time"], width: int
) -> Float[np.ndarray, "runs time"]:
    """Mean of the last `width` samples at every time, of those there are at the start."""
    total = np.cumsum(values, axis=1)
    count = np.minimum(np.arange(1, values.shape[1] + 1), width)
    before = np.concatenate([np.zeros_like(values[:, :width]), total], axis=1)[:, : total.shape[1]]
    return (total - before) / count[None]
