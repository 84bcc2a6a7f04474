"""Unbiased minimum variance filter of the load: Filipozzi et al. 2021, Eq. 17-30.

The momenta p_s and p_u are seen only through q' = p_u / m_u - p_s / m_s, so the observable system
has the states q and q', per corner: the direction m_s p_s + m_u p_u is gone. The inputs are the
loads themselves, gravity and preload are known. The third signal that makes the system strongly
observable, q', is made here: all signals pass one low-pass 1 / (1 + s / w_d)^2, behind which the
deflection's derivative is known too, and the load comes out behind that low-pass.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.errors import require_in_range
from wheelhop.estimators.inverse_load import LoadSensors
from wheelhop.estimators.unbiased_noise import shaped_variances, steady_load_cov
from wheelhop.estimators.wheel_load import LoadObserver, LoadSample, WheelLoad
from wheelhop.estimators.youla_load import FASTEST, checked_sensors
from wheelhop.filtering import rational
from wheelhop.filtering.decoupling import DecoupledModel, UnknownInputModel, decoupled
from wheelhop.filtering.gaussian import Gaussian, moment_match
from wheelhop.filtering.interface import Filter, Info
from wheelhop.filtering.rational import Chain, Chained
from wheelhop.filtering.unknown_input import UnknownInputState, unknown_input
from wheelhop.vehicle.corner_suspension import CornerSuspension, validate
from wheelhop.vehicle.full_vehicle_state import STANDARD_GRAVITY

USUAL_LOAD = 5e3
"""Size of a load that no sample tells [N]."""


class ThreeSignals(NamedTuple):
    """What the filter proper measures of a corner [m/s^2], [m], [m/s]."""

    body_acceleration: Any
    deflection: Any
    deflection_rate: Any


class Stroke(NamedTuple):
    """The observable state of a corner: q [m] and q' [m/s]."""

    deflection: Any
    deflection_rate: Any


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class UnbiasedParams:
    """Parameters of the filter.

    Attributes:
        system: of the filter proper.
        shaping: chain of the differentiator's low-pass.
        acceleration_noise: of the sensor [m/s^2].
        deflection_noise: of the sensor [m].
        acceleration_drift, deflection_drift: as those of `LoadSensors`.
        load_cov: covariance of (F, dF) that the sensors' noise makes in the end [N^2], [2, 2].
    """

    system: DecoupledModel
    shaping: Chain
    acceleration_noise: Any
    deflection_noise: Any
    acceleration_drift: Any
    deflection_drift: Any
    load_cov: Any


class UnbiasedState(NamedTuple):
    """State of the filter.

    Attributes:
        signals: the measurements in the chains of the differentiator.
        inner: state of the filter proper; its `input` is the load of one sample before, with the
            covariance that white noise in the three signals would make.
        load: `Gaussian` of that load, with the covariance that the two sensors make.
    """

    signals: tuple[Chained, Chained]
    inner: UnknownInputState
    load: Gaussian


def unbiased_params(
    corner: CornerSuspension,
    dt: float,
    bandwidth: float = 30.0,
    sensors: LoadSensors | None = None,
    walk: float = 1e-3,
) -> UnbiasedParams:
    """Parameters of the filter for one corner.

    Args:
        corner: the corner, entries [], concrete.
        dt: sampling interval [s].
        bandwidth: w_d / (2 pi) of each of the differentiator's two poles [Hz].
        sensors: their noise and drifts; they must follow at once.
        walk: standard deviation of q' from what the model leaves out, in a second [m/s].

    Raises:
        InputError: naming the figure that is out of range.
        ValueError: if the suspension does not determine the load.
    """
    require_in_range("dt", dt, 1e-6, 10.0, "s")
    require_in_range("bandwidth", bandwidth, 0.01, FASTEST / dt, "Hz")
    validate(corner)
    require_in_range("walk", walk, 0.0, 10.0, "m/s in a second")
    sensors = checked_sensors(LoadSensors() if sensors is None else sensors, undoes=False)
    shaping = rational.chain(jnp.asarray([1.0, 2.0, 1.0]), 2.0 * math.pi * bandwidth, dt)
    noise = shaped_noise(shaping, sensors)
    system = decoupled(
        corner_system(corner, dt, jnp.asarray(walk), noise), USUAL_LOAD**2 * np.eye(2)
    )
    levels = float(sensors.acceleration_noise), float(sensors.deflection_noise)
    made = steady_load_cov(system, shaping, *levels) if any(levels) else np.zeros((2, 2))
    kind = shaping.now.dtype
    drifts = sensors.acceleration_drift, sensors.deflection_drift
    numbers = (jnp.asarray(number, kind) for number in (*levels, *drifts, made))
    return UnbiasedParams(system, shaping, *numbers)


