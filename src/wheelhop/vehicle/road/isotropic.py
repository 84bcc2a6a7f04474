"""A random road under several wheels: parallel lines on one isotropic Gaussian surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.special import gamma, kv

from wheelhop.errors import InputError
from wheelhop.vehicle.road.iso8608 import displacement_psd_cycles
from wheelhop.vehicle.road.synthesis import (
    HIGHEST_FREQUENCY,
    LOWEST_FREQUENCY,
    points_and_step,
)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class IsotropicRoad:
    """Spectral factor of parallel lines at level 1 m^3/rad, from which roads are drawn.

    Attributes:
        factor: square root of the cross-spectral matrix times the frequency step, with the
            scale of the inverse transform [m], [frequencies, tracks, tracks].
        points: number of points of a track.
    """

    factor: Any
    points: int = field(metadata={"static": True})


def two_track_coherence(
    frequency: Float[np.ndarray, "*n"], distance: float, waviness: float = 2.0
) -> np.ndarray:
    """Cross spectrum of two parallel lines on an isotropic surface per spectrum of one [-].

    gamma(n) = 2 / Gamma(w/2) (pi n D)^(w/2) K_{w/2}(2 pi n D) for Gd(n) ~ n^-w: the surface's
    spectrum ~ |k|^-(w + 1) integrated over the lateral wavenumber (Basset's integral). For
    w = 2 it is (2 pi n D) K_1(2 pi n D). Kamash & Robson 1978; Bogsjo 2007. What is commonly
    plotted as magnitude-squared coherence is its square.

    Args:
        frequency: n [cycles/m].
        distance: D between the lines [m].
        waviness: w [-].

    Raises:
        InputError: if the waviness is not between 1 and 4.
    """
    if not 1.0 <= waviness <= 4.0:
        raise InputError("waviness", f"{waviness:g} is not that of a road", "Use 1 to 4.")
    order = 0.5 * waviness
    argument = 2.0 * np.pi * np.abs(np.asarray(frequency, float) * distance)
    safe = np.clip(argument, 1e-12, 600.0)
    value = 2.0 / gamma(order) * (0.5 * safe) ** order * kv(order, safe)
    return np.where(argument < 1e-12, 1.0, value)


def wheel_lines(front_track: float, rear_track: float) -> tuple[float, float, float, float]:
    """Lateral positions y [m] of the wheels FL, FR, RL, RR of a car of given track widths [m]."""
    return 0.5 * front_track, -0.5 * front_track, 0.5 * rear_track, -0.5 * rear_track


def prepare_isotropic(
    length: float,
    spacing: float,
    waviness: float,
    lateral_positions: Sequence[float],
    band: tuple[float, float] = (LOWEST_FREQUENCY, HIGHEST_FREQUENCY),
) -> IsotropicRoad:
    """Factor the cross-spectral matrix of parallel lines once, to draw many roads from it.

    Lines millimetres apart make it nearly singular, so that the symmetric square root is
    taken, which is unique.

    Args:
        length: of the road [m].
        spacing: of the points [m].
        waviness: w [-], a number.
        lateral_positions: y of the lines [m].
        band: lowest and highest spatial frequency [cycles/m].

    Raises:
        InputError: if length, spacing and band do not hold a single frequency, or for a
            waviness that is no road's.
    """
    points, step = points_and_step(length, spacing, band)
    low, high = band
    n = step * np.arange(points // 2 + 1)
    inside = (n >= low) & (n <= high) & (n < 0.5 / spacing)
    y = np.asarray(lateral_positions, float)
    apart = np.abs(y[:, None] - y[None, :])
    wave = n[inside]
    matrix = np.empty((len(wave), len(y), len(y)))
    for distance in np.unique(apart):
        law = two_track_coherence(wave, float(distance), waviness)
        matrix[:, apart == distance] = law[:, None]
    values, vectors = np.linalg.eigh(matrix)
    root = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :] @ vectors.swapaxes(1, 2)
    # E|Z|^2 of the inverse real transform that gives this one-sided PSD
    scale = points * np.sqrt(displacement_psd_cycles(wave, 1.0, waviness) * step / 4.0)
    factor = np.zeros((len(n), len(y), len(y)))
    factor[inside] = scale[:, None, None] * root
    return IsotropicRoad(jnp.asarray(factor), points)


def draw_tracks(key: Array, road: IsotropicRoad, level: Any) -> Float[Array, "tracks points"]:
    """One road: elevation [m] of all lines, periodic over the length; pure in key and level.

    Args:
        key: JAX random key.
        road: from `prepare_isotropic`.
        level: Gd(W0) [m^3/rad].
    """
    factor = road.factor
    real, imaginary = jax.random.normal(key, (2, factor.shape[0], factor.shape[1]), factor.dtype)
    root = jnp.sqrt(jnp.asarray(level, factor.dtype))

    def mix(normal: Any) -> Any:
        return root * jnp.sum(factor * normal[:, None, :], axis=-1).T

    return jnp.fft.irfft(jax.lax.complex(mix(real), mix(imaginary)), n=road.points, axis=-1)


def isotropic_tracks(
    key: Array,
    length: float,
    spacing: float,
    level: Any,
    waviness: float,
    lateral_positions: Sequence[float],
    band: tuple[float, float] = (LOWEST_FREQUENCY, HIGHEST_FREQUENCY),
) -> Float[Array, "tracks points"]:
    """An isotropic Gaussian road of the spectrum Gd(n), read along parallel lines.

    Every line has Gd(n) = 2 pi Gd(W0) (2 pi n)^-w inside the band, every pair the cross
    spectrum Gd(n) gamma(n) of `two_track_coherence`. A pure function of the key and the level.

    Args:
        key: JAX random key.
        length: of the road [m].
        spacing: of the points [m].
        level: Gd(W0) [m^3/rad].
        waviness: w [-], a number.
        lateral_positions: y of the lines [m], e.g. `wheel_lines`.
        band: lowest and highest spatial frequency [cycles/m].

    Returns:
        Elevation [m] at 0, spacing, 2 spacing, ... of every line.

    Raises:
        InputError: as `prepare_isotropic`.
    """
    road = prepare_isotropic(length, spacing, waviness, lateral_positions, band)
    return draw_tracks(key, road, level)
