"""The quarter car on a road that nobody measured: a state-space model for filters.

The road's velocity is process noise. At waviness 2 it is white; at another waviness two shaping
states colour it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from wheelhop.filtering import Gaussian, StateSpaceModel, gaussian
from wheelhop.staging import stage
from wheelhop.vehicle.integrate import rk4
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.quarter_car import (
    Accelerations,
    RelativeState,
    accelerations,
    relative_derivative,
    relative_step,
)
from wheelhop.vehicle.road import road_velocity_intensity
from wheelhop.vehicle.road_noise import road_noise_cov
from wheelhop.vehicle.tire import stiffness_from_pressure

LONGEST_STEP = 0.004
"""Longest integration step [s] within a sampling interval."""

_CENTERS = (0.92947, 10.61904)
_SPREAD = 2.5112
_NODES = ((0.5 - 0.15**0.5, 5 / 18), (0.5, 8 / 18), (0.5 + 0.15**0.5, 5 / 18))
_SERIES = (1.0, 1.0, 1 / 2, 1 / 6, 1 / 24, 1 / 120)
_REST = RelativeState(0.02, 0.01, 0.3, 1.0)


class ShapedState(NamedTuple):
    """Quarter car on a coloured road.

    Attributes:
        deflection, tyre_deflection, v_s, v_u: as in `RelativeState`.
        slow, fast: shaping states of the road [m].
    """

    deflection: Any
    tyre_deflection: Any
    v_s: Any
    v_u: Any
    slow: Any
    fast: Any


class Shaping(NamedTuple):
    """Velocity of a coloured road, z_r' = n + v (r_1 x_1 + r_2 x_2), x_k' = -v p_k x_k + n.

    n is white of intensity `gain` times that of the road of the same level at waviness 2.

    Attributes:
        poles: p_k [rad/m], two.
        residues: r_k [rad/m], two.
        gain: relative intensity of n [-].
    """

    poles: tuple[Any, Any]
    residues: tuple[Any, Any]
    gain: Any


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class RoadModelParams:
    """Parameters of the model; speed and pressure vary in time.

    Attributes:
        car: the corner.
        level: Gd(W0) of the road [m^3/rad].
        waviness: w of the road [-]; the white model does not read it.
        noise_a_s, noise_a_u: standard deviations of the accelerometers [m/s^2].
        speed: v [m/s].
        pressure: of the tyre [Pa].
        dt: sampling interval [s].
    """

    car: QuarterCar
    level: Any
    waviness: Any
    noise_a_s: Any
    noise_a_u: Any
    speed: Any
    pressure: Any
    dt: Any


def shaping(waviness: Any) -> Shaping:
    """Two lead-lag pairs whose power gain follows W^(2-w).

    Zeros and poles lie about two fixed wavenumbers c_k, z_k = c_k exp(-aL/2),
    p_k = c_k exp(aL/2), a = (2-w)/2 (Oustaloup et al. 2000). The c_k and L minimise the largest
    error over 0.05 to 5 cycles/m and w = 1.5 to 2.75, which is 0.26 dB; it grows with |w - 2| and
    is none at w = 2 and at W0 = 1 rad/m, where the level is defined. Beyond that band the
    velocity's spectrum levels off.

    Args:
        waviness: w [-], any shape.
    """
    half = 0.25 * _SPREAD * (2.0 - waviness)
    zeros = [c * jnp.exp(-half) for c in _CENTERS]
    poles = [c * jnp.exp(half) for c in _CENTERS]
    # the pairs keep their order: c_2 / c_1 is larger than any pole / zero
    first = (zeros[0] - poles[0]) * (zeros[1] - poles[0]) / (poles[1] - poles[0])
    second = (zeros[0] - poles[1]) * (zeros[1] - poles[1]) / (poles[0] - poles[1])
    at_reference = [(1.0 + z * z) / (1.0 + p * p) for z, p in zip(zeros, poles, strict=True)]
    gain = 1.0 / (at_reference[0] * at_reference[1])
    return Shaping((poles[0], poles[1]), (first, second), gain)


def corner_on_road(coloured: bool, substeps: int = 1) -> StateSpaceModel:
    """State-space model of the corner with the stiffness that its pressure gives.

    Args:
        coloured: with shaping states for a waviness other than 2.
        substeps: integration steps, and pieces of the road noise, per sampling interval.
    """

    def white_step(x: RelativeState, p: RoadModelParams) -> RelativeState:
        return relative_step(x, _stiffness(p), None, p.dt / substeps, p.car)

    def coloured_step(x: ShapedState, p: RoadModelParams) -> ShapedState:
        shape, dt = shaping(p.waviness), p.dt / substeps
        car = replace(p.car, tire=replace(p.car.tire, damping=0.0))
        (slow, fast), (r_slow, r_fast) = [p.speed * pole for pole in shape.poles], shape.residues

        def derivative(s: ShapedState) -> ShapedState:
            velocity = p.speed * (r_slow * s.slow + r_fast * s.fast)
            motion = relative_derivative(RelativeState(*s[:4]), _stiffness(p), velocity, car)
            return ShapedState(*motion, -slow * s.slow, -fast * s.fast)

        moved = rk4(derivative, x, dt)
        # exact where the step is long beside the decay
        return moved._replace(slow=x.slow * jnp.exp(-slow * dt), fast=x.fast * jnp.exp(-fast * dt))

    step = coloured_step if coloured else white_step

    def transition(x: Any, params: RoadModelParams) -> Any:
        if substeps == 1:
            return step(x, params)
        return jax.lax.scan(lambda s, _: (step(s, params), None), x, length=substeps)[0]

    def observation(x: Any, params: RoadModelParams) -> Accelerations:
        return accelerations(x, _stiffness(params), params.car)

    def process_cov(x: Any, params: RoadModelParams) -> tuple:
        del x
        q = road_velocity_intensity(params.level, params.speed)
        if coloured:
            return shaped_noise_cov(q, params, substeps)
        return road_noise_cov(_stiffness(params), q, params.dt, params.car, substeps)

    def observation_cov(params: RoadModelParams) -> tuple:
        zero = 0.0 * params.noise_a_s
        return ((params.noise_a_s**2,), (zero, params.noise_a_u**2))

    return StateSpaceModel(stage(transition), stage(observation), process_cov, observation_cov)


def shaped_noise_cov(intensity: Any, params: RoadModelParams, substeps: int = 1) -> tuple:
    """Covariance of `ShapedState` after a sampling interval from the white part of the road.

    As `road_noise_cov`, with the shaping states: Taylor series of fifth order and three-point
    Gauss-Legendre quadrature in every substep of the linear car.

    Args:
        intensity: of the white velocity of the same level at waviness 2 [m^2/s].
        params: the model's parameters.
        substeps: pieces of the interval.
    """
    shape = shaping(params.waviness)
    scale = intensity * shape.gain
    fine = params.dt / substeps
    zero = 0.0 * scale * _stiffness(params)
    one = 1.0 + zero
    start = ShapedState(zero, -one, zero, zero, one, one)

    def piece(h: ShapedState) -> tuple[ShapedState, tuple]:
        powers = [h]
        for _ in _SERIES[1:]:
            powers.append(_linear_derivative(powers[-1], shape, params))

        def at(t: Any) -> list[Any]:
            return [
                sum(c * t**k * p[i] for k, (c, p) in enumerate(zip(_SERIES, powers, strict=True)))
                for i in range(6)
            ]

        samples = [(weight, at(node * fine)) for node, weight in _NODES]
        cov = tuple(
            tuple(scale * fine * sum(w * x[i] * x[j] for w, x in samples) for j in range(i + 1))
            for i in range(6)
        )
        return ShapedState(*at(fine)), cov

    if substeps == 1:
        return stage(piece)(start)[1]

    def step(carry: tuple, _: None) -> tuple:
        response, total = carry
        response, share = piece(response)
        return (response, jax.tree.map(jnp.add, total, share)), None

    none = tuple(tuple(zero for _ in range(i + 1)) for i in range(6))
    return jax.lax.scan(step, (start, none), length=substeps)[0][1]


def prior(params: RoadModelParams, coloured: bool) -> Gaussian:
    """Belief before the first sample: moving a little, the shaping states in their stationarity.

    Args:
        params: the model's parameters at the first sample.
        coloured: with shaping states.
    """
    zero = 0.0 * params.level * params.speed
    sigma = [zero + s for s in _REST]
    diagonal = [[zero] * i + [s * s] for i, s in enumerate(sigma)]
    if not coloured:
        return gaussian(RelativeState(zero, zero, zero, zero), tuple(map(tuple, diagonal)))
    shape = shaping(params.waviness)
    # intensity over speed: the stationary states do not know how fast the road is driven
    white = road_velocity_intensity(params.level, 1.0) * shape.gain + zero
    slow, fast = shape.poles
    rows = [
        *diagonal,
        [zero] * 4 + [white / (2.0 * slow)],
        [zero] * 4 + [white / (slow + fast), white / (2.0 * fast)],
    ]
    return gaussian(ShapedState(zero, zero, zero, zero, zero, zero), tuple(map(tuple, rows)))


def _stiffness(params: RoadModelParams) -> Any:
    return stiffness_from_pressure(params.pressure, params.car.tire)


def _linear_derivative(h: ShapedState, shape: Shaping, params: RoadModelParams) -> ShapedState:
    car, v = params.car, params.speed
    w = h.v_s - h.v_u
    force = car.suspension.stiffness * h.deflection + car.suspension.damping * w
    wheel = (force - _stiffness(params) * h.tyre_deflection) / car.unsprung_mass
    road = v * (shape.residues[0] * h.slow + shape.residues[1] * h.fast)
    return ShapedState(
        w,
        h.v_u - road,
        -force / car.sprung_mass,
        wheel,
        -v * shape.poles[0] * h.slow,
        -v * shape.poles[1] * h.fast,
    )
