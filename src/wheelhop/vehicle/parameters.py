"""Parameters of a quarter car, and the published sets."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import jax

from wheelhop.errors import InputError, require_in_range
from wheelhop.vehicle import suspension as _suspension
from wheelhop.vehicle import tire as _tire
from wheelhop.vehicle.suspension import Suspension
from wheelhop.vehicle.tire import Tire


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class QuarterCar:
    """One corner of a vehicle.

    Attributes:
        sprung_mass: m_s [kg].
        unsprung_mass: m_u [kg].
        suspension: spring and damper.
        tire: vertical stiffness law.
    """

    sprung_mass: Any
    unsprung_mass: Any
    suspension: Suspension
    tire: Tire


@dataclass(frozen=True)
class VehicleTable:
    """Whole-vehicle data of Brancati & Tufano 2022, Table 1 (segment-D SUV), SI units."""

    chassis_mass: float = 1788.0
    front_semi_wheelbase: float = 1.347
    rear_semi_wheelbase: float = 1.471
    front_track: float = 1.606
    rear_track: float = 1.6364
    yaw_inertia: float = 3230.0
    center_of_mass_height: float = 0.6
    frontal_area: float = 2.75
    front_unsprung_mass: float = 61.14
    rear_unsprung_mass: float = 52.75
    nominal_pressure: float = 250e3
    tire_stiffness: float = 264.7e3


BRANCATI_TABLE_1 = VehicleTable()

BRANCATI_TABLE_3 = {
    "A": Suspension(113086.0, 130098.0, 6576.0, 4319.0),
    "B": Suspension(173415.0, 151886.0, 4585.0, 6016.0),
    "C": Suspension(94544.0, 62836.0, 14819.0, 5839.0),
    "D": Suspension(118114.0, 121723.0, 14708.0, 4555.0),
}
"""Suspension per road class, Brancati & Tufano 2022, Table 3. The paper itself calls them
poor in physical meaning: they fit its simulator's output, not a spring and a damper."""

PHYSICAL_SUSPENSION = Suspension(
    stiffness=33.6e3, cubic_stiffness=1.0e5, damping=2400.0, quadratic_damping=500.0
)
"""Suspension of 1.35 Hz ride frequency and damping ratio 0.30 under 466.7 kg, mildly
nonlinear; the default, because the paper gives its suspension as curves only."""


def corner_sprung_mass(table: VehicleTable, axle: str, load_mass: float = 0.0) -> float:
    """Sprung mass [kg] on one wheel: half the body mass times the opposite lever arm.

    Brancati & Tufano 2022, Eq. 2.

    Args:
        table: whole-vehicle data.
        axle: "front" or "rear".
        load_mass: added to the chassis mass [kg].

    Raises:
        InputError: if the axle is neither.
    """
    arms = {"front": table.rear_semi_wheelbase, "rear": table.front_semi_wheelbase}
    if axle not in arms:
        raise InputError("axle", f"{axle!r} is not an axle", "Use 'front' or 'rear'.")
    wheelbase = table.front_semi_wheelbase + table.rear_semi_wheelbase
    return 0.5 * (table.chassis_mass + load_mass) * arms[axle] / wheelbase


def brancati_suv(axle: str = "front", load_mass: float = 0.0) -> QuarterCar:
    """Quarter car of the SUV of Brancati & Tufano 2022 with a physical suspension.

    Args:
        axle: "front" or "rear".
        load_mass: payload added to the chassis mass [kg].
    """
    table = BRANCATI_TABLE_1
    sprung = corner_sprung_mass(table, axle, load_mass)
    unsprung = table.front_unsprung_mass if axle == "front" else table.rear_unsprung_mass
    tire = Tire(table.tire_stiffness, table.nominal_pressure, pressure_coefficient=0.7)
    return QuarterCar(sprung, unsprung, PHYSICAL_SUSPENSION, tire)


def with_suspension(car: QuarterCar, suspension: Suspension) -> QuarterCar:
    """The same corner on another suspension."""
    return replace(car, suspension=suspension)


def validate(car: QuarterCar) -> QuarterCar:
    """The same parameters, checked against what a road vehicle can have.

    Raises:
        InputError: naming the parameter that is out of physical range.
    """
    require_in_range("quarter_car.sprung_mass", car.sprung_mass, 20.0, 20e3, "kg")
    require_in_range("quarter_car.unsprung_mass", car.unsprung_mass, 2.0, 2e3, "kg")
    _suspension.validate(car.suspension)
    _tire.validate(car.tire)
    return car
