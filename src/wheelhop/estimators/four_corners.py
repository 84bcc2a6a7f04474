"""Stiffness of four tyres that roll over roads of one roughness.

The four corners have tyres of their own and share ln G (design: their informations add). What is
common to all wheels is as uncertain as the road's level leaves it; how the wheels differ is known
almost as well as on a known road, and one soft tyre is found by that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from wheelhop.errors import InputError
from wheelhop.estimators import road_model
from wheelhop.estimators.changing import ChangeTuning, changing_modes
from wheelhop.estimators.road_model import corner_on_road
from wheelhop.estimators.stiffness import (
    INNER,
    CornerTheta,
    StiffnessTuning,
    bind_theta,
    prior_ln_sigma,
    stiffness_params,
    substeps_for,
    validate_tuning,
)
from wheelhop.filtering import (
    Filter,
    InteractingParams,
    SensitivityParams,
    SensitivityPrior,
    independent,
    interacting,
    joint_sensitivity,
)
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.tire import stiffness_from_pressure

WHEELS = ("FL", "FR", "RL", "RR")
"""The wheels, in the order of every array of four."""

VEHICLE_TUNING = StiffnessTuning(stiffness_walk=0.008)
"""Default tuning: four corners settle sooner than one, and may follow a leak more closely."""


class VehicleTheta(NamedTuple):
    """What is estimated of a vehicle.

    Attributes:
        ln_k_t_fl, ln_k_t_fr, ln_k_t_rl, ln_k_t_rr: log of the tyres' stiffness in N/m.
        ln_level: log of the road's level over that of the parameters.
    """

    ln_k_t_fl: Any
    ln_k_t_fr: Any
    ln_k_t_rl: Any
    ln_k_t_rr: Any
    ln_level: Any


_PLACES = tuple((i, 4) for i in range(4))


def four_corner_filter(dt: float, inner: str = "extended") -> Filter:
    """Recursive maximum likelihood over four corners with one roughness.

    Args:
        dt: sampling interval [s].
        inner: key of `stiffness.INNER`.

    Returns:
        A `Filter` over `SensitivityState`; parameters from `four_corner_params`, belief before the
        first sample from `four_corner_prior`, measurements `Accelerations` with entries [4].
    """
    if inner not in INNER:
        raise InputError("inner", f"{inner!r} is unknown", f"Use one of {tuple(INNER)}.")
    return _four(substeps_for(dt), inner)


def changing_four_corner_filter(dt: float, inner: str = "extended") -> Filter:
    """IMM of `four_corner_filter` over what changes: nothing, the road, or tyres."""
    return _changing(four_corner_filter(dt, inner))


@lru_cache(maxsize=16)
def _four(substeps: int, inner: str) -> Filter:
    corner = INNER[inner](corner_on_road(False, substeps))
    return joint_sensitivity(corner, bind_theta, CornerTheta, _PLACES)


@lru_cache(maxsize=16)
def _changing(member: Filter) -> Filter:
    return interacting(member)


def four_corner_params(
    cars: Sequence[QuarterCar],
    speed: float,
    dt: float,
    tuning: StiffnessTuning = VEHICLE_TUNING,
) -> SensitivityParams:
    """Parameters of `four_corner_filter`.

    Args:
        cars: the corners FL, FR, RL, RR; one parameter set for all is refused, give it four times.
        speed: v [m/s] until `bind_speed` sets another.
        dt: sampling interval [s].
        tuning: priors, walks and noise.

    Raises:
        InputError: if there are not four corners, or tuning is out of range.
    """
    if len(cars) != len(WHEELS):
        raise InputError("cars", f"{len(cars)} corners", "Give four: FL, FR, RL, RR.")
    each = [stiffness_params(car, speed, dt, tuning) for car in cars]
    inner = jax.tree.map(lambda *a: jnp.stack(a), *(e.inner for e in each))
    tyre, level = each[0].walk
    return SensitivityParams(inner, VehicleTheta(tyre, tyre, tyre, tyre, level))


def four_corner_prior(
    params: SensitivityParams, tuning: StiffnessTuning = VEHICLE_TUNING
) -> SensitivityPrior:
    """Belief before the first sample: moving a little, tyres and roughness as in the tuning."""
    inner = params.inner
    tires = [jax.tree.map(lambda a, i=i: a[i], inner.car.tire) for i in range(len(WHEELS))]
    mean = [jnp.log(stiffness_from_pressure(tuning.prior_pressure, tire)) for tire in tires]
    sigma = [prior_ln_sigma(tuning, tire) for tire in tires]
    zero = jnp.zeros_like(mean[0])
    theta = independent(
        VehicleTheta._make([*mean, zero]),
        VehicleTheta._make([*sigma, jnp.asarray(tuning.prior_level_sigma)]),
    )
    theta = jax.tree.map(lambda a: jnp.asarray(a, float), theta)
    local = CornerTheta(jnp.stack(mean), jnp.broadcast_to(zero, (len(WHEELS),)))
    return SensitivityPrior(road_model.prior(bind_theta(inner, local), False), theta)


def changing_four_corner_params(
    cars: Sequence[QuarterCar],
    speed: float,
    dt: float,
    tuning: StiffnessTuning = VEHICLE_TUNING,
    changes: ChangeTuning = ChangeTuning(),
) -> InteractingParams:
    """Parameters of `changing_four_corner_filter`; see `four_corner_params`."""
    modes = changing_modes(dt, validate_tuning(tuning), changes)
    members = [
        four_corner_params(cars, speed, dt, replace(tuning, stiffness_walk=stiff, level_walk=rough))
        for stiff, rough in zip(modes.stiffness_walks, modes.level_walks, strict=True)
    ]
    return InteractingParams(
        jax.tree.map(lambda *a: jnp.stack(a), *members),
        jnp.asarray(modes.transition, float),
        jnp.asarray(modes.initial, float),
    )


def changing_four_corner_prior(
    params: InteractingParams, tuning: StiffnessTuning = VEHICLE_TUNING
) -> SensitivityPrior:
    """Belief before the first sample; see `four_corner_prior`."""
    return four_corner_prior(jax.tree.map(lambda a: a[0], params.members), tuning)


def bind_speed(params: Any, speed: Any) -> Any:
    """The parameters, of the filter or of its IMM, at a time of speed [m/s]."""
    members = getattr(params, "members", params)
    shape = members.inner.speed.shape[: 2 if members is not params else 1]
    speed = jnp.asarray(speed, members.inner.speed.dtype)
    every = jnp.broadcast_to(speed, (*shape, *speed.shape))
    found = replace(members, inner=replace(members.inner, speed=every))
    return found if members is params else replace(params, members=found)
