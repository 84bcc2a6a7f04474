"""Drivers of one shape, so that a single compiled fleet drives them all.

Every one has a steering curve of `KNOTS` points, open loop or with a driver who also corrects, and
holds the speed.
"""

from __future__ import annotations

import numpy as np

from wheelhop.errors import require_in_range
from wheelhop.vehicle.curve import Curve
from wheelhop.vehicle.full_vehicle import FullVehicle
from wheelhop.vehicle.maneuver import LaneChange, Maneuver, double_lane_change, understeer_gradient

KNOTS = 16


def straight_ahead(speed: float) -> Maneuver:
    """A driver who keeps the lane at a speed [m/s]."""
    return _driver(speed, [0.0], [0.0], follow=1.0)


def steered_lane_change(
    speed: float,
    peak: float,
    vehicle: FullVehicle,
    begin: float = 5.0,
    period: float = 2.5,
    gap: float = 2.0,
) -> Maneuver:
    """Double lane change steered open loop: a wave to the left, straight, the mirrored wave.

    Args:
        speed: [m/s].
        peak: lateral acceleration [m/s^2] that the largest angle would hold on a circle; the car's
            own peak differs by its lag.
        vehicle: on sound tyres, whose understeer sets the angle.
        begin: of the first wave [s].
        period: of each wave [s].
        gap: between the waves [s].

    Raises:
        InputError: for a speed or acceleration that no car has.
    """
    angle = held_angle(speed, peak, vehicle)
    wave = np.array([0.0, 0.25, 0.75, 1.0]) * period
    times = np.concatenate([begin + wave, begin + period + gap + wave])
    return _driver(speed, times, angle * np.array([0, 1, -1, 0, 0, -1, 1, 0], float))


def followed_lane_change(speed: float, peak: float, begin: float = 5.0) -> Maneuver:
    """Double lane change on a path of 3.5 m, which a driver follows.

    Args:
        speed: [m/s].
        peak: lateral acceleration of the path [m/s^2].
        begin: of the first arc [s].

    Raises:
        InputError: for a speed or acceleration that no car has.
    """
    path = double_lane_change(speed, peak, begin=begin).path
    return _driver(speed, [0.0], [0.0], follow=1.0, path=path)


def slalom(
    speed: float, peak: float, vehicle: FullVehicle, frequency: float = 0.4, begin: float = 1.0
) -> Maneuver:
    """Seven waves of steer, open loop; between the extremes the curve is a cubic.

    Args:
        speed: [m/s].
        peak: lateral acceleration [m/s^2] that the largest angle would hold on a circle.
        vehicle: on sound tyres.
        frequency: of the waves [Hz].
        begin: [s].

    Raises:
        InputError: for a speed, acceleration or frequency out of range.
    """
    require_in_range("slalom.frequency", frequency, 0.05, 3.0, "Hz")
    quarter = 0.25 / frequency
    times = begin + quarter * np.concatenate([[0.0], 1.0 + 2.0 * np.arange(14.0), [28.0]])
    signs = np.concatenate([[0.0], (-1.0) ** np.arange(14), [0.0]])
    return _driver(speed, times, held_angle(speed, peak, vehicle) * signs)


def held_angle(speed: float, acceleration: float, vehicle: FullVehicle) -> float:
    """Angle of the front wheels [rad] on a circle: a_y (L / v^2 + K).

    Args:
        speed: [m/s].
        acceleration: a_y [m/s^2].
        vehicle: on sound tyres.

    Raises:
        InputError: for a speed or acceleration that no car has.
    """
    require_in_range("maneuver.speed", speed, 5.0, 60.0, "m/s")
    require_in_range("maneuver.peak", acceleration, 0.0, 12.0, "m/s^2")
    c = vehicle.chassis
    wheelbase = float(c.front_arm + c.rear_arm)
    return acceleration * (wheelbase / speed**2 + float(understeer_gradient(vehicle)))


def _driver(
    speed: float,
    times: np.ndarray | list[float],
    angles: np.ndarray | list[float],
    follow: float = 0.0,
    path: LaneChange = LaneChange(0.0, 0.0, 1.0, 0.0),
) -> Maneuver:
    spare = np.arange(1.0, KNOTS - len(times) + 1.0)
    x = np.concatenate([times, times[-1] + spare])
    y = np.concatenate([angles, np.zeros(len(spare))])
    return Maneuver(
        speed, release=np.inf, path=path, steer=Curve(x, y, np.zeros(KNOTS)), follow=follow
    )
