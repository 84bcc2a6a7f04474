"""Published vehicles as full-vehicle parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from wheelhop.vehicle.full_vehicle import FullVehicle
from wheelhop.vehicle.magic_formula_parameters import generic_passenger_tire
from wheelhop.vehicle.parameters import BRANCATI_TABLE_1
from wheelhop.vehicle.strut import Damper
from wheelhop.vehicle.vehicle_design import (
    CORNERS,
    Axle,
    as_arrays,
    design,
    validate,
    with_payload,
    with_tire,
)
from wheelhop.vehicle.vertical_tire import linear_coefficient, linear_vertical_tire

__all__ = [
    "CORNERS",
    "VEHICLES",
    "Axle",
    "as_arrays",
    "bmw_e90",
    "commonroad_2",
    "design",
    "suv",
    "validate",
    "with_payload",
    "with_tire",
]


def suv(anti_roll: bool = True, load_and_speed: bool = False) -> FullVehicle:
    """The segment-D SUV of Brancati & Tufano 2022, Table 1.

    What the table leaves open is ours: inertias in roll and pitch, a damper of ratio 0.3 that is
    2.3 times stiffer in extension, ride frequencies of 1.35 and 1.45 Hz, anti-roll bars, tyres'
    slip behaviour. Its 0.6 m of height is taken as that of the whole vehicle.

    Args:
        anti_roll: with anti-roll bars.
        load_and_speed: the tyre stiffens with load and speed (Q_FZ2 15.416, Q_V2 0.0466 of a
            245/60R16 sample tyre) and has the table's stiffness at the rated load, standing;
            otherwise it is linear, as the quarter car's.
    """
    t = BRANCATI_TABLE_1
    vertical = linear_vertical_tire(
        stiffness=t.tire_stiffness,
        nominal_pressure=t.nominal_pressure,
        pressure_coefficient=0.7,
        unloaded_radius=0.36,
        rated_load=5000.0,
        damping=100.0,
    )
    if load_and_speed:
        vertical = replace(
            vertical,
            q_fz1=linear_coefficient(t.tire_stiffness, 15.416, 0.36, 5000.0),
            q_fz2=15.416,
            speed_coefficient=0.0466,
        )
    unsprung = 2.0 * (t.front_unsprung_mass + t.rear_unsprung_mass)
    height = (
        (t.chassis_mass + unsprung) * t.center_of_mass_height - unsprung * 0.34
    ) / t.chassis_mass
    front = Axle(
        t.front_track,
        t.front_unsprung_mass,
        33.6e3,
        Damper(2800.0, asymmetry=0.4, knee=0.1, digression=1.0),
        anti_roll=15e3 if anti_roll else 0.0,
    )
    rear = Axle(
        t.rear_track,
        t.rear_unsprung_mass,
        35.5e3,
        Damper(2700.0, asymmetry=0.4, knee=0.1, digression=1.0),
        anti_roll=8e3 if anti_roll else 0.0,
    )
    return design(
        t.chassis_mass,
        (700.0, 2900.0, t.yaw_inertia),
        (t.front_semi_wheelbase, t.rear_semi_wheelbase),
        height,
        (front, rear),
        vertical,
        generic_passenger_tire(rated_load=5000.0),
        drag_area=0.35 * t.frontal_area,
    )


def bmw_e90() -> FullVehicle:
    """A BMW E90 with the springs, dampers, bars and tyres of Project Chrono's model.

    Dampers F = c v / (1 + d |v|); the same in both directions. Weight distribution 50:50.
    """
    vertical = linear_vertical_tire(
        stiffness=310.5e3,
        nominal_pressure=220e3,
        pressure_coefficient=0.7,
        unloaded_radius=0.3186,
        rated_load=4000.0,
        damping=186.0,
    )
    front = Axle(1.5, 41.0, 29.77e3, Damper(4352.0, digression=1.3), anti_roll=13e3)
    rear = Axle(1.513, 41.0, 37.13e3, Damper(5810.0, digression=1.3), anti_roll=13e3)
    return design(
        1442.0,
        (572.0, 2487.0, 2768.0),
        (0.5 * 2.757, 0.5 * 2.757),
        0.55,
        (front, rear),
        vertical,
        generic_passenger_tire(rated_load=4000.0),
        drag_area=0.6,
        drive_front=0.0,
    )


def commonroad_2() -> FullVehicle:
    """Vehicle 2 (BMW 320i) of CommonRoad's vehicle models: linear springs and dampers.

    Its auxiliary roll stiffness is an anti-roll bar here; its yaw inertia, which is that of the
    whole car, is less that of the wheels; its slip behaviour is our generic tyre's.
    """
    vertical = linear_vertical_tire(
        stiffness=158.294e3,
        nominal_pressure=220e3,
        pressure_coefficient=0.7,
        unloaded_radius=0.344,
        rated_load=2700.0,
        damping=50.0,
    )
    wheel = 0.5 * 63.7921826
    front = Axle(
        1.38684,
        wheel,
        24453.14,
        Damper(1786.244),
        anti_roll=6914.88 / 1.38684**2,
        spin_inertia=1.7,
        diametral_inertia=0.85,
    )
    rear = Axle(
        1.36398,
        wheel,
        19635.5,
        Damper(1649.083),
        anti_roll=2643.6 / 1.36398**2,
        spin_inertia=1.7,
        diametral_inertia=0.85,
    )
    return design(
        965.7108,
        (207.265, 1565.818, 1513.0),
        (1.1561957, 1.4227171),
        0.61373,
        (front, rear),
        vertical,
        generic_passenger_tire(rated_load=2700.0),
        drag_area=0.0,
        drive_front=0.0,
        brake_front=0.66,
    )


VEHICLES: dict[str, Callable[[], FullVehicle]] = {
    "suv": suv,
    "suv-load-speed": lambda: suv(load_and_speed=True),
    "bmw-e90": bmw_e90,
    "commonroad-2": commonroad_2,
}
