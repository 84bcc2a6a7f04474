"""Two-track model of lateral vehicle dynamics: side slip and yaw rate on four tyres.

Solmaz, "A novel method for indirect estimation of tire pressure", Eq. 1-3 and 7-11, after Kiencke
& Nielsen 2000. Two of its equations hold for left turns only: with a negative angle Eq. 2 gives the
inner wheel the smaller steer, and with a negative yaw rate Eq. 9 makes the inner wheel the faster.
`printed=True` keeps them; the default steers and moves the wheels as mirror images.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from wheelhop.errors import require_in_range
from wheelhop.staging import stage
from wheelhop.vehicle.arctangent import arctan
from wheelhop.vehicle.full_vehicle_state import STANDARD_GRAVITY
from wheelhop.vehicle.lateral_tire import ARCTANGENT, TireLaw


class Wheels(NamedTuple):
    """One entry a wheel: numbers, arrays or trees."""

    front_left: Any
    front_right: Any
    rear_left: Any
    rear_right: Any


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class TwoTrack:
    """A vehicle for lateral dynamics.

    Attributes:
        mass: m [kg].
        yaw_inertia: J_zz [kg m^2].
        front_arm: l_v, from the centre of mass to the front axle [m].
        rear_arm: l_h, to the rear axle [m].
        track: T [m].
        height: h of the centre of mass [m].
        front_transfer: share of the lateral load transfer that the front axle takes [-]; None for
            that of its static load, as in Eq. 7.
        roll_gain: what an accelerometer on the rolling body shows beyond a_y, per a_y [-]: gravity
            times the roll angle per lateral acceleration; the printed model has none.
    """

    mass: Any
    yaw_inertia: Any
    front_arm: Any
    rear_arm: Any
    track: Any
    height: Any
    front_transfer: Any = None
    roll_gain: Any = 0.0


SOLMAZ_CAR = TwoTrack(1300.0, 1200.0, 1.2, 1.3, 1.5, 0.7)
"""Solmaz, section IV."""


class LateralState(NamedTuple):
    """State of the two-track model: side slip beta [rad] and yaw rate [rad/s]."""

    side_slip: Any
    yaw_rate: Any


class Steering(NamedTuple):
    """What drives the model: angle of the front wheels [rad] and speed [m/s]."""

    steer: Any
    speed: Any


class LateralMotion(NamedTuple):
    """What the tyres do to the vehicle at one instant.

    Attributes:
        side_slip_rate: [rad/s].
        yaw_acceleration: [rad/s^2].
        lateral_acceleration: a_y of the centre of mass [m/s^2].
        force: lateral forces [N], `Wheels`.
        slip_angle: [rad], `Wheels`.
        load: vertical forces [N], `Wheels`.
    """

    side_slip_rate: Any
    yaw_acceleration: Any
    lateral_acceleration: Any
    force: Wheels
    slip_angle: Wheels
    load: Wheels


def wheel_loads(lateral_acceleration: Any, car: TwoTrack) -> Wheels:
    """Vertical forces [N] under lateral acceleration [m/s^2]: Solmaz, Eq. 7.

    A negative load means that the wheel has lifted. With `front_transfer` the moment m h a_y is
    shared as that says, not by the axles' static loads.
    """
    wheelbase = car.front_arm + car.rear_arm
    front = 0.5 * car.mass * STANDARD_GRAVITY * car.rear_arm / wheelbase
    rear = 0.5 * car.mass * STANDARD_GRAVITY * car.front_arm / wheelbase
    share = car.rear_arm / wheelbase if car.front_transfer is None else car.front_transfer
    moved = car.mass * car.height / car.track * lateral_acceleration
    f, r = share * moved, (1.0 - share) * moved
    return Wheels(front - f, front + f, rear - r, rear + r)


def wheel_angles(steer: Any, car: TwoTrack, printed: bool = False) -> tuple[Any, Any]:
    """Angles of the left and right front wheel [rad]: Solmaz, Eq. 2.

    The inner wheel steers more, delta_inner = delta (1 + |delta| T / 2L). As printed, delta +
    delta^2 T / 2L, it steers less in a right turn, where delta is negative.

    Args:
        steer: delta [rad], to the left positive.
        car: the vehicle.
        printed: take the equation as it is printed.
    """
    excess = car.track / (2.0 * (car.front_arm + car.rear_arm)) * steer * steer
    if not printed:
        return steer + excess, steer - excess
    left = steer > 0.0
    return jnp.where(left, steer + excess, steer - excess), jnp.where(
        left, steer - excess, steer + excess
    )


def slip_angles(x: LateralState, u: Steering, car: TwoTrack, printed: bool = False) -> Wheels:
    """Slip angles of the wheels [rad]: Solmaz, Eq. 8, and its mirror image for right turns.

    Args:
        x: state.
        u: steer and speed.
        car: the vehicle.
        printed: Eq. 9 as printed for right turns, with the sides' speeds exchanged.
    """
    left_angle, right_angle = wheel_angles(u.steer, car, printed)
    widen = 0.5 * car.track * x.yaw_rate
    if printed:
        widen = jnp.where(u.steer > 0.0, widen, -widen)
    left, right = u.speed - widen, u.speed + widen
    front = u.speed * x.side_slip + car.front_arm * x.yaw_rate
    rear = u.speed * x.side_slip - car.rear_arm * x.yaw_rate
    return Wheels(
        left_angle - arctan(front / left),
        right_angle - arctan(front / right),
        -arctan(rear / left),
        -arctan(rear / right),
    )


def lateral_motion(
    x: LateralState,
    u: Steering,
    load: Wheels,
    tires: Wheels,
    car: TwoTrack,
    friction: Any = 1.0,
    law: TireLaw = ARCTANGENT,
    printed: bool = False,
) -> LateralMotion:
    """Rates of the state and lateral acceleration: Solmaz, Eq. 1 and 11.

    Args:
        x: state.
        u: steer and speed.
        load: of the wheels [N], as from `wheel_loads` of the measured lateral acceleration.
        tires: parameters of the tyres.
        car: the vehicle.
        friction: of the road relative to the tyres' data [-].
        law: of the tyres.
        printed: slip angles by Eq. 2 and 9 as printed.
    """
    slips = stage(slip_angles)(x, u, car, printed)
    force = stage(wheel_forces)(slips, load, tires, friction, law)
    front, rear = force.front_left + force.front_right, force.rear_left + force.rear_right
    acceleration = (front + rear) / car.mass
    return LateralMotion(
        side_slip_rate=acceleration / u.speed - x.yaw_rate,
        yaw_acceleration=(front * car.front_arm - rear * car.rear_arm) / car.yaw_inertia,
        lateral_acceleration=acceleration,
        force=force,
        slip_angle=slips,
        load=load,
    )


def wheel_forces(
    slips: Wheels, load: Wheels, tires: Wheels, friction: Any = 1.0, law: TireLaw = ARCTANGENT
) -> Wheels:
    """Lateral forces [N] of the wheels, the law traced once for all four.

    Args:
        slips: slip angles [rad].
        load: vertical forces [N].
        tires: parameters of the tyres.
        friction: of the road relative to the tyres' data [-].
        law: of the tyres.
    """
    slip = jnp.stack(jnp.broadcast_arrays(*slips))
    down = _along(jnp.stack(jnp.broadcast_arrays(*load)), slip.ndim)

    def stacked(*leaves: Any) -> Any:
        return _along(jnp.stack([jnp.asarray(leaf, slip.dtype) for leaf in leaves]), slip.ndim)

    tire = jax.tree.map(stacked, *tires)
    grip = _along(jnp.asarray(friction, slip.dtype)[None], slip.ndim)
    force = law.force(slip, down, tire, grip)
    return Wheels(*(force[k] for k in range(4)))


def _along(stacked: Any, axes: int) -> Any:
    """A leading axis of wheels, and axes of one for those that only the slips have."""
    return stacked.reshape(stacked.shape[:1] + (1,) * (axes - stacked.ndim) + stacked.shape[1:])


def balanced_motion(
    x: LateralState,
    u: Steering,
    tires: Wheels,
    car: TwoTrack,
    friction: Any = 1.0,
    law: TireLaw = ARCTANGENT,
    iterations: int = 8,
) -> LateralMotion:
    """`lateral_motion` under the loads of its own lateral acceleration.

    The loads move the tyres' forces by what left and right do not cancel, so that the iteration
    contracts; eight rounds leave less than 1e-6 of a_y for the tyres of Solmaz below 2 m/s^2, and
    1e-4 below 3.

    Args:
        x, u, tires, car, friction, law: as in `lateral_motion`.
        iterations: rounds.
    """

    def at(acceleration: Any) -> LateralMotion:
        return lateral_motion(x, u, wheel_loads(acceleration, car), tires, car, friction, law)

    def again(_: Any, acceleration: Any) -> Any:
        return at(acceleration).lateral_acceleration

    first = at(jnp.zeros_like(x.yaw_rate)).lateral_acceleration
    return at(jax.lax.fori_loop(1, iterations, again, first))


def yaw_gain(speed: Any, front_stiffness: Any, rear_stiffness: Any, car: TwoTrack) -> Any:
    """Steady yaw rate per steer angle [1/s] of the linear model: v / (L + K v^2).

    K = m (l_h C_h - l_v C_v) / (C_v C_h L), with the axles' cornering stiffnesses (Kiencke &
    Nielsen 2000).

    Args:
        speed: [m/s].
        front_stiffness, rear_stiffness: C_v, C_h of the axles [N/rad].
        car: the vehicle.
    """
    wheelbase = car.front_arm + car.rear_arm
    balance = car.rear_arm * rear_stiffness - car.front_arm * front_stiffness
    gradient = car.mass * balance / (front_stiffness * rear_stiffness * wheelbase)
    return speed / (wheelbase + gradient * speed * speed)


def validate(car: TwoTrack) -> TwoTrack:
    """The same vehicle, checked; for plain numbers.

    Raises:
        InputError: naming the parameter that is out of range.
    """
    for name, low, high, unit in (
        ("mass", 50.0, 60e3, "kg"),
        ("yaw_inertia", 5.0, 1e6, "kg m^2"),
        ("front_arm", 0.1, 10.0, "m"),
        ("rear_arm", 0.1, 10.0, "m"),
        ("track", 0.3, 4.0, "m"),
        ("height", 0.0, 3.0, "m"),
        ("roll_gain", -0.5, 1.0, "(no unit)"),
    ):
        require_in_range(f"two_track.{name}", getattr(car, name), low, high, unit)
    if car.front_transfer is not None:
        require_in_range("two_track.front_transfer", car.front_transfer, 0.0, 1.0, "(no unit)")
    return car
