"""Wheel loads from the accelerations by lever arms alone: Filipozzi et al. 2021, Eq. 31-34.

A rigid vehicle in quasi-steady state. Neither springs, bars nor dampers are in it, so that it has
no transient, and shares the sideways transfer among the axles as it shares the weight.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax.numpy as jnp

from wheelhop.errors import InputError, require_in_range
from wheelhop.vehicle.full_vehicle_state import STANDARD_GRAVITY, FullVehicle
from wheelhop.vehicle.two_track_of import common_centre


class WeightDistribution(NamedTuple):
    """Mass and centre of mass of a whole vehicle, wheels included.

    Attributes:
        mass: m [kg].
        front_distance: l_F, from the centre of mass to the front axle [m].
        left_distance: w_L, from the centre of mass to the left wheels [m].
        height: h, of the centre of mass above the road [m].
        wheelbase: L = l_F + l_R [m].
        track: W = w_L + w_R [m]; one for both axles.
    """

    mass: Any
    front_distance: Any
    left_distance: Any
    height: Any
    wheelbase: Any
    track: Any


def algebraic_loads(a_x: Any, a_y: Any, distribution: WeightDistribution, a_z: Any = 0.0) -> Any:
    """Load of each wheel FL, FR, RL, RR [N], [..., 4]; pure.

    F_FL = m (g + a_z) l_R w_R / (L W) - m h w_R / (L W) a_x - m h l_R / (L W) a_y, and so on: the
    front sheds a_x and the left sheds a_y, each load its share at the *other* end and side. The sum
    is m (g + a_z) whatever a_x and a_y; as printed a_z = 0, which on a slope of tangent t
    overstates all loads by the factor sqrt(1 + t^2). The product of both transfers,
    m h^2 a_x a_y / (g L W), is left out as printed. Filipozzi et al. 2021, Eq. 31-34.

    Args:
        a_x: accelerometer forward [m/s^2], uphill positive at rest, [...].
        a_y: accelerometer to the left [m/s^2], positive at rest where the left is the higher side,
            the shape of `a_x`.
        distribution: mass and centre of mass, entries [] or [...].
        a_z: accelerometer upward less standard gravity [m/s^2], [] or [...].
    """
    d = distribution
    rear, right = d.wheelbase - d.front_distance, d.track - d.left_distance
    scale = d.mass / (d.wheelbase * d.track)
    weight = scale * (STANDARD_GRAVITY + a_z)
    along, across = scale * d.height * a_x, scale * d.height * a_y

    def load(length: Any, width: Any, behind: float, beside: float) -> Any:
        return weight * length * width + behind * along * width + beside * across * length

    front, left = d.front_distance, d.left_distance
    return jnp.stack(
        jnp.broadcast_arrays(
            load(rear, right, -1.0, -1.0),
            load(rear, left, -1.0, 1.0),
            load(front, right, 1.0, -1.0),
            load(front, left, 1.0, 1.0),
        ),
        axis=-1,
    )


def distribution_of(vehicle: FullVehicle, pressure: Any = None) -> WeightDistribution:
    """The weight distribution of a full vehicle that stands level; pure.

    The track is the mean of both axles'.

    Args:
        vehicle: parameters, as arrays.
        pressure: of the tyres [Pa], [4]; nominal by default.
    """
    c = vehicle.chassis
    centre = common_centre(vehicle, vehicle.nominal_pressure if pressure is None else pressure)
    track = 0.5 * (c.front_track + c.rear_track)
    return WeightDistribution(
        mass=c.body_mass + jnp.sum(c.wheel_mass),
        front_distance=c.front_arm - centre.ahead,
        left_distance=0.5 * track,
        height=centre.height,
        wheelbase=c.front_arm + c.rear_arm,
        track=track,
    )


def validate(distribution: WeightDistribution) -> WeightDistribution:
    """The same distribution, checked.

    Raises:
        InputError: naming the entry that is out of range.
    """
    limits = (
        ("mass", 50.0, 6e4, "kg"),
        ("wheelbase", 0.3, 20.0, "m"),
        ("track", 0.3, 4.0, "m"),
        ("height", 0.0, 4.0, "m"),
    )
    for name, low, high, unit in limits:
        for number in jnp.ravel(jnp.asarray(getattr(distribution, name))).tolist():
            require_in_range(f"distribution.{name}", number, low, high, unit)
    d = distribution
    for name, distance, whole in (
        ("front_distance", d.front_distance, d.wheelbase),
        ("left_distance", d.left_distance, d.track),
    ):
        if not bool(jnp.all((jnp.asarray(distance) > 0) & (jnp.asarray(distance) < whole))):
            raise InputError(
                f"distribution.{name}",
                f"{distance} m is not between 0 and {whole} m",
                "Give a centre of mass that lies within the four wheels.",
            )
    return distribution
