"""The two-track model as a state-space model: what a lateral filter of one hypothesis believes.

The hypothesis says which tyre is on which wheel; the filter finds side slip and yaw rate, the
road's friction and the offsets of the sensors beside them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from wheelhop.filtering import Gaussian, StateSpaceModel, independent
from wheelhop.filtering.smallmat import diagonal
from wheelhop.staging import stage
from wheelhop.vehicle.lateral_tire import ARCTANGENT, TireLaw
from wheelhop.vehicle.two_track import (
    LateralState,
    Steering,
    TwoTrack,
    Wheels,
    lateral_motion,
    wheel_loads,
)


class LateralBelief(NamedTuple):
    """State of a lateral filter.

    Attributes:
        side_slip: beta [rad].
        yaw_rate: [rad/s].
        ln_friction: logarithm of the road's friction relative to the tyres' data.
        ln_mass: logarithm of the vehicle's mass over the one it is thought to have; the yaw inertia
            goes with it.
        acceleration_bias: of the accelerometer [m/s^2].
        yaw_rate_bias: of the gyroscope [rad/s].
        steer_bias: of the steering sensor, as angle of the front wheels [rad].
    """

    side_slip: Any
    yaw_rate: Any
    ln_friction: Any
    ln_mass: Any
    acceleration_bias: Any
    yaw_rate_bias: Any
    steer_bias: Any


class LateralReading(NamedTuple):
    """What is measured: lateral acceleration [m/s^2] and yaw rate [rad/s]."""

    lateral_acceleration: Any
    yaw_rate: Any


class LateralInput(NamedTuple):
    """What drives the model over one sampling interval.

    Attributes:
        steer: measured angle of the front wheels at its end [rad].
        steer_before: at its beginning [rad].
        speed: [m/s].
        load_acceleration: measured lateral acceleration at its beginning [m/s^2], from which the
            loads follow. That at its end has the noise that the filter is about to weigh: with it
            a model explains part of every noise, the more the more its tyres slip.
    """

    steer: Any
    steer_before: Any
    speed: Any
    load_acceleration: Any


LATERAL_PRIOR = LateralBelief(0.01, 0.02, 0.3, 0.1, 0.1, 0.005, 0.001)
"""Standard deviations before the first sample."""

LATERAL_WALK = LateralBelief(1e-4, 3e-4, 0.03, 1e-4, 1e-3, 1e-5, 1e-5)
"""Standard deviations gained in one second, of a vehicle that is the model."""

LATERAL_NOISE = LateralReading(0.05, 0.002)
"""Standard deviations of the sensors of stability control."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class LateralTuning:
    """Of a lateral filter.

    Attributes:
        prior: standard deviations before the first sample.
        walk: standard deviations that every component gains in one second [unit/s^0.5]: what the
            model leaves out, changes of road and drift of sensors.
        noise: standard deviations of the sensors.
        misfit: what the model leaves out of the lateral acceleration, as a share of it [-].
        gate: lateral acceleration [m/s^2] at which a sample tells half of what its likelihood
            says of the hypotheses; 0 takes every sample at its word. Straight ahead they are all
            equal but for the noise they assume, which over a long time is no evidence.
    """

    prior: LateralBelief = LATERAL_PRIOR
    walk: LateralBelief = LATERAL_WALK
    noise: LateralReading = LATERAL_NOISE
    misfit: Any = 0.0
    gate: Any = 0.5


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class LateralParams:
    """Of one hypothesis.

    Attributes:
        car: the vehicle.
        tires: `Wheels`.
        drive: inputs of the interval.
        dt: sampling interval [s].
        tuning: of the filter.
    """

    car: TwoTrack
    tires: Wheels
    drive: LateralInput
    dt: Any
    tuning: LateralTuning = LateralTuning()


@lru_cache(maxsize=8)
def lateral_model(law: TireLaw = ARCTANGENT) -> StateSpaceModel:
    """Two-track model with friction and offsets of the sensors.

    Args:
        law: of the tyres.
    """

    @stage
    def motion(x: LateralState, steer: Any, b: LateralBelief, p: LateralParams) -> Any:
        u = Steering(steer - b.steer_bias, p.drive.speed)
        shown = p.drive.load_acceleration - b.acceleration_bias
        true = shown / (1.0 + p.car.roll_gain)
        heavier = jnp.exp(b.ln_mass)
        car = replace(p.car, mass=heavier * p.car.mass, yaw_inertia=heavier * p.car.yaw_inertia)
        load = wheel_loads(true, car)
        found = lateral_motion(x, u, load, p.tires, car, jnp.exp(b.ln_friction), law)
        return found.side_slip_rate, found.yaw_acceleration, found.lateral_acceleration

    def transition(b: LateralBelief, p: LateralParams) -> LateralBelief:
        between = 0.5 * (p.drive.steer + p.drive.steer_before)

        def slope(x: LateralState) -> LateralState:
            return LateralState(*motion(x, between, b, p)[:2])

        x = rk2(slope, LateralState(b.side_slip, b.yaw_rate), p.dt)
        return b._replace(side_slip=x.side_slip, yaw_rate=x.yaw_rate)

    def observation(b: LateralBelief, p: LateralParams) -> LateralReading:
        felt = motion(LateralState(b.side_slip, b.yaw_rate), p.drive.steer, b, p)[2]
        shown = (1.0 + p.car.roll_gain) * felt
        return LateralReading(shown + b.acceleration_bias, b.yaw_rate + b.yaw_rate_bias)

    def process_cov(b: LateralBelief, p: LateralParams) -> Any:
        del b
        return diagonal([walk * walk * p.dt for walk in p.tuning.walk])

    def observation_cov(p: LateralParams) -> Any:
        left_out = p.tuning.misfit * p.drive.load_acceleration
        a, r = p.tuning.noise
        return diagonal([a * a + left_out * left_out, r * r + 0.0 * left_out])

    return StateSpaceModel(transition, observation, process_cov, observation_cov)


def lateral_prior(tuning: LateralTuning, friction: Any = 1.0) -> Gaussian:
    """Belief before the first sample of a vehicle that drives straight ahead.

    Args:
        tuning: of the filter.
        friction: expected of the road [-].
    """
    mean = LateralBelief(0.0, 0.0, jnp.log(friction), 0.0, 0.0, 0.0, 0.0)
    return independent(mean, tuning.prior)


def rk2(derivative: Any, x: Any, dt: Any) -> Any:
    """Midpoint rule, second order."""
    half = jax.tree.map(lambda a, b: a + 0.5 * dt * b, x, derivative(x))
    return jax.tree.map(lambda a, b: a + dt * b, x, derivative(half))
