"""A full vehicle from plain numbers: what follows from them, and what is checked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.errors import InputError, require_in_range
from wheelhop.vehicle.chassis import Chassis
from wheelhop.vehicle.full_vehicle_state import STANDARD_GRAVITY, FullVehicle
from wheelhop.vehicle.magic_formula_parameters import MagicFormula
from wheelhop.vehicle.magic_formula_parameters import validate as validate_slip
from wheelhop.vehicle.strut import AntiRollBars, Damper, Strut, default_stop
from wheelhop.vehicle.strut import validate as validate_strut
from wheelhop.vehicle.vertical_tire import VerticalTire, deflection_at_load
from wheelhop.vehicle.vertical_tire import validate as validate_vertical
from wheelhop.vehicle.wheel_contact import WheelTire

CORNERS = ("FL", "FR", "RL", "RR")


@dataclass(frozen=True)
class Axle:
    """One axle of a vehicle, per wheel where it says so.

    Attributes:
        track: distance of the wheels [m].
        unsprung_mass: per wheel [kg].
        stiffness: of the spring at the wheel, per wheel [N/m].
        damper: per wheel.
        anti_roll: force per difference of the compressions [N/m].
        spin_inertia, diametral_inertia: of a wheel [kg m^2].
        bump_clearance, rebound_clearance: to the stops [m].
        cubic_stiffness: of the spring [N/m^3].
    """

    track: float
    unsprung_mass: float
    stiffness: float
    damper: Damper
    anti_roll: float = 0.0
    spin_inertia: float = 1.2
    diametral_inertia: float = 0.8
    bump_clearance: float = 0.06
    rebound_clearance: float = 0.07
    cubic_stiffness: float = 0.0


def design(
    body_mass: float,
    inertia: tuple[float, float, float],
    arms: tuple[float, float],
    body_height: float,
    axles: tuple[Axle, Axle],
    vertical: VerticalTire,
    slip: MagicFormula,
    *,
    roll_yaw_product: float = 0.0,
    drag_area: float = 0.9,
    drive_front: float = 0.5,
    brake_front: float = 0.65,
    steering_ratio: float = 16.0,
    rolling_resistance: float = 0.01,
) -> FullVehicle:
    """A vehicle that rests level with zero compression at its design load and pressure.

    Spring preloads and hub heights follow from the masses; another load, pressure or grade
    moves the equilibrium, which `static_equilibrium` finds.

    Args:
        body_mass: sprung [kg].
        inertia: of the body in roll, pitch, yaw [kg m^2].
        arms: from the body's centre of mass to the front and rear axle [m].
        body_height: of the body's centre of mass above the road [m].
        axles: front and rear.
        vertical: vertical law of all tyres.
        slip: Magic Formula of all tyres.
        roll_yaw_product: I_xz of the body [kg m^2].
        drag_area: c_d A [m^2].
        drive_front, brake_front: share of the torque on the front axle [-].
        steering_ratio: steering-wheel angle per wheel angle [-].
        rolling_resistance: f_r [-].

    Raises:
        InputError: naming the figure that is out of range.
    """
    front, rear = axles
    wheelbase = arms[0] + arms[1]
    share = 0.5 * np.array([arms[1], arms[1], arms[0], arms[0]]) / wheelbase

    def corners(field: str) -> Any:
        a, b = float(getattr(front, field)), float(getattr(rear, field))
        return jnp.asarray([a, a, b, b], float)

    def dampers(field: str) -> Any:
        a, b = float(getattr(front.damper, field)), float(getattr(rear.damper, field))
        return jnp.asarray([a, a, b, b], float)

    preload = body_mass * STANDARD_GRAVITY * share
    wheel_mass = np.array([front.unsprung_mass] * 2 + [rear.unsprung_mass] * 2)
    load = jnp.asarray(preload + wheel_mass * STANDARD_GRAVITY, float)
    tires = _four(vertical)
    deflection = deflection_at_load(load, jnp.zeros(4), tires.nominal_pressure, tires)
    side = jnp.asarray([1.0, -1.0, 1.0, -1.0])
    chassis = Chassis(
        body_mass=body_mass,
        roll_inertia=inertia[0],
        pitch_inertia=inertia[1],
        yaw_inertia=inertia[2],
        roll_yaw_product=roll_yaw_product,
        front_arm=arms[0],
        rear_arm=arms[1],
        front_track=front.track,
        rear_track=rear.track,
        hub_drop=body_height - (tires.unloaded_radius - deflection),
        wheel_mass=jnp.asarray(wheel_mass, float),
        spin_inertia=corners("spin_inertia"),
        diametral_inertia=corners("diametral_inertia"),
    )
    strut = Strut(
        preload=jnp.asarray(preload, float),
        stiffness=corners("stiffness"),
        cubic_stiffness=corners("cubic_stiffness"),
        damper=Damper(
            dampers("damping"),
            dampers("asymmetry"),
            dampers("knee"),
            dampers("digression"),
            dampers("quadratic"),
        ),
        bump_clearance=corners("bump_clearance"),
        rebound_clearance=corners("rebound_clearance"),
        stop=default_stop(),
    )
    vehicle = FullVehicle(
        chassis=chassis,
        strut=strut,
        anti_roll=AntiRollBars(front.anti_roll, rear.anti_roll),
        tire=WheelTire(
            vertical=tires,
            slip=replace(_four(slip), side=side),
            rolling_resistance=jnp.full(4, rolling_resistance, float),
            standstill_damping=jnp.full(4, 0.02, float),
        ),
        drag_area=drag_area,
        drive_share=_split(drive_front),
        brake_share=_split(brake_front),
        steering_ratio=steering_ratio,
        nominal_pressure=tires.nominal_pressure,
    )
    return validate(as_arrays(vehicle))


def with_payload(vehicle: FullVehicle, mass: float) -> FullVehicle:
    """The same vehicle with a payload [kg] at the body's centre of mass; springs unchanged."""
    chassis = vehicle.chassis
    scale = (chassis.body_mass + mass) / chassis.body_mass
    heavier = replace(
        chassis,
        body_mass=chassis.body_mass * scale,
        roll_inertia=chassis.roll_inertia * scale,
        pitch_inertia=chassis.pitch_inertia * scale,
        yaw_inertia=chassis.yaw_inertia * scale,
        roll_yaw_product=chassis.roll_yaw_product * scale,
    )
    return replace(vehicle, chassis=heavier)


