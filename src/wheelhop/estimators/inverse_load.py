"""Observer that is a polynomial inverse of the suspension behind a low-pass.

Closed around a model of the suspension, a Youla controller makes the input's estimate Y y with
Y = M_T G^-1, where M_T is the low-pass that the design asks for and G^-1 holds polynomials in s
(Filipozzi et al. 2021, Eq. 9-15). Its virtual measurement is M_T y. Both are sums over the entries
of one chain per measurement, whatever the suspension has for corners.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from wheelhop.estimators.wheel_load import LoadObserver
from wheelhop.filtering import rational
from wheelhop.filtering.gaussian import Gaussian, moment_match
from wheelhop.filtering.interface import Filter, Flags, Info, all_finite
from wheelhop.filtering.rational import Chain, Chained
from wheelhop.vehicle.corner_suspension import CornerSuspension


class LoadSensors(NamedTuple):
    """Sensors of a corner as an observer believes in them.

    Attributes:
        acceleration_noise: standard deviation, white [m/s^2].
        deflection_noise: standard deviation, white [m].
        acceleration_bandwidth, deflection_bandwidth: -3 dB frequency of a second-order Butterworth
            low-pass that the observer undoes [Hz]; infinite for a sensor that follows at once.
        acceleration_drift, deflection_drift: by how much the signal leaves its last value in a
            second without samples, as the root of time [m/s^2/s^0.5, m/s^0.5].
    """

    acceleration_noise: Any = 0.05
    deflection_noise: Any = 5e-4
    acceleration_bandwidth: Any = math.inf
    deflection_bandwidth: Any = math.inf
    acceleration_drift: Any = 5.0
    deflection_drift: Any = 0.05


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class InverseParams:
    """Parameters of an observer of this kind.

    Attributes:
        corner: the corner, or the corners of an axle on a leading axis [2].
        shaping: chain of the low-pass.
        sensors: their noise and dynamics.
    """

    corner: CornerSuspension
    shaping: Chain
    sensors: LoadSensors


class Inverse(NamedTuple):
    """u = N(s) y + constant, before the low-pass.

    Attributes:
        numerators: for every input, for every measurement, coefficients of N in s, ascending;
            an empty list where there is none.
        constant: of every input, each [...].
    """

    numerators: Any
    constant: Any


class InverseState(NamedTuple):
    """State of the observer.

    Attributes:
        signals: the measurements, each in its chain.
        load: `Gaussian` over the inputs that they make.
    """

    signals: tuple[Chained, ...]
    load: Gaussian


@lru_cache(maxsize=8)
def inverse_observer(
    inverse: Callable[[InverseParams], Inverse],
    inputs: type,
    noise: Callable[[LoadSensors], tuple[tuple[Any, ...], tuple[Any, ...]]],
) -> LoadObserver:
    """The observer of an inverse.

    A measurement that is missing is held, and its doubt grows. `Info` describes y - M_T y, whose
    covariance is that of the sensors' noise alone: the signal's own parts beyond the bandwidth are
    in the innovation too, so that `nis` is large on a rough road.

    Args:
        inverse: (params) -> the inverse of the suspension.
        inputs: NamedTuple type of the inputs.
        noise: (sensors) -> standard deviation of every measurement, and its drift.
    """

    def load(signals: tuple[Chained, ...], params: InverseParams) -> Gaussian:
        numerators, constant = inverse(params)
        weights = [
            [
                None if not n else _spread(rational.combination(params.shaping, n), s)
                for n, s in zip(row, signals, strict=True)
            ]
            for row in numerators
        ]
        mean = [
            sum(
                (rational.value(s, w) for s, w in zip(signals, row, strict=True) if w is not None),
                start=c,
            )
            for row, c in zip(weights, constant, strict=True)
        ]

        def cov(i: int, j: int) -> Any:
            rows = zip(signals, weights[i], weights[j], strict=True)
            zero = jnp.zeros_like(mean[0])
            return sum(
                (
                    rational.covariance(s, a, b)
                    for s, a, b in rows
                    if a is not None and b is not None
                ),
                start=zero,
            )

        return Gaussian(
            inputs(*mean), tuple(tuple(cov(i, j) for j in range(i + 1)) for i in range(len(mean)))
        )

    def init(prior: Gaussian, params: InverseParams) -> InverseState:
        signals = tuple(
            rational.begin(params.shaping, mean, row[i])
            for i, (mean, row) in enumerate(zip(prior.mean, prior.cov, strict=True))
        )
        return InverseState(signals, load(signals, params))

    def step(state: InverseState, y: Any, params: InverseParams) -> tuple[InverseState, Info]:
        shaping = params.shaping
        variances, growths = (
            [jnp.asarray(r, shaping.now.dtype) ** 2 for r in rs] for rs in noise(params.sensors)
        )
        signals = tuple(
            rational.advance(shaping, before, u, r, shaping.dt * g)
            for before, u, r, g in zip(state.signals, y, variances, growths, strict=True)
        )
        new = InverseState(signals, load(signals, params))
        return new, _report(new, y, shaping)

    def mix(weights: Any, stacked: InverseState) -> InverseState:
        signals = tuple(rational.mixed(weights, signal) for signal in stacked.signals)
        return InverseState(signals, moment_match(weights, stacked.load))

    return LoadObserver(Filter(init, step, mix), load_of_state)


def load_of_state(state: InverseState) -> Gaussian:
    """The load of a state."""
    return state.load


def times_polynomial(first: list[Any], second: list[Any]) -> list[Any]:
    """Coefficients of a product of polynomials, ascending."""
    result: list[Any] = [0.0] * (len(first) + len(second) - 1)
    for i, a in enumerate(first):
        for j, b in enumerate(second):
            result[i + j] = result[i + j] + a * b
    return result


def undone(bandwidth: Any) -> list[Any]:
    """Denominator of a second-order Butterworth low-pass [Hz] in s, ascending; 1 if infinite."""
    w = 2.0 * math.pi * bandwidth
    return [1.0, math.sqrt(2.0) / w, 1.0 / (w * w)]


def _report(state: InverseState, y: Any, shaping: Chain) -> Info:
    weights = rational.combination(shaping, [-1.0])
    weights = weights + jnp.zeros_like(weights).at[-1].set(1.0)
    rest, variances, volume = [], [], []
    for signal, u in zip(state.signals, y, strict=True):
        here = _spread(weights, signal)
        present = jnp.isfinite(u)
        variance = rational.covariance(signal, here, here)
        rest.append(jnp.where(present, rational.value(signal, here), 0.0))
        variances.append(jnp.where(present & (variance > 0), variance, 1.0))
        volume.append(jnp.where(present, jnp.log(2.0 * math.pi * variances[-1]), 0.0))
    nis = sum(e * e / c for e, c in zip(rest, variances, strict=True))
    zero = jnp.zeros_like(rest[0])
    cov = tuple((*[zero] * i, c) for i, c in enumerate(variances))
    missing = sum((~jnp.isfinite(u)).astype(jnp.int32) for u in y)
    none = jnp.zeros_like(missing)
    nonfinite = ~all_finite(tuple(signal.entries for signal in state.signals))
    flags = Flags(missing, jnp.zeros_like(nonfinite), nonfinite, none, none)
    return Info(type(y)(*rest), cov, -0.5 * (nis + sum(volume)), nis, flags)


def _spread(weights: Any, signal: Chained) -> Any:
    return weights.reshape(weights.shape + (1,) * (signal.entries.ndim - weights.ndim))
