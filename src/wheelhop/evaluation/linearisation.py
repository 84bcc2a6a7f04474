"""The linear corner nearest to a nonlinear one on a random road."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from wheelhop.evaluation.spectra import (
    RESOLUTION,
    IsoRoad,
    corner_response,
    require_drive,
    road_velocity_psd,
)
from wheelhop.vehicle.corner_modes import equivalent_damping
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.suspension import Suspension

_ITERATIONS = 30


def linearised(car: QuarterCar, pressure: float, road: IsoRoad, speed: float) -> QuarterCar:
    """The linear corner nearest to a nonlinear one on this road, by statistical linearisation.

    c = c_s + c_snl sqrt(8 / pi) sigma_w and k = k_s + 3 k_snl sigma_d^2, with the standard
    deviations of suspension velocity and deflection that follow, iterated. What the resulting
    dependence of c and k on the road's level would add to the information is left out.

    Args:
        car: the corner.
        pressure: of the tyre [Pa].
        road: level and waviness.
        speed: v [m/s].

    Raises:
        InputError: for a road, speed or pressure out of range.
    """
    require_drive(car, pressure, road, speed, (1.0, 1.0), 500.0)
    width = RESOLUTION / 4
    frequency = width * (np.arange(8000) + 0.5)
    intensity, _ = road_velocity_psd(road, speed, frequency)
    s = 2j * np.pi * frequency
    suspension = car.suspension
    linear = replace(suspension, cubic_stiffness=0.0, quadratic_damping=0.0)
    for _ in range(_ITERATIONS):
        body, wheel = corner_response(replace(car, suspension=linear), pressure, frequency).value
        velocity = np.abs((body - wheel) / s) ** 2 * intensity
        deflection = np.sum(velocity / np.abs(s) ** 2) * 2.0 * width
        linear = Suspension(
            stiffness=float(suspension.stiffness)
            + 3.0 * float(suspension.cubic_stiffness) * float(deflection),
            cubic_stiffness=0.0,
            damping=equivalent_damping(car, float(np.sqrt(np.sum(velocity) * 2.0 * width))),
            quadratic_damping=0.0,
        )
    return replace(car, suspension=linear)
