"""What can be computed of the paper's car and equations without simulating anything."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from wheelhop.estimators.failure_modes import level_table
from wheelhop.vehicle.full_vehicle_state import STANDARD_GRAVITY
from wheelhop.vehicle.lateral_tire import NOMINAL_TIRE, SOFT_TIRE, ArctangentTire
from wheelhop.vehicle.two_track import SOLMAZ_CAR, TwoTrack, wheel_angles

TIRES = (SOFT_TIRE, NOMINAL_TIRE)
"""By level."""


class ModeLimits(NamedTuple):
    """Of the 16 models.

    Attributes:
        critical_speed: beyond which the linear model diverges [m/s]; infinite if nowhere, [16].
        growth: largest real part of the linear model's eigenvalues at a speed [1/s], [16].
        guard: smallest lateral acceleration at which a tyre's load leaves its law [m/s^2], [16].
    """

    critical_speed: np.ndarray
    growth: np.ndarray
    guard: np.ndarray


def mode_limits(speed: float, car: TwoTrack = SOLMAZ_CAR) -> ModeLimits:
    """Stability and validity of every model, linear about straight ahead.

    The model diverges beyond v^2 = -L / K where it oversteers, K < 0 (Kiencke & Nielsen 2000).

    Args:
        speed: [m/s].
        car: the vehicle.
    """
    front, rear = static_loads(car)
    wheelbase = car.front_arm + car.rear_arm
    critical, growth, guard = [], [], []
    for levels in level_table(2):
        tires = [TIRES[level] for level in levels]
        loads = (front, front, rear, rear)
        each = [_slope(f, tire) for f, tire in zip(loads, tires, strict=True)]
        c_v, c_h = each[0] + each[1], each[2] + each[3]
        balance = car.rear_arm * c_h - car.front_arm * c_v
        k = car.mass * balance / (c_v * c_h * wheelbase)
        critical.append(np.sqrt(-wheelbase / k) if k < 0 else np.inf)
        square = car.front_arm**2 * c_v + car.rear_arm**2 * c_h
        system = [
            [-(c_v + c_h) / (car.mass * speed), balance / (car.mass * speed**2) - 1.0],
            [balance / car.yaw_inertia, -square / (car.yaw_inertia * speed)],
        ]
        growth.append(np.linalg.eigvals(np.array(system)).real.max())
        axles = (True, True, False, False)
        guard.append(min(guard_at(t, f, car) for t, f in zip(tires, axles, strict=True)))
    return ModeLimits(np.array(critical), np.array(growth), np.array(guard))


def static_loads(car: TwoTrack = SOLMAZ_CAR) -> tuple[float, float]:
    """Load of a front and of a rear wheel at rest [N]: Solmaz, Eq. 7."""
    wheelbase = car.front_arm + car.rear_arm
    weight = 0.5 * car.mass * STANDARD_GRAVITY
    return weight * car.rear_arm / wheelbase, weight * car.front_arm / wheelbase


def guard_at(tire: ArctangentTire, front: bool, car: TwoTrack = SOLMAZ_CAR) -> float:
    """Lateral acceleration [m/s^2] that loads an outer wheel with k1 k2, where Eq. 3 turns.

    Args:
        tire: of the wheel.
        front: whether on the front axle.
        car: the vehicle.
    """
    static = static_loads(car)[0 if front else 1]
    arm = car.rear_arm if front else car.front_arm
    gain = car.mass * arm * car.height / ((car.front_arm + car.rear_arm) * car.track)
    return float((tire.k1 * tire.k2 - static) / gain)


def inner_steer_deficit(steer: float, car: TwoTrack = SOLMAZ_CAR) -> float:
    """By how much [rad] Eq. 2 as printed turns the inner wheel less than the outer one.

    Args:
        steer: delta [rad]; negative in a right turn.
        car: the vehicle.
    """
    left, right = (abs(float(a)) for a in wheel_angles(jnp.asarray(steer, float), car, True))
    return left - right if steer < 0 else right - left


def drift_rate(bias: float, speed: float) -> float:
    """Rate of the side slip of Eq. 10 [rad/s] under a bias of the accelerometer [m/s^2]."""
    return bias / speed


def _slope(load: float, tire: ArctangentTire) -> float:
    return float((tire.k1 - load / tire.k2) * load * tire.k3)
