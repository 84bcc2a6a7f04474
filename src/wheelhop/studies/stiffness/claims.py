"""What the study must show on continuous roughness, against what it measured."""

from __future__ import annotations

import numpy as np

from wheelhop.evaluation.consistency import mean_band
from wheelhop.evaluation.tracking import Interval, rms_interval
from wheelhop.io.report import Finding
from wheelhop.studies.frame import verdict_of
from wheelhop.studies.stiffness import continuous as lone
from wheelhop.studies.stiffness import several_wheels as four
from wheelhop.studies.stiffness.continuous import Continuous, Track
from wheelhop.studies.stiffness.runs import at, reported
from wheelhop.studies.stiffness.several_wheels import SeveralWheels, combined_variance

LARGEST_RATIO = 1.1
"""Of the rms of ln k_t over its bound."""

LARGEST_BETWEEN = 0.014
"""Rms of the difference of two wheels' errors of ln k_t after 10 s."""


def rms(error: np.ndarray) -> np.ndarray:
    """Root mean square over the runs, [..., runs, time] to [..., time]."""
    return np.asarray(np.sqrt(np.mean(error**2, axis=-2)))


def percent(interval: Interval) -> str:
    """A relative error with its interval."""
    value, low, high = (100 * x for x in interval)
    return f"{value:.2f} % ({low:.2f} to {high:.2f})"


def scaled(interval: Interval, factor: float) -> Interval:
    """An interval in another unit."""
    return Interval(*(factor * x for x in interval))


def at_time(error: np.ndarray, time: np.ndarray, wanted: float) -> Interval:
    """Rms over the runs at a time, with its bootstrap interval; error [runs, time, ...]."""
    there = error[:, at(time, wanted)]
    return rms_interval(there.reshape(len(there), -1))


def continuous_findings(result: Continuous) -> list[Finding]:
    """Claims on roads of any level."""
    shown = reported(float(result.time[-1]), lone.REPORTED)
    main = result.tracks[lone.MAIN]
    ratios = {t: ratio_at(result, main, t) for t in shown}
    nees = {t: float(nees_over_time(main)[at(result.time, t)]) for t in shown}
    low, high = mean_band(1, main.error.shape[0])
    contrast = result.tracks[lone.DEFAULT]
    cost = "; ".join(f"{ratio_at(result, contrast, t).value:.2f} at {t:g} s" for t in shown)
    return [
        Finding(
            "continuous roughness",
            "rms error of ln k_t within 1.1 of the Cramer-Rao bound at "
            + ", ".join(f"{t:g}" for t in lone.REPORTED)
            + " s",
            "; ".join(
                f"{r.value:.2f} ({r.low:.2f} to {r.high:.2f}) at {t:g} s" for t, r in ratios.items()
            ),
            verdict_of([r.value <= LARGEST_RATIO for r in ratios.values()]),
            "The bound takes the road's level as unknown and has the mean and spread of the drawn "
            "pressures and levels as prior; an average of 200 squares is itself uncertain by a "
            f"tenth. The default, which watches for abrupt changes: {cost}.",
        ),
        Finding(
            "continuous roughness",
            "NEES of ln k_t inside its 95 % band",
            "; ".join(f"{n:.2f} at {t:g} s" for t, n in nees.items()) + f"; band {low:.2f} to "
            f"{high:.2f}",
            verdict_of([low <= n <= high for n in nees.values()]),
            "The band is that of a mean of independent squares of unit normal variables, one for "
            "each run; at five times one in four studies of an honest filter has one outside.",
        ),
    ]


def ratio_at(result: Continuous, track: Track, wanted: float) -> Interval:
    """Rms of ln k_t over the bound, with its interval."""
    best = float(result.bound[at(result.time, wanted)])
    return scaled(at_time(track.error, result.time, wanted), 1.0 / best)


def nees_over_time(track: Track) -> np.ndarray:
    """Mean over the runs of the squared error over its stated variance, [time]."""
    return np.asarray(np.mean(track.error**2 / track.variance, axis=0))


def wheel_errors(result: SeveralWheels, name: str) -> np.ndarray:
    """Errors of one of `COMBINATIONS`, [runs, time, figures]."""
    return np.asarray(np.einsum("fi,rti->rtf", four.COMBINATIONS[name], result.error))


def wheel_stated(result: SeveralWheels, name: str) -> np.ndarray:
    """Root of the mean stated variance of one of `COMBINATIONS`, [time]."""
    stated = combined_variance(result.cov, four.COMBINATIONS[name])
    return np.asarray(np.sqrt(stated.mean(axis=(0, 2))))


def wheel_nees(result: SeveralWheels) -> np.ndarray:
    """Mean over the runs of the normalised square of all four errors, [time]; 4 is honest."""
    solved = np.linalg.solve(result.cov, result.error[..., None])[..., 0]
    return np.asarray(np.mean(np.sum(result.error * solved, axis=-1), axis=0))


def wheels_findings(result: SeveralWheels) -> list[Finding]:
    """Claims on four corners."""
    shown = reported(float(result.time[-1]), four.REPORTED)
    wanted = 10.0 if 10.0 in shown else shown[-1]
    between = at_time(wheel_errors(result, four.PAIRS), result.time, wanted)
    mean = at_time(wheel_errors(result, four.AGAINST_MEAN), result.time, wanted)
    best = float(result.bound[four.PAIRS][at(result.time, wanted)])
    nees = {t: float(wheel_nees(result)[at(result.time, t)]) for t in shown}
    low, high = mean_band(4, len(result.error))
    forbids = " and forbids it" if best > LARGEST_BETWEEN else ""
    return [
        Finding(
            "four corners",
            "wheel-to-wheel error of ln k_t at most 1.4 % at 10 s",
            f"between two wheels {percent(between)}, against the mean of the four {percent(mean)}, "
            f"at {wanted:g} s",
            verdict_of([mean.value <= LARGEST_BETWEEN, between.value <= LARGEST_BETWEEN]),
            f"The bound of the difference of two wheels, each with a road of its own, is "
            f"{100 * best:.2f} %{forbids}; the measured one is {between.value / best:.2f} of it.",
        ),
        Finding(
            "four corners",
            "NEES of the four ln k_t together inside its 95 % band",
            "; ".join(f"{n:.2f} at {t:g} s" for t, n in nees.items()) + f"; band {low:.2f} to "
            f"{high:.2f}",
            verdict_of([low <= n <= high for n in nees.values()]),
            "Four normalised squares a run: 4 is honest.",
        ),
    ]
