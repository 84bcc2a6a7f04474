"""Tyre stiffness of a front and a rear corner on one road, by recursive maximum likelihood.

The rear wheel meets the front wheel's road a wheelbase later, the more alike the better. What both
tyres make of the same road tells their stiffness apart from the road's level.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from dataclasses import replace as changed
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from wheelhop.errors import InputError, require_in_range
from wheelhop.estimators.axle_pair_model import PairSample, PlaceParams, corners_at_one_place
from wheelhop.estimators.axle_pair_settings import PairParams, PairTheta
from wheelhop.estimators.road_model import LONGEST_STEP
from wheelhop.filtering import Filter, Gaussian, SensitivityParams, SensitivityPrior, sensitivity
from wheelhop.filtering.interface import Info
from wheelhop.filtering.triangular import root
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.quarter_car import Accelerations

SLOWEST = 1e-3
"""Speed [m/s] below which the pair counts as standing."""

GROUP_DELAY = 0.85
"""Delay of the coherence's low-pass, times its bandwidth in rad/s, over the frequencies that tell
the delay of the road: less than the 1 of its lowest frequencies."""

NARROWED = 0.5
"""Bandwidth in rad/s times standard deviation of the delay, at most. At 1 the delay of 24 starts
was 0.4 % rms off at 2 s, at 0.5 it was 0.1 %."""

SETTLING = 1.0
"""Time [s] over which the caution that the prior of the delay asks for may fade: the first tenths
of a second understate how far off the delay may be."""

DOUBTED = 2.0 * math.pi * 48.0
"""Frequency [rad/s] at which a delay that is off by its standard deviation makes the roads
differ by as much as the doubt allows for."""


class Waiting(NamedTuple):
    """The front's last samples, newest first, every entry [length].

    Attributes:
        a_s, a_u: accelerations [m/s^2].
        speed: indicated at the sample [m/s].
        distance: driven since the sample, by the indicated speed [m].
        fresh: 1 until the rear wheel has passed the sample's place, then 0; 0 where there is none.
    """

    a_s: Any
    a_u: Any
    speed: Any
    distance: Any
    fresh: Any


class AxlePairState(NamedTuple):
    """State of an axle pair.

    Attributes:
        pair: `SensitivityState` of both corners, the front one as it was where the rear wheel is.
        waiting: the front's samples.
        elapsed: since the rear wheel met the first of them [s].
    """

    pair: Any
    waiting: Waiting
    elapsed: Any


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class _Meeting:
    """Parameters of a step, with the front's sample that the rear wheel meets in it.

    Attributes:
        pair: the pair's.
        distance: driven since the sample at the step's beginning [m].
        speed: indicated at the sample [m/s].
        bandwidth: of the coherence [rad/s].
        doubt: odds of the rear wheel's road being its own, from not knowing the delay.
        idle: True before the first sample.
    """

    pair: PairParams
    distance: Any
    speed: Any
    bandwidth: Any
    doubt: Any
    idle: Any


def axle_pair(dt: float, longest_delay: float = 0.5) -> Filter:
    """Recursive maximum likelihood over a front and a rear corner on one road.

    The likelihood is that of both corners jointly: front samples wait until the rear wheel comes
    to their place, and eight states with one road beneath them take both in (`axle_pair_model`).
    The front's stiffness is therefore l / v old.

    Three things stand between this and Newton's method on the likelihood of a road that is
    coherent at all frequencies; they are there because the delay must be found:

    Bandwidth. With coherence up to any frequency the sampled likelihood of the delay is a comb
    with a tooth per sampling interval, and has maxima within 0.1 % of the truth. A coherence that
    falls by half at 150 Hz makes it rise from 4 % on either side to within 0.3 % of the truth. But
    where no frequency is less coherent it biases ln k_t: by up to 7 % where both wheels hop at
    one frequency, on class D at coherence 0.99; at 800 Hz by less than 1 %. So the bandwidth is
    `NARROWED` over the delay's standard deviation s, and at most the tuning's.

    Doubt. The odds of the rear wheel's road being its own are larger by (`DOUBTED` s)^2. During
    the first `SETTLING` s is not taken below a fading share of the prior's.

    Forgetting. The variance of the delay grows at the rate of the tuning. Where that rate faded
    over 2 s the delay of 48 starts stayed 0.3 % rms off for 20 s, instead of below 0.1 %.

    Measured by `wheelhop reproduce stiffness` on 200 pairs of quarter cars at 130-230 kPa and
    40-80 km/h, levels from half a class below A to half a class above D, speed wrong by 1.5 % rms,
    coherence known: rms error of ln k_t over its Whittle bound, at 2, 5, 10, 20 s,

        coherence 0.9:   1.13, 1.26, 1.33, 1.55   (normalised square at 20 s: 2.0)
        coherence 0.99:  1.19, 1.28, 1.34, 1.59   (normalised square at 20 s: 3.0)

    From 10 s on the error is larger than the covariance says. The settings were chosen on 48
    other pairs.

    Args:
        dt: sampling interval [s]; the parameters' must not be longer.
        longest_delay: l / v [s] up to which front samples wait. Where the car is slower they are
            left out, and the rear corner goes on alone.

    Returns:
        A `Filter` over `AxlePairState` with measurements `PairSample`; parameters from
        `axle_pair_params`, belief before the first sample from `axle_pair_prior`. `Info` holds
        the innovations of the samples taken in, and counts as missing the front's two in a step
        without one; its `mix` refuses.

    Raises:
        InputError: if dt is above `road_model.LONGEST_STEP`, or the delay below dt.
    """
    require_in_range("dt", dt, 1e-5, LONGEST_STEP, "s")
    if not longest_delay > dt:
        raise InputError(
            "longest_delay",
            f"{longest_delay:g} s is no longer than the sampling interval {dt:g} s",
            "Give the wheelbase over the lowest speed.",
        )
    return _axle_pair(math.ceil(longest_delay / dt) + 1)


@lru_cache(maxsize=16)
def _axle_pair(length: int) -> Filter:
    core = sensitivity(corners_at_one_place(), _bind)

    def init(prior: SensitivityPrior, params: SensitivityParams) -> AxlePairState:
        zero = 0.0 * (params.inner.speed + params.inner.dt)
        idle = zero == zero
        meeting = _Meeting(params.inner, zero, zero + 1.0, zero + 1.0, zero, idle)
        pair = core.init(prior, changed(params, inner=meeting))
        empty = jnp.stack([zero] * length)
        return AxlePairState(pair, Waiting(*(empty for _ in Waiting._fields)), zero)

    def step(
        state: AxlePairState, y: PairSample, params: SensitivityParams
    ) -> tuple[AxlePairState, Info]:
        p, waiting = params.inner, state.waiting
        zero = jnp.zeros_like(waiting.distance[0])
        travel = p.speed * p.dt + zero
        bandwidth, doubt = _caution(state.pair.theta, state.elapsed, p)
        reach = _reach(p, state.pair.theta.mean.ln_speed, bandwidth)
        passed = (waiting.distance + travel[None] >= reach[None]) & (waiting.fresh > 0)
        # of several the newest: the others' places lie behind the rear sample before this one
        chosen = passed & (jnp.cumsum(passed, 0) == 1)
        met = jnp.any(chosen, 0)

        def of_chosen(entries: Any, otherwise: Any) -> Any:
            return jnp.where(met, jnp.sum(jnp.where(chosen, entries, 0.0), 0), otherwise)

        lost = jnp.full_like(zero, jnp.nan)
        front = Accelerations(of_chosen(waiting.a_s, lost), of_chosen(waiting.a_u, lost))
        meeting = _Meeting(
            p,
            # without a sample the step is cut in its middle
            of_chosen(waiting.distance, reach - 0.5 * travel),
            jnp.maximum(of_chosen(waiting.speed, p.speed), SLOWEST),
            bandwidth,
            doubt,
            (state.elapsed == 0) & ~met,
        )
        walk = params.walk._replace(ln_speed=params.walk.ln_speed + _faded(state.pair.theta, p))
        pair, info = core.step(
            state.pair, PairSample(front, y.rear), SensitivityParams(meeting, walk)
        )
        newest = Waiting(y.front.a_s, y.front.a_u, p.speed + zero, zero, zero + 1.0)
        older = waiting._replace(
            distance=waiting.distance + travel[None],
            fresh=jnp.where(passed, 0.0, waiting.fresh),
        )
        pushed = (
            jnp.concatenate([new[None], old[:-1]]) for new, old in zip(newest, older, strict=True)
        )
        elapsed = jnp.where(meeting.idle, 0.0, state.elapsed + p.dt)
        return AxlePairState(pair, Waiting(*pushed), elapsed), info

    return Filter(init, step, _no_mixture)


def _caution(theta: Gaussian, elapsed: Any, p: PairParams) -> tuple[Any, Any]:
    """Bandwidth of the coherence [rad/s] and odds of doubt at this uncertainty of the delay."""
    relative = jnp.maximum(root(theta.cov[3][3]), p.speed_sigma * jnp.exp(-elapsed / SETTLING))
    sigma = relative * p.wheelbase / jnp.maximum(p.speed, SLOWEST)
    widest = 2.0 * math.pi * p.bandwidth
    return widest / jnp.maximum(1.0, widest * sigma / NARROWED), (DOUBTED * sigma) ** 2


def _faded(theta: Gaussian, p: PairParams) -> Any:
    """Variance that ln_speed gains in a step by forgetting: none at the prior's."""
    variance, most = theta.cov[3][3], p.speed_sigma * p.speed_sigma
    room = jnp.maximum(1.0 - variance / jnp.where(most > 0, most, 1.0), 0.0)
    return p.speed_forgetting * p.dt * variance * room


