"""The four corners of a vehicle under unknown tyre loads, as a state-space model.

Along the body's vertical axis only the struts act on the body, so that an accelerometer at its
centre of mass shows sum(S) / m_b - g, one on a wheel (F_b - S) / m_u - g with F_b the tyre's force
along that axis, and each compression follows s'' = a_u - a_s. S is the whole law of the strut,
digression, stops and bars included. The tyres' horizontal forces come in as two moments on the
body; loads and moments are random walks.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from wheelhop.estimators.joint_load_params import JointLoadParams, map_springs
from wheelhop.filtering import Filter, Gaussian, StateSpaceModel, independent, scaled, unscented
from wheelhop.filtering.smallmat import diagonal
from wheelhop.staging import stage
from wheelhop.vehicle.full_vehicle_state import STANDARD_GRAVITY
from wheelhop.vehicle.load_record import VehicleLoadSample
from wheelhop.vehicle.strut import anti_roll_force, damper_force, spring_force

LOADS = slice(8, 12)
"""Places of the four loads in the state."""

_MASS_WALK = 1e-6
_PLACE, _RATE, _MOMENT = 0.05, 0.3, 3000.0
NEAR = 0.52
"""Spread alpha of the sigma points, two deviations out: those of the plain rule, four out, see a
damper long past its knee and diverge at 100 Hz; a smaller one makes the weight of the centre
negative."""

_RUNGE_KUTTA = ((0.0, 1 / 6), (0.5, 1 / 3), (0.5, 1 / 3), (1.0, 1 / 6))


class JointLoadBelief(NamedTuple):
    """State of the filter; corners FL, FR, RL, RR.

    Attributes:
        s_FL, s_FR, s_RL, s_RR: compression of the struts from their design place [m].
        w_FL, w_FR, w_RL, w_RR: its rate [m/s].
        load_FL, load_FR, load_RL, load_RR: normal force of the tyres [N].
        roll_moment, pitch_moment: on the body about its centre of mass, of all but the struts and
            what a_x and a_y of the parameters tell [Nm]; forces to the left raise its left side,
            braking forces lower its nose.
        ln_mass: logarithm of the sprung mass over the one it is thought to have.
    """

    s_FL: Any
    s_FR: Any
    s_RL: Any
    s_RR: Any
    w_FL: Any
    w_FR: Any
    w_RL: Any
    w_RR: Any
    load_FL: Any
    load_FR: Any
    load_RL: Any
    load_RR: Any
    roll_moment: Any
    pitch_moment: Any
    ln_mass: Any


def shown_accelerations(
    s: Any, w: Any, b: Any, p: JointLoadParams, scale: tuple[Any, Any] = (1.0, 1.0)
) -> tuple[Any, Any]:
    """What accelerometers on the body above each wheel and on the wheels show [m/s^2], [4, ...].

    The tyre's force along the leaning body's axis is F - F_y sin(roll) + F_x sin(pitch). The tilt
    against the road follows from compressions and tyre deflections, the horizontal forces from the
    two moments and their lever; F_y is shared as the loads, F_x as brakes or drive share it.

    Args:
        s, w: compressions [m] and their rates [m/s], [4, ...].
        b: state, `JointLoadBelief` or one that has its entries; its own compressions are not read.
        p: parameters.
        scale: what the springs' forces beyond the preload, and the dampers', are multiplied by
            besides the scale of the parameters.
    """

    def at(leaf: Any) -> Any:
        return leaf.reshape(leaf.shape + (1,) * (s.ndim - leaf.ndim))

    x, y = at(p.x), at(p.y)
    force = _strut_force(s, w, at, p, scale)
    load = jnp.stack(b[LOADS])
    sunk = s + (load - at(p.static_load)) / at(p.tire_stiffness)
    # a bound, so that loads that sum to nothing have a share
    carried = jnp.maximum(jnp.sum(load, 0), 0.1 * jnp.sum(p.static_load, 0))
    share = load / carried[None]

    behind = x - jnp.mean(x, 0)[None]
    leaning = -jnp.sum(y * sunk, 0) / jnp.sum(y * y, 0)
    diving = jnp.sum(behind * sunk, 0) / jnp.sum(behind * behind, 0)
    heavier = jnp.exp(b.ln_mass)
    total = p.body_mass * heavier + jnp.sum(p.wheel_mass, 0)
    # a force at a contact that has come nearer to the body has less of a lever; what the lean
    # makes of the weight in a_x and a_y acts at the hubs, under which the contacts stay
    weight = p.told * p.radius * jnp.sum(load, 0)
    across = total * p.a_y * (p.lever - jnp.sum(share * sunk, 0)) - leaning * weight
    roll_moment = b.roll_moment + across
    braking = b.pitch_moment - total * p.a_x * p.lever > 0.0
    lengthwise = jnp.where(braking[None], at(p.brake_share), at(p.drive_share))
    ahead = total * p.a_x * (p.lever - jnp.sum(lengthwise * sunk, 0)) + diving * weight
    pitch_moment = b.pitch_moment - ahead

    up = jnp.sum(force, 0) / (p.body_mass * heavier) - STANDARD_GRAVITY
    roll = (jnp.sum(y * force, 0) + roll_moment) / (p.roll_inertia * heavier)
    pitch = (pitch_moment - jnp.sum(x * force, 0)) / (p.pitch_inertia * heavier)

    tilted = (leaning * roll_moment)[None] * share + (diving * pitch_moment)[None] * lengthwise
    along = load - tilted / p.lever
    body = up[None] + roll[None] * y - pitch[None] * x
    return body, (along - force) / at(p.wheel_mass) - STANDARD_GRAVITY


def _strut_force(s: Any, w: Any, at: Any, p: JointLoadParams, scale: Any) -> Any:
    law, preload = map_springs(at, p.strut), at(p.strut.preload)
    spring, damper = (own * known for own, known in zip(scale, p.scale, strict=True))
    own = preload + spring * (spring_force(s, law) - preload)
    return own + damper * damper_force(w, law) + anti_roll_force(s, p.bars)


def _as_given(b: Any) -> tuple[float, float]:
    del b
    return 1.0, 1.0


def motion_model(scale_of: Callable[[Any], Any] = _as_given) -> tuple[Any, Any]:
    """Transition and observation over `JointLoadBelief` or a belief that has its entries.

    Args:
        scale_of: a state -> the `scale` of its springs and dampers.
    """

    @stage
    def slope(motion: tuple[Any, ...], b: Any, p: JointLoadParams) -> tuple[Any, ...]:
        s, w = jnp.stack(motion[:4]), jnp.stack(motion[4:])
        body, wheel = shown_accelerations(s, w, b, p, scale_of(b))
        return (*motion[4:], *(wheel - body))

    def transition(b: Any, p: JointLoadParams) -> Any:
        start = b[:8]

        # a loop over the four stages: the compiler sees the strut's law once
        def next_stage(carry: Any, weights: Any) -> tuple[Any, None]:
            before, end = carry
            ahead, share = weights[0] * p.dt, weights[1] * p.dt
            rate = slope(tuple(a + ahead * r for a, r in zip(start, before, strict=True)), b, p)
            return (rate, tuple(a + share * r for a, r in zip(end, rate, strict=True))), None

        weights = jnp.asarray(_RUNGE_KUTTA, start[0].dtype)
        still = tuple(jnp.zeros_like(a) for a in start)
        return type(b)(*jax.lax.scan(next_stage, (still, start), weights)[0][1], *b[8:])

    @stage
    def observation(b: Any, p: JointLoadParams) -> VehicleLoadSample:
        s, w = jnp.stack(b[:4]), jnp.stack(b[4:8])
        body, wheel = shown_accelerations(s, w, b, p, scale_of(b))
        return VehicleLoadSample._make((*body, *b[:4], *wheel))

    return transition, observation


@lru_cache(maxsize=1)
def joint_load_model() -> StateSpaceModel:
    """State-space model over `JointLoadBelief`, `VehicleLoadSample` and `JointLoadParams`."""
    transition, observation = motion_model()

    def process_cov(b: JointLoadBelief, p: JointLoadParams) -> Any:
        return motion_noise(len(b), p, p.tuning.moment_walk)

    return StateSpaceModel(transition, observation, process_cov, sensor_noise)


def sensor_noise(p: JointLoadParams) -> Any:
    """Covariance of a `VehicleLoadSample`."""
    t = p.tuning
    sigmas = [t.body_acceleration] * 4 + [t.compression] * 4 + [t.wheel_acceleration] * 4
    return diagonal([sigma * sigma for sigma in sigmas])


@lru_cache(maxsize=1)
def joint_load_filter() -> Filter:
    """Unscented filter of the model; entries of a sample that are NaN are left out."""
    return unscented(joint_load_model(), scaled(alpha=NEAR))


def joint_load_prior(p: JointLoadParams) -> Gaussian:
    """Belief before the first sample: the vehicle near rest on level ground."""
    z = jnp.zeros_like(p.body_mass)
    t = p.tuning
    mean = JointLoadBelief._make((*[z] * 8, *p.static_load, z, z, z))
    spread = [z + _PLACE] * 4 + [z + _RATE] * 4 + [z + t.load_prior] * 4 + [z + _MOMENT] * 2
    return independent(mean, JointLoadBelief._make((*spread, z + t.mass_prior)))


def motion_noise(size: int, p: JointLoadParams, moment_walk: Any) -> Any:
    """Loads that walk within the interval, as they move rate and place of a free wheel.

    Args:
        size: of the state; what is beyond `JointLoadBelief` stands still.
        p: parameters.
        moment_walk: [Nm/s^0.5].
    """
    dt, walk = p.dt, p.load_walk
    lower = [[0.0 * dt] * (i + 1) for i in range(size)]
    for k in range(4):
        s, w, f = k, 4 + k, LOADS.start + k
        pushed = walk / p.wheel_mass[k]
        lower[s][s], lower[w][s] = pushed**2 * dt**5 / 20, pushed**2 * dt**4 / 8
        lower[w][w] = pushed**2 * dt**3 / 3
        lower[f][s], lower[f][w] = walk * pushed * dt**3 / 6, walk * pushed * dt**2 / 2
        lower[f][f] = walk**2 * dt
    for k in (12, 13):
        lower[k][k] = moment_walk**2 * dt
    lower[14][14] = _MASS_WALK**2 * dt
    return tuple(tuple(row) for row in lower)
