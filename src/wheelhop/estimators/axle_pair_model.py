"""Two corners on one road, the rear one later: their joint filter, theta given.

The road is the clock. While the rear wheel is at a place, the filter holds the front corner as it
was at that place, and the front's samples wait until the rear wheel arrives there. Both corners
are then driven at once by one road, and a state of either and one of the road carry the joint
likelihood: no estimate of the road is handed on, and nothing of it is lost on the way.

Where the front wheel's road rises at the white velocity w, the rear wheel's rises at

    w_r = A w + B n,  A = gamma a / (s + a),  B = (s + a sqrt(1 - gamma^2)) / (s + a),

n white and independent of the same intensity. |A|^2 + |B|^2 = 1: the rear wheel's road is white
of that intensity too, and the coherence is gamma up to the bandwidth a, then falls.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from wheelhop.filtering import Filter, smallmat
from wheelhop.filtering.interface import Info
from wheelhop.filtering.triangular import triangularise
from wheelhop.filtering.update import report
from wheelhop.staging import stage
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.quarter_car import (
    Accelerations,
    RelativeState,
    accelerations,
    relative_step,
)
from wheelhop.vehicle.road import road_velocity_intensity

EDGE = 1e-3
"""Shortest part of a sampling interval before and after a front sample: the root of a noise has no
derivative at no duration."""

FASTEST_RATIO = 2.0
"""Largest ratio of the speeds of the two wheels at one place."""


# four-point Gauss-Legendre rule on [0, 1]: nodes and weights
_NODES = (
    (0.06943184420297371, 0.17392742256872693),
    (0.33000947820757187, 0.32607257743127307),
    (0.66999052179242813, 0.32607257743127307),
    (0.93056815579702629, 0.17392742256872693),
)


class PairSample(NamedTuple):
    """Accelerations of both corners of one side [m/s^2]; NaN where missing."""

    front: Accelerations
    rear: Accelerations


class PairInnovation(NamedTuple):
    """Innovations [m/s^2], each given the ones before it: no correlation among them."""

    front_a_s: Any
    front_a_u: Any
    rear_a_s: Any
    rear_a_u: Any


class PairBelief(NamedTuple):
    """Gaussian of both corners at one place of the road.

    Attributes:
        front: mean of the front corner, as it was there.
        rear: mean of the rear corner.
        road: state of the coherence, w_r less its white part [m/s].
        rows: rows of a root of the covariance, in this order, each [9, ...].
    """

    front: RelativeState
    rear: RelativeState
    road: Any
    rows: tuple[Any, ...]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class PlaceParams:
    """Parameters of a step of `corners_at_one_place`.

    Attributes:
        front, rear: the corners; their tyres' stiffness is k_t.
        level: Gd(W0) of the road [m^3/rad].
        shared: coherence of the two wheels' roads below the bandwidth, gamma [-].
        own: sqrt(1 - gamma^2).
        bandwidth: a [rad/s].
        noise_a_s, noise_a_u: standard deviations of the accelerometers [m/s^2].
        front_speed, rear_speed: of either wheel over this stretch of the road [m/s].
        part: part of the sampling interval before the front's sample, 0 to 1.
        dt: sampling interval [s].
        idle: True until the front wheel's record reaches this place: the front corner is held.
    """

    front: QuarterCar
    rear: QuarterCar
    level: Any
    shared: Any
    own: Any
    bandwidth: Any
    noise_a_s: Any
    noise_a_u: Any
    front_speed: Any
    rear_speed: Any
    part: Any
    dt: Any
    idle: Any


def corners_at_one_place() -> Filter:
    """Extended Kalman filter of both corners in the clock of the road.

    A step goes from one rear sample to the next: predict to where the front sample was taken,
    update with it, predict on, update with the rear sample. The road rises alike under both
    wheels up to the coherence, so its noise enters as common and as own columns of the root of the
    covariance; nothing is subtracted from a covariance. Potter's update takes the four
    accelerations one at a time (Bierman 1977).

    Returns:
        A `Filter` over `PairBelief`, `PairSample` and `PlaceParams`; `mix` refuses.
    """

    def init(prior: PairBelief, params: PlaceParams) -> PairBelief:
        del params
        return prior

    def step(belief: PairBelief, y: PairSample, params: PlaceParams) -> tuple[PairBelief, Info]:
        part = jnp.clip(params.part, EDGE, 1.0 - EDGE)
        belief, early = _predict(belief, part * params.dt, params)
        belief, front = _update(belief, 0, y.front, params.front, params)
        belief, late = _predict(belief, (1.0 - part) * params.dt, params)
        belief, rear = _update(belief, 4, y.rear, params.rear, params)
        entries = [*front, *rear]
        innovation = PairInnovation(*(entry.innovation for entry in entries))
        deviation = [jnp.sqrt(entry.variance) for entry in entries]
        return belief, report(
            innovation,
            smallmat.diagonal([entry.variance for entry in entries]),
            [r / s for r, s in zip(innovation, deviation, strict=True)],
            smallmat.diagonal(deviation),
            [entry.present for entry in entries],
            belief,
            early | late,
        )

    return Filter(init, step, _no_mixture)


class _Entry(NamedTuple):
    """One scalar measurement's innovation, its variance and whether it was measured."""

    innovation: Any
    variance: Any
    present: Any


