"""Rational transfer functions with one denominator, as a discrete chain of derivatives.

The chain holds the signal behind 1 / D(s) and its derivatives, so that any N(s) / D(s) with a
degree of N up to that of D is a sum of its entries. Time is counted in 1 / `scale`, p = s / scale,
which keeps all entries of the size of the signal.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

Method = Literal["exact", "bilinear"]
"""Of discretisation: exact for a signal that is linear between samples, or Tustin's."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Chain:
    """x_k = A x_{k-1} + b u_{k-1} + c u_k, where x_i = p^i u / D(p), i = 0 .. n - 1.

    All runs of a batch share one chain.

    Attributes:
        denominator: coefficients of D in p, ascending, [n + 1]; D(0) = 1.
        scale: of time [rad/s].
        transition: A [n, n].
        before: b [n].
        now: c [n].
        dt: sampling interval [s].
    """

    denominator: Any
    scale: Any
    transition: Any
    before: Any
    now: Any
    dt: float = field(metadata={"static": True})


class Chained(NamedTuple):
    """A signal in its chain: what is in it, and how the noise of the signal shakes it.

    Attributes:
        entries: x_0 .. x_{n-1} and the latest u, [n + 1, ...].
        cov: their covariance, [n + 1, n + 1, ...].
    """

    entries: Any
    cov: Any


def chain(denominator: Any, scale: Any, dt: float, method: Method = "bilinear") -> Chain:
    """Discretise 1 / D(p) and its derivatives; pure in `denominator` and `scale`.

    Args:
        denominator: coefficients of D in p = s / scale, ascending, [n + 1], the first 1.
        scale: [rad/s].
        dt: sampling interval [s].
        method: "exact" reproduces the response to a signal that is linear between samples: of a
            sine of frequency f the chain sees sinc(f dt)^2, 0.3 % less at f dt = 0.03, and its
            images about the sampling rate, which tell in the higher derivatives where D passes
            them. "bilinear" replaces s by 2 (z - 1) / (dt (z + 1)): no images, frequencies warped
            by (pi f dt)^2 / 3, 0.3 % there, and poles faster than the sampling ring.

    Raises:
        ValueError: for a sampling interval that is not positive, or another method.
    """
    if not dt > 0:
        raise ValueError(f"dt={dt} s: give a positive sampling interval")
    if method not in ("exact", "bilinear"):
        raise ValueError(f"method={method!r} is unknown: use 'exact' or 'bilinear'")
    d = jnp.asarray(denominator, jnp.result_type(float))
    n = d.shape[0] - 1
    span = jnp.asarray(scale, d.dtype) * dt
    a = jnp.eye(n, k=1, dtype=d.dtype).at[-1].set(-d[:-1] / d[-1]) * span
    b = jnp.zeros(n, d.dtype).at[-1].set(1.0 / d[-1]) * span
    if method == "bilinear":
        left, right = (jnp.eye(n, dtype=d.dtype) + s * 0.5 * a for s in (-1.0, 1.0))
        # one system: two of a batch at once could wait for each other's threads
        moved = jnp.linalg.solve(left, jnp.concatenate([right, 0.5 * b[:, None]], axis=1))
        return Chain(d, jnp.asarray(scale, d.dtype), moved[:, :n], moved[:, n], moved[:, n], dt)
    # the signal and its slope are two more states while it is linear
    whole = jnp.zeros((n + 2, n + 2), d.dtype).at[:n, :n].set(a).at[:n, n].set(b)
    moved = jax.scipy.linalg.expm(whole.at[n, n + 1].set(1.0))
    now = moved[:n, n + 1]
    return Chain(d, jnp.asarray(scale, d.dtype), moved[:n, :n], moved[:n, n] - now, now, dt)


def begin(of: Chain, value: Any, variance: Any) -> Chained:
    """The chain of a signal that has had an uncertain constant value for ever.

    Args:
        of: the chain.
        value: of the signal, [...].
        variance: of that value, [...].
    """
    value, variance = jnp.broadcast_arrays(jnp.asarray(value), jnp.asarray(variance))
    n = of.transition.shape[0]
    steady = jnp.zeros(n + 1, value.dtype).at[0].set(1.0).at[n].set(1.0)
    steady = steady.reshape((n + 1,) + (1,) * value.ndim)
    return Chained(steady * value[None], steady[:, None] * steady[None] * variance[None, None])


