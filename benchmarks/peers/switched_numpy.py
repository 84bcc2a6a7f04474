"""The switched bank as a plain loop over samples in NumPy, vectorised over its models.

What a Matlab user would write: the step of `estimators.lateral` with its observer, Heun's rule
and hysteresis, every operation on a vector of models; arctangent law, complete samples only.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from wheelhop.estimators.lateral import LateralSample, SwitchedParams
from wheelhop.vehicle.full_vehicle_state import STANDARD_GRAVITY


def build(params: SwitchedParams) -> Any:
    """A function of one record, `LateralSample` of arrays [time], to the models believed [time].

    Args:
        params: of the models; speeds above the slowest.
    """
    car, tuning, dt = params.car, params.tuning, float(params.dt)
    tires = [[np.asarray(getattr(t, k)) for t in params.tires] for k in ("k1", "k2", "k3")]
    k1, k2, k3 = (np.stack(each) for each in tires)
    length = car.front_arm + car.rear_arm
    moved = car.mass * car.height / car.track
    front, rear = car.rear_arm / length, car.front_arm / length
    share = front if car.front_transfer is None else car.front_transfer
    rest = 0.5 * car.mass * STANDARD_GRAVITY * np.array([front, front, rear, rear])
    transfer = moved * np.array([-share, share, share - 1.0, 1.0 - share])
    half, excess = 0.5 * car.track, 0.5 * car.track / length
    models = k1.shape[1]

    def motion(beta: Any, rate: Any, y: tuple[float, ...]) -> tuple[Any, Any]:
        steer, speed, a_y, _ = y
        load = (rest + transfer * a_y / (1.0 + car.roll_gain))[:, None]
        ahead, behind = speed * beta + car.front_arm * rate, speed * beta - car.rear_arm * rate
        left, right = speed - half * rate, speed + half * rate
        slip = -np.arctan(np.stack([ahead / left, ahead / right, behind / left, behind / right]))
        slip[0] += steer + excess * steer * steer
        slip[1] += steer - excess * steer * steer
        grip = np.maximum(load, 0.0) * np.maximum(k1 - load / k2, 0.0)
        force = grip * np.arctan(k3 * slip)
        before, after = force[0] + force[1], force[2] + force[3]
        turn = (before * car.front_arm - after * car.rear_arm) / car.yaw_inertia
        return (before + after) / car.mass, turn

    def rates(beta: Any, rate: Any, y: tuple[float, ...], found: tuple[Any, Any]) -> tuple:
        _, speed, a_y, yaw_rate = y
        error = a_y / (1.0 + car.roll_gain) - found[0]
        turning = found[0] / speed - rate + tuning.side_slip_gain * error / speed
        return turning, found[1] + tuning.yaw_rate_gain * (yaw_rate - rate)

    def run(record: LateralSample) -> np.ndarray:
        beta = rate = integral = last = np.zeros(models)
        slopes = (np.zeros(models), np.zeros(models))
        selected, believed = models - 1, np.empty(len(record.speed), int)
        decay = np.exp(-tuning.forgetting * dt)
        for k, y in enumerate(zip(*(np.asarray(entry).tolist() for entry in record), strict=True)):
            guess = beta + dt * slopes[0], rate + dt * slopes[1]
            ahead = rates(*guess, y, motion(*guess, y))
            beta = beta + 0.5 * dt * (slopes[0] + ahead[0])
            rate = rate + 0.5 * dt * (slopes[1] + ahead[1])
            found = motion(beta, rate, y)
            e_a = y[2] - (1.0 + car.roll_gain) * found[0]
            e_r = y[3] - rate
            error = np.hypot(e_a / tuning.acceleration_scale, e_r / tuning.yaw_rate_scale)
            learning = abs(y[2]) >= tuning.gate
            error = error if learning else np.zeros(models)
            if learning or tuning.gate <= 0.0:
                integral = decay * integral + 0.5 * dt * (decay * last + error)
            cost = tuning.instantaneous * error + tuning.cumulative * integral
            best = int(np.argmin(cost))
            if learning and cost[best] < (1.0 - tuning.hysteresis) * cost[selected]:
                selected = best
            slopes, last = rates(beta, rate, y, found), error
            believed[k] = selected
        return believed

    return run
