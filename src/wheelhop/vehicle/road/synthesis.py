"""Spectral synthesis of a road of any level and waviness."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from wheelhop.errors import InputError
from wheelhop.vehicle.road.iso8608 import displacement_psd_cycles

LOWEST_FREQUENCY = 0.01
HIGHEST_FREQUENCY = 10.0
"""Band [cycles/m] of a synthesised road; Brancati & Tufano 2022, section 2.1."""


def points_and_step(length: float, spacing: float, band: tuple[float, float]) -> tuple[int, float]:
    """Number of points of a synthesised road and the step of its spectrum [cycles/m].

    Args:
        length: of the road [m].
        spacing: of the points [m].
        band: lowest and highest spatial frequency [cycles/m].

    Raises:
        InputError: if they do not hold a single frequency.
    """
    points = round(length / spacing)
    low, high = band
    step = 1.0 / (points * spacing) if points > 0 else float("inf")
    if points < 4 or step > min(high, 0.5 / spacing):
        raise InputError(
            "length",
            f"{length:g} m at a spacing of {spacing:g} m holds no wave between {low:g} and "
            f"{high:g} cycles/m",
            "Give a longer road or a finer spacing.",
        )
    return points, step


def synthesise(
    key: Array,
    length: float,
    spacing: float,
    level: Any,
    waviness: Any = 2.0,
    band: tuple[float, float] = (LOWEST_FREQUENCY, HIGHEST_FREQUENCY),
) -> Float[Array, " points"]:
    """A Gaussian road with the spectrum Gd(n) = 2 pi Gd(W0) (2 pi n)^-w inside a band.

    Amplitudes are complex Gaussian, so that every realisation is a sample of a Gaussian
    process and its periodogram scatters as that of a measured road does; it is periodic
    over `length`.

    Args:
        key: JAX random key.
        length: of the road [m].
        spacing: of the points [m].
        level: Gd(W0) [m^3/rad].
        waviness: w [-].
        band: lowest and highest spatial frequency [cycles/m].

    Returns:
        Elevation [m] at 0, spacing, 2 spacing, ...

    Raises:
        InputError: if length, spacing and band do not hold a single frequency.
    """
    points, step = points_and_step(length, spacing, band)
    low, high = band
    frequency = step * jnp.arange(points // 2 + 1, dtype=float)
    inside = (frequency >= low) & (frequency <= high) & (frequency < 0.5 / spacing)
    density = displacement_psd_cycles(jnp.where(inside, frequency, 1.0), level, waviness)
    # E|Z|^2 of the inverse real transform that gives one-sided PSD `density`
    scale = jnp.where(inside, jnp.sqrt(density * step / 4.0), 0.0)
    real, imaginary = jax.random.normal(key, (2, frequency.shape[0]), scale.dtype)
    return jnp.fft.irfft(points * jax.lax.complex(scale * real, scale * imaginary), n=points)
