"""Switched two-track models that say which tyre went soft while cornering.

Solmaz, "A novel method for indirect estimation of tire pressure", section III: one model for every
combination of soft tyres, a forgetting cost of each one's errors, and the cheapest is believed.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from wheelhop.errors import InputError, require_in_range
from wheelhop.vehicle.lateral_record import LateralSample
from wheelhop.vehicle.lateral_tire import ARCTANGENT, TireLaw
from wheelhop.vehicle.two_track import (
    LateralMotion,
    LateralState,
    Steering,
    TwoTrack,
    Wheels,
    lateral_motion,
    wheel_loads,
)
from wheelhop.vehicle.two_track import validate as validate_car


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class SwitchTuning:
    """Design parameters; the paper names the first three and gives no values.

    Attributes:
        instantaneous: alpha of Eq. 13, weight of the error now.
        cumulative: gamma [1/s], weight of the integral.
        forgetting: lambda [1/s].
        acceleration_scale: of the error's first entry [m/s^2]; 1 as printed.
        yaw_rate_scale: of its second [rad/s]; 1 as printed.
        hysteresis: a model is left only for one cheaper by this share [-]; 0 as printed.
        gate: size of the measured lateral acceleration [m/s^2] below which nothing is learnt and
            no model is chosen; 0 as printed. Driving straight ahead, all models are equal.
        side_slip_gain: of the observer, share of the measured acceleration in the side slip's rate
            [-]: 0 runs the model alone.
        yaw_rate_gain: of the observer [1/s].
    """

    instantaneous: Any = 1.0
    cumulative: Any = 1.0
    forgetting: Any = 0.1
    acceleration_scale: Any = 1.0
    yaw_rate_scale: Any = 1.0
    hysteresis: Any = 0.0
    gate: Any = 0.0
    side_slip_gain: Any = 0.5
    yaw_rate_gain: Any = 1.0


STEADY_TUNING = SwitchTuning(
    forgetting=0.05,
    acceleration_scale=0.05,
    yaw_rate_scale=2e-3,
    hysteresis=0.1,
    gate=0.3,
    side_slip_gain=0.1,
)
"""For sensors with noise: errors in units of it, and no opinion while driving straight ahead."""

SLOWEST = 3.0
"""Speed [m/s] below which a vehicle is taken to roll straight and nothing is learnt."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class SwitchedParams:
    """Of m switched models.

    Attributes:
        car: the vehicle.
        tires: of the models, `Wheels` with leaves [m], as from `failure_modes.stacked_tires`.
        dt: sampling interval [s].
        tuning: of cost and observer.
    """

    car: TwoTrack
    tires: Wheels
    dt: Any
    tuning: SwitchTuning = SwitchTuning()


class SwitchedState(NamedTuple):
    """Between two samples.

    Attributes:
        side_slip, yaw_rate: of the models [rad], [rad/s], [m].
        integral: of Eq. 13 [m].
        error: size of the last error [m].
        selected: model believed, from zero.
        last: the last sample used.
        rates: of side slip and yaw rate at that sample, two of [m].
    """

    side_slip: Any
    yaw_rate: Any
    integral: Any
    error: Any
    selected: Any
    last: LateralSample
    rates: tuple[Any, Any]


class SwitchedInfo(NamedTuple):
    """Report of one sample.

    Attributes:
        cost: J of Eq. 13 [m].
        selected: model with the least of them, from zero.
        lateral_acceleration: of the models [m/s^2], [m].
        yaw_rate: of the models [rad/s], [m].
        cornering_stiffness: S / alpha of the selected model's tyres [N/rad], `Wheels` (Eq. 15).
        overloaded: number of the selected model's tyres on which the law's guard acts.
        missing: number of sensors without a sample; such a time costs nothing.
        learning: whether this sample counted: complete, fast enough, cornering beyond the gate.
    """

    cost: Any
    selected: Any
    lateral_acceleration: Any
    yaw_rate: Any
    cornering_stiffness: Wheels
    overloaded: Any
    missing: Any
    learning: Any


