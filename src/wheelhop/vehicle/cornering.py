"""A car on four tyres through a corner: the truth that lateral estimators are judged by.

The two-track model under the loads of its own lateral acceleration, by Runge & Kutta's rule of
fourth order at a finer step than the sensors'; nothing of it is printed in a wrong sign.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.errors import InputError, require_in_range
from wheelhop.vehicle import lateral_tire, two_track
from wheelhop.vehicle.lateral_tire import ARCTANGENT, ArctangentTire, TireLaw
from wheelhop.vehicle.two_track import (
    LateralMotion,
    LateralState,
    Steering,
    TwoTrack,
    Wheels,
    balanced_motion,
)

DT = 0.01
"""Sampling interval of sensors of stability control [s]."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class SineSteer:
    """Steer in whole sine periods, to the left first, and after a gap once more.

    Attributes:
        amplitude: of the front wheels' angle [rad].
        begin: of the first period [s].
        period: [s].
        cycles: whole number of periods.
        gap: between the two trains of periods [s].
        again: what the second train is of the first: -1 its mirror image, 0 if there is none.
    """

    amplitude: Any
    begin: Any = 5.0
    period: Any = 2.5
    cycles: Any = 1.0
    gap: Any = 2.0
    again: Any = 0.0


class Cornering(NamedTuple):
    """What a car truly does, at the ends of the sampling intervals; all [time].

    Attributes:
        time: [s].
        steer: angle of the front wheels [rad].
        side_slip: beta [rad].
        yaw_rate: [rad/s].
        lateral_acceleration: a_y of the centre of mass [m/s^2].
        load: vertical forces [N], `Wheels`.
        force: lateral forces [N], `Wheels`.
        slip_angle: [rad], `Wheels`.
        overloaded: number of tyres outside their law's range.
    """

    time: Any
    steer: Any
    side_slip: Any
    yaw_rate: Any
    lateral_acceleration: Any
    load: Wheels
    force: Wheels
    slip_angle: Wheels
    overloaded: Any


def double_lane_change(
    amplitude: Any, begin: Any = 5.0, period: Any = 2.5, gap: Any = 2.0
) -> SineSteer:
    """Steer into the lane on the left and back: a sine period, and its mirror image.

    Args:
        amplitude: of the front wheels' angle [rad].
        begin: [s].
        period: of each change of lane [s].
        gap: straight ahead between them [s].
    """
    return SineSteer(amplitude, begin, period, 1.0, gap, -1.0)


def slalom(amplitude: Any, begin: Any = 5.0, period: Any = 2.5, cycles: Any = 4.0) -> SineSteer:
    """Steer left and right without a pause.

    Args:
        amplitude: of the front wheels' angle [rad].
        begin: [s].
        period: [s].
        cycles: whole number of periods.
    """
    return SineSteer(amplitude, begin, period, cycles)


def straight() -> SineSteer:
    """No steer."""
    return SineSteer(0.0)


def steer_at(maneuver: SineSteer, t: Any) -> Any:
    """Angle of the front wheels [rad] at a time [s], any shape."""
    length = maneuver.cycles * maneuver.period

    def train(since: Any) -> Any:
        inside = (since > 0.0) & (since < length)
        return jnp.where(inside, jnp.sin(2.0 * jnp.pi * since / maneuver.period), 0.0)

    since = t - maneuver.begin
    second = train(since - length - maneuver.gap)
    return maneuver.amplitude * (train(since) + maneuver.again * second)


