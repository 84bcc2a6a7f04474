"""What every part of the stiffness study is given."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

RATE = 500.0
"""Sampling rate of every log [Hz]."""

SPEEDS = (40 / 3.6, 80 / 3.6)
"""Between which speeds are drawn [m/s]."""

PRESSURES = (130e3, 230e3)
"""Between which pressures are drawn [Pa]."""


@dataclass(frozen=True)
class StiffnessSettings:
    """Of every part.

    Attributes:
        runs: of each Monte Carlo.
        noise: of every accelerometer [m/s^2].
        seed: of roads, sensors and scenarios.
        substeps: simulation steps per sample.
        longest: duration of the longest drives [s]; a part's own duration where that is shorter.
        bound_runs: runs over whose operating points a bound is averaged, at most.
    """

    runs: int = 200
    noise: float = 0.5
    seed: int = 0
    substeps: int = 8
    longest: float = 60.0
    bound_runs: int = 40


QUICK = StiffnessSettings(runs=4, longest=10.0, substeps=4, bound_runs=4)
"""Small: to see that all works, not what is true."""


def drive_settings(settings: StiffnessSettings) -> dict[str, Any]:
    """What every Monte Carlo depends on; how many bounds are averaged is none of it."""
    content = asdict(settings)
    del content["bound_runs"]
    return content
