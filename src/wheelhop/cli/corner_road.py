"""The road of a single corner, as the options of `simulate` name it."""

from __future__ import annotations

from typing import Any

import numpy as np

from wheelhop.cli.session import console
from wheelhop.errors import InputError, require_in_range
from wheelhop.vehicle.road import Profile, synthesise
from wheelhop.vehicle.road.iso8608 import level_of
from wheelhop.vehicle.road.shape_filter import stationary_variance
from wheelhop.vehicle.scenario import (
    constant_travel,
    road_rise_from_profile,
    road_rise_of_class,
)

SYNTHESIS_SPACING = 0.02
"""Distance [m] between the points of a road synthesised by spectrum."""


def random_rise(
    key: Any,
    road_class: str,
    speed: float,
    duration: float,
    rate: float,
    waviness: float | None,
    convention: str,
) -> Any:
    """Rise per fine step of an ISO road: exact shape filter, or spectral for any waviness."""
    level = level_of(road_class)
    if waviness is None:
        samples = round(duration * rate)
        travel = constant_travel(speed, samples, rate)
        return road_rise_of_class(key, level, travel, convention)
    require_in_range("--waviness", waviness, 1.0, 4.0, "(no unit)")
    level *= stationary_variance(1.0, convention) / stationary_variance(1.0)
    length = speed * duration + 2.0
    z = synthesise(key, length, SYNTHESIS_SPACING, level, waviness)
    profile = Profile(SYNTHESIS_SPACING, np.asarray(z, float))
    return road_rise_from_profile(profile, speed, duration, rate)


def measured_rise(
    profile: Profile, speed: float, duration: float, rate: float, reflect: bool
) -> np.ndarray:
    """Rise per fine step of a measured road.

    Raises:
        InputError: for a drive beyond its end without `reflect`.
    """
    once = profile.length / speed
    if duration > once * (1 + 1e-9) and not reflect:
        raise InputError(
            "--duration",
            f"the road of {profile.length:g} m lasts {once:.3g} s at {3.6 * speed:g} km/h, "
            f"not {duration:g} s",
            "Give a shorter duration, or --reflect to continue the road there and back.",
        )
    if duration > once * (1 + 1e-9):
        console.print(f"the road of {profile.length:g} m is continued there and back (--reflect)")
    return road_rise_from_profile(profile, speed, duration, rate, reflect=reflect)
