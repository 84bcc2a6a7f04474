"""The simulated vehicles: the paper prints no parameters, so they are variants of our SUV.

The paper's vehicle has linear springs and dampers and no anti-roll bars, and its text tells of no
stops: here they are out of reach.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.errors import require_in_range
from wheelhop.staging import staged_jit
from wheelhop.vehicle.corner_suspension import corner_suspensions
from wheelhop.vehicle.equilibrium import Rest, require_rest, static_equilibrium
from wheelhop.vehicle.full_vehicle import FullVehicle, Surroundings
from wheelhop.vehicle.full_vehicle_parameters import as_arrays, suv
from wheelhop.vehicle.strut import AntiRollBars, Damper

_NO_STOP = 0.5


def paper_vehicle(stiffness: float = 1.0, damping: float = 1.0) -> FullVehicle:
    """The SUV without anti-roll bars, with linear dampers as stiff as its own are at rest.

    Args:
        stiffness, damping: as those of `scaled`.

    Raises:
        InputError: for a factor out of range.
    """
    car = suv(anti_roll=False)
    slope = corner_suspensions(car).damping
    none, far = jnp.zeros_like(slope), jnp.full_like(slope, _NO_STOP)
    damper = Damper(slope, none, jnp.full_like(slope, 0.1), none, none)
    strut = replace(car.strut, damper=damper, bump_clearance=far, rebound_clearance=far)
    return scaled(as_arrays(replace(car, strut=strut)), stiffness, damping)


def scaled(vehicle: FullVehicle, stiffness: float = 1.0, damping: float = 1.0) -> FullVehicle:
    """The same vehicle on other springs and dampers.

    Scaled springs carry the same mass at the same height: only their free length differs, which a
    sensor that counts from the free spring shows, see `free_deflection`.

    Args:
        vehicle: to change.
        stiffness: of the springs, per its own [-].
        damping: of the dampers, per its own [-].

    Raises:
        InputError: for a factor out of range.
    """
    require_in_range("stiffness", stiffness, 0.1, 10.0, "(factor)")
    require_in_range("damping", damping, 0.0, 10.0, "(factor)")
    strut = vehicle.strut
    damper = replace(strut.damper, damping=damping * strut.damper.damping)
    stiff = replace(strut, stiffness=stiffness * strut.stiffness, damper=damper)
    return replace(vehicle, strut=stiff)


def digressive_vehicle() -> FullVehicle:
    """The paper's vehicle with the SUV's own dampers: they fade, and resist extension more."""
    car = paper_vehicle()
    return as_arrays(replace(car, strut=replace(car.strut, damper=suv().strut.damper)))


def barred_vehicle(front: float = 1.0, rear: float = 1.0) -> FullVehicle:
    """The paper's vehicle with the SUV's anti-roll bars.

    Args:
        front, rear: stiffness of the axles' bars per the SUV's [-].

    Raises:
        InputError: for a factor out of range.
    """
    for name, factor in (("front", front), ("rear", rear)):
        require_in_range(name, factor, 0.0, 100.0, "(factor)")
    bars = suv().anti_roll
    return as_arrays(
        replace(paper_vehicle(), anti_roll=AntiRollBars(front * bars.front, rear * bars.rear))
    )


def free_deflection(compression: Any, vehicle: FullVehicle) -> Any:
    """Deflections counted from the free spring [m], q = s + S_0 / k: k q carries the body's mass.

    What Filipozzi et al. 2021, Eq. 35 takes the sensor to show.

    Args:
        compression: s, from the design place [m], [..., 4], in NumPy.
        vehicle: that was driven.
    """
    return compression + np.asarray(vehicle.strut.preload / vehicle.strut.stiffness)


def level_ground() -> Surroundings:
    """Surroundings as arrays."""
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.asarray(0.0).dtype), Surroundings())


def standing(vehicle: FullVehicle, around: Surroundings | None = None) -> Rest:
    """The vehicle at rest on its nominal pressures, on level ground unless told otherwise.

    Args:
        vehicle: parameters, as arrays.
        around: gravity's direction, as arrays.

    Raises:
        DivergenceError: if it finds no equilibrium.
    """
    around = level_ground() if around is None else around
    return require_rest(_compiled_rest()(vehicle, vehicle.nominal_pressure, around))


@lru_cache(maxsize=1)
def _compiled_rest() -> Any:
    return staged_jit(static_equilibrium)
