"""An estimate over time as figures draw it: pressure, its modes and their probabilities."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from wheelhop.estimators.candidate import Track
from wheelhop.evaluation.tracking import moving_average
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.tire import pressure_from_stiffness, pressure_slope

WINDOW = 0.5
"""Length [s] of the moving averages."""


class Course(NamedTuple):
    """One filter on one drive, beside its repetitions on other roads of the kind.

    Attributes:
        t: time [s], [time].
        pressure: estimate [Pa], [time].
        sigma: its stated standard deviation [Pa], [time].
        mode_pressure: moving average of each mode's estimate [Pa], [time, modes].
        probabilities: moving average of the mode probabilities, [time, modes].
        modes: names of the modes.
        low, high: 10 % and 90 % quantile of the estimates over the repetitions [Pa], [time].
    """

    t: np.ndarray
    pressure: np.ndarray
    sigma: np.ndarray
    mode_pressure: np.ndarray
    probabilities: np.ndarray
    modes: tuple[str, ...]
    low: np.ndarray
    high: np.ndarray


def course_of(
    t: np.ndarray, track: Track, modes: tuple[str, ...], car: QuarterCar, run: int = 0
) -> Course:
    """The course of one run of a track, with the quantiles of all of them.

    Args:
        t: time of the track's samples [s].
        track: readings, [runs, time] and [runs, time, modes].
        modes: names of the modes.
        car: the corner, whose tyre turns stiffness into pressure.
        run: which is drawn.
    """
    width = max(1, round(WINDOW / float(np.median(np.diff(t)))))
    pressure = np.asarray(pressure_from_stiffness(track.stiffness, car.tire))
    mode_pressure = np.asarray(pressure_from_stiffness(track.mode_stiffness[run], car.tire))
    low, high = np.quantile(pressure, [0.1, 0.9], axis=0)
    return Course(
        t,
        pressure[run],
        float(pressure_slope(car.tire)) * track.sigma[run],
        moving_average(mode_pressure.T, width).T,
        moving_average(track.probabilities[run].T, width).T,
        modes,
        low,
        high,
    )
