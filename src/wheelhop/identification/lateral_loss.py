"""Output error of a two-track simulation over the coefficients of its tyres.

Measured steer and speed drive the model from a free initial state; what it says of lateral
acceleration and yaw rate is compared with the sensors, in units of their noise.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from wheelhop.estimators.lateral import LateralSample
from wheelhop.vehicle.lateral_tire import ArctangentTire, overloaded
from wheelhop.vehicle.two_track import (
    LateralMotion,
    LateralState,
    Steering,
    TwoTrack,
    Wheels,
    lateral_motion,
    wheel_loads,
)

# each round leaves a fifth of the error in the lateral acceleration
_ROUNDS = (2, 3)


class Own(NamedTuple):
    """What every record has of its own: standard deviations before it is seen; 0 holds it at 0.

    Attributes:
        side_slip: at the first sample [rad].
        yaw_rate: at the first sample [rad/s].
        acceleration_offset: of the sensor, measured less true [m/s^2].
        yaw_rate_offset: of the sensor [rad/s].
        steer_offset: of the sensor, as angle of the front wheels [rad].
    """

    side_slip: Any = 0.1
    yaw_rate: Any = 0.5
    acceleration_offset: Any = 0.0
    yaw_rate_offset: Any = 0.0
    steer_offset: Any = 0.0


class Task(NamedTuple):
    """What candidates are judged by: arrays only.

    Attributes:
        start: k1, k2 and k3 of the four wheels to start from, [4, 3].
        assigned: which parameter each coefficient is fitted by, 1 or 0, [4, 3, n].
        load: of the wheels, or of all that share a tyre in the mean, under static load [N], [4].
        drive: samples without gaps, [records, time].
        weight: one over the noise of lateral acceleration and yaw rate, 0 where there is no sample,
            [records, time, 2].
        interval: to the sample before [s], 0 for the first, [time].
        own: standard deviations, [5].
        spread: standard deviation of every parameter around 0.
        car: the vehicle.
    """

    start: Any
    assigned: Any
    load: Any
    drive: LateralSample
    weight: Any
    interval: Any
    own: Any
    spread: Any
    car: TwoTrack


def coefficients(theta: Any, task: Task) -> Any:
    """k1, k2 and k3 of the wheels [4, 3] of parameters [n], zeros for the start.

    The parameter of k1 is the change of ln k1; that of k2 the change of ln(k1 k2 / F_0 - 1), with
    which every tyre carries its static load F_0; that of k3 the change of the cornering stiffness's
    logarithm, ln((k1 - F_0 / k2) k3). In these the loss is much closer to a parabola than in the
    coefficients, along whose curved valley of one stiffness it hardly changes. Coefficients that
    are not fitted keep their start.
    """
    k = task.start
    moved, fitted = task.assigned @ theta, task.assigned.sum(-1) > 0.0
    k1 = k[:, 0] * jnp.exp(moved[:, 0])
    spare = jnp.where(fitted[:, 1], k[:, 0] * k[:, 1] / task.load - 1.0, 1.0)
    k2 = jnp.where(fitted[:, 1], task.load * (1.0 + spare * jnp.exp(moved[:, 1])) / k1, k[:, 1])
    grip = jnp.maximum(k1 - task.load / k2, 1e-3)
    before = jnp.maximum(k[:, 0] - task.load / k[:, 1], 1e-3)
    k3 = jnp.where(fitted[:, 2], k[:, 2] * before / grip * jnp.exp(moved[:, 2]), k[:, 2])
    return jnp.stack([k1, k2, k3], axis=1)


def tires_of(theta: Any, task: Task) -> Wheels:
    """Tyres of the wheels of parameters [n]."""
    return Wheels(*(ArctangentTire(k[0], k[1], k[2]) for k in coefficients(theta, task)))


def simulate(
    tires: Wheels, own: Own, drive: LateralSample, interval: Any, car: TwoTrack, loads: str
) -> tuple[LateralSample, Any]:
    """Lateral acceleration and yaw rate as the sensors would show them, by Heun's rule.

    What is integrated is lateral speed v beta, which holds for a changing speed too; at constant
    speed it is Solmaz, Eq. 1.

    Args:
        tires: of the wheels.
        own: initial state and offsets.
        drive: steer, speed and, for loads "measured", lateral acceleration, [time].
        interval: to the sample before [s], 0 for the first, [time].
        car: the vehicle.
        loads: "measured", Eq. 7 of the measured lateral acceleration, or "model", of its own.

    Returns:
        The drive with simulated sensors, and whether the tyre law's guard acts, [time].
    """
    gain = 1.0 + car.roll_gain
    once = loads == "measured"

    def motion(v_y: Any, rate: Any, now: LateralSample, last: Any, rounds: int) -> LateralMotion:
        x, u = LateralState(v_y / now.speed, rate), Steering(now.steer, now.speed)
        acceleration = now.lateral_acceleration if once else last
        for _ in range(1 if once else rounds):
            found = lateral_motion(x, u, wheel_loads(acceleration, car), tires, car)
            acceleration = found.lateral_acceleration
        return found

    def slopes(found: LateralMotion, now: LateralSample) -> tuple[Any, Any]:
        return now.speed * found.side_slip_rate, found.yaw_acceleration

    @jax.checkpoint
    def step(carry: Any, now_and_dt: Any) -> tuple[Any, Any]:
        (v_y, rate), (a, b), last = carry
        now, dt = now_and_dt
        found = motion(v_y + dt * a, rate + dt * b, now, last, _ROUNDS[0])
        c, d = slopes(found, now)
        v_y, rate = v_y + 0.5 * dt * (a + c), rate + 0.5 * dt * (b + d)
        found = motion(v_y, rate, now, found.lateral_acceleration, _ROUNDS[1])
        guarded = jnp.stack([overloaded(f, t) for f, t in zip(found.load, tires, strict=True)])
        shown = gain * found.lateral_acceleration + own.acceleration_offset
        out = shown, rate + own.yaw_rate_offset, guarded.any()
        return ((v_y, rate), slopes(found, now), found.lateral_acceleration), out

    true = drive._replace(
        steer=drive.steer - own.steer_offset,
        lateral_acceleration=(drive.lateral_acceleration - own.acceleration_offset) / gain,
    )
    none = jnp.zeros_like(drive.speed[0])
    start = own.side_slip * drive.speed[0], own.yaw_rate + none
    carry = start, (none, none), none
    _, (acceleration, rate, guarded) = jax.lax.scan(step, carry, (true, interval))
    return drive._replace(lateral_acceleration=acceleration, yaw_rate=rate), guarded


def weighted_errors(
    theta: Any, own: Any, drive: LateralSample, weight: Any, task: Task, loads: str
) -> tuple[Any, Any]:
    """Simulated less measured in units of noise [time, 2] of one record, and where guards act.

    Args:
        theta: parameters [n].
        own: the record's own numbers, in standard deviations, [5].
        drive, weight: of the record.
        task: the rest.
        loads: as in `simulate`.
    """
    given = Own(*(own * task.own))
    shown, guarded = simulate(tires_of(theta, task), given, drive, task.interval, task.car, loads)
    error = jnp.stack(
        [
            shown.lateral_acceleration - drive.lateral_acceleration,
            shown.yaw_rate - drive.yaw_rate,
        ],
        axis=1,
    )
    return weight * error, guarded & (weight > 0.0).any(1)


def penalty(theta: Any, own: Any, task: Task) -> Any:
    """What the parameters [n] and own numbers [records, 5] cost: their distance from 0, squared.

    It holds at its start what the records do not see, and bends the rest by next to nothing.
    """
    return (theta * theta).sum() / (task.spread * task.spread) + (own * own).sum()


def loss(theta: Any, own: Any, task: Task, loads: str = "measured") -> Any:
    """Sum of squares of the weighted errors, and `penalty`.

    Twice the negative logarithm of the posterior density, up to a constant. Differentiable both
    ways; backwards, the simulation keeps its state only.

    Args:
        theta: parameters [n].
        own: the records' own numbers, in standard deviations, [records, 5].
        task: what they are judged by.
        loads: as in `simulate`.
    """

    def one(own: Any, drive: LateralSample, weight: Any) -> Any:
        e, _ = weighted_errors(theta, own, drive, weight, task, loads)
        return (e * e).sum()

    return jax.vmap(one)(own, task.drive, task.weight).sum() + penalty(theta, own, task)
