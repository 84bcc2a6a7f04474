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
    slope = PchipInterpolator(xs, ys)(xs, 1) if len(xs) > 2 else np.full(2, np.ptp(ys) / np.ptp(xs))
    if len(xs) == 2:
        slope = np.full(2, (ys[1] - ys[0]) / (xs[1] - xs[0]))
    for end, value in zip((0, -1), end_slopes, strict=True):
        slope[end] = slope[end] if value is None else value
    return Curve(jnp.asarray(xs, float), jnp.asarray(ys, float), jnp.asarray(slope, float))


def value(c: Curve, x: Any) -> Any:
    """y at x, any shape, elementwise: no table lookup, so it stays in vector lanes."""
    y = c.y[0] + c.slope[0] * jnp.minimum(x - c.x[0], 0.0)
    for k in range(c.x.shape[0] - 1):
        width, rise = c.x[k + 1] - c.x[k], c.y[k + 1] - c.y[k]
        u = jnp.clip((x - c.x[k]) / width, 0.0, 1.0)
        # Hermite cubic above the segment's first ordinate
        cubic = width * (c.slope[k] + c.slope[k + 1]) - 2.0 * rise
        square = 3.0 * rise - width * (2.0 * c.slope[k] + c.slope[k + 1])
        y = y + u * (width * c.slope[k] + u * (square + u * cubic))
    return y + c.slope[-1] * jnp.maximum(x - c.x[-1], 0.0)