def _predict(belief: PairBelief, dt: Any, p: PlaceParams) -> tuple[PairBelief, Any]:
    """Both corners over a stretch of the road which the rear wheel needs a time dt for."""
    ratio = jnp.clip(p.rear_speed / p.front_speed, 1.0 / FASTEST_RATIO, FASTEST_RATIO)
    moving = jnp.where(p.idle, 0.0, 1.0).astype(dt.dtype)
    front_dt = dt * ratio * moving
    shared, own = p.shared * moving, jnp.where(p.idle, 1.0, p.own)

    def ahead(x: RelativeState) -> RelativeState:
        return relative_step(x, p.front.tire.stiffness, None, front_dt, p.front)

    def behind(x: tuple[RelativeState, Any]) -> tuple[RelativeState, Any]:
        return _behind(x, dt, p.bandwidth, p.rear)

    front, front_rows = _moved(ahead, belief.front, RelativeState(*belief.rows[:4]))
    (rear, road), (rear_rows, road_row) = _moved(
        behind, (belief.rear, belief.road), (RelativeState(*belief.rows[4:8]), belief.rows[8])
    )
    # q dt is a matter of the distance alone: the same for either wheel
    strength = jnp.sqrt(road_velocity_intensity(p.level, p.rear_speed) * dt)

    def at(node: Any, weight: Any) -> tuple[list[Any], list[Any]]:
        under_front, direct, begun = _responses(node, front_dt, dt, p)
        first = [moving * x for x in under_front]
        late = [shared * x for x in begun]
        alone = [d - (1.0 - own) * x for d, x in zip(direct, begun, strict=True)]
        none = [jnp.zeros_like(dt)] * 4
        scale = strength * weight
        return [scale * x for x in (*first, *late)], [scale * x for x in (*none, *alone)]

    nodes, weights = (jnp.asarray(c, dt.dtype) for c in zip(*_NODES, strict=True))
    columns = jax.vmap(at)(nodes, jnp.sqrt(weights))
    old = [*front_rows, *rear_rows, road_row]
    lower, guarded = triangularise([jnp.concatenate(c) for c in zip(old, *columns, strict=True)])
    return PairBelief(front, rear, road, smallmat.rows_of(lower)), guarded


def _moved(move: Any, mean: Any, rows: Any) -> tuple[Any, Any]:
    """Mean and rows of the root after a linearised motion."""
    return move(mean), jax.vmap(lambda along: jax.jvp(move, (mean,), (along,))[1])(rows)


def _behind(
    x: tuple[RelativeState, Any], dt: Any, bandwidth: Any, car: QuarterCar
) -> tuple[RelativeState, Any]:
    """The rear corner and its road a time dt later, if nothing new befalls the road."""
    state, road = x
    passed = bandwidth * dt
    # the mean over dt instead of the decaying velocity: exact in the rise of the road
    mean_velocity = road * -jnp.expm1(-passed) / passed
    moved = relative_step(state, car.tire.stiffness, mean_velocity, dt, _undamped(car))
    return moved, road * jnp.exp(-passed)


