"""From a road of any kind to the surface under a car: lead-in, obstacles, contact patch."""

from __future__ import annotations

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from wheelhop.vehicle.full_vehicle import FullVehicle
from wheelhop.vehicle.road.envelope import Envelope
from wheelhop.vehicle.road.isotropic import isotropic_tracks, wheel_lines
from wheelhop.vehicle.road.obstacles import Obstacle, obstacle_tracks
from wheelhop.vehicle.road.profile import Profile
from wheelhop.vehicle.road.surface import RoadSurface, surface_from_tracks
from wheelhop.vehicle.road.tracks import grid_points, tracks_from_profiles, with_lead_in

SPACING = 0.025
"""Distance [m] between the points of a road under a full vehicle."""

START = -10.0
"""x [m] of its first point; the car's centre of mass starts at 0."""


def lines_of(vehicle: FullVehicle) -> tuple[float, float, float, float]:
    """Lateral positions y [m] of the wheels FL, FR, RL, RR of a vehicle."""
    c = vehicle.chassis
    return wheel_lines(float(c.front_track), float(c.rear_track))


def flat_tracks(length: float) -> Float[np.ndarray, "4 points"]:
    """A level road from `START` to a length [m]."""
    return np.zeros((4, len(grid_points(START, length, SPACING))))


def random_tracks(
    key: Array, level: float, length: float, lines: Sequence[float], waviness: float = 2.0
) -> Float[Array, "4 points"]:
    """An isotropic random road that rises out of the flat at x = 0.

    Args:
        key: JAX random key.
        level: Gd(W0) [m^3/rad].
        length: last x [m].
        lines: lateral positions of the wheels [m].
        waviness: w [-].

    Raises:
        InputError: as `isotropic_tracks`.
    """
    x = grid_points(START, length, SPACING)
    z = isotropic_tracks(key, len(x) * SPACING, SPACING, level, waviness, lines)
    return with_lead_in(z[:, : len(x)], jnp.asarray(x, z.dtype))


def measured_tracks(
    left: Profile, right: Profile | None, length: float, reflect: bool = False
) -> Float[np.ndarray, "4 points"]:
    """Measured profiles that rise out of the flat at x = 0.

    Args:
        left: the left track, or the only one.
        right: the right track, or None.
        length: last x [m].
        reflect: continue a profile that is too short there and back again.

    Raises:
        InputError: for a length beyond the profiles without `reflect`.
    """
    return tracks_from_profiles(left, right, SPACING, length, START, reflect=reflect)


def build_surface(
    tracks: Float[Array | np.ndarray, "4 points"],
    obstacles: Sequence[Obstacle] = (),
    contact: str = "moving_average",
) -> RoadSurface:
    """The surface of four tracks from `START` on, with obstacles laid over them.

    Args:
        tracks: elevation under FL, FR, RL, RR [m], every `SPACING`.
        obstacles: to add.
        contact: "point", "moving_average" or "tandem_cam".

    Raises:
        InputError: for another kind of contact.
    """
    z = jnp.asarray(tracks, jnp.asarray(0.0).dtype)
    x = jnp.asarray(START + SPACING * np.arange(z.shape[1]), z.dtype)
    z = z + obstacle_tracks(obstacles, x).astype(z.dtype)
    return surface_from_tracks(z, SPACING, START, Envelope(contact))
