"""A driver who steers: a car on soft tyres is driven, not left to itself.

With a soft rear tyre the car of Solmaz oversteers, and beyond a critical speed below his 120 km/h
an angle given as a function of time alone ends in a spin.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp

from wheelhop.vehicle.cornering import DT, Cornering, SineSteer, steer_at
from wheelhop.vehicle.lateral_tire import ARCTANGENT, TireLaw
from wheelhop.vehicle.two_track import (
    LateralMotion,
    LateralState,
    Steering,
    TwoTrack,
    Wheels,
    balanced_motion,
)

DRIVER_GAIN = 0.2
"""Steer angle per missing yaw rate [s] of a driver who notices what the car does not do."""


def drive_cornering(
    maneuver: SineSteer,
    speed: Any,
    tires: Wheels,
    car: TwoTrack,
    sound: Wheels,
    expected: TwoTrack,
    friction: Any = 1.0,
    gain: Any = DRIVER_GAIN,
    law: TireLaw = ARCTANGENT,
    *,
    samples: int = 2000,
    dt: float = DT,
    substeps: int = 2,
) -> Cornering:
    """Drive at constant speed from straight ahead; pure, for `jit` and `vmap`.

    delta = delta_0(t) + gain (r_0(t) - r): delta_0 is the maneuver's, r_0 the yaw rate that the car
    the driver expects would have from it. Midpoint rule.

    Args:
        maneuver: what the driver means to do.
        speed: [m/s].
        tires: on the car.
        car: the vehicle.
        sound: tyres that the driver expects.
        expected: vehicle that the driver expects.
        friction: of the road relative to the tyres' data [-].
        gain: [s]; 0 steers as a function of time alone.
        law: of the tyres.
        samples: length of the record.
        dt: sampling interval [s].
        substeps: steps of integration in a sampling interval.

    Returns:
        Signals at dt, 2 dt, ... samples dt.
    """
    h = dt / substeps

    def motions(x: Any, wanted: Any, t: Any) -> tuple[LateralMotion, LateralMotion, Any]:
        meant = steer_at(maneuver, t)
        angle = meant + gain * (wanted.yaw_rate - x.yaw_rate)
        one = balanced_motion(x, Steering(angle, speed), tires, car, friction, law)
        other = balanced_motion(wanted, Steering(meant, speed), sound, expected, 1.0, law)
        return one, other, angle

    def ahead(x: LateralState, found: LateralMotion, reach: Any) -> LateralState:
        return LateralState(
            x.side_slip + reach * found.side_slip_rate, x.yaw_rate + reach * found.yaw_acceleration
        )

    def step(both: Any, k: Any) -> tuple[Any, Any]:
        def half(middle: Any, reach: Any) -> tuple[Any, None]:
            one, other, _ = motions(middle[0], middle[1], k * h + (reach - 0.5 * h))
            return (ahead(both[0], one, reach), ahead(both[1], other, reach)), None

        # the midpoint rule's two stages are one loop: the motion is compiled once
        after, _ = jax.lax.scan(half, both, jnp.array([0.5 * h, h], both[0].yaw_rate.dtype))
        return after, after[0]

    rest = jnp.zeros((), jnp.result_type(float))
    start = LateralState(rest, rest)
    steps = jnp.arange(samples * substeps).astype(rest.dtype)

    def sample(both: Any, k: Any) -> tuple[Any, Any]:
        both, _ = jax.lax.scan(step, both, k)
        t = (k[-1] + 1.0) * h
        found, _, angle = motions(both[0], both[1], t)
        return both, (t, angle, both[0], found)

    _, (t, angle, x, found) = jax.lax.scan(sample, (start, start), steps.reshape(samples, substeps))
    guarded = [
        law.overloaded(load, tire).astype(jnp.int32)
        for load, tire in zip(found.load, tires, strict=True)
    ]
    return Cornering(
        time=t,
        steer=angle,
        side_slip=x.side_slip,
        yaw_rate=x.yaw_rate,
        lateral_acceleration=found.lateral_acceleration,
        load=found.load,
        force=found.force,
        slip_angle=found.slip_angle,
        overloaded=sum(guarded[1:], guarded[0]),
    )
