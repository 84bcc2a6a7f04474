"""Spectrum of a measured road, and the ISO 8608 line fitted to it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.signal import welch

from wheelhop.errors import InputError
from wheelhop.vehicle.road.iso8608 import class_of_level
from wheelhop.vehicle.road.profile import Profile

FIT_BAND = (0.011, 2.83)
"""Spatial frequencies [cycles/m] that ISO 8608 fits."""

_SEGMENT = 100.0
_BANDS_PER_OCTAVE = 3
_MINIMUM_BANDS = 3


@dataclass(frozen=True)
class Spectrum:
    """One-sided displacement PSD.

    Attributes:
        frequency: n [cycles/m].
        density: Gd(n) [m^3].
    """

    frequency: np.ndarray
    density: np.ndarray


@dataclass(frozen=True)
class RoadFit:
    """Straight line through a spectrum in log-log, and the class it means.

    Attributes:
        level: Gd(W0) [m^3/rad] of the line with free waviness.
        waviness: w of that line [-].
        iso_level: Gd(W0) [m^3/rad] of the best line of waviness 2.
        iso_class: class that holds `iso_level`.
        band: spatial frequencies [cycles/m] that were fitted.
        frequency: centres of the third-octave bands [cycles/m].
        density: mean PSD in these bands [m^3].
    """

    level: float
    waviness: float
    iso_level: float
    iso_class: str
    band: tuple[float, float]
    frequency: np.ndarray
    density: np.ndarray


def profile_psd(profile: Profile, segment: float = _SEGMENT) -> Spectrum:
    """Welch estimate of the displacement PSD: Hann window, half overlap, linear detrend.

    Args:
        profile: the road.
        segment: window length [m], cut to the road's length.

    Raises:
        InputError: if the road is perfectly flat.
    """
    if np.ptp(profile.elevation) == 0:
        raise InputError("road", "it is perfectly flat", "Give a measured elevation.")
    points = min(len(profile.elevation), max(8, round(segment / profile.spacing)))
    frequency, density = welch(
        profile.elevation, fs=1.0 / profile.spacing, nperseg=points, detrend="linear"
    )
    return Spectrum(frequency[1:], density[1:])


def fit_iso8608(spectrum: Spectrum, band: tuple[float, float] = FIT_BAND) -> RoadFit:
    """Level and waviness of a spectrum by least squares over third-octave means (ISO 8608).

    The lowest two lines of the spectrum (leakage of the trend) and the highest fifth (the
    measuring system's own low-pass) are left out of the fit.

    Args:
        spectrum: one-sided PSD.
        band: spatial frequencies [cycles/m] to fit.

    Raises:
        InputError: if the road is too short or too coarse to fit a line.
    """
    low = max(band[0], 2.5 * spectrum.frequency[0])
    high = min(band[1], 0.8 * spectrum.frequency[-1])
    inside = (spectrum.frequency >= low) & (spectrum.frequency <= high)
    inside &= spectrum.density > 0
    n, density = spectrum.frequency[inside], spectrum.density[inside]
    index = np.floor(_BANDS_PER_OCTAVE * np.log2(n / low)).astype(int) if n.size else np.array([])
    bands = np.unique(index)
    if len(bands) < _MINIMUM_BANDS:
        raise InputError(
            "road",
            f"its spectrum has {len(bands)} third-octave bands between {low:g} and {high:g} "
            "cycles/m",
            f"Give a longer road or a finer spacing: a fit needs {_MINIMUM_BANDS} bands with "
            "elevation that is not flat.",
        )
    log_n = np.array([np.mean(np.log(n[index == b])) for b in bands])
    log_g = np.array([np.log(np.mean(density[index == b])) for b in bands])

    slope, intercept = np.polyfit(log_n, log_g, 1)
    level = _level_per_radian(math.exp(intercept), -slope)
    iso_level = _level_per_radian(math.exp(float(np.mean(log_g + 2.0 * log_n))), 2.0)
    return RoadFit(
        level=level,
        waviness=float(-slope),
        iso_level=iso_level,
        iso_class=class_of_level(iso_level),
        band=(float(n[0]), float(n[-1])),
        frequency=np.exp(log_n),
        density=np.exp(log_g),
    )


def _level_per_radian(density_at_one_cycle: float, waviness: float) -> float:
    """Gd(W0 = 1 rad/m) of the line Gd(n) = density_at_one_cycle n^-w."""
    return density_at_one_cycle * (2 * math.pi) ** waviness / (2 * math.pi)
