"""Levels of road spectra with their uncertainty, and roughness indices of many roads."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.linalg import expm
from scipy.stats import chi2

from wheelhop.vehicle.road.roughness_index import SPEED, golden_car
from wheelhop.vehicle.road.synthesis import HIGHEST_FREQUENCY

HANN_LOSS = 19.0 / 18.0

THIRD_OCTAVE = 2.0 ** (1.0 / 6.0)

CONFIDENCE = 0.95

BASE_LENGTH = 0.25


class FlatTable(NamedTuple):
    """Columns of equal length, and the unit of each that has one; as `write_table` takes them."""

    columns: dict[str, np.ndarray]
    units: dict[str, str]


class Interval(NamedTuple):
    """A value and its 95 % confidence interval."""

    value: float
    low: float
    high: float


def line_iri(level: float) -> float:
    """Expected roughness index [m/km] of a Gaussian road with the line of waviness 2.

    The golden car's rectified velocity is the modulus of a Gaussian, of mean sqrt(2 / pi) times
    its standard deviation, which is an integral over the spectrum of the slope, here white.

    Args:
        level: Gd(W0) [m^3/rad].
    """
    return float(math.sqrt(level) * _unit_iri())


@lru_cache(maxsize=1)
def _unit_iri() -> float:
    a, b = golden_car()
    wave = 2 * math.pi * np.geomspace(1e-3, HIGHEST_FREQUENCY, 4000)
    system = 1j * SPEED * wave[:, None, None] * np.eye(4) - a
    response = np.linalg.solve(system, np.broadcast_to(b[:, None], (len(wave), 4, 1)))[..., 0]
    gain = np.abs(response[:, 0] - response[:, 2]) ** 2
    gain *= np.sinc(BASE_LENGTH * wave / (2 * math.pi)) ** 2
    return 1e3 * math.sqrt(2.0 / math.pi * np.trapezoid(gain, wave))


def level_ratio(
    wave: np.ndarray, ratio: np.ndarray, band: tuple[float, float], extent: float
) -> Interval:
    """Mean ratio of a Welch estimate to its law over a band, from roads of a total extent [m]."""
    inside = (wave >= band[0]) & (wave <= band[1])
    value = float(np.mean(ratio[inside]))
    dof = degrees_of_freedom((wave[1] - wave[0]) * np.count_nonzero(inside), extent)
    tail = 0.5 * (1.0 - CONFIDENCE)
    low, high = chi2.ppf([1.0 - tail, tail], dof)
    return Interval(value, float(value * dof / low), float(value * dof / high))


def degrees_of_freedom(width: Any, extent: float) -> Any:
    """Chi-square degrees of freedom of the mean of a Welch spectrum over a band.

    Two per independent wave, width times extent / (2 pi), less the 1 / 18 that Hann windows of
    half overlap lose by weighing the road unevenly: Welch 1967, for a band wider than the
    window's.

    Args:
        width: of the band [rad/m].
        extent: length of road in all [m].
    """
    return 2.0 * width * extent / (2.0 * math.pi) / HANN_LOSS


def roughness_indices(z: Float[np.ndarray, "roads points"], spacing: float) -> np.ndarray:
    """`iri` [m/km] of many roads of one spacing, all at once."""
    width = round(BASE_LENGTH / spacing)
    if width > 1:
        padded = np.pad(z, ((0, 0), (width // 2, (width - 1) // 2)), mode="edge")
        total = np.cumsum(np.pad(padded, ((0, 0), (1, 0))), axis=1)
        z = (total[:, width:] - total[:, :-width]) / width
    slope = np.ascontiguousarray(np.diff(z, axis=1).T) / spacing
    a, b = golden_car()
    augmented = np.zeros((5, 5))
    augmented[:4, :4], augmented[:4, 4] = a, b
    step = expm(augmented * spacing / SPEED)
    transition, drive = step[:4, :4], step[:4, 4:]
    lead = slope[: max(1, round(11.0 / spacing))].mean(axis=0)
    x = np.stack([lead, np.zeros_like(lead), lead, np.zeros_like(lead)])
    total = np.zeros_like(lead)
    for s in slope:
        x = transition @ x + drive * s
        total += np.abs(x[0] - x[2])
    return 1e3 * total / len(slope)


def decibels(ratio: Any) -> Any:
    """A ratio of powers [-] as decibels."""
    return 10.0 * np.log10(ratio)
