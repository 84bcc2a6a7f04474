"""Uniform cubic B-splines on a bank of rows: coefficients, weights and look-up."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp

PAD = 4
"""Coefficients added at each end, of the constant end value: the spline runs out flat."""


def prefilter(z: Any) -> Any:
    """Quasi-interpolating coefficients c_i = (-z[i-1] + 8 z[i] - z[i+1]) / 6 (de Boor & Fix 1973).

    Local, and exact for cubic polynomials: the spline is of fourth order.
    """
    widths = [(0, 0)] * (z.ndim - 1) + [(PAD + 1, PAD + 1)]
    z = jnp.pad(z, widths, mode="edge")
    return (8.0 * z[..., 1:-1] - z[..., :-2] - z[..., 2:]) / 6.0


def spline_weights(t: Any) -> tuple[Any, Any]:
    """Uniform cubic B-spline at the fraction t of a cell: four values and their derivatives."""
    s = 1.0 - t
    value = [
        s**3 / 6.0,
        (4.0 - 6.0 * t**2 + 3.0 * t**3) / 6.0,
        (4.0 - 6.0 * s**2 + 3.0 * s**3) / 6.0,
        t**3 / 6.0,
    ]
    rate = [-0.5 * s**2, 1.5 * t**2 - 2.0 * t, 2.0 * s - 1.5 * s**2, 0.5 * t**2]
    return jnp.stack(value, axis=-1), jnp.stack(rate, axis=-1)


def slices(bank: Any, row: Any, first: Any, across: int) -> list[Any]:
    """Four taps [lengths, 4, across] from `first` on, a slice a wheel: fast for one run."""
    size = (bank.shape[0], across, 4)
    zero = jnp.zeros_like(first[0])
    wheels = [jax.lax.dynamic_slice(bank, (zero, row[i], first[i]), size) for i in range(4)]
    return [jnp.stack([wheel[..., k] for wheel in wheels], axis=1) for k in range(4)]


def gathers(bank: Any, row: Any, first: Any, across: int) -> list[Any]:
    """The same taps as a gather each, which fuses with the sum over them: fast for lanes."""
    rows = row[:, None] + jnp.arange(across, dtype=row.dtype)[None, :]
    return [bank.at[:, rows, first[:, None] + k].get(mode="clip") for k in range(4)]
