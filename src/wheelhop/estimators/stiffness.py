"""Tyre stiffness of one corner by recursive maximum likelihood, on a road nobody measured.

The inner filter knows four states, d, e, v_s and v_u, and is conditioned on
theta = (ln k_t, ln G, ...); theta climbs the likelihood of the accelerations (Ljung &
Soderstrom 1983; `filtering.sensitivity`). A joint state cannot do this: its gain is linear in the
innovation, while the road's level and the stiffness show in the size of the innovations.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from wheelhop.errors import InputError, require_in_range
from wheelhop.estimators import road_model
from wheelhop.estimators.road_model import LONGEST_STEP, RoadModelParams, corner_on_road
from wheelhop.filtering import (
    Filter,
    Gaussian,
    SensitivityParams,
    SensitivityPrior,
    extended,
    independent,
    sensitivity,
    unscented,
)
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.tire import pressure_slope, stiffness_from_pressure

INNER: dict[str, Callable[..., Filter]] = {"extended": extended, "unscented": unscented}
"""Filters that theta may condition. The corner is nearly linear: they differ by less than 1 % of
a standard deviation, and the extended one costs half."""

EXTRA = ("waviness", "ln_sprung_mass", "ln_damping")
"""What may be free beside ln k_t and ln G, as deviations from the parameters."""

MIDDLE_LEVEL = 8e-6
"""Gd(W0) [m^3/rad] between ISO 8608 classes B and C, where a road of unknown roughness starts."""


@dataclass(frozen=True)
class StiffnessTuning:
    """What a user may tune.

    Attributes:
        noise_a_s, noise_a_u: of the body and the wheel accelerometer [m/s^2].
        prior_pressure: mean of the prior [Pa].
        prior_pressure_sigma: its standard deviation [Pa].
        prior_level: median of the road level's prior, Gd(W0) [m^3/rad].
        prior_level_sigma: of ln G; 1.6 is a road anywhere between classes A and D.
        stiffness_walk: random walk of ln k_t [1/sqrt(s)].
        level_walk: random walk of ln G [1/sqrt(s)].
        waviness_sigma: of the road's waviness about that of the parameters, where it is free.
        sprung_mass_sigma: of ln m_s, where it is free.
        damping_sigma: of the log of the damper's force, where it is free.
    """

    noise_a_s: float = 0.5
    noise_a_u: float = 0.5
    prior_pressure: float = 190e3
    prior_pressure_sigma: float = 40e3
    prior_level: float = MIDDLE_LEVEL
    prior_level_sigma: float = 1.6
    stiffness_walk: float = 0.005
    level_walk: float = 0.0
    waviness_sigma: float = 0.25
    sprung_mass_sigma: float = 0.1
    damping_sigma: float = 0.1


_RANGES = {
    "noise_a_s": (1e-4, 100.0, "m/s^2"),
    "noise_a_u": (1e-4, 100.0, "m/s^2"),
    "prior_pressure": (20e3, 1.5e6, "Pa"),
    "prior_pressure_sigma": (1.0, 1e6, "Pa"),
    "prior_level": (1e-9, 1e-1, "m^3/rad"),
    "prior_level_sigma": (0.0, 10.0, "(no unit)"),
    "stiffness_walk": (0.0, 10.0, "1/sqrt(s)"),
    "level_walk": (0.0, 1e3, "1/sqrt(s)"),
    "waviness_sigma": (0.0, 1.0, "(no unit)"),
    "sprung_mass_sigma": (0.0, 1.0, "(no unit)"),
    "damping_sigma": (0.0, 1.0, "(no unit)"),
}


def validate_tuning(tuning: StiffnessTuning) -> StiffnessTuning:
    """The same tuning, checked.

    Raises:
        InputError: naming the figure that is out of range.
    """
    for field in fields(tuning):
        if field.name in _RANGES:
            low, high, unit = _RANGES[field.name]
            require_in_range(f"tuning.{field.name}", getattr(tuning, field.name), low, high, unit)
    return tuning


class CornerTheta(NamedTuple):
    """What is estimated of a corner on a road of waviness 2.

    Attributes:
        ln_k_t: log of the tyre stiffness in N/m.
        ln_level: log of the road's level over that of the parameters.
    """

    ln_k_t: Any
    ln_level: Any


@lru_cache(maxsize=16)
def theta_type(free: tuple[str, ...] = ()) -> Any:
    """The NamedTuple of theta: `CornerTheta`, and the entries of `EXTRA` that are free.

    Raises:
        InputError: for a name that is unknown or given twice.
    """
    for name in free:
        if name not in EXTRA or free.count(name) > 1:
            raise InputError("free", f"{name!r} in {free}", f"Use some of {EXTRA}, each once.")
    if not free:
        return CornerTheta
    return NamedTuple("CornerTheta", [(n, Any) for n in (*CornerTheta._fields, *free)])


def bind_theta(inner: RoadModelParams, theta: Any) -> RoadModelParams:
    """The corner's parameters with theta in effect.

    Args:
        inner: whose tyre gives way to theta, and from whose other entries theta deviates.
        theta: of a `theta_type`.
    """
    car = inner.car
    tire = replace(car.tire, stiffness=jnp.exp(theta.ln_k_t))
    suspension, mass, waviness = car.suspension, car.sprung_mass, inner.waviness
    if hasattr(theta, "ln_damping"):
        more = jnp.exp(theta.ln_damping)
        suspension = replace(
            suspension,
            damping=more * suspension.damping,
            quadratic_damping=more * suspension.quadratic_damping,
        )
    if hasattr(theta, "ln_sprung_mass"):
        mass = mass * jnp.exp(theta.ln_sprung_mass)
    if hasattr(theta, "waviness"):
        waviness = waviness + theta.waviness
    return replace(
        inner,
        car=QuarterCar(mass, car.unsprung_mass, suspension, tire),
        level=inner.level * jnp.exp(theta.ln_level),
        waviness=waviness,
        pressure=tire.nominal_pressure + 0.0 * theta.ln_k_t,
    )


def substeps_for(dt: float) -> int:
    """Integration steps per sampling interval [s] that keep the wheel hop accurate."""
    return max(1, math.ceil(dt / LONGEST_STEP - 1e-9))


def stiffness_filter(
    dt: float, free: Sequence[str] = (), inner: str = "extended", coloured: bool | None = None
) -> Filter:
    """Recursive maximum likelihood over one corner.

    On quarter cars of continuous roughness its error of ln k_t stays within 1.1 of the
    Cramer-Rao bound from 2 s on, and its variance is that of its errors (see the README).

    Args:
        dt: sampling interval [s].
        free: entries of `EXTRA` to estimate too.
        inner: key of `INNER`.
        coloured: with shaping states for a waviness other than 2; by default where it is free.

    Returns:
        A `Filter` over `SensitivityState`; parameters from `stiffness_params`, belief before the
        first sample from `stiffness_prior`, measurements `Accelerations`.

    Raises:
        InputError: for an unknown filter or entry.
    """
    if inner not in INNER:
        raise InputError("inner", f"{inner!r} is unknown", f"Use one of {tuple(INNER)}.")
    theta_type(tuple(free))
    shaped = "waviness" in free if coloured is None else coloured
    return _stiffness_filter(substeps_for(dt), inner, shaped)


@lru_cache(maxsize=16)
def _stiffness_filter(substeps: int, inner: str, coloured: bool) -> Filter:
    return sensitivity(INNER[inner](corner_on_road(coloured, substeps)), bind_theta)


def stiffness_params(
    car: QuarterCar,
    speed: float,
    dt: float,
    tuning: StiffnessTuning = StiffnessTuning(),
    free: Sequence[str] = (),
    waviness: float = 2.0,
) -> SensitivityParams:
    """Parameters of `stiffness_filter`, arrays of JAX's default floating type.

    Args:
        car: the corner; its tyre's stiffness is not used.
        speed: v [m/s] until `bind_speed` sets another.
        dt: sampling interval [s].
        tuning: priors, walks and noise.
        free: as in `stiffness_filter`.
        waviness: w of the road, or its prior's mean.
    """
    validate_tuning(tuning)
    kind = theta_type(tuple(free))
    walk = kind(tuning.stiffness_walk**2 * dt, tuning.level_walk**2 * dt, *(0.0 for _ in free))
    inner = RoadModelParams(
        car,
        tuning.prior_level,
        waviness,
        tuning.noise_a_s,
        tuning.noise_a_u,
        speed,
        car.tire.nominal_pressure,
        dt,
    )
    return jax.tree.map(lambda a: jnp.asarray(a, float), SensitivityParams(inner, walk))


def stiffness_prior(
    params: SensitivityParams,
    tuning: StiffnessTuning = StiffnessTuning(),
    free: Sequence[str] = (),
    coloured: bool | None = None,
) -> SensitivityPrior:
    """Belief before the first sample: moving a little, pressure and roughness as in the tuning."""
    tire = params.inner.car.tire
    sigma = theta_type(tuple(free))(
        prior_ln_sigma(tuning, tire),
        tuning.prior_level_sigma,
        *(getattr(tuning, f"{name.removeprefix('ln_')}_sigma") for name in free),
    )
    mean = type(sigma)(
        jnp.log(stiffness_from_pressure(tuning.prior_pressure, tire)), *(0.0 for _ in sigma[1:])
    )
    shaped = "waviness" in free if coloured is None else coloured
    theta = jax.tree.map(lambda a: jnp.asarray(a, float), independent(mean, sigma))
    return SensitivityPrior(road_model.prior(bind_theta(params.inner, theta.mean), shaped), theta)


def prior_ln_sigma(tuning: StiffnessTuning, tire: Any) -> Any:
    """Standard deviation of ln k_t that the pressure prior of a tuning means."""
    stiffness = stiffness_from_pressure(tuning.prior_pressure, tire)
    return tuning.prior_pressure_sigma / (pressure_slope(tire) * stiffness)


def bind_speed(params: SensitivityParams, speed: Any) -> SensitivityParams:
    """The parameters at a time of speed [m/s]."""
    return replace(params, inner=replace(params.inner, speed=speed))


def read_theta(state: Any) -> Gaussian:
    """`Gaussian` of theta, of a state of `stiffness_filter` or of the mixture of an IMM of it."""
    return getattr(state, "combined", state).theta