class Switched(NamedTuple):
    """A bank of switched models: `init` (params) -> state, `step` (state, sample, params) ->
    (state, info), pure functions of one run."""

    init: Any
    step: Any


@lru_cache(maxsize=16)
def switched(slip: str = "observer", printed: bool = False, law: TireLaw = ARCTANGENT) -> Switched:
    """Switched two-track models.

    Args:
        slip: "observer", every model on its own states, corrected by the sensors, which does not
            drift; or "integrated", all models on the side slip of Eq. 10 and the measured yaw rate.
        printed: steering and slip angles of right turns as printed (Eq. 2 and 9).
        law: of the tyres.

    Raises:
        InputError: for another slip.
    """
    if slip not in ("observer", "integrated"):
        raise InputError("slip", f"{slip!r} is unknown", "Use 'observer' or 'integrated'.")
    integrated = slip == "integrated"

    def motion(beta: Any, rate: Any, y: LateralSample, params: SwitchedParams) -> LateralMotion:
        load = wheel_loads(y.lateral_acceleration / (1.0 + params.car.roll_gain), params.car)

        def one(b: Any, r: Any, tires: Wheels) -> LateralMotion:
            x, u = LateralState(b, r), Steering(y.steer, y.speed)
            return lateral_motion(x, u, load, tires, params.car, 1.0, law, printed)

        if integrated:
            rate = jnp.broadcast_to(y.yaw_rate, rate.shape)
        return jax.vmap(one)(beta, rate, params.tires)

    def shown(found: LateralMotion, params: SwitchedParams) -> Any:
        return (1.0 + params.car.roll_gain) * found.lateral_acceleration

    def rates(
        beta: Any, rate: Any, y: LateralSample, found: LateralMotion, params: SwitchedParams
    ) -> tuple[Any, Any]:
        """Of the side slip that the slip angles take, and of the model's yaw rate."""
        tuning = params.tuning
        acceleration = y.lateral_acceleration / (1.0 + params.car.roll_gain)
        if integrated:
            kinematic = acceleration / y.speed - y.yaw_rate
            return jnp.broadcast_to(kinematic, beta.shape), found.yaw_acceleration
        error = acceleration - found.lateral_acceleration
        return (
            found.side_slip_rate + tuning.side_slip_gain * error / y.speed,
            found.yaw_acceleration + tuning.yaw_rate_gain * (y.yaw_rate - rate),
        )

    def init(params: SwitchedParams) -> SwitchedState:
        modes = jax.tree.leaves(params.tires)[0].shape[0]
        none = jnp.zeros(modes, jnp.result_type(float))
        zero = none[0]
        straight = LateralSample(zero, zero, zero, zero)
        last = jnp.asarray(modes - 1)
        return SwitchedState(none, none, none, none, last, straight, (none, none))

    def step(
        state: SwitchedState, y: LateralSample, params: SwitchedParams
    ) -> tuple[SwitchedState, SwitchedInfo]:
        tuning, dt = params.tuning, params.dt
        lost = [~jnp.isfinite(entry) for entry in y]
        missing = sum(entry.astype(jnp.int32) for entry in lost)
        y = LateralSample(
            *(jnp.where(gone, b, a) for gone, a, b in zip(lost, y, state.last, strict=True))
        )
        rolls = y.speed >= SLOWEST
        received, y = y, y._replace(speed=jnp.maximum(y.speed, SLOWEST))
        # Heun's rule: the sensors are known at both ends of the interval
        beta = state.side_slip + dt * state.rates[0]
        rate = state.yaw_rate + dt * state.rates[1]
        ahead = rates(beta, rate, y, motion(beta, rate, y, params), params)
        beta = jnp.where(rolls, state.side_slip + 0.5 * dt * (state.rates[0] + ahead[0]), 0.0)
        rate = jnp.where(rolls, state.yaw_rate + 0.5 * dt * (state.rates[1] + ahead[1]), 0.0)
        found = motion(beta, rate, y, params)
        learning = rolls & (missing == 0) & (jnp.abs(y.lateral_acceleration) >= tuning.gate)
        e_a = (y.lateral_acceleration - shown(found, params)) / tuning.acceleration_scale
        e_r = (y.yaw_rate - rate) / tuning.yaw_rate_scale
        error = jnp.where(learning, jnp.hypot(e_a, e_r), 0.0)
        decay = jnp.exp(-tuning.forgetting * dt)
        grown = decay * state.integral + 0.5 * dt * (decay * state.error + error)
        integral = jnp.where(learning | (tuning.gate <= 0.0), grown, state.integral)
        cost = tuning.instantaneous * error + tuning.cumulative * integral
        best = jnp.argmin(cost)
        cheaper = cost[best] < (1.0 - tuning.hysteresis) * cost[state.selected]
        chosen = jnp.where(learning & cheaper, best, state.selected)
        tires = jax.tree.map(lambda leaf: leaf[chosen], params.tires)
        stiffness, overloaded = _of_the_chosen(found, chosen, tires, law)
        turning, yawing = rates(beta, rate, y, found, params)
        slopes = (jnp.where(rolls, turning, 0.0), jnp.where(rolls, yawing, 0.0))
        after = SwitchedState(beta, rate, integral, error, chosen, received, slopes)
        return after, SwitchedInfo(
            cost, chosen, shown(found, params), rate, stiffness, overloaded, missing, learning
        )

    return Switched(init, step)