def corner_system(
    corner: CornerSuspension, dt: float, walk: Any, noise: ThreeSignals
) -> UnknownInputModel:
    """Matrices of one corner, the loads constant over a sampling interval; pure.

    Args:
        corner: entries [].
        dt: sampling interval [s].
        walk: of q' [m/s] in a second.
        noise: standard deviation of each signal.
    """
    c, g = corner, STANDARD_GRAVITY
    ease = 1.0 / c.sprung_mass + 1.0 / c.unsprung_mass
    one = jnp.ones_like(c.stiffness * ease)
    zero = 0.0 * one
    a = jnp.stack(
        [jnp.stack([zero, one]), jnp.stack([-c.stiffness * ease, -c.damping * ease]) * one]
    )
    into = jnp.stack([zero, one / c.unsprung_mass]), jnp.stack([zero, one / c.sprung_mass])
    known = jnp.stack([zero, -c.preload * ease * one])
    whole = jnp.zeros((5, 5), a.dtype).at[:2, :2].set(a)
    moved = jax.scipy.linalg.expm(whole.at[:2, 2:].set(jnp.stack([*into, known], 1)) * dt)
    rows = jnp.stack(
        [
            jnp.stack([c.stiffness, c.damping]) * one / c.sprung_mass,
            jnp.stack([one, zero]),
            jnp.stack([zero, one]),
        ]
    )
    through = jnp.zeros((3, 2), a.dtype).at[0, 1].set(-1.0 / c.sprung_mass)
    return UnknownInputModel(
        transition=moved[:2, :2],
        input_matrix=moved[:2, 2:4],
        observation=rows,
        feedthrough=through,
        process_cov=jnp.diag(jnp.stack([zero, walk**2 * dt * one])),
        observation_cov=jnp.diag(jnp.stack([s * s * one for s in noise])),
        state_offset=moved[:2, 4],
        observation_offset=jnp.zeros(3, a.dtype).at[0].set(c.preload / c.sprung_mass - g),
    )


def shaped_noise(shaping: Chain, sensors: LoadSensors) -> ThreeSignals:
    """Standard deviations of the sensors' noise in the shaped signals.

    The low-pass makes them hang together over a few samples, which the filter does not know.

    Args:
        shaping: chain of the differentiator's low-pass, concrete.
        sensors: their noise.
    """
    a, q = sensors.acceleration_noise, sensors.deflection_noise
    low, fast = (float(np.sqrt(v)) for v in shaped_variances(shaping))
    fast *= float(shaping.scale)
    floor = 1e-9
    return ThreeSignals(max(a * low, floor), max(q * low, floor), max(q * fast, floor))


@lru_cache(maxsize=1)
def unbiased() -> LoadObserver:
    """The filter of one corner over `LoadSample` and `WheelLoad`.

    Its `init` takes a `Gaussian` over `LoadSample`, as that of `youla_load.youla`. F is that of the
    sampling interval before the latest sample, dF that of its beginning. The load's covariance is
    that of a settled filter, times what a beginning or lost samples, which are held, add to the
    variance of the shaped signals. `Info` is that of the filter proper, which takes
    its third signal for a measurement of its own: its `nis` is far below one.
    """
    inner = unknown_input(ThreeSignals, WheelLoad)

    def init(prior: Gaussian, params: UnbiasedParams) -> UnbiasedState:
        mean, ((a,), (_, q)) = prior.mean, prior.cov
        signals = (
            rational.begin(params.shaping, mean.body_acceleration, a),
            rational.begin(params.shaping, mean.deflection, q),
        )
        zero = jnp.zeros_like(q)
        stroke = Stroke(mean.deflection, zero)
        scale = jnp.asarray(params.shaping.scale, q.dtype)
        cov = ((q,), (zero, q * scale**2))
        begun = inner.init(Gaussian(stroke, cov), params.system)
        return UnbiasedState(signals, begun, _stated(signals, begun, params))

    def step(
        state: UnbiasedState, y: LoadSample, params: UnbiasedParams
    ) -> tuple[UnbiasedState, Info]:
        shaping = params.shaping
        variances = (params.acceleration_noise**2, params.deflection_noise**2)
        drifts = (params.acceleration_drift, params.deflection_drift)
        a, q = (
            rational.advance(shaping, before, u, r, shaping.dt * g * g)
            for before, u, r, g in zip(state.signals, y, variances, drifts, strict=True)
        )
        level = rational.combination(shaping, [1.0])
        rate = rational.combination(shaping, [0.0, 1.0])
        shaped = ThreeSignals(
            *(
                rational.value(s, w.reshape((-1,) + (1,) * (s.entries.ndim - 1)))
                for s, w in ((a, level), (q, level), (q, rate))
            )
        )
        found, info = inner.step(state.inner, shaped, params.system)
        missing = sum((~jnp.isfinite(u)).astype(jnp.int32) for u in y)
        info = info._replace(flags=info.flags._replace(missing=missing))
        return UnbiasedState((a, q), found, _stated((a, q), found, params)), info

    def mix(weights: Any, stacked: UnbiasedState) -> UnbiasedState:
        a, q = (rational.mixed(weights, s) for s in stacked.signals)
        load = moment_match(weights, stacked.load)
        return UnbiasedState((a, q), inner.mix(weights, stacked.inner), load)

    return LoadObserver(Filter(init, step, mix), _load_of, delay=1)


def _load_of(state: UnbiasedState) -> Gaussian:
    return state.load


def _stated(
    signals: tuple[Chained, Chained], inner: UnknownInputState, params: UnbiasedParams
) -> Gaussian:
    a, q = signals
    wide = (-1,) + (1,) * (a.entries.ndim - 1)
    level, rate = (
        rational.combination(params.shaping, n).reshape(wide) for n in ([1.0], [0.0, 1.0])
    )
    usual = params.system.model.observation_cov
    more = jnp.maximum(
        rational.covariance(a, level, level) / usual[0, 0],
        rational.covariance(q, rate, rate) / usual[2, 2],
    )
    more, cov = jnp.maximum(more, 1.0), params.load_cov
    return Gaussian(inner.input.mean, ((more * cov[0, 0],), (more * cov[1, 0], more * cov[1, 1])))
