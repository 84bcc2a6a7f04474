"""Vertical force, rolling radius and contact length of a pneumatic tyre."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp

from wheelhop.errors import InputError, require_in_range
from wheelhop.vehicle.arctangent import arctan


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class VerticalTire:
    """Vertical law of a tyre: quadratic in deflection, linear in pressure and in spin.

    Each entry is a number, or an array that broadcasts against the deflection.

    Attributes:
        unloaded_radius: R0 [m].
        rated_load: Fz0 [N].
        q_fz1: linear coefficient of deflection [-].
        q_fz2: quadratic coefficient of deflection [-].
        pressure_coefficient: p_Fz1 [-], relative stiffness per relative pressure.
        nominal_pressure: p0 [Pa], gauge.
        speed_coefficient: q_v2 [-], relative stiffening per multiple of the reference speed.
        reference_speed: V0 [m/s].
        damping: c_z [Ns/m].
        b_reff: low-load slope of the effective rolling radius [-].
        d_reff: its peak value [-].
        f_reff: its high-load slope [-].
        contact_factor: contact half length per sqrt(R0 deflection) [-].
    """

    unloaded_radius: Any
    rated_load: Any
    q_fz1: Any
    q_fz2: Any = 0.0
    pressure_coefficient: Any = 0.0
    nominal_pressure: Any = 250e3
    speed_coefficient: Any = 0.0
    reference_speed: Any = 16.7
    damping: Any = 0.0
    b_reff: Any = 8.0
    d_reff: Any = 0.25
    f_reff: Any = 0.01
    contact_factor: Any = 0.88


def _load_per_quadratic(spin: Any, pressure: Any, tire: VerticalTire) -> Any:
    """Load [N] that a unit of q_Fz1 rho/R0 + q_Fz2 (rho/R0)^2 carries."""
    speed = jnp.abs(spin) * tire.unloaded_radius / tire.reference_speed
    excess = (pressure - tire.nominal_pressure) / tire.nominal_pressure
    stiffening = 1.0 + tire.speed_coefficient * speed
    return stiffening * (1.0 + tire.pressure_coefficient * excess) * tire.rated_load


def vertical_load(deflection: Any, rate: Any, spin: Any, pressure: Any, tire: VerticalTire) -> Any:
    """Load F_z [N] of the road on the tyre: never negative, zero without contact.

    F_z = (1 + q_v2 |Omega| R0/V0) (1 + p_Fz1 (p - p0)/p0)
    (q_Fz1 rho/R0 + q_Fz2 (rho/R0)^2) Fz0 + c_z rho'. Besselink, Schmeitz & Pacejka 2010.

    Args:
        deflection: rho [m], any shape.
        rate: rho' [m/s], the same shape.
        spin: Omega [rad/s], the same shape.
        pressure: p [Pa], the same shape or [].
        tire: parameters.
    """
    strain = jnp.maximum(deflection, 0.0) / tire.unloaded_radius
    elastic = _load_per_quadratic(spin, pressure, tire) * (
        tire.q_fz1 * strain + tire.q_fz2 * strain * strain
    )
    load = jnp.maximum(elastic + tire.damping * rate, 0.0)
    # asked this way round, what is not a number gives no plausible load
    return jnp.where(deflection <= 0.0, 0.0, load)


def vertical_stiffness(deflection: Any, spin: Any, pressure: Any, tire: VerticalTire) -> Any:
    """Stiffness dF_z/drho [N/m] at a deflection [m]; zero without contact.

    Args:
        deflection: rho [m], any shape.
        spin: Omega [rad/s], the same shape.
        pressure: p [Pa], the same shape or [].
        tire: parameters.
    """
    slope = (tire.q_fz1 + 2.0 * tire.q_fz2 * deflection / tire.unloaded_radius) / (
        tire.unloaded_radius
    )
    stiffness = _load_per_quadratic(spin, pressure, tire) * slope
    return jnp.where(deflection <= 0.0, 0.0, stiffness)


def deflection_at_load(load: Any, spin: Any, pressure: Any, tire: VerticalTire) -> Any:
    """Static deflection rho [m] under a load [N]: the root of the quadratic law.

    Args:
        load: F_z >= 0 [N], any shape.
        spin: Omega [rad/s], the same shape.
        pressure: p [Pa], the same shape or [].
        tire: parameters.
    """
    relative = jnp.maximum(load, 0.0) / _load_per_quadratic(spin, pressure, tire)
    root = jnp.sqrt(tire.q_fz1 * tire.q_fz1 + 4.0 * tire.q_fz2 * relative)
    # this form of the root has no 0/0 for the linear tyre
    return tire.unloaded_radius * 2.0 * relative / (tire.q_fz1 + root)


def nominal_stiffness(tire: VerticalTire) -> Any:
    """Stiffness [N/m] at the rated load and nominal pressure, standing.

    k = Fz0/R0 sqrt(q_Fz1^2 + 4 q_Fz2). Besselink, Schmeitz & Pacejka 2010.
    """
    root = (tire.q_fz1 * tire.q_fz1 + 4.0 * tire.q_fz2) ** 0.5
    return tire.rated_load / tire.unloaded_radius * root


def effective_radius(deflection: Any, tire: VerticalTire) -> Any:
    """Effective rolling radius R_e [m], speed of a free-rolling wheel per spin.

    R_e = R0 - rho_0 (D_reff atan(B_reff rho/rho_0) + F_reff rho/rho_0), rho_0 = Fz0/k.
    Pacejka 2012, chapter 4.

    Args:
        deflection: rho [m], any shape; negative counts as zero.
        tire: parameters.
    """
    reference = tire.rated_load / nominal_stiffness(tire)
    relative = jnp.maximum(deflection, 0.0) / reference
    drop = tire.d_reff * arctan(tire.b_reff * relative) + tire.f_reff * relative
    return tire.unloaded_radius - reference * drop


def contact_half_length(deflection: Any, tire: VerticalTire) -> Any:
    """Half the length [m] of the contact patch: contact_factor sqrt(R0 rho).

    Args:
        deflection: rho [m], any shape; zero length without contact.
        tire: parameters.
    """
    apart = deflection <= 0.0
    square = tire.unloaded_radius * jnp.where(apart, 1.0, deflection)
    return jnp.where(apart, 0.0, tire.contact_factor * jnp.sqrt(square))


def linear_vertical_tire(
    stiffness: float,
    nominal_pressure: float,
    pressure_coefficient: float,
    unloaded_radius: float,
    rated_load: float,
    damping: float = 0.0,
    **others: Any,
) -> VerticalTire:
    """Tyre of constant stiffness at constant pressure and spin.

    Args:
        stiffness: k [N/m] at the nominal pressure.
        nominal_pressure: p0 [Pa].
        pressure_coefficient: p_Fz1 [-].
        unloaded_radius: R0 [m].
        rated_load: Fz0 [N].
        damping: c_z [Ns/m].
        **others: further fields of `VerticalTire`.
    """
    return VerticalTire(
        unloaded_radius=unloaded_radius,
        rated_load=rated_load,
        q_fz1=stiffness * unloaded_radius / rated_load,
        pressure_coefficient=pressure_coefficient,
        nominal_pressure=nominal_pressure,
        damping=damping,
        **others,
    )


def linear_coefficient(
    stiffness: float, q_fz2: float, unloaded_radius: float, rated_load: float
) -> float:
    """The q_Fz1 that gives a stiffness k [N/m] at the rated load.

    q_Fz1 = sqrt((k R0/Fz0)^2 - 4 q_Fz2). Besselink, Schmeitz & Pacejka 2010.

    Raises:
        InputError: if q_Fz2 asks for more stiffness than k at the rated load.
    """
    square = (stiffness * unloaded_radius / rated_load) ** 2 - 4.0 * q_fz2
    if not square > 0.0:
        raise InputError(
            "q_fz2",
            f"{q_fz2:g} leaves no stiffness at small loads with {stiffness:g} N/m at "
            f"{rated_load:g} N",
            "Use a smaller quadratic coefficient.",
        )
    return float(square**0.5)


def validate(tire: VerticalTire) -> VerticalTire:
    """The same parameters, checked; for a tyre of plain numbers.

    Raises:
        InputError: naming the parameter that is out of physical range.
    """
    require_in_range("vertical_tire.unloaded_radius", tire.unloaded_radius, 0.1, 2.0, "m")
    require_in_range("vertical_tire.rated_load", tire.rated_load, 100.0, 2e5, "N")
    require_in_range("vertical_tire.q_fz1", tire.q_fz1, 0.1, 500.0, "(no unit)")
    require_in_range("vertical_tire.q_fz2", tire.q_fz2, -500.0, 5e3, "(no unit)")
    require_in_range(
        "vertical_tire.pressure_coefficient", tire.pressure_coefficient, 0.0, 1.2, "(no unit)"
    )
    require_in_range("vertical_tire.nominal_pressure", tire.nominal_pressure, 5e4, 1.5e6, "Pa")
    require_in_range(
        "vertical_tire.speed_coefficient", tire.speed_coefficient, 0.0, 1.0, "(no unit)"
    )
    require_in_range("vertical_tire.reference_speed", tire.reference_speed, 1.0, 100.0, "m/s")
    require_in_range("vertical_tire.damping", tire.damping, 0.0, 1e4, "Ns/m")
    require_in_range("vertical_tire.b_reff", tire.b_reff, 0.0, 100.0, "(no unit)")
    require_in_range("vertical_tire.d_reff", tire.d_reff, 0.0, 2.0, "(no unit)")
    require_in_range("vertical_tire.f_reff", tire.f_reff, -1.0, 1.0, "(no unit)")
    require_in_range("vertical_tire.contact_factor", tire.contact_factor, 0.1, 2.0, "(no unit)")
    # the stiffness must stay positive up to three times the rated load
    if not float(tire.q_fz1) ** 2 + 12.0 * float(tire.q_fz2) > 0.0:
        raise InputError(
            "vertical_tire.q_fz2",
            f"{float(tire.q_fz2):g} makes the tyre yield below three times its rated load",
            "Use a larger quadratic coefficient.",
        )
    return tire