def with_tire(vehicle: FullVehicle, slip: MagicFormula) -> FullVehicle:
    """The same vehicle on tyres of another Magic Formula (as from a .tir file)."""
    four = replace(_four(slip), side=vehicle.tire.slip.side)
    return as_arrays(replace(vehicle, tire=replace(vehicle.tire, slip=four)))


def as_arrays(vehicle: FullVehicle, dtype: Any = None) -> FullVehicle:
    """The same parameters as floating arrays of one type (default: JAX's)."""
    kind = jnp.asarray(0.0).dtype if dtype is None else dtype
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, kind), vehicle)


def validate(vehicle: FullVehicle) -> FullVehicle:
    """The same parameters, checked against what a road vehicle can have.

    Raises:
        InputError: naming the parameter that is out of physical range.
    """
    c = vehicle.chassis
    checks = (
        ("body_mass", 50.0, 60e3, "kg"),
        ("roll_inertia", 5.0, 1e6, "kg m^2"),
        ("pitch_inertia", 5.0, 1e6, "kg m^2"),
        ("yaw_inertia", 5.0, 1e6, "kg m^2"),
        ("front_arm", 0.1, 10.0, "m"),
        ("rear_arm", 0.1, 10.0, "m"),
        ("front_track", 0.3, 4.0, "m"),
        ("rear_track", 0.3, 4.0, "m"),
        ("hub_drop", 0.0, 3.0, "m"),
        ("wheel_mass", 1.0, 2e3, "kg"),
        ("spin_inertia", 0.01, 200.0, "kg m^2"),
        ("diametral_inertia", 0.0, 200.0, "kg m^2"),
    )
    for name, low, high, unit in checks:
        for number in jnp.ravel(jnp.asarray(getattr(c, name))).tolist():
            require_in_range(f"chassis.{name}", number, low, high, unit)
    if float(c.roll_yaw_product) ** 2 >= float(c.roll_inertia) * float(c.yaw_inertia):
        raise InputError(
            "chassis.roll_yaw_product",
            f"{float(c.roll_yaw_product):g} kg m^2 makes the inertia indefinite",
            "Keep its square below the product of roll and yaw inertia.",
        )
    validate_strut(vehicle.strut, vehicle.anti_roll)
    require_in_range("drag_area", vehicle.drag_area, 0.0, 20.0, "m^2")
    require_in_range("steering_ratio", vehicle.steering_ratio, 1.0, 50.0, "(no unit)")
    for vertical, slip in map(_each_wheel(vehicle.tire), range(4)):
        validate_vertical(vertical)
        validate_slip(slip)
    for name in ("drive_share", "brake_share"):
        total = float(jnp.sum(getattr(vehicle, name)))
        if abs(total - 1.0) > 1e-6:
            raise InputError(name, f"its sum is {total:g}", "Make the four shares sum to 1.")
    return vehicle


def _each_wheel(tire: WheelTire) -> Callable[[int], tuple[VerticalTire, MagicFormula]]:
    return lambda k: jax.tree.map(lambda leaf: leaf[k], (tire.vertical, tire.slip))


def _four(parameters: Any) -> Any:
    """Every leaf with a leading axis of four wheels."""
    return jax.tree.map(lambda leaf: jnp.broadcast_to(jnp.asarray(leaf, float), (4,)), parameters)


def _split(front: float) -> Any:
    return jnp.asarray([0.5 * front, 0.5 * front, 0.5 * (1 - front), 0.5 * (1 - front)], float)
