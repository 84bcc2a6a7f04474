"""A measured characteristic as a smooth, monotone curve through its points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy.interpolate import PchipInterpolator

from wheelhop.errors import InputError

_LONGEST_SUM = 16


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Curve:
    """Cubic Hermite curve, continued straight beyond its ends.

    Attributes:
        x: abscissae, strictly increasing, [points].
        y: ordinates, [points].
        slope: dy/dx at the points, [points].
    """

    x: Any
    y: Any
    slope: Any


def curve(x: Sequence[float], y: Sequence[float], end_slopes: Any = (None, None)) -> Curve:
    """The monotone curve (PCHIP) through points; it overshoots nowhere.

    Args:
        x: abscissae, strictly increasing.
        y: ordinates.
        end_slopes: slope at the first and the last point; None for the interpolant's own.

    Raises:
        InputError: for fewer than two points, a value that is no number, or abscissae that do
            not increase.

    Source: Fritsch & Butland 1984 (SciPy's `PchipInterpolator`).
    """
    xs, ys = np.asarray(x, float), np.asarray(y, float)
    if xs.shape != ys.shape or xs.ndim != 1 or len(xs) < 2:
        raise InputError("curve", f"{xs.shape} abscissae, {ys.shape} ordinates", "Give pairs.")
    if not (np.all(np.isfinite(xs)) and np.all(np.isfinite(ys))):
        raise InputError("curve", "a point is not a number", "Give finite points.")
    if np.any(np.diff(xs) <= 0):
        raise InputError("curve", f"abscissae {xs.tolist()}", "Sort them; none may repeat.")
    if len(xs) > 2:
        slope = PchipInterpolator(xs, ys)(xs, 1)
    else:
        slope = np.full(2, (ys[1] - ys[0]) / (xs[1] - xs[0]))
    for end, value in zip((0, -1), end_slopes, strict=True):
        slope[end] = slope[end] if value is None else value
    return Curve(jnp.asarray(xs, float), jnp.asarray(ys, float), jnp.asarray(slope, float))


def value(c: Curve, x: Any) -> Any:
    """y at x, any shape.

    A short curve is summed segment by segment: no table lookup, so it stays in vector lanes. A
    long one, as a recorded steering angle, is looked up.

    Args:
        c: the curve; points [points], or [points, lanes] where x has lanes as its last axis.
        x: abscissae.
    """
    if c.x.ndim > 1 and jnp.ndim(x) >= c.x.ndim:
        c = Curve(*(part[:, None] for part in (c.x, c.y, c.slope)))
    inside = _looked_up(c, x) if c.x.shape[0] > _LONGEST_SUM else _summed(c, x)
    below = c.slope[0] * jnp.minimum(x - c.x[0], 0.0)
    return inside + below + c.slope[-1] * jnp.maximum(x - c.x[-1], 0.0)


def _summed(c: Curve, x: Any) -> Any:
    y = c.y[0]
    for k in range(c.x.shape[0] - 1):
        y = y + _rise(c.x[k], c.x[k + 1], c.y[k], c.y[k + 1], c.slope[k], c.slope[k + 1], x)
    return y


def _looked_up(c: Curve, x: Any) -> Any:
    knots, y, slope = (jnp.reshape(part, (part.shape[0],)) for part in (c.x, c.y, c.slope))
    k = jnp.clip(jnp.searchsorted(knots, x, side="right") - 1, 0, knots.shape[0] - 2)
    rise = _rise(knots[k], knots[k + 1], y[k], y[k + 1], slope[k], slope[k + 1], x)
    return y[k] + rise


def _rise(x0: Any, x1: Any, y0: Any, y1: Any, s0: Any, s1: Any, x: Any) -> Any:
    """Hermite cubic of a segment above its first ordinate: 0 before it, y1 - y0 after it."""
    width, rise = x1 - x0, y1 - y0
    u = jnp.clip((x - x0) / width, 0.0, 1.0)
    cubic = width * (s0 + s1) - 2.0 * rise
    square = 3.0 * rise - width * (2.0 * s0 + s1)
    return u * (width * s0 + u * (square + u * cubic))
