"""What every part of the Solmaz study is given."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wheelhop.errors import require_in_range
from wheelhop.estimators.failure_modes import mode_of
from wheelhop.vehicle.cornering import SineSteer, double_lane_change

SPEED = 120 / 3.6
"""Of the paper's maneuver [m/s]."""

DURATION = 20.0
"""Of the paper's drive [s]."""

ONSET = 5.0
"""When its steering begins [s]."""

FAILED = mode_of((True, False, False, False))
"""Index of the mode that the paper simulates, front left alone: model 8, counted from one."""

SOUND = mode_of((False, False, False, False))
"""Index of the mode without a soft tyre: model 16."""


@dataclass(frozen=True)
class SolmazSettings:
    """Of every part.

    Attributes:
        runs: noisy runs of each case.
        noise: of the accelerometer [m/s^2].
        yaw_rate_noise: of the yaw rate sensor [rad/s].
        seed: of all random numbers.
        amplitude: of the front wheels' angle in the paper's maneuver [rad]; its text gives none.
        quick: a small run, to see that all works.
    """

    runs: int = 200
    noise: float = 0.05
    yaw_rate_noise: float = 0.002
    seed: int = 0
    amplitude: float = 0.02
    quick: bool = False


QUICK = SolmazSettings(runs=4, quick=True)
"""Small: to see that all works, not what is true."""


def validate_settings(settings: SolmazSettings) -> SolmazSettings:
    """The same settings, checked.

    Raises:
        InputError: naming the setting that is out of range.
    """
    require_in_range("--runs", settings.runs, 2, 100_000, "runs")
    require_in_range("--noise", settings.noise, 0.0, 10.0, "m/s^2")
    require_in_range("yaw_rate_noise", settings.yaw_rate_noise, 0.0, 1.0, "rad/s")
    require_in_range("amplitude", settings.amplitude, 1e-3, 0.1, "rad")
    return settings


def maneuver(settings: SolmazSettings) -> SineSteer:
    """The paper's double lane change."""
    return double_lane_change(settings.amplitude, ONSET)


def sensor_noise(settings: SolmazSettings, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Errors of the accelerometer [m/s^2] and the yaw rate sensor [rad/s], each [runs, time].

    White and Gaussian; those of a run depend on its number and the seed alone.

    Args:
        settings: of the study.
        samples: of a run.
    """
    drawn = np.stack(
        [
            np.random.default_rng([settings.seed, run]).standard_normal((2, samples))
            for run in range(settings.runs)
        ]
    )
    return settings.noise * drawn[:, 0], settings.yaw_rate_noise * drawn[:, 1]
