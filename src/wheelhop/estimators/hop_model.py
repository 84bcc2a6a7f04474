"""A corner in the band of the wheel hop: the state-space model of its mean wheel acceleration."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from wheelhop.estimators.road_model import RoadModelParams, shaping
from wheelhop.filtering import Gaussian, StateSpaceModel, gaussian
from wheelhop.staging import stage
from wheelhop.vehicle.integrate import rk4
from wheelhop.vehicle.quarter_car import RelativeState, relative_derivative
from wheelhop.vehicle.road import road_velocity_intensity
from wheelhop.vehicle.tire import stiffness_from_pressure

_NODES = ((0.5 - 0.15**0.5, 5 / 18), (0.5, 8 / 18), (0.5 + 0.15**0.5, 5 / 18))
_SERIES = (1.0, 1.0, 1 / 2, 1 / 6, 1 / 24, 1 / 120)
_REST = (0.02, 0.01, 0.3, 1.0)


class HopState(NamedTuple):
    """Quarter car on a coloured road that a contact patch averages.

    Attributes:
        deflection, tyre_deflection, v_s, v_u: as in `RelativeState`.
        slow, fast: shaping states of the road [m].
        rise: velocity of the averaged road under the wheel [m/s].
        before: v_u at the beginning of the interval [m/s].
    """

    deflection: Any
    tyre_deflection: Any
    v_s: Any
    v_u: Any
    slow: Any
    fast: Any
    rise: Any
    before: Any


class WheelAcceleration(NamedTuple):
    """Mean acceleration of the wheel over an interval [m/s^2]."""

    a_u: Any


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class HopParams:
    """Parameters of a corner.

    Attributes:
        corner: of the corner and its road; `dt` is the interval of the means [s].
        patch: half-length of the contact patch [m].
    """

    corner: RoadModelParams
    patch: Any


def hop_model(substeps: int) -> StateSpaceModel:
    """State-space model of a corner's mean wheel acceleration.

    Args:
        substeps: integration steps, and pieces of the road noise, per interval.
    """

    def step(x: HopState, p: HopParams) -> HopState:
        shape, c = shaping(p.corner.waviness), p.corner
        car = replace(c.car, tire=replace(c.car.tire, damping=0.0))
        stiffness = stiffness_from_pressure(c.pressure, c.car.tire)

        def derivative(s: HopState) -> HopState:
            motion = relative_derivative(RelativeState(*s[:4]), stiffness, s.rise, car)
            road = _road(s, shape, p)
            return HopState(*motion, *road, 0.0 * s.before)

        return rk4(derivative, x, c.dt / substeps)

    def transition(x: HopState, params: HopParams) -> HopState:
        start = x._replace(before=x.v_u)
        return jax.lax.scan(lambda s, _: (step(s, params), None), start, length=substeps)[0]

    def observation(x: HopState, params: HopParams) -> WheelAcceleration:
        return WheelAcceleration((x.v_u - x.before) / params.corner.dt)

    def process_cov(x: HopState, params: HopParams) -> tuple:
        del x
        return hop_noise_cov(params, substeps)

    def observation_cov(params: HopParams) -> tuple:
        return ((params.corner.noise_a_u**2,),)

    return StateSpaceModel(stage(transition), observation, process_cov, observation_cov)


def _road(s: Any, shape: Any, p: HopParams) -> tuple[Any, Any, Any]:
    """Rates of slow, fast and rise without the white part."""
    v = p.corner.speed
    coloured = v * (shape.residues[0] * s.slow + shape.residues[1] * s.fast)
    return (
        -v * shape.poles[0] * s.slow,
        -v * shape.poles[1] * s.fast,
        _corner_rate(p) * (coloured - s.rise),
    )


def _corner_rate(p: HopParams) -> Any:
    """Of the low-pass [rad/s] whose gain, 1 - (w a/v)^2/6 at low w, is that of the patch's mean."""
    return 3.0**0.5 * p.corner.speed / p.patch


def hop_noise_cov(params: HopParams, substeps: int) -> tuple:
    """Covariance of `HopState` after an interval from the white part of the road.

    Args:
        params: of the corner.
        substeps: pieces of the interval, each by a Taylor series of fifth order and three-point
            Gauss-Legendre quadrature.
    """
    c = params.corner
    shape = shaping(c.waviness)
    stiffness = stiffness_from_pressure(c.pressure, c.car.tire)
    scale = road_velocity_intensity(c.level, c.speed) * shape.gain
    fine = c.dt / substeps
    zero = 0.0 * scale * stiffness
    one = 1.0 + zero
    car = c.car
    start = HopState(zero, zero, zero, zero, one, one, _corner_rate(params) + zero, zero)

    def derivative(h: HopState) -> HopState:
        w = h.v_s - h.v_u
        force = car.suspension.stiffness * h.deflection + car.suspension.damping * w
        wheel = (force - stiffness * h.tyre_deflection) / car.unsprung_mass
        motion = (w, h.v_u - h.rise, -force / car.sprung_mass, wheel)
        return HopState(*motion, *_road(h, shape, params), zero)

    def piece(carry: tuple, _: None) -> tuple:
        h, total = carry
        powers = [h]
        for _k in _SERIES[1:]:
            powers.append(derivative(powers[-1]))

        def at(t: Any) -> list[Any]:
            return [
                sum(a * t**k * x[i] for k, (a, x) in enumerate(zip(_SERIES, powers, strict=True)))
                for i in range(8)
            ]

        samples = [(weight, at(node * fine)) for node, weight in _NODES]
        share = tuple(
            tuple(scale * fine * sum(w * x[i] * x[j] for w, x in samples) for j in range(i + 1))
            for i in range(8)
        )
        return (HopState(*at(fine)), jax.tree.map(jnp.add, total, share)), None

    none = tuple(tuple(zero for _ in range(i + 1)) for i in range(8))
    return jax.lax.scan(piece, (start, none), length=substeps)[0][1]


def hop_state_prior(params: HopParams) -> Gaussian:
    """Belief before the first mean: moving a little; entries as those of the parameters."""
    c, shape = params.corner, shaping(params.corner.waviness)
    zero = 0.0 * c.level * c.speed
    white = road_velocity_intensity(c.level, 1.0) * shape.gain
    spread = [zero + s * s for s in (*_REST[:4],)]
    spread += [white / (2.0 * p) + zero for p in shape.poles]
    spread += [0.5 * white * c.speed * _corner_rate(params) + zero, zero + _REST[3] ** 2]
    rows = tuple((*([zero] * i), s) for i, s in enumerate(spread))
    return gaussian(HopState(*([zero] * 8)), rows)
