"""What every part of the Filipozzi study is given, and what the paper prints."""

from __future__ import annotations

from dataclasses import dataclass

from wheelhop.errors import require_in_range
from wheelhop.vehicle.full_vehicle_state import STANDARD_GRAVITY

SPEED = 90 / 3.6
"""Of the paper's braking, double lane change and steady cornering [m/s]."""

BRAKE_TORQUE = 3000.0
"""Of all wheels together [Nm]."""

BRAKE_BEGIN = 1.0
"""When the brakes are stepped on [s]."""

LANE_CHANGE_PEAK = 0.6 * STANDARD_GRAVITY
"""Largest lateral acceleration of the double lane change [m/s^2]."""

CORNERING = 0.4 * STANDARD_GRAVITY
"""Lateral acceleration of the steady cornering about which the vehicle is linearised [m/s^2]."""

SWEEP_SPEED = 20 / 3.6
"""On the bounce sine sweep [m/s]."""

SHORTEST_WAVE = 1.6
"""Of the bounce sine sweep [m], reached at `SWEEP_END`."""

SWEEP_END = 20.0
"""When the shortest wave is reached [s]."""

GRADIENT = 0.2
"""Of the slope [-]."""

FACTORS = (0.5, 1.0, 1.5)
"""Of the plant's stiffness or damping per that of the estimation model [-]."""

ACCELERATION_PSD = 1e-4
"""Of the noise of the sprung mass's vertical acceleration [(m/s^2)^2/Hz]."""

DEFLECTION_PSD = 1e-9
"""Of the noise of the suspension deflections [m^2/Hz]."""

CORRELATION_TIME = 0.01
"""Of both [s]."""


@dataclass(frozen=True)
class FilipozziSettings:
    """Of every part.

    Attributes:
        runs: noisy runs of each case.
        seed: of all random numbers.
        rate: of the records and the estimators [Hz].
        bandwidth: of the observers [Hz].
        quick: a small run, to see that all works.
    """

    runs: int = 50
    seed: int = 0
    rate: float = 1000.0
    bandwidth: float = 30.0
    quick: bool = False


QUICK = FilipozziSettings(runs=4, rate=500.0, quick=True)
"""Small: to see that all works, not what is true."""


def validate_settings(settings: FilipozziSettings) -> FilipozziSettings:
    """The same settings, checked.

    Raises:
        InputError: naming the setting that is out of range.
    """
    require_in_range("--runs", settings.runs, 2, 100_000, "runs")
    require_in_range("seed", settings.seed, 0, 2**32 - 1, "(whole number)")
    # a correlation time of noise must be a whole number of samples, and hop well sampled
    require_in_range("rate", settings.rate, 200.0, 5000.0, "Hz")
    require_in_range("bandwidth", settings.bandwidth, 1.0, 0.2 * settings.rate, "Hz")
    return settings