def simulate_cornering(
    steer: SineSteer | Callable[[Any], Any] | jax.Array | np.ndarray,
    speed: Any,
    tires: Wheels,
    car: TwoTrack,
    friction: Any = 1.0,
    law: TireLaw = ARCTANGENT,
    *,
    duration: float = 20.0,
    dt: float = DT,
    substeps: int = 2,
) -> Cornering:
    """Drive at constant speed from straight ahead; pure, for `jit` and `vmap`.

    Args:
        steer: a maneuver; a function of time [s] to angles of the front wheels [rad]; or their
            samples at 0, dt, ... duration, [time + 1], with straight lines between.
        speed: [m/s].
        tires: parameters of the tyres, `Wheels`.
        car: the vehicle.
        friction: of the road relative to the tyres' data [-].
        law: of the tyres.
        duration: [s].
        dt: sampling interval [s].
        substeps: steps of integration in a sampling interval; two of 5 ms leave 2e-8 m/s^2 of the
            lane change's a_y.

    Returns:
        Signals at dt, 2 dt, ... duration.

    Raises:
        InputError: for a duration, interval or number of steps out of range, or samples of another
            length.
    """
    count = _validate_times(duration, dt, substeps)
    angle = _angle_over_time(steer, count, dt)
    h = dt / substeps

    def motion(beta: Any, rate: Any, t: Any) -> LateralMotion:
        return balanced_motion(
            LateralState(beta, rate), Steering(angle(t), speed), tires, car, friction, law
        )

    def step(x: tuple[Any, Any], k: Any) -> tuple[tuple[Any, Any], tuple[Any, Any]]:
        # the four stages are one loop: the motion is compiled once
        def stage(carry: Any, weights: Any) -> tuple[Any, None]:
            slope, total = carry
            reach, share = weights
            beta, rate = (a + reach * h * b for a, b in zip(x, slope, strict=True))
            found = motion(beta, rate, k * h + reach * h)
            slope = (found.side_slip_rate, found.yaw_acceleration)
            return (slope, tuple(a + share * b for a, b in zip(total, slope, strict=True))), None

        none = jax.tree.map(jnp.zeros_like, x)
        reach = jnp.array([0.0, 0.5, 0.5, 1.0], x[0].dtype)
        share = jnp.array([1.0, 2.0, 2.0, 1.0], x[0].dtype) / 6.0
        (_, total), _ = jax.lax.scan(stage, (none, none), (reach, share))
        after = tuple(a + h * b for a, b in zip(x, total, strict=True))
        return after, after

    rest = jnp.zeros((), jnp.result_type(float))
    steps = jnp.arange(count * substeps).astype(rest.dtype)
    _, (beta, rate) = jax.lax.scan(step, (rest, rest), steps)
    beta, rate = beta[substeps - 1 :: substeps], rate[substeps - 1 :: substeps]
    time = dt * jnp.arange(1, count + 1).astype(rest.dtype)
    found = jax.vmap(motion)(beta, rate, time)
    guarded = [
        law.overloaded(load, tire).astype(jnp.int32)
        for load, tire in zip(found.load, tires, strict=True)
    ]
    return Cornering(
        time=time,
        steer=jnp.broadcast_to(jax.vmap(angle)(time), time.shape),
        side_slip=beta,
        yaw_rate=rate,
        lateral_acceleration=found.lateral_acceleration,
        load=found.load,
        force=found.force,
        slip_angle=found.slip_angle,
        overloaded=sum(guarded[1:], guarded[0]),
    )


def _angle_over_time(steer: Any, count: int, dt: float) -> Callable[[Any], Any]:
    if isinstance(steer, SineSteer):
        return lambda t: steer_at(steer, t)
    if callable(steer):
        return steer
    steer = jnp.asarray(steer, float)
    if steer.shape != (count + 1,):
        raise InputError(
            "steer", f"samples of shape {steer.shape}", f"Give {count + 1}, from 0 to the end."
        )
    knots = dt * jnp.arange(count + 1).astype(steer.dtype)
    return lambda t: jnp.interp(t, knots, steer)


def _validate_times(duration: float, dt: float, substeps: int) -> int:
    require_in_range("dt", dt, 1e-5, 1.0, "s")
    require_in_range("duration", duration, dt, 3600.0, "s")
    require_in_range("substeps", substeps, 1, 1000, "steps")
    count = round(duration / dt)
    if abs(count * dt - duration) > 1e-6 * duration:
        raise InputError(
            "duration", f"{duration:g} s is no multiple of {dt:g} s", "Give a whole number of dt."
        )
    return count


def validate_maneuver(maneuver: SineSteer) -> SineSteer:
    """The same maneuver, checked; for plain numbers.

    Raises:
        InputError: naming what is out of range.
    """
    for name, low, high, unit in (
        ("amplitude", -0.6, 0.6, "rad"),
        ("begin", 0.0, 3600.0, "s"),
        ("period", 0.1, 600.0, "s"),
        ("cycles", 1.0, 1000.0, "periods"),
        ("gap", 0.0, 3600.0, "s"),
        ("again", -1.0, 1.0, "(no unit)"),
    ):
        require_in_range(f"steer.{name}", getattr(maneuver, name), low, high, unit)
    if float(maneuver.cycles) != round(float(maneuver.cycles)):
        raise InputError(
            "steer.cycles", f"{float(maneuver.cycles):g} periods", "Give a whole number."
        )
    return maneuver


def validate(
    maneuver: SineSteer, speed: float, tires: Wheels, car: TwoTrack, friction: float = 1.0
) -> None:
    """Check what `simulate_cornering` takes; for plain numbers.

    Args:
        maneuver: of the driver.
        speed: [m/s].
        tires: of the paper's law, or of another, which is not looked into.
        car: the vehicle.
        friction: of the road relative to the tyres' data [-].

    Raises:
        InputError: naming what is out of range.
    """
    validate_maneuver(maneuver)
    require_in_range("speed", speed, 1.0, 100.0, "m/s")
    require_in_range("friction", friction, 0.02, 2.0, "(no unit)")
    two_track.validate(car)
    for name, tire in zip(Wheels._fields, tires, strict=True):
        if isinstance(tire, ArctangentTire):
            lateral_tire.validate(name, tire)
