"""ISO 8608 road classes: displacement spectra and the white road velocity they imply."""

from __future__ import annotations

import math
from typing import Any

from wheelhop.errors import InputError, require_in_range

REFERENCE_WAVENUMBER = 1.0
"""W0 [rad/m] at which a level is quoted."""

CLASSES = "ABCDEFGH"

_CENTER_A = 1e-6


def class_level(road_class: str) -> float:
    """Class centre Gd(W0) [m^3/rad] = 4^a 1e-6, a = 0 (A) .. 7 (H).

    ISO 8608; Brancati & Tufano 2022, Eq. 7.

    Raises:
        InputError: if the class is not one of A to H.
    """
    name = str(road_class).strip().upper()
    if len(name) != 1 or name not in CLASSES:
        raise InputError(
            "road class", f"{road_class!r} is not an ISO 8608 class", "Use one of A to H."
        )
    return _CENTER_A * 4.0 ** CLASSES.index(name)


def level_of(name: str) -> float:
    """Level Gd(W0) [m^3/rad] of a class letter, or given as a number in these units.

    Raises:
        InputError: if it is neither a class A to H nor a level of a road.
    """
    try:
        level = float(name)
    except ValueError:
        return class_level(name)
    require_in_range("road level", level, 1e-8, 0.1, "m^3/rad")
    return level


def class_of_level(level: float) -> str:
    """Class whose range holds a level Gd(W0) [m^3/rad] at waviness 2; A and H are open-ended.

    The bounds lie a factor 2 below and above each class centre.
    """
    index = math.floor(0.5 * math.log2(level / _CENTER_A) + 0.5)
    return CLASSES[min(max(index, 0), len(CLASSES) - 1)]


def displacement_psd(wavenumber: Any, level: Any, waviness: Any = 2.0) -> Any:
    """One-sided PSD of elevation Gd(W) = Gd(W0) (W / W0)^-w [m^3/rad] at W [rad/m]."""
    return level * (wavenumber / REFERENCE_WAVENUMBER) ** (-waviness)


def displacement_psd_cycles(spatial_frequency: Any, level: Any, waviness: Any = 2.0) -> Any:
    """The same PSD per cycle, Gd(n) = 2 pi Gd(W = 2 pi n) [m^3], at n [cycles/m]."""
    return 2.0 * math.pi * displacement_psd(2.0 * math.pi * spatial_frequency, level, waviness)


def road_velocity_intensity(level: Any, speed: Any) -> Any:
    """Intensity q [m^2/s] of the white road velocity at waviness 2.

    E[z_r'(t) z_r'(t + tau)] = q delta(tau), q = pi Gd(W0) W0^2 v.

    Args:
        level: Gd(W0) [m^3/rad].
        speed: v [m/s].
    """
    return math.pi * level * REFERENCE_WAVENUMBER**2 * speed