def _responses(
    node: Any, front_dt: Any, dt: Any, p: PlaceParams
) -> tuple[RelativeState, list[Any], list[Any]]:
    """What is left at the end of dt of an impulse of the road's velocity, `node` dt before it.

    Of the front corner; of the rear one and its road's state without that state; and with that
    state alone, pushed by the bandwidth times the impulse.
    """
    zero = jnp.zeros_like(dt)
    step = RelativeState(zero, zero - 1.0, zero, zero)
    front_car, rear_car = _linear(p.front), _linear(p.rear)
    front = relative_step(step, front_car.tire.stiffness, None, node * front_dt, front_car)
    left = node * dt
    direct = relative_step(step, rear_car.tire.stiffness, None, left, rear_car)
    rest = RelativeState(zero, zero, zero, zero)
    begun, road = _behind((rest, p.bandwidth + zero), left, p.bandwidth, rear_car)
    return front, [*direct, zero], [*begun, road]


def _linear(car: QuarterCar) -> QuarterCar:
    """The corner without the suspension's nonlinear terms."""
    return replace(
        car, suspension=replace(car.suspension, cubic_stiffness=0.0, quadratic_damping=0.0)
    )


def _undamped(car: QuarterCar) -> QuarterCar:
    """The corner without the tyre's damper, which would feel the white velocity itself."""
    return replace(car, tire=replace(car.tire, damping=0.0))


def _update(
    belief: PairBelief, first: int, y: Accelerations, car: QuarterCar, p: PlaceParams
) -> tuple[PairBelief, list[_Entry]]:
    """Belief after the accelerations of the corner whose rows begin at `first`."""
    mean = belief.rear if first else belief.front

    def observe(x: RelativeState) -> Accelerations:
        return accelerations(x, car.tire.stiffness, car)

    def along(direction: RelativeState) -> Accelerations:
        return jax.jvp(observe, (mean,), (direction,))[1]

    expected = observe(mean)
    odd = jax.vmap(along)(RelativeState(*belief.rows[first : first + 4]))
    present = [jnp.isfinite(v) for v in y]
    gap = [
        jnp.where(here, jnp.where(here, v, 0.0) - e, 0.0)
        for here, v, e in zip(present, y, expected, strict=True)
    ]
    # the rows of the observations are those of further states: each update moves them along
    rows = [*belief.rows]
    rows += [jnp.where(here[None], g, 0.0) for here, g in zip(present, odd, strict=True)]
    means = [
        *belief.front,
        *belief.rear,
        belief.road,
        jnp.zeros_like(gap[0]),
        jnp.zeros_like(gap[0]),
    ]
    entries = []
    for i, noise in enumerate((p.noise_a_s, p.noise_a_u)):
        g, here = rows[9 + i], present[i]
        noise_variance = jnp.where(here, noise * noise, 1.0)
        innovation = jnp.where(here, gap[i] - means[9 + i], 0.0)
        rows, means, variance = _potter(rows, means, g, innovation, noise_variance)
        entries.append(_Entry(innovation, variance, here))
    updated = PairBelief(
        RelativeState(*means[:4]), RelativeState(*means[4:8]), means[8], tuple(rows[:9])
    )
    return updated, entries


@stage
def _potter(
    rows: list[Any], means: list[Any], g: Any, innovation: Any, noise_variance: Any
) -> tuple[list[Any], list[Any], Any]:
    """Rows and means after a scalar measurement of row g of the root, and its variance."""
    variance = jnp.sum(g * g, 0) + noise_variance
    gain = 1.0 / variance
    shrink = 1.0 / (variance + jnp.sqrt(variance * noise_variance))
    cross = [jnp.sum(row * g, 0) for row in rows]
    rows = [row - (shrink * c)[None] * g for row, c in zip(rows, cross, strict=True)]
    means = [m + gain * c * innovation for m, c in zip(means, cross, strict=True)]
    return rows, means, variance


def _no_mixture(weights: Any, stacked: PairBelief) -> PairBelief:
    raise ValueError(
        "an axle pair cannot be a member of an IMM: every member would wait for the rear wheel at "
        "its own place; mix single corners instead"
    )