def advance(of: Chain, state: Chained, u: Any, variance: Any, drift: Any = 0.0) -> Chained:
    """One sample on.

    Args:
        of: the chain.
        state: before.
        u: the sample, [...]; where it is not finite the one before is held, with its error.
        variance: of the noise in u, white, [...].
        drift: variance by which a held value becomes more doubtful in a sample, [...].
    """
    n = of.transition.shape[0]
    move = jnp.concatenate([of.transition, of.before[:, None]], 1)
    move = jnp.concatenate([move, jnp.zeros((1, n + 1), move.dtype)])
    gain = jnp.concatenate([of.now, jnp.ones(1, move.dtype)])
    present = jnp.isfinite(u)
    u = jnp.where(present, u, state.entries[n])
    wide = (1,) * u.ndim
    gain = gain.reshape((n + 1, *wide))
    entries = jnp.tensordot(move, state.entries, 1) + gain * u[None]
    moved = jnp.tensordot(move, state.cov, 1)
    cov = jnp.moveaxis(jnp.tensordot(moved, move, ((1,), (1,))), -1, 1)
    # a held value has the error of the one before, which is in the entries already
    along = jnp.where(present[None], 0.0, moved[:, n])
    side = gain[:, None] * along[None]
    own = jnp.where(present, variance + 0.0 * u, state.cov[n, n] + drift)
    return Chained(
        entries,
        cov + side + jnp.swapaxes(side, 0, 1) + gain[:, None] * gain[None] * own[None, None],
    )


def combination(of: Chain, numerator: Any) -> Any:
    """Weights of a chain's entries whose sum is N(s) / D(s) u, [n + 1, ...].

    Args:
        of: the chain.
        numerator: coefficients of N in s, ascending, at most n + 1 of them, each [...].
    """
    d = of.denominator
    n = d.shape[0] - 1
    numerator = jnp.broadcast_arrays(*(jnp.asarray(c, d.dtype) for c in numerator))
    if len(numerator) > n + 1:
        raise ValueError(
            f"a numerator of degree {len(numerator) - 1} over a denominator of degree {n} would "
            "differentiate the measurement: give the shaping more poles"
        )
    zero = jnp.zeros_like(numerator[0])
    scaled = [c * of.scale**k for k, c in enumerate(numerator)]
    scaled += [zero] * (n + 1 - len(scaled))
    top = scaled[n] / d[n]
    return jnp.stack([c - top * d[k] for k, c in enumerate(scaled[:n])] + [top])


def value(state: Chained, weights: Any) -> Any:
    """Sum of the entries times weights of `combination`, [...]."""
    return jnp.sum(weights * state.entries, 0)


def covariance(state: Chained, first: Any, second: Any) -> Any:
    """Covariance of two such sums, [...]."""
    return jnp.sum(first[:, None] * second[None] * state.cov, (0, 1))


def mixed(weights: Any, stacked: Chained) -> Chained:
    """Moments of a mixture of chains, stacked on a leading axis [m, n + 1, ...].

    Args:
        weights: [m, ...].
        stacked: the chains.
    """
    w = weights[:, None]
    mean = jnp.sum(w * stacked.entries, 0)
    off = stacked.entries - mean[None]
    spread = off[:, :, None] * off[:, None]
    return Chained(mean, jnp.sum(w[:, None] * (stacked.cov + spread), 0))


def response(of: Chain, numerator: Any, frequency: Any) -> np.ndarray:
    """Frequency response of the discrete N / D, complex [frequencies].

    Args:
        of: the chain, concrete.
        numerator: as in `combination`, numbers.
        frequency: [Hz], below half the sampling rate.

    Raises:
        ValueError: for a frequency beyond it.
    """
    frequency = np.asarray(frequency, float)
    if np.any(np.abs(frequency) > 0.5 / of.dt):
        raise ValueError(f"frequency beyond half the sampling rate, {0.5 / of.dt:g} Hz")
    a, b, c = (np.asarray(x, float) for x in (of.transition, of.before, of.now))
    weights = np.asarray(combination(of, numerator), float)
    z = np.exp(2j * np.pi * frequency * of.dt)
    n = len(a)
    inside = z[:, None, None] * np.eye(n) - a
    entries = np.linalg.solve(inside, (b + z[:, None] * c)[..., None])[..., 0]
    return np.asarray(entries @ weights[:n] + weights[n])
