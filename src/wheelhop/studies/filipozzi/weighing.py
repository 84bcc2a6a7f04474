"""Mass and centre of mass from four deflections at rest, Eq. 31-35, on the full vehicle."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.estimators.algebraic_load import WeightDistribution, distribution_of
from wheelhop.estimators.mass_at_rest import RestEstimate, mass_at_rest
from wheelhop.estimators.resting_stretch import Stands
from wheelhop.studies.filipozzi.settings import FACTORS, GRADIENT, FilipozziSettings
from wheelhop.studies.filipozzi.vehicles import paper_vehicle, standing
from wheelhop.studies.frame import Advance, Store
from wheelhop.vehicle.equilibrium import Rest
from wheelhop.vehicle.full_vehicle import FullVehicle, Surroundings
from wheelhop.vehicle.full_vehicle_parameters import with_payload
from wheelhop.vehicle.full_vehicle_state import gravity_in_plane
from wheelhop.vehicle.vector import body_frame, to_body

PAYLOAD, BEHIND, ABOVE = 250.0, 0.08, 0.03
"""What is loaded [kg], and by how much it moves the body's centre of mass [m]."""

SIGMA = 5e-5
"""Of a mean deflection [m]: a hundred samples of 0.5 mm."""

_SLOPE, _BANK = math.atan(GRADIENT), 0.1

STANDS = {
    "level": ((0.0, 0.0),),
    "20 % slope": ((_SLOPE, 0.0),),
    "20 % slope and 0.1 rad bank": ((_SLOPE, _BANK),),
    "level, then 20 % slope": ((0.0, 0.0), (_SLOPE, 0.0)),
}
"""Grade and bank [rad] of every stand, by name."""

PRINTED, EQUILIBRIUM = "printed", "equilibrium"


class Weighing(NamedTuple):
    """Results.

    Attributes:
        settings: that made them.
        true: weight distribution of the laden vehicle, wheels included.
        body_mass: true sprung mass [kg].
        estimates: by stand and method, from exact deflections, `SIGMA` believed.
        stiffness: sprung mass by the factor of the true springs' stiffness, where deflections count
            from the free spring, level [kg].
    """

    settings: FilipozziSettings
    true: WeightDistribution
    body_mass: float
    estimates: dict[str, dict[str, RestEstimate]]
    stiffness: dict[float, float]


def weighing(settings: FilipozziSettings, store: Store, advance: Advance) -> Weighing:
    """Weigh a laden vehicle on every one of `STANDS`.

    Args:
        settings: not used but told.
        store: not used: it takes seconds.
        advance: told of the stands.
    """
    del store
    known = paper_vehicle()
    laden = loaded(known)
    estimates = {}
    for done, (name, slopes) in enumerate(STANDS.items()):
        advance(done, len(STANDS) + 1)
        stands = stood(laden, slopes)
        estimates[name] = {
            method: mass_at_rest(stands, known, SIGMA, method=method)
            for method in (EQUILIBRIUM, PRINTED)
        }
    advance(len(STANDS), len(STANDS) + 1)
    true = jax.tree.map(float, distribution_of(laden))
    body = float(laden.chassis.body_mass)
    # k q of springs counted from free, believed in with the factor 1, carries m / factor
    stiffness = {f: _free_mass(known, f) for f in FACTORS}
    advance(len(STANDS) + 1, len(STANDS) + 1)
    return Weighing(settings, true, body, estimates, stiffness)


def loaded(vehicle: FullVehicle) -> FullVehicle:
    """The vehicle with `PAYLOAD`, its body's centre of mass moved by `BEHIND` and `ABOVE`."""
    heavy = with_payload(vehicle, PAYLOAD)
    c = heavy.chassis
    moved = replace(
        c,
        front_arm=c.front_arm + BEHIND,
        rear_arm=c.rear_arm - BEHIND,
        hub_drop=c.hub_drop + ABOVE,
    )
    return replace(heavy, chassis=moved)


def stood(vehicle: FullVehicle, slopes: tuple[tuple[float, float], ...]) -> Stands:
    """What perfect sensors show of a vehicle that stands.

    Args:
        vehicle: as arrays.
        slopes: grade and bank of every stand [rad].
    """
    q, a_x, a_y = [], [], []
    for grade, bank in slopes:
        around = jax.tree.map(jnp.asarray, Surroundings(grade=grade, bank=bank))
        rest = standing(vehicle, around)
        felt = _felt(rest, around)
        q.append(np.asarray(rest.compression))
        a_x.append(felt[0])
        a_y.append(felt[1])
    return Stands(np.array(q), np.array(a_x), np.array(a_y))


def _felt(rest: Rest, around: Surroundings) -> tuple[float, float]:
    frame = body_frame(rest.roll, rest.pitch, jnp.zeros_like(rest.roll))
    down: Any = to_body(frame, gravity_in_plane(around))
    return -float(down.x), -float(down.y)


def _free_mass(known: FullVehicle, factor: float) -> float:
    """Sprung mass that k q of free springs weighs where the true springs are stiffer [kg]."""
    plant = paper_vehicle(stiffness=factor)
    q = standing(plant).compression + plant.strut.preload / plant.strut.stiffness
    shown = q - known.strut.preload / known.strut.stiffness
    stands = Stands(np.asarray(shown)[None], np.zeros(1), np.zeros(1))
    return mass_at_rest(stands, known, SIGMA).body_mass