def _of_the_chosen(
    found: LateralMotion, chosen: Any, tires: Wheels, law: TireLaw
) -> tuple[Wheels, Any]:
    """Secant stiffnesses of one model's tyres, the slope where nothing slips; guards acting."""
    stiffness, guarded = [], []
    for slips, loads, tire in zip(found.slip_angle, found.load, tires, strict=True):
        slip, load = slips[chosen], jnp.broadcast_to(loads, slips.shape)[chosen]
        small = jnp.abs(slip) < 1e-6
        slip = jnp.where(small, 1e-6, slip)
        stiffness.append(law.force(slip, load, tire, 1.0) / slip)
        guarded.append(law.overloaded(load, tire).astype(jnp.int32))
    return Wheels(*stiffness), sum(guarded[1:], guarded[0])


def validate_params(params: SwitchedParams) -> SwitchedParams:
    """The same parameters, checked; for plain numbers.

    Raises:
        InputError: naming the parameter that is out of range.
    """
    validate_car(params.car)
    require_in_range("dt", params.dt, 1e-5, 0.5, "s")
    validate_tuning(params.tuning)
    return params


def validate_tuning(tuning: SwitchTuning) -> SwitchTuning:
    """The same design parameters, checked; for plain numbers.

    Raises:
        InputError: naming the parameter that is out of range.
    """
    for name, high, unit in (
        ("instantaneous", 1e6, "(no unit)"),
        ("cumulative", 1e6, "1/s"),
        ("forgetting", 1e3, "1/s"),
        ("hysteresis", 0.99, "(no unit)"),
        ("gate", 20.0, "m/s^2"),
        ("side_slip_gain", 1.0, "(no unit)"),
        ("yaw_rate_gain", 1e3, "1/s"),
    ):
        require_in_range(f"tuning.{name}", getattr(tuning, name), 0.0, high, unit)
    for name, unit in (("acceleration_scale", "m/s^2"), ("yaw_rate_scale", "rad/s")):
        require_in_range(f"tuning.{name}", getattr(tuning, name), 1e-6, 1e6, unit)
    if float(tuning.instantaneous) + float(tuning.cumulative) == 0.0:
        raise InputError("tuning", "both weights of the cost are 0", "Make one of them positive.")
    return tuning
