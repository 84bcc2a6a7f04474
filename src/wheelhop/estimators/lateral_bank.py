"""Which tyre went soft, as probabilities: a bank of filters, one for each combination.

The hypotheses of Solmaz, each with an extended Kalman filter of its own instead of a cost of its
errors, so that noise, offsets of the sensors and the road's friction have their place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import jax
import jax.numpy as jnp

from wheelhop.estimators.failure_modes import stacked_tires
from wheelhop.estimators.lateral import LateralSample
from wheelhop.estimators.lateral_model import (
    LateralInput,
    LateralParams,
    LateralReading,
    LateralTuning,
    lateral_model,
    lateral_prior,
)
from wheelhop.filtering import Filter, Gaussian, extended
from wheelhop.filtering.multiple_model import MultipleModelParams, multiple_model
from wheelhop.vehicle.lateral_tire import ARCTANGENT, TireLaw
from wheelhop.vehicle.two_track import TwoTrack, Wheels

CHANGE = 1e-4
"""Default rate [1/s] at which another combination of soft tyres may begin."""


@lru_cache(maxsize=8)
def lateral_bank(law: TireLaw = ARCTANGENT) -> Filter:
    """Bank of extended filters over every combination of soft tyres.

    Args:
        law: of the tyres.
    """
    return multiple_model(extended(lateral_model(law)))


def lateral_params(
    car: TwoTrack,
    levels: Sequence[Any] | Wheels,
    dt: float,
    *,
    tuning: LateralTuning | None = None,
    prior: Any = None,
    change: float = CHANGE,
    temper: float = 1.0,
) -> MultipleModelParams:
    """Parameters of `lateral_bank`.

    Args:
        car: the vehicle.
        levels: tyres from the softest to the sound one, as in `failure_modes.stacked_tires`.
        dt: sampling interval [s].
        tuning: of every filter.
        prior: probabilities of the modes; half for the sound vehicle by default, the rest shared.
        change: rate at which the hypothesis may change [1/s].
        temper: exponent of the likelihoods.
    """
    tires = stacked_tires(levels)
    modes = jax.tree.leaves(tires)[0].shape[0]
    if prior is None:
        prior = jnp.full(modes, 0.5 / (modes - 1)).at[-1].set(0.5)
    prior = jnp.asarray(prior)
    tuning = LateralTuning() if tuning is None else tuning
    zero = jnp.zeros(())
    drive = LateralInput(zero, zero, zero + 1.0, zero)

    def stacked(leaf: Any) -> Any:
        leaf = jnp.asarray(leaf, jnp.result_type(float))
        return jnp.broadcast_to(leaf[None], (modes, *leaf.shape))

    shared, drive, step, tuning = jax.tree.map(stacked, (car, drive, dt, tuning))
    members = LateralParams(shared, tires, drive, step, tuning)
    return MultipleModelParams(members, prior, change * dt, temper)


def bind_drive(params: MultipleModelParams, drive: LateralInput) -> MultipleModelParams:
    """The parameters with the inputs of one interval, the same for every member.

    The likelihoods' exponent is lowered to what the excitation is worth, a^2 / (a^2 + gate^2).
    """
    modes = params.prior.shape[0]
    each = jax.tree.map(lambda a: jnp.broadcast_to(a[None], (modes, *a.shape)), drive)
    gate = params.members.tuning.gate[0]
    excited, floor = drive.load_acceleration**2, gate * gate
    open_always = floor <= 0.0
    worth = jnp.where(open_always, 1.0, excited / jnp.where(open_always, 1.0, excited + floor))
    members = replace(params.members, drive=each)
    return replace(params, members=members, temper=params.temper * worth)


def bank_prior(params: MultipleModelParams, friction: Any = 1.0) -> Gaussian:
    """Belief of every filter before the first sample."""
    tuning = jax.tree.map(lambda leaf: leaf[0], params.members.tuning)
    return lateral_prior(tuning, friction)


def readings_and_inputs(sample: LateralSample) -> tuple[LateralReading, LateralInput]:
    """What `lateral_bank` measures and is driven by, of samples [..., time].

    Where steer or speed is missing, the last one before it drives the model and the sample measures
    nothing.

    Args:
        sample: of the sensors, NaN where one is missing.
    """
    steer, speed = _held(sample.steer), _held(sample.speed)
    drive = LateralInput(
        steer, _delayed(steer), speed, _delayed(_held(sample.lateral_acceleration))
    )
    known = jnp.isfinite(sample.steer) & jnp.isfinite(sample.speed)
    measured = (sample.lateral_acceleration, sample.yaw_rate)
    return LateralReading(*(jnp.where(known, y, jnp.nan) for y in measured)), drive


def _delayed(signal: Any) -> Any:
    """The signal one sample later."""
    return jnp.concatenate([signal[..., :1], signal[..., :-1]], axis=-1)


def _held(signal: Any) -> Any:
    """The last finite value before each missing one; the first finite one at the beginning."""
    signal = jnp.asarray(signal)
    known = jnp.isfinite(signal)
    index = jnp.where(known, jnp.arange(signal.shape[-1]), -1)
    last = jax.lax.cummax(index, axis=signal.ndim - 1)
    first = jnp.argmax(known, axis=-1, keepdims=True)
    return jnp.take_along_axis(signal, jnp.where(last < 0, first, last), axis=-1)
