"""Low-pressure alarms per wheel: a state machine over beliefs, and its events in words.

An alarm is raised when the posterior probability that a tyre has lost more than a test level
(half of the 15 % that are to be found) stays above a bound. A tyre counts as low

 - absolutely: by its own ln k_t, whose error is mostly common to the wheels; or
 - against two others: two wheels agree that it is softer than they are, by the test level, and
   its own ln k_t does not contradict by two standard deviations (wheels pumped up); or
 - against one other, if its own ln k_t says so too, more likely than not. This finds three low
   tyres by the fourth; without the condition one tyre pumped up would accuse the other three.

The contrasts use the full covariance, in which common errors cancel. The belief is taken as it
is, so that an estimator should assume a random walk of ln k_t that suits the minutes in which a
tyre leaks.

Measured on Gaussian beliefs of the default estimator (sd of ln k_t 2.4 % at 10 s, wheel to wheel
1.3 %, walk 0.008 per sqrt(s)), a drift since the calibration of 2 % common to the wheels and 0.5 %
of each, pressure lost at once, 450 drives: share found within 60 s, median time

    probability                   0.98            0.97, default   0.95
    1 tyre, 15 %                  1.00, 10.0 s    1.00,  9.0 s    1.00,  8.0 s
    3 tyres, 15 %                 0.97, 20.0 s    0.99, 18.5 s    0.99, 16.5 s
    4 tyres, 20 %                 0.85, 33.5 s    0.88, 31.0 s    0.94, 28.0 s
    drives with a false alarm     0 in 600 h      1 in 600 h      11 in 600 h

Walks of 0.006 and 0.012 find four tyres in 0.79 and 0.87 of the drives at 0.98. Four tyres have
only their absolute stiffness: the drift limits them. On beliefs of the filter itself, which are
wider, see `wheelhop reproduce stiffness`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import ndtr

from wheelhop.errors import InputError, require_in_range
from wheelhop.estimators.deflation import (
    DeflationParams,
    DeflationState,
    deflation_init,
    deflation_step,
)
from wheelhop.estimators.pressure import StiffnessBelief, ln_stiffness
from wheelhop.vehicle.tire import Tire, pressure_slope

LEVELS = (0.15, 0.20, 0.25)
"""Losses under placard that are told apart: to be found early, UN R64/R141, FMVSS 138."""


_CONTRADICTION = 2.0


@dataclass(frozen=True)
class AlarmSettings:
    """How alarms are decided.

    Attributes:
        test_level: loss under placard that is tested for [-].
        probability: posterior probability above which a wheel counts as low.
        clear_probability: the one below which it counts as sound again.
        hold, clear_hold: time for which it must count so [s].
        settle: time at the start of a drive without alarms [s], while the estimator settles.
        puncture_rate: loss of pressure per time that tells a puncture from a slow leak [Pa/s].
        level_walk: random walk of ln k_t over minutes [1/sqrt(s)].
        rate_walk: of its rate [1/s per sqrt(s)].
        rate_memory: time after which a rate is forgotten [s].
    """

    test_level: float = 0.075
    probability: float = 0.97
    clear_probability: float = 0.5
    hold: float = 3.0
    clear_hold: float = 10.0
    settle: float = 10.0
    puncture_rate: float = 10e3 / 60.0
    level_walk: float = 0.001
    rate_walk: float = 1e-4
    rate_memory: float = 300.0


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class AlarmParams:
    """Settings in the units of the beliefs; see `alarm_params`.

    Attributes:
        deflation: model of the level and rate of ln k_t.
        reference: ln k_t at the placard pressure, [wheels].
        placard: [Pa], [wheels].
        pressure_per_ln: dp / d ln k_t at the placard pressure [Pa], [wheels].
        test: change of ln k_t at the test level, [wheels].
        bias: covariance of errors that stay for a whole drive, [wheels, wheels].
        probability, clear_probability: bounds.
        hold, clear_hold, settle: steps.
        puncture_rate: [Pa/s].
    """

    deflation: DeflationParams
    reference: Any
    placard: Any
    pressure_per_ln: Any
    test: Any
    bias: Any
    probability: Any
    clear_probability: Any
    hold: Any
    clear_hold: Any
    settle: Any
    puncture_rate: Any


class AlarmState(NamedTuple):
    """What the state machine carries.

    Attributes:
        deflation: Gaussian over level and rate of ln k_t, for the rate.
        level: last belief over ln k_t, from its value at the placard pressure, [wheels].
        cov: its covariance, [wheels, wheels].
        alarm: whether a wheel's alarm is on, [wheels].
        low, sound: steps for which it has counted so, [wheels].
        seen: steps with a belief, [wheels].
    """

    deflation: DeflationState
    level: Any
    cov: Any
    alarm: Any
    low: Any
    sound: Any
    seen: Any


class AlarmOutput(NamedTuple):
    """One step's result, each [wheels] unless said otherwise.

    Attributes:
        alarm: whether the alarm is on.
        valid: whether the wheel had a belief.
        probability: that the wheel lost more than the test level.
        pressure, pressure_sd: over minutes [Pa], biases included.
        loss, loss_sd: under placard, relative [-].
        exceedance: probability that the loss exceeds each of `LEVELS`, [wheels, levels].
        rate, rate_sd: of the pressure [Pa/s]; negative while it falls.
        puncture: probability that it falls faster than a puncture must.
    """

    alarm: Any
    valid: Any
    probability: Any
    pressure: Any
    pressure_sd: Any
    loss: Any
    loss_sd: Any
    exceedance: Any
    rate: Any
    rate_sd: Any
    puncture: Any


def alarm_params(
    tire: Tire,
    placard: Any,
    *,
    wheels: int,
    dt: float,
    belief_walk: float,
    bias: Any = None,
    settings: AlarmSettings = AlarmSettings(),
) -> AlarmParams:
    """Parameters of `alarm_step`, checked.

    Args:
        tire: law, entries [] or [wheels].
        placard: recommended pressure [Pa], [] or [wheels].
        wheels: how many.
        dt: time between beliefs [s].
        belief_walk: random walk of ln k_t that the estimator assumes [1/sqrt(s)].
        bias: covariance of the errors that stay for a drive (`calibration.bias_cov`),
            [wheels, wheels]; none if left out.
        settings: how alarms are decided.

    Raises:
        InputError: naming what is out of range.
    """
    s = settings
    require_in_range("dt", dt, 1e-3, 5.0, "s")
    require_in_range("belief_walk", belief_walk, 1e-5, 1.0, "1/sqrt(s)")
    require_in_range("alarm.test_level", s.test_level, 0.01, 0.5, "(no unit)")
    require_in_range("alarm.probability", s.probability, 0.5, 1.0 - 1e-6, "(no unit)")
    require_in_range(
        "alarm.clear_probability", s.clear_probability, 1e-6, s.probability, "(no unit)"
    )
    require_in_range("alarm.hold", s.hold, 0.0, 600.0, "s")
    require_in_range("alarm.clear_hold", s.clear_hold, 0.0, 600.0, "s")
    require_in_range("alarm.settle", s.settle, 0.0, 600.0, "s")
    require_in_range("alarm.level_walk", s.level_walk, 1e-6, 0.1, "1/sqrt(s)")
    require_in_range("alarm.rate_walk", s.rate_walk, 1e-8, 0.1, "1/s per sqrt(s)")
    require_in_range("alarm.rate_memory", s.rate_memory, 10.0 * dt, 1e5, "s")
    for value in np.atleast_1d(np.asarray(placard, float)):
        require_in_range("placard", float(value), 5e4, 1.5e6, "Pa")
    dtype = jnp.result_type(float)
    recommended = jnp.broadcast_to(jnp.asarray(placard, dtype), (wheels,))
    law: Tire = jax.tree.map(lambda a: jnp.broadcast_to(jnp.asarray(a, dtype), (wheels,)), tire)
    reference = ln_stiffness(recommended, law)
    matrix = jnp.zeros((wheels, wheels), dtype) if bias is None else jnp.asarray(bias, dtype)
    if matrix.shape != (wheels, wheels):
        raise InputError("bias", f"has shape {matrix.shape} for {wheels} wheels", "Give a matrix.")
    return AlarmParams(
        DeflationParams(dt, belief_walk, s.level_walk, s.rate_walk, s.rate_memory),
        reference,
        recommended,
        pressure_slope(law) * jnp.exp(reference),
        ln_stiffness((1.0 - s.test_level) * recommended, law) - reference,
        matrix,
        s.probability,
        s.clear_probability,
        max(1, math.ceil(s.hold / dt - 1e-9)),
        max(1, math.ceil(s.clear_hold / dt - 1e-9)),
        math.ceil(s.settle / dt - 1e-9),
        s.puncture_rate,
    )


def alarm_init(params: AlarmParams) -> AlarmState:
    """State before the first belief, all alarms off."""
    wheels = params.reference.shape[0]
    zero = jnp.zeros(wheels, jnp.int32)
    deflation = deflation_init(wheels, params.deflation, params.reference.dtype)
    level = jnp.zeros(wheels, params.reference.dtype)
    return AlarmState(
        deflation,
        level,
        jnp.eye(wheels, dtype=level.dtype),
        jnp.zeros(wheels, bool),
        zero,
        zero,
        zero,
    )


def alarm_step(
    state: AlarmState, belief: StiffnessBelief, params: AlarmParams
) -> tuple[AlarmState, AlarmOutput]:
    """One belief later; a wheel without a belief keeps its alarm and its counts.

    Args:
        state: the last state.
        belief: over ln k_t less the calibration's offset, at the reference load and speed,
            mean [wheels], without the covariance of the calibration.
        params: from `alarm_params`.
    """
    deflation, valid = deflation_step(
        state.deflation, belief.mean - params.reference, belief.cov, params.deflation
    )
    level = jnp.where(valid, belief.mean - params.reference, state.level)
    walk = jnp.square(params.deflation.belief_walk) * params.deflation.dt
    held = state.cov + walk * jnp.eye(len(level), dtype=level.dtype)
    known = jnp.where(valid[:, None] & valid[None, :], belief.cov, held)
    cov = known + params.bias
    probability = _probability(level, cov, params)
    seen = state.seen + valid.astype(jnp.int32)
    settled = seen > params.settle
    # a belief as wide as what is tested for is the prior's, not the data's
    judged = settled & (jnp.sqrt(jnp.diagonal(known)) < jnp.abs(params.test))
    low = jnp.where(judged & (probability > params.probability), state.low + 1, 0)
    sound = jnp.where(probability < params.clear_probability, state.sound + 1, 0)
    low, sound = jnp.where(valid, low, state.low), jnp.where(valid, sound, state.sound)
    alarm = jnp.where(state.alarm, sound < params.clear_hold, low >= params.hold)
    alarm = jnp.where(valid, alarm, state.alarm)
    updated = AlarmState(deflation, level, known, alarm, low, sound, seen)
    return updated, _output(updated, cov, probability, valid, params)


def run_alarms(belief: StiffnessBelief, params: AlarmParams) -> AlarmOutput:
    """`alarm_step` over time, mean [time, wheels]; vmap over drives."""

    def step(state: AlarmState, now: StiffnessBelief) -> tuple[AlarmState, AlarmOutput]:
        return alarm_step(state, now, params)

    return jax.lax.scan(step, alarm_init(params), belief)[1]


def _probability(level: Any, cov: Any, params: AlarmParams) -> Any:
    """Posterior probability by which a wheel counts as low, [wheels]."""
    wheels = len(level)
    variance = jnp.diagonal(cov)
    margin = (params.test - level) / jnp.sqrt(variance)
    if wheels == 1:
        return ndtr(margin)
    itself = jnp.eye(wheels, dtype=bool)
    spread = jnp.where(itself, 1.0, variance[:, None] + variance[None, :] - 2.0 * cov)
    contrast = (params.test[:, None] - level[:, None] + level[None, :]) / jnp.sqrt(spread)
    ordered = jnp.sort(jnp.where(itself, -jnp.inf, contrast), axis=1)
    best = jnp.maximum(margin, jnp.where(margin > 0.0, ordered[:, -1], -jnp.inf))
    if wheels == 2:
        return ndtr(best)
    against_two = jnp.where(margin > -_CONTRADICTION, ordered[:, -2], -jnp.inf)
    return ndtr(jnp.maximum(best, against_two))


def _output(state: AlarmState, cov: Any, probability: Any, valid: Any, p: AlarmParams) -> Any:
    """The belief over ln k_t and its rate in terms of pressure, about the placard."""
    deflation = state.deflation
    ratio, sd = jnp.exp(state.level), jnp.sqrt(jnp.diagonal(cov))
    # the law is linear: loss = (1 - k_t/k_t(placard)) gain
    gain = p.pressure_per_ln / p.placard
    loss = (1.0 - ratio) * gain
    rate = p.pressure_per_ln * ratio * deflation.rate
    rate_sd = p.pressure_per_ln * ratio * jnp.sqrt(jnp.diagonal(deflation.rate_cov))
    lost = [(jnp.log1p(-level / gain) - state.level) / sd for level in LEVELS]
    return AlarmOutput(
        state.alarm,
        valid,
        probability,
        p.placard * (1.0 - loss),
        p.pressure_per_ln * ratio * sd,
        loss,
        gain * ratio * sd,
        ndtr(jnp.stack(lost, axis=-1)),
        rate,
        rate_sd,
        ndtr((-p.puncture_rate - rate) / rate_sd),
    )
