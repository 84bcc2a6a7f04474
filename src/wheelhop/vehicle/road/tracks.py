"""Measured roads on the grid of the four wheels, and what is laid over them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from wheelhop.errors import InputError
from wheelhop.vehicle.road.obstacles import smoothstep
from wheelhop.vehicle.road.profile import Profile, elevation_at, without_aliases

LEAD_IN = 10.0
"""Length [m] over which a road rises smoothly out of the flat on which a car starts."""


@dataclass(frozen=True)
class RoadGrid:
    """A measured surface on an even grid.

    Attributes:
        spacing: of the points along the road [m].
        lateral_start: y of the first row [m]; y rises to the left.
        lateral_spacing: of the rows [m].
        elevation: z [m], [rows, points].
    """

    spacing: float
    lateral_start: float
    lateral_spacing: float
    elevation: np.ndarray

    @property
    def lateral(self) -> np.ndarray:
        """y [m] of every row."""
        return self.lateral_start + self.lateral_spacing * np.arange(len(self.elevation))


def profile_along(grid: RoadGrid, lateral: float) -> Profile:
    """The track at a lateral position y [m], linear between the rows.

    Raises:
        InputError: if the position lies beside the grid.
    """
    place = (lateral - grid.lateral_start) / grid.lateral_spacing
    last = len(grid.elevation) - 1
    if not -1e-9 <= place <= last + 1e-9:
        low, high = grid.lateral[0], grid.lateral[-1]
        raise InputError(
            "lateral position",
            f"{lateral:g} m is beside the road, which reaches from {low:g} to {high:g} m",
            "Drive on the road, or take a narrower car.",
        )
    row = min(max(int(place), 0), last - 1)
    part = place - row
    z = (1.0 - part) * grid.elevation[row] + part * grid.elevation[row + 1]
    return Profile(grid.spacing, z)


def grid_points(start: float, length: float, spacing: float) -> Float[np.ndarray, " points"]:
    """x [m] of the points of a road from `start` (may be negative) to `length` [m]."""
    if not (spacing > 0 and length > start):
        raise InputError(
            "length",
            f"{length:g} m from {start:g} m every {spacing:g} m is no road",
            "Let it end after its start, with a positive spacing.",
        )
    return start + spacing * np.arange(round((length - start) / spacing) + 1)


def tracks_from_profiles(
    left: Profile,
    right: Profile | None,
    spacing: float,
    length: float | None = None,
    start: float = -10.0,
    lead_in: float = LEAD_IN,
    reflect: bool = False,
) -> Float[np.ndarray, "4 points"]:
    """Measured profiles under the wheels FL, FR, RL, RR: their x = 0 is where the road begins.

    The tracks share one datum, their mean elevation at x = 0; the cross fall between them
    stays. Points that lie closer in the profile than in the result are low-passed first.

    Args:
        left: the left track, or the only one.
        right: the right track, or None where both sides see the same.
        spacing: of the result [m].
        length: last x [m]; default the end of the shorter profile.
        start: first x [m]; the road is flat up to x = 0.
        lead_in: length [m] over which the road rises out of the flat.
        reflect: continue a profile that is too short there and back again.

    Raises:
        InputError: for a length beyond the profiles without `reflect`, or an empty road.
    """
    both = [left] if right is None else [left, right]
    end = min(p.length for p in both) if length is None else length
    end = start + spacing * np.floor((end - start) / spacing * (1 + 1e-12))
    x = grid_points(start, float(end), spacing)
    fine = [without_aliases(p, spacing) for p in both]
    z = np.stack([elevation_at(p, np.maximum(x, 0.0), reflect) for p in fine])
    z = z - np.mean([p.elevation[0] for p in fine])
    z = np.asarray(with_lead_in(jnp.asarray(z), jnp.asarray(x), lead_in))
    return z[[0, -1, 0, -1]]


def with_lead_in(
    tracks: Float[Array, "tracks points"], x: Float[Array, " points"], lead_in: float = LEAD_IN
) -> Float[Array, "tracks points"]:
    """The tracks [m] at x [m], zero up to x = 0 and blended in smoothly over a length [m]."""
    weight: Any = smoothstep(x / lead_in) if lead_in > 0 else jnp.where(x > 0, 1.0, 0.0)
    return tracks * weight.astype(tracks.dtype)[None]
