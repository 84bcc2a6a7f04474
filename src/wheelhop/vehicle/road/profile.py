"""A measured road profile: uniform samples, resampling without aliasing, continuation."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline
from scipy.signal import firwin, oaconvolve

from wheelhop.errors import InputError, InputWarning

_UNIFORM_TOLERANCE = 1e-3
_MINIMUM_POINTS = 8
_LONGEST_HOLE = 5.0
_STEEPEST = 2.0


@dataclass(frozen=True)
class Profile:
    """Elevation of one track at uniform spacing.

    Attributes:
        spacing: distance between points [m].
        elevation: z [m], [points].
    """

    spacing: float
    elevation: np.ndarray

    @property
    def distance(self) -> np.ndarray:
        """x [m] of every point, from 0."""
        return self.spacing * np.arange(len(self.elevation))

    @property
    def length(self) -> float:
        """Distance [m] between the first and the last point."""
        return self.spacing * (len(self.elevation) - 1)


def profile_from_samples(
    distance: Float[np.ndarray, " points"], elevation: Float[np.ndarray, " points"]
) -> Profile:
    """Profile from measured pairs; irregular spacing is interpolated to its median.

    Args:
        distance: x [m], strictly increasing.
        elevation: z [m].

    Raises:
        InputError: for too few points, a value that is not finite, or a distance that does
            not increase.
    """
    x, z = np.asarray(distance, float), np.asarray(elevation, float)
    if len(x) < _MINIMUM_POINTS:
        raise InputError(
            "x_m", f"the road has {len(x)} points", f"Give at least {_MINIMUM_POINTS} points."
        )
    for name, values in (("x_m", x), ("z_m", z)):
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            raise InputError(
                name,
                f"row {bad[0] + 1} of the data is not a number ({bad.size} such rows)",
                "Remove these rows or fill them by interpolation.",
            )
    gaps = np.diff(x)
    if np.any(gaps <= 0):
        row = int(np.flatnonzero(gaps <= 0)[0])
        raise InputError(
            "x_m",
            f"distance goes from {x[row]:g} to {x[row + 1]:g} m at row {row + 2} of the data",
            "Sort the rows by distance and remove repeated ones.",
        )
    spacing = float(np.median(gaps))
    widest = int(np.argmax(gaps))
    if gaps[widest] > _LONGEST_HOLE * spacing:
        raise InputError(
            "x_m",
            f"there is a hole of {gaps[widest]:g} m at row {widest + 2} of the data, with points "
            f"every {spacing:g} m elsewhere",
            "Cut the road there, or fill it with measured points.",
        )
    slope = float(np.median(np.abs(np.diff(z) / gaps)))
    if slope > _STEEPEST:
        raise InputError(
            "z_m",
            f"the road is as steep as {slope:.3g} m/m half of the time",
            "Check the unit of the elevation: write z_mm or 'z [mm]' if it is in millimetres.",
        )
    if np.max(np.abs(gaps - spacing)) <= _UNIFORM_TOLERANCE * spacing:
        return Profile((x[-1] - x[0]) / (len(x) - 1), z)
    warnings.warn(
        f"x_m: spacing varies from {gaps.min():g} to {gaps.max():g} m; the profile was "
        f"interpolated to its median, {spacing:g} m.",
        InputWarning,
        stacklevel=2,
    )
    count = int((x[-1] - x[0]) / spacing) + 1
    return Profile(spacing, CubicSpline(x, z)(x[0] + spacing * np.arange(count)))


def resample(profile: Profile, spacing: float) -> Profile:
    """The same road at another spacing [m], low-passed first where that is coarser.

    The anti-aliasing filter is a zero-phase FIR (Kaiser window, 80 dB) whose stop band begins
    at the new Nyquist frequency; the ends are continued by odd reflection.

    Raises:
        InputError: if the spacing is not positive or leaves fewer than two points.
    """
    if not 0 < spacing <= profile.length:
        raise InputError(
            "spacing",
            f"{spacing:g} m for a road of {profile.length:g} m",
            "Give a positive spacing below the road's length.",
        )
    smooth = without_aliases(profile, spacing).elevation
    count = int(np.floor(profile.length / spacing * (1 + 1e-12))) + 1
    return Profile(spacing, CubicSpline(profile.distance, smooth)(spacing * np.arange(count)))


def without_aliases(profile: Profile, spacing: float) -> Profile:
    """The road without the waves that would alias when sampled every `spacing` metres."""
    if spacing <= profile.spacing * (1 + 1e-9):
        return profile
    return Profile(
        profile.spacing, _low_pass(profile.elevation, profile.spacing, nyquist=0.5 / spacing)
    )


def elevation_at(profile: Profile, distance: np.ndarray, reflect: bool = False) -> np.ndarray:
    """Elevation [m] at any distances [m] by cubic spline.

    Args:
        profile: the road.
        distance: x [m] from its start.
        reflect: continue a road that is too short there and back again.

    Raises:
        InputError: if a distance lies beyond the road and `reflect` is off.
    """
    x = np.asarray(distance, float)
    if reflect:
        phase = np.mod(x, 2 * profile.length)
        x = np.minimum(phase, 2 * profile.length - phase)
    elif x.size and (x.min() < 0 or x.max() > profile.length * (1 + 1e-9)):
        raise InputError(
            "distance",
            f"{x.max():g} m is beyond the road, which is {profile.length:g} m long",
            "Drive a shorter distance or let the road be continued by reflection.",
        )
    return CubicSpline(profile.distance, profile.elevation)(x)


def _low_pass(z: np.ndarray, spacing: float, nyquist: float) -> np.ndarray:
    transition = 0.15 * nyquist
    taps = int(np.ceil(5.0 / (transition * spacing))) | 1
    window = firwin(taps, nyquist - 0.5 * transition, window=("kaiser", 8.0), fs=1 / spacing)
    half = taps // 2
    padded = np.pad(z, half, mode="reflect", reflect_type="odd")
    return oaconvolve(padded, window, mode="valid")
