"""The road of a full vehicle, as the options of a command name it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from wheelhop.cli.session import console
from wheelhop.errors import InputError, require_in_range
from wheelhop.io.opencrg import read_opencrg
from wheelhop.io.roads import read_road
from wheelhop.io.tables import read_table
from wheelhop.vehicle.full_vehicle import FullVehicle
from wheelhop.vehicle.road.build import (
    build_surface,
    flat_tracks,
    lines_of,
    measured_tracks,
    random_tracks,
)
from wheelhop.vehicle.road.iso8608 import level_of
from wheelhop.vehicle.road.obstacles import Obstacle
from wheelhop.vehicle.road.profile import Profile
from wheelhop.vehicle.road.surface import RoadSurface
from wheelhop.vehicle.road.tracks import profile_along

CONTACTS = ("point", "moving-average", "tandem-cam")
"""How a tyre may touch the road."""

_AHEAD = 5.0
# drives of about the same length share their compiled code
_STEP = 50.0


@dataclass(frozen=True)
class RoadChoice:
    """What the options say of a road.

    Attributes:
        road: `flat`, `iso:A` to `iso:H`, `iso:24e-6` for a level [m^3/rad], or a file.
        track: elevation column of a table, for both sides.
        reflect: continue a short road there and back again.
        waviness: of a random road [-].
        contact: one of `CONTACTS`.
    """

    road: str = "flat"
    track: str | None = None
    reflect: bool = False
    waviness: float | None = None
    contact: str = "moving-average"

    @property
    def name(self) -> str:
        """The road without its folder."""
        return Path(self.road).name


def road_for(
    choice: RoadChoice,
    key: Any,
    vehicle: FullVehicle,
    distance: float,
    obstacles: Sequence[Obstacle] = (),
) -> RoadSurface:
    """The road under a vehicle that drives a distance [m], with obstacles laid over it.

    Each wheel keeps its own track along the drive, also where the car moves sideways.

    Args:
        choice: what the options say.
        key: JAX random key of a random road.
        vehicle: parameters.
        distance: [m].
        obstacles: of the maneuver.

    Raises:
        InputError: naming the option that the road does not take, or the file's fault.
    """
    needed = distance + float(vehicle.chassis.front_arm) + _AHEAD
    length = _STEP * math.ceil(needed / _STEP)
    random = choice.road.lower().startswith("iso:")
    measured = not random and choice.road.lower() != "flat"
    crg = choice.road.lower().endswith(".crg")
    _refuse("--waviness", choice.waviness is not None, random, "a random road, as iso:B")
    _refuse("--reflect", choice.reflect, measured, "a measured road")
    _refuse("--track", choice.track is not None, measured and not crg, "a table of x_m, z_m")
    if random:
        waviness = 2.0 if choice.waviness is None else choice.waviness
        require_in_range("--waviness", waviness, 1.0, 4.0, "(no unit)")
        level = level_of(choice.road[4:])
        tracks: Any = random_tracks(key, level, length, lines_of(vehicle), waviness)
    elif measured:
        left, right = _profiles(Path(choice.road), choice.track, lines_of(vehicle))
        end = left.length if right is None else min(left.length, right.length)
        if end < needed and not choice.reflect:
            raise InputError(
                "--duration",
                f"the drive needs {needed:.4g} m of road, and {choice.name} has {end:.4g} m",
                "Give a shorter duration, or --reflect to continue the road there and back.",
            )
        length = length if choice.reflect else min(length, end)
        tracks = measured_tracks(left, right, length, choice.reflect)
    else:
        tracks = flat_tracks(length)
    return build_surface(tracks, obstacles, choice.contact.replace("-", "_"))


def _profiles(
    path: Path, track: str | None, lines: Sequence[float]
) -> tuple[Profile, Profile | None]:
    """Left and right profile of a file; no right one where both sides see the same."""
    if path.suffix.lower() == ".crg":
        grid = read_opencrg(path, unroll=True)
        return profile_along(grid, lines[0]), profile_along(grid, lines[1])
    if track is None:
        columns = read_table(path).columns
        sides = [n for side in ("left", "right") for n in columns if n.startswith(f"z_{side}")]
        if len(sides) == 2:
            return read_road(path, sides[0])[0], read_road(path, sides[1])[0]
    profile, name = read_road(path, track)
    console.print(f"road: column {name} under all four wheels")
    return profile, None


def _refuse(option: str, given: bool, fits: bool, remedy: str) -> None:
    if given and not fits:
        raise InputError(option, "this road does not take it", f"Use it with {remedy}.")
