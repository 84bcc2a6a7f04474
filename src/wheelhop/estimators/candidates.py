"""The filters of Brancati & Tufano 2022 as candidates: as printed, and corrected."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.estimators.candidate import Candidate, Knob, Reading, Tuning, as_float
from wheelhop.estimators.immuf import (
    CornerState,
    MemberParams,
    bind_speed,
    immuf,
    sticky,
)
from wheelhop.estimators.printed import (
    AbsoluteCorner,
    Misprints,
    artificial_roads,
    bind_road,
    printed_immuf,
    printed_params,
)
from wheelhop.filtering import Gaussian, InteractingParams, InteractingState, independent
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.road import class_level, stationary_variance
from wheelhop.vehicle.tire import pressure_slope, stiffness_from_pressure

PRIOR_PRESSURE = 180e3
"""Mean of the prior of every filter [Pa]: the middle of Brancati & Tufano 2022, Table 4."""

PRIOR_SIGMA = 100e3 / 12.0**0.5
"""Standard deviation [Pa] of a pressure that is uniform over the 100 kPa of Table 4."""

NOISE = 0.5
"""Of both accelerometers [m/s^2]: Brancati & Tufano 2022, section 5.3."""

STAY = 0.97
"""Diagonal of Pz: Brancati & Tufano 2022, Eq. 17."""


KEPT = Misprints(weights=False)
"""The misprints with which the printed filter runs at all."""


class _Setting(NamedTuple):
    """What a candidate is built for.

    Attributes:
        cars: the corner as each mode models it, leaves [modes].
        roads: levels [m^3/rad] or variances [m^2] of the modes' roads [modes].
        dt: sampling interval [s].
        noise: of both accelerometers [m/s^2].
    """

    cars: QuarterCar
    roads: Any
    dt: Any
    noise: Any


def _stacked(cars: Sequence[QuarterCar]) -> QuarterCar:
    return as_float(jax.tree.map(lambda *a: np.stack([np.asarray(v, float) for v in a]), *cars))


def printed(
    cars: Mapping[str, QuarterCar],
    dt: float,
    classes: Sequence[str] | None = None,
    convention: str = "brancati2022",
    misprints: Misprints = KEPT,
    name: str = "as printed",
    noise: float = NOISE,
) -> Candidate:
    """The paper's filter: Brancati & Tufano 2022, Eq. 9-19.

    Args:
        cars: the corner by road class, each with the suspension identified on that class.
        dt: sampling interval [s].
        classes: ISO 8608 classes of the modes; all of `cars` by default.
        convention: level of the artificial roads, "iso8608" or "brancati2022".
        misprints: those that are kept; all but the mixing weights by default, with which the
            members' states grow without bound.
        name: of the candidate.
        noise: of both accelerometers [m/s^2], for R.
    """
    modes = tuple(cars if classes is None else classes)
    setting = _Setting(
        _stacked([cars[c] for c in modes]),
        as_float(np.array([stationary_variance(class_level(c), convention) for c in modes])),
        as_float(dt),
        as_float(noise),
    )
    return Candidate(
        name,
        modes,
        printed_knobs(dt),
        printed_immuf(misprints),
        setting,
        _printed_prior,
        _printed_params,
        _printed_inputs,
        bind_road,
        _read_absolute,
    )


def _printed_prior(tuning: Tuning, setting: _Setting, normal: Any) -> Gaussian:
    tire = jax.tree.map(lambda a: a[0], setting.cars.tire)
    stiffness = stiffness_from_pressure(PRIOR_PRESSURE, tire)
    sigma = AbsoluteCorner(
        tuning["p0_z_s"],
        tuning["p0_z_u"],
        tuning["p0_v_s"],
        tuning["p0_v_u"],
        tuning["p0_pressure"] / pressure_slope(tire),
    )
    return _disturbed(AbsoluteCorner(0.0, 0.0, 0.0, 0.0, stiffness), sigma, normal)


def _printed_params(tuning: Tuning, setting: _Setting) -> InteractingParams:
    q = AbsoluteCorner(*(tuning[f"q_{i}"] for i in range(1, 6)))
    return printed_params(setting.cars, setting.dt, q, setting.noise, STAY)


def _printed_inputs(key: Any, speed: Any, setting: _Setting) -> Any:
    return artificial_roads(key, speed, setting.dt, setting.roads.astype(speed.dtype))


def corrected(
    cars: Mapping[str, QuarterCar],
    dt: float,
    classes: Sequence[str] | None = None,
    convention: str = "iso8608",
    name: str = "corrected",
    noise: float = NOISE,
) -> Candidate:
    """The corrected filter, `immuf`, with a set of parameters for each class.

    Arguments as `printed`; the classes are process noise on the road here.
    """
    modes = tuple(cars if classes is None else classes)
    ratio = stationary_variance(1.0, convention) / stationary_variance(1.0)
    setting = _Setting(
        _stacked([cars[c] for c in modes]),
        as_float(np.array([ratio * class_level(c) for c in modes])),
        as_float(dt),
        as_float(noise),
    )
    return Candidate(
        name,
        modes,
        CORRECTED_KNOBS,
        immuf(dt),
        setting,
        _corrected_prior,
        _corrected_params,
        _corrected_inputs,
        bind_speed,
        _read_relative,
    )


def _corrected_prior(tuning: Tuning, setting: _Setting, normal: Any) -> Gaussian:
    tire = jax.tree.map(lambda a: a[0], setting.cars.tire)
    stiffness = stiffness_from_pressure(PRIOR_PRESSURE, tire)
    sigma = CornerState(
        tuning["p0_deflection"],
        tuning["p0_tyre_deflection"],
        tuning["p0_v_s"],
        tuning["p0_v_u"],
        tuning["p0_pressure"] / (pressure_slope(tire) * stiffness),
    )
    return _disturbed(CornerState(0.0, 0.0, 0.0, 0.0, jnp.log(stiffness)), sigma, normal)


def _corrected_params(tuning: Tuning, setting: _Setting) -> InteractingParams:
    modes = setting.roads.shape[0]

    def each(number: Any) -> Any:
        return jnp.broadcast_to(jnp.asarray(number, setting.roads.dtype), (modes,))

    members = MemberParams(
        setting.cars,
        tuning["road_gain"] * setting.roads,
        each(1.0),
        each(setting.dt),
        each(setting.noise),
        each(setting.noise),
        each(tuning["stiffness_walk"]),
        each(tuning["velocity_walk"]),
        each(tuning["wheel_walk"]),
    )
    return InteractingParams(members, *sticky(modes, STAY))


def _corrected_inputs(key: Any, speed: Any, setting: _Setting) -> Any:
    del key, setting
    return speed


def printed_knobs(dt: float) -> dict[str, Knob]:
    """Q and P0 of the printed filter, Eq. 18 and section 5.3, where tuning starts.

    Args:
        dt: sampling interval [s]; q is what a step adds over dt^3.
    """
    stiffness = 2e5
    step = {
        1: (1e-5, "m^2/s^3", "z_s"),
        2: (1e-3, "m^2/s^3", "z_u"),
        3: (1e-2, "m^2/s^5", "v_s"),
        4: (3e-1, "m^2/s^5", "v_u"),
        5: (0.001 * stiffness * dt**0.5, "N^2/(m^2 s^3)", "k_t"),
    }
    knobs = {
        f"q_{i}": Knob(sigma**2 / dt**3, unit, f"process noise of {of}, Eq. 18")
        for i, (sigma, unit, of) in step.items()
    }
    return knobs | {
        "p0_z_s": Knob(0.005, "m", "P0 of z_s"),
        "p0_z_u": Knob(0.005, "m", "P0 of z_u"),
        "p0_v_s": Knob(0.05, "m/s", "P0 of v_s"),
        "p0_v_u": Knob(0.2, "m/s", "P0 of v_u"),
        "p0_pressure": Knob(10e3, "Pa", "P0 of k_t, as a pressure"),
    }


CORRECTED_KNOBS = {
    "stiffness_walk": Knob(0.002, "1/sqrt(s)", "random walk of ln k_t"),
    "velocity_walk": Knob(3.0, "m/s/sqrt(s)", "random walk of the body's velocity"),
    "wheel_walk": Knob(3.0, "m/s/sqrt(s)", "random walk of the wheel's velocity"),
    "road_gain": Knob(3.0, "-", "factor on the roads' levels"),
    "p0_deflection": Knob(0.005, "m", "P0 of d = z_s - z_u"),
    "p0_tyre_deflection": Knob(0.002, "m", "P0 of e = z_u - z_r"),
    "p0_v_s": Knob(0.05, "m/s", "P0 of v_s"),
    "p0_v_u": Knob(0.2, "m/s", "P0 of v_u"),
    "p0_pressure": Knob(10e3, "Pa", "P0 of k_t, as a pressure"),
}
"""Q and P0 of the corrected filter, where tuning starts."""


def _disturbed(mean: Any, sigma: Any, normal: Any) -> Any:
    moved = type(mean)(
        *(m + s * normal[i] for i, (m, s) in enumerate(zip(mean, sigma, strict=True)))
    )
    return independent(moved, sigma)


def _read_absolute(state: InteractingState) -> Reading:
    belief = state.combined
    return Reading(
        belief.mean.k_t,
        jnp.sqrt(belief.cov[4][4]),
        jnp.exp(state.log_probabilities),
        state.members.mean.k_t,
    )


def _read_relative(state: InteractingState) -> Reading:
    belief = state.combined
    stiffness = jnp.exp(belief.mean.ln_k_t)
    return Reading(
        stiffness,
        stiffness * jnp.sqrt(belief.cov[4][4]),
        jnp.exp(state.log_probabilities),
        jnp.exp(state.members.mean.ln_k_t),
    )


def class_a_printed(
    cars: Mapping[str, QuarterCar], dt: float, convention: str, noise: float = NOISE
) -> Candidate:
    """The printed filter's class A member by itself, the paper's yardstick."""
    return printed(cars, dt, ("A",), convention, name="as printed, class A alone", noise=noise)


def class_a_corrected(
    cars: Mapping[str, QuarterCar], dt: float, convention: str, noise: float = NOISE
) -> Candidate:
    """The corrected filter's class A member by itself."""
    return corrected(cars, dt, ("A",), convention, name="corrected, class A alone", noise=noise)


def all_printed(
    cars: Mapping[str, QuarterCar], dt: float, convention: str, noise: float = NOISE
) -> Candidate:
    """The printed filter over all classes of `cars`."""
    return printed(cars, dt, convention=convention, noise=noise)


def all_corrected(
    cars: Mapping[str, QuarterCar], dt: float, convention: str, noise: float = NOISE
) -> Candidate:
    """The corrected filter over all classes of `cars`."""
    return corrected(cars, dt, convention=convention, noise=noise)
