"""Which tyre load compresses which suspension: relative gain arrays, Filipozzi et al. 2021, Eq. 1.

Lambda = (G(0)^-1)^T x G(0), entry by entry; rows are compressions, columns tyre loads.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import brentq

from wheelhop.studies.filipozzi.settings import CORNERING, SPEED, FilipozziSettings
from wheelhop.studies.filipozzi.vehicles import barred_vehicle, level_ground, standing
from wheelhop.studies.frame import Advance, Store
from wheelhop.vehicle.full_vehicle import FullVehicle
from wheelhop.vehicle.linearise import cornering_gain, in_the_turn, relative_gain_array

PAPER_FREE = np.array(
    [
        [0.9560, -0.0527, 0.0474, 0.0493],
        [-0.0527, 0.9604, 0.0452, 0.0471],
        [0.0474, 0.0452, 0.9497, -0.0423],
        [0.0493, 0.0471, -0.0423, 0.9459],
    ]
)
"""Lambda_1: without an anti-roll bar."""

PAPER_REAR = np.array(
    [
        [0.9560, -0.0527, 0.0474, 0.0493],
        [-0.0527, 0.9604, 0.0452, 0.0471],
        [0.0478, 0.0457, 1.2118, -0.3053],
        [0.0488, 0.0466, -0.3043, 1.2089],
    ]
)
"""Lambda_2: with one on the rear axle."""

FREE, REAR, STRONG, BOTH = "no bar", "rear bar", "strong rear bar", "both bars"

_STIFFEST = 40.0


class Coupled(NamedTuple):
    """One vehicle.

    Attributes:
        bars: stiffness of the front and the rear bar [N/m], [2].
        springs: stiffness of a front and a rear spring [N/m], [2].
        roll: in steady cornering [rad], [].
        compression: there [m], [4].
        at_rest: relative gains at rest [-], [4, 4].
        cornering: those about steady cornering [-], [4, 4].
    """

    bars: np.ndarray
    springs: np.ndarray
    roll: np.ndarray
    compression: np.ndarray
    at_rest: np.ndarray
    cornering: np.ndarray


Coupling = dict[str, Coupled]
"""By `FREE`, `REAR`, `STRONG`, `BOTH`."""


def coupling(settings: FilipozziSettings, store: Store, advance: Advance) -> Coupling:
    """Relative gains of the paper's vehicle with and without bars.

    `REAR` and `BOTH` carry the SUV's own bars; `STRONG` has the rear bar that couples the rear
    wheels as much as the paper's does.

    Args:
        settings: of the study; nothing of it matters here.
        store: of what is finished.
        advance: told of the steps.
    """
    del settings
    advance(0, 1)
    flat = store.arrays("coupling", {}, _all)
    advance(1, 1)
    names = (FREE, REAR, STRONG, BOTH)
    return {n: Coupled(*(flat[f"{n}.{field}"] for field in Coupled._fields)) for n in names}


def coupled(vehicle: FullVehicle) -> Coupled:
    """Relative gains of a vehicle at rest and about steady cornering.

    Args:
        vehicle: parameters, as arrays.
    """
    at_rest = _gains(vehicle, 0.0)[2]
    roll, compression, cornering = _gains(vehicle, CORNERING)
    bars = np.array([float(vehicle.anti_roll.front), float(vehicle.anti_roll.rear)])
    springs = np.asarray(vehicle.strut.stiffness, float)[[0, 2]]
    return Coupled(bars, springs, roll, compression, at_rest, cornering)


def rear_coupling(gains: np.ndarray) -> float:
    """Mean of the rear wheels' entries on the diagonal [-].

    Args:
        gains: relative gains, [4, 4].
    """
    return float(0.5 * (gains[2, 2] + gains[3, 3]))


def bar_like_the_papers() -> float:
    """Stiffness per the SUV's of a rear bar that adds to the rear diagonal as the paper's."""
    added = rear_coupling(PAPER_REAR) - rear_coupling(PAPER_FREE)

    def missing(factor: float) -> float:
        gains = _gains(barred_vehicle(0.0, factor), CORNERING)[2]
        return rear_coupling(gains) - free - added

    free = rear_coupling(_gains(barred_vehicle(0.0, 0.0), CORNERING)[2])
    return float(brentq(missing, 0.0, _STIFFEST, xtol=1e-6))


def _all() -> dict[str, np.ndarray]:
    vehicles = {
        FREE: barred_vehicle(0.0, 0.0),
        REAR: barred_vehicle(0.0, 1.0),
        STRONG: barred_vehicle(0.0, bar_like_the_papers()),
        BOTH: barred_vehicle(),
    }
    found = {name: coupled(vehicle) for name, vehicle in vehicles.items()}
    return {f"{n}.{f}": getattr(c, f) for n, c in found.items() for f in Coupled._fields}


def _gains(
    vehicle: FullVehicle, lateral_acceleration: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Roll [rad], compressions [m] and relative gains."""
    kind = jnp.asarray(0.0).dtype
    a_y, around = jnp.asarray(lateral_acceleration, kind), level_ground()
    rest = standing(vehicle, in_the_turn(around, a_y))
    gain = _compiled()(rest, vehicle, around, jnp.asarray(SPEED, kind), a_y)
    gains = np.asarray(relative_gain_array(gain), float)
    return np.asarray(rest.roll, float), np.asarray(rest.compression, float), gains


@lru_cache(maxsize=1)
def _compiled() -> Any:
    return jax.jit(cornering_gain)