def _reach(p: PairParams, ln_speed: Any, bandwidth: Any) -> Any:
    """Indicated distance [m] from a front sample to the rear wheel taking it in."""
    return p.wheelbase * jnp.exp(-ln_speed) - p.speed * GROUP_DELAY / bandwidth


def _bind(meeting: _Meeting, theta: PairTheta) -> PlaceParams:
    p = meeting.pair
    speed = jnp.maximum(p.speed, SLOWEST)
    ahead = _reach(p, theta.ln_speed, meeting.bandwidth) - meeting.distance
    square = p.coherence * p.coherence
    odds = (1.0 - square) * jnp.exp(theta.ln_own) + square * meeting.doubt
    whole = jnp.sqrt(square + odds)
    return PlaceParams(
        _with_stiffness(p.front, theta.ln_k_front),
        _with_stiffness(p.rear, theta.ln_k_rear),
        p.level * jnp.exp(theta.ln_level),
        p.coherence / whole,
        root(odds) / whole,
        meeting.bandwidth,
        p.noise_a_s,
        p.noise_a_u,
        meeting.speed,
        speed,
        ahead / (speed * p.dt),
        p.dt,
        meeting.idle,
    )


def _with_stiffness(car: QuarterCar, ln_k_t: Any) -> QuarterCar:
    return changed(car, tire=changed(car.tire, stiffness=jnp.exp(ln_k_t)))


def _no_mixture(weights: Any, stacked: AxlePairState) -> AxlePairState:
    raise ValueError(
        "an axle pair cannot be a member of an IMM: every member would wait for the rear wheel at "
        "its own place; mix single corners instead"
    )
