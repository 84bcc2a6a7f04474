"""International Roughness Index: the golden car at 80 km/h, by exact state transition."""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm

from wheelhop.errors import InputError
from wheelhop.vehicle.road.profile import Profile

SPEED = 80.0 / 3.6
_K_TIRE, _K_SUSPENSION, _DAMPING, _MASS_RATIO = 653.0, 63.3, 6.0, 0.15
_BASE_LENGTH = 0.25
_LEAD_IN = 11.0
_WIDEST_SPACING = 0.3


def golden_car() -> tuple[np.ndarray, np.ndarray]:
    """A [4, 4] and b [4] of x' = A x + b s for x = (z_s', z_s'', z_u', z_u'') per speed.

    s is the road's slope. Sayers 1995, On the calculation of international roughness index.
    """
    a = np.array(
        [
            [0.0, 1.0, 0.0, 0.0],
            [-_K_SUSPENSION, -_DAMPING, _K_SUSPENSION, _DAMPING],
            [0.0, 0.0, 0.0, 1.0],
            [
                _K_SUSPENSION / _MASS_RATIO,
                _DAMPING / _MASS_RATIO,
                -(_K_TIRE + _K_SUSPENSION) / _MASS_RATIO,
                -_DAMPING / _MASS_RATIO,
            ],
        ]
    )
    return a, np.array([0.0, 0.0, 0.0, _K_TIRE / _MASS_RATIO])


def rectified_slope(profile: Profile, moving_average: bool = True) -> np.ndarray:
    """|z_s' - z_u'| / v [m/m] of the golden car at the end of every interval [points - 1].

    Args:
        profile: the road.
        moving_average: smooth over the 250 mm base length first, as ISO and ASTM E1926 do
            for profiles sampled more finely than that.

    Raises:
        InputError: if the road is shorter than the golden car's 11 m lead-in, or its points
            lie more than 0.3 m apart.
    """
    if profile.length < _LEAD_IN:
        raise InputError(
            "road",
            f"it is {profile.length:g} m long",
            f"The roughness index needs at least {_LEAD_IN:g} m of road.",
        )
    if profile.spacing > _WIDEST_SPACING:
        raise InputError(
            "road",
            f"its points are {profile.spacing:g} m apart",
            f"The roughness index needs them every {_WIDEST_SPACING:g} m or closer.",
        )
    z = profile.elevation
    width = round(_BASE_LENGTH / profile.spacing)
    if moving_average and width > 1:
        padded = np.pad(z, (width // 2, (width - 1) // 2), mode="edge")
        z = np.convolve(padded, np.full(width, 1.0 / width), mode="valid")
    slope = np.diff(z) / profile.spacing

    a, b = golden_car()
    augmented = np.zeros((5, 5))
    augmented[:4, :4], augmented[:4, 4] = a, b
    step = expm(augmented * profile.spacing / SPEED)
    transition, drive = step[:4, :4], step[:4, 4]

    lead = slope[: max(1, round(_LEAD_IN / profile.spacing))].mean()
    x = np.array([lead, 0.0, lead, 0.0])
    result = np.empty(len(slope))
    for k, s in enumerate(slope):
        x = transition @ x + drive * s
        result[k] = abs(x[0] - x[2])
    return result


def iri(profile: Profile, moving_average: bool = True) -> float:
    """International Roughness Index of the whole profile [m/km]."""
    return 1e3 * float(np.mean(rectified_slope(profile, moving_average)))


def iri_segments(profile: Profile, length: float = 20.0, moving_average: bool = True) -> np.ndarray:
    """Roughness index [m/km] of consecutive segments of a length [m], one continuous drive."""
    slope = rectified_slope(profile, moving_average)
    per = round(length / profile.spacing)
    count = len(slope) // per
    return 1e3 * slope[: count * per].reshape(count, per).mean(axis=1)
