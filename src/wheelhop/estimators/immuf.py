"""Brancati & Tufano's interacting multiple model of unscented filters, corrected.

One unscented filter per ISO 8608 road class over x = (d, e, v_s, v_u, ln k_t): the state is
relative to the road, the road is white process noise on the tyre deflection integrated over
the sampling interval, and the tyre stiffness is a random walk in the state, as in the paper.
A joint state of this kind cannot use what the spectrum's level says of the stiffness, so its
accuracy is limited by construction; the README states what was measured.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from wheelhop.errors import InputError, require_in_range
from wheelhop.filtering import (
    Filter,
    Gaussian,
    InteractingParams,
    StateSpaceModel,
    cubature,
    independent,
    interacting,
    unscented,
)
from wheelhop.filtering.sigma_points import Rule
from wheelhop.staging import stage
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.quarter_car import (
    Accelerations,
    RelativeState,
    accelerations,
    relative_step,
)
from wheelhop.vehicle.road import class_level, road_velocity_intensity, stationary_variance
from wheelhop.vehicle.road_noise import road_noise_cov
from wheelhop.vehicle.tire import pressure_slope, stiffness_from_pressure

ROAD_CLASSES = ("A", "B", "C", "D")

_LONGEST_STEP = 0.004


class CornerState(NamedTuple):
    """Relative quarter car with the tyre in the state.

    Attributes:
        deflection: d = z_s - z_u [m].
        tyre_deflection: e = z_u - z_r [m].
        v_s: sprung velocity [m/s].
        v_u: unsprung velocity [m/s].
        ln_k_t: log of the tyre stiffness in N/m.
    """

    deflection: Any
    tyre_deflection: Any
    v_s: Any
    v_u: Any
    ln_k_t: Any


@dataclass(frozen=True)
class Tuning:
    """What a user may tune of the filter.

    Attributes:
        noise_a_s: standard deviation of the body accelerometer [m/s^2].
        noise_a_u: standard deviation of the wheel accelerometer [m/s^2].
        stiffness_walk: random walk of ln k_t [1/sqrt(s)].
        velocity_walk: random walk of the body's velocity [m/s/sqrt(s)], for what the model lacks.
        stay: diagonal of Pz, the probability that the road class holds from one sample to
            the next.
        prior_pressure: mean of the prior [Pa].
        prior_pressure_sigma: its standard deviation [Pa].
        wheel_walk: random walk of the wheel's velocity [m/s/sqrt(s)]; None for the body's.
    """

    noise_a_s: float = 0.5
    noise_a_u: float = 0.5
    stiffness_walk: float = 0.02
    velocity_walk: float = 0.01
    stay: float = 0.97
    prior_pressure: float = 180e3
    prior_pressure_sigma: float = 29e3
    wheel_walk: float | None = None


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class MemberParams:
    """Parameters of one member filter; `speed` varies in time and is bound at each step.

    Attributes:
        car: the corner.
        road_level: Gd(W0) of the member's road [m^3/rad].
        speed: v [m/s].
        dt: sampling interval [s].
        noise_a_s, noise_a_u, stiffness_walk, velocity_walk, wheel_walk: as in `Tuning`.
    """

    car: QuarterCar
    road_level: Any
    speed: Any
    dt: Any
    noise_a_s: Any
    noise_a_u: Any
    stiffness_walk: Any
    velocity_walk: Any
    wheel_walk: Any


def corner_model(substeps: int = 1) -> StateSpaceModel:
    """State-space model of the corner with the stiffness in the state.

    Args:
        substeps: RK4 steps, and pieces of the road noise, per sampling interval.
    """

    def transition(x: CornerState, params: MemberParams) -> CornerState:
        moving = RelativeState(x.deflection, x.tyre_deflection, x.v_s, x.v_u)
        stiffness = jnp.exp(x.ln_k_t)

        def step(motion: RelativeState, _: None) -> tuple[RelativeState, None]:
            return relative_step(motion, stiffness, None, params.dt / substeps, params.car), None

        if substeps == 1:
            moving, _ = step(moving, None)
        else:  # a loop: unrolled, the compiler's fusion repeats the work of every step
            moving, _ = jax.lax.scan(step, moving, length=substeps)
        return CornerState(*moving, x.ln_k_t)

    def observation(x: CornerState, params: MemberParams) -> Accelerations:
        return accelerations(x, jnp.exp(x.ln_k_t), params.car)

    def process_cov(x: CornerState, params: MemberParams) -> tuple:
        dt = params.dt
        q = road_velocity_intensity(params.road_level, params.speed)
        body, wheel = params.velocity_walk**2 * dt, params.wheel_walk**2 * dt
        road = road_noise_cov(jnp.exp(x.ln_k_t), q, dt, params.car, substeps)
        (dd,), (ed, ee), (sd, se, ss), (ud, ue, us, uu) = road
        zero = 0.0 * q
        return (
            (dd,),
            (ed, ee),
            (sd, se, ss + body),
            (ud, ue, us, uu + wheel),
            (zero, zero, zero, zero, params.stiffness_walk**2 * dt),
        )

    def observation_cov(params: MemberParams) -> tuple:
        return ((params.noise_a_s**2,), (0.0, params.noise_a_u**2))

    return StateSpaceModel(stage(transition), stage(observation), process_cov, observation_cov)


def substeps_for(dt: float) -> int:
    """RK4 steps per sampling interval that keep the wheel hop accurate."""
    return max(1, int(-(-dt // _LONGEST_STEP)))


def member_filter(dt: float, rule: Rule = cubature) -> Filter:
    """The unscented filter of one road class, for a sampling interval dt [s]."""
    return _member_filter(substeps_for(dt), rule)


def immuf(dt: float, rule: Rule = cubature) -> Filter:
    """The interacting multiple model filter over road classes, for an interval dt [s]."""
    return _immuf(substeps_for(dt), rule)


@lru_cache(maxsize=32)
def _member_filter(substeps: int, rule: Rule) -> Filter:
    return unscented(corner_model(substeps), rule)


@lru_cache(maxsize=32)
def _immuf(substeps: int, rule: Rule) -> Filter:
    return interacting(_member_filter(substeps, rule))


def member_params(
    car: QuarterCar, road_level: float, speed: float, dt: float, tuning: Tuning = Tuning()
) -> MemberParams:
    """Parameters of one member, as arrays of JAX's default floating type."""
    params = MemberParams(
        car,
        road_level,
        speed,
        dt,
        tuning.noise_a_s,
        tuning.noise_a_u,
        tuning.stiffness_walk,
        tuning.velocity_walk,
        tuning.velocity_walk if tuning.wheel_walk is None else tuning.wheel_walk,
    )
    return jax.tree.map(lambda a: jnp.asarray(a, float), params)


