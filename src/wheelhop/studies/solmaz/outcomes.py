"""Verdicts against the truth: confusion, detection time, false alarms."""

from __future__ import annotations

import numpy as np

from wheelhop.estimators.failure_modes import level_table, mode_of
from wheelhop.evaluation.tracking import Interval

SOUND = mode_of((False, False, False, False))
"""Mode without a soft tyre."""

MODES = 16


def confusion(true: np.ndarray, told: np.ndarray) -> np.ndarray:
    """Share of the runs of each true mode (rows) that are told as each mode, [16, 16].

    Args:
        true: mode of each run, [runs].
        told: mode believed, [runs].
    """
    counts = np.zeros((MODES, MODES))
    np.add.at(counts, (true, told), 1.0)
    return counts / np.maximum(counts.sum(axis=1, keepdims=True), 1.0)


def share(right: np.ndarray) -> Interval:
    """Share of runs, with its 95 % Wilson interval; of no runs NaN, between 0 and 1.

    Args:
        right: whether each run is, [runs].
    """
    if len(right) == 0:
        return Interval(float("nan"), 0.0, 1.0)
    n, p, z = len(right), float(np.mean(right)), 1.959964
    middle = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * np.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return Interval(p, float(middle - half), float(middle + half))


def tires_right(true: np.ndarray, told: np.ndarray) -> np.ndarray:
    """Share of runs in which each tyre is told right, [4].

    Args:
        true, told: modes, [runs].
    """
    soft = level_table(2) == 0
    return np.asarray((soft[true] == soft[told]).mean(axis=0))


def detection_time(
    time: np.ndarray, selected: np.ndarray, true: np.ndarray, onset: float
) -> np.ndarray:
    """From the onset of steering until the true mode is told and stays told [s]; inf if never.

    Args:
        time: [s], [time].
        selected: modes believed, [runs, time].
        true: [runs].
        onset: [s].
    """
    right = selected == true[:, None]
    # from where on every later sample is right
    stays = np.flip(np.logical_and.accumulate(np.flip(right, axis=1), axis=1), axis=1)
    found = np.where(stays.any(axis=1), time[stays.argmax(axis=1)] - onset, np.inf)
    return np.asarray(np.maximum(found, 0.0))


def switches_per_minute(time: np.ndarray, selected: np.ndarray) -> np.ndarray:
    """Changes of the mode believed, [runs].

    Args:
        time: [s], [time].
        selected: [runs, time].
    """
    minutes = (time[-1] - time[0]) / 60.0
    return np.asarray((np.diff(selected, axis=1) != 0).sum(axis=1) / minutes)
