"""The test drives of the literature: a maneuver, the obstacles it needs, and its duration."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from wheelhop.errors import require_in_range
from wheelhop.vehicle import maneuver as _maneuver
from wheelhop.vehicle.full_vehicle_state import STANDARD_GRAVITY
from wheelhop.vehicle.maneuver import Maneuver
from wheelhop.vehicle.road.obstacles import Obstacle, SineSweep, Slope

_START = 1.0


@dataclass(frozen=True)
class Drive:
    """A test drive.

    Attributes:
        maneuver: what the driver does.
        duration: [s].
        obstacles: to be laid on the road, the car starting at x = 0.
    """

    maneuver: Maneuver
    duration: float
    obstacles: tuple[Obstacle, ...] = ()


def straight(speed: float = 60.0 / 3.6) -> Drive:
    """Straight ahead at constant speed [m/s] for 10 s."""
    return Drive(_maneuver.straight(speed), 10.0)


def brake_step(speed: float = 25.0, torque: float = 3000.0) -> Drive:
    """A brake torque of 3,000 Nm at 1 s from 90 km/h. Filipozzi et al. 2021, Fig. 5a."""
    return Drive(_maneuver.brake_step(speed, torque, _START), 5.0)


def lane_change(speed: float = 25.0, peak: float = 0.6 * STANDARD_GRAVITY) -> Drive:
    """Double lane change at constant speed.

    Filipozzi et al. 2021, Fig. 5b: 90 km/h, up to 0.6 g. Solmaz, Fig. 6: 120 km/h, mild.

    Args:
        speed: [m/s].
        peak: largest lateral acceleration of the path [m/s^2].
    """
    plan = _maneuver.double_lane_change(speed, peak, begin=_START)
    back = (2.0 * plan.path.length + plan.path.gap) / speed
    return Drive(plan, max(8.0, float(math.ceil(_START + back + 3.0))))


def sine_sweep(speed: float = 20.0 / 3.6, amplitude: float = 0.05) -> Drive:
    """Bounce sine sweep: waves from 25 m down to 1.6 m, met at 0.2 to 3.5 Hz at 20 km/h.

    Filipozzi et al. 2021, Fig. 6; the heights are ours, 50 mm falling with the wavelength.

    Args:
        speed: [m/s].
        amplitude: of the longest wave [m].
    """
    length = 20.0 * 20.0 / 3.6
    sweep = SineSweep(start=2.0, length=length, amplitude=amplitude)
    require_in_range("sine_sweep.speed", speed, 1.0, 30.0, "m/s")
    return Drive(_maneuver.straight(speed), (length + 8.0) / speed, (sweep,))


def slope(speed: float = 30.0 / 3.6, gradient: float = 0.2) -> Drive:
    """From the flat onto a slope, by default of 20 %. Filipozzi et al. 2021, Fig. 7.

    Args:
        speed: [m/s].
        gradient: rise per run [-].
    """
    require_in_range("slope.gradient", gradient, -0.35, 0.35, "(rise per run)")
    hill = Slope(start=2.0 * speed, gradient=gradient, transition=10.0)
    return Drive(_maneuver.straight(speed), max(8.0, float(math.ceil(2.0 + 25.0 / speed))), (hill,))


DRIVES: dict[str, Callable[..., Drive]] = {
    "straight": straight,
    "brake-step": brake_step,
    "lane-change": lane_change,
    "sine-sweep": sine_sweep,
    "slope": slope,
}
"""Test drives by name; each takes the speed [m/s] first."""