def immuf_params(
    cars: QuarterCar | Sequence[QuarterCar],
    speed: float,
    dt: float,
    tuning: Tuning = Tuning(),
    classes: Sequence[str] = ROAD_CLASSES,
    convention: str = "iso8608",
) -> InteractingParams:
    """Parameters of the IMM, one member per road class.

    Args:
        cars: the corner, or one parameter set per class (as the paper's Table 3).
        speed: v [m/s] until `bind_speed` sets another.
        dt: sampling interval [s].
        tuning: the filter's tuning.
        classes: ISO 8608 classes of the members.
        convention: of their levels, "iso8608" or "brancati2022".

    Raises:
        InputError: for an unknown class or convention, a number of cars that
            does not fit, or tuning out of range.
    """
    validate_tuning(tuning)
    ratio = stationary_variance(1.0, convention) / stationary_variance(1.0)
    levels = [ratio * class_level(c) for c in classes]
    sets = [cars] * len(levels) if isinstance(cars, QuarterCar) else list(cars)
    if len(sets) != len(levels):
        raise InputError(
            "cars", f"{len(sets)} sets for {len(levels)} classes", "Give one, or one per class."
        )
    members = [
        member_params(c, level, speed, dt, tuning) for c, level in zip(sets, levels, strict=True)
    ]
    transition, initial = sticky(len(levels), tuning.stay)
    return InteractingParams(jax.tree.map(lambda *a: jnp.stack(a), *members), transition, initial)


def sticky(modes: int, stay: Any) -> tuple[Any, Any]:
    """Pz with one diagonal and equal rest, Eq. 17, and equal initial probabilities."""
    if modes == 1:
        return jnp.ones((1, 1), float), jnp.ones((1,), float)
    leave = jnp.full((modes, modes), (1.0 - stay) / (modes - 1), float)
    transition = jnp.where(jnp.eye(modes, dtype=bool), stay, leave)
    return transition, jnp.full((modes,), 1.0 / modes, float)


def prior(car: QuarterCar, tuning: Tuning = Tuning()) -> Gaussian:
    """Belief before the first sample: near rest, with the pressure prior of the tuning."""
    stiffness = stiffness_from_pressure(tuning.prior_pressure, car.tire)
    ln_sigma = tuning.prior_pressure_sigma / (pressure_slope(car.tire) * stiffness)
    mean = CornerState(0.0, 0.0, 0.0, 0.0, jnp.log(stiffness))
    return independent(mean, CornerState(0.005, 0.002, 0.05, 0.2, ln_sigma))


def bind_speed(params: InteractingParams, speed: Any) -> InteractingParams:
    """The parameters at a time of speed [m/s]."""
    members = params.members
    speed = jnp.asarray(speed, members.speed.dtype)
    every_mode = jnp.broadcast_to(speed[None], (members.speed.shape[0], *speed.shape))
    return replace(params, members=replace(members, speed=every_mode))


def validate_tuning(tuning: Tuning) -> Tuning:
    """The same tuning, checked.

    Raises:
        InputError: naming the figure that is out of range.
    """
    require_in_range("tuning.noise_a_s", tuning.noise_a_s, 1e-4, 100.0, "m/s^2")
    require_in_range("tuning.noise_a_u", tuning.noise_a_u, 1e-4, 100.0, "m/s^2")
    require_in_range("tuning.stiffness_walk", tuning.stiffness_walk, 0.0, 10.0, "1/sqrt(s)")
    require_in_range("tuning.velocity_walk", tuning.velocity_walk, 0.0, 100.0, "m/s/sqrt(s)")
    if tuning.wheel_walk is not None:
        require_in_range("tuning.wheel_walk", tuning.wheel_walk, 0.0, 100.0, "m/s/sqrt(s)")
    require_in_range("tuning.stay", tuning.stay, 1e-6, 1.0, "(probability)")
    require_in_range("tuning.prior_pressure", tuning.prior_pressure, 20e3, 1.5e6, "Pa")
    require_in_range("tuning.prior_pressure_sigma", tuning.prior_pressure_sigma, 1.0, 1e6, "Pa")
    return tuning
