"""Brancati & Tufano's filter as the paper prints it; every misprint can be switched off.

One unscented filter per road class over x = (z_s, z_u, v_s, v_u, k_t) in absolute coordinates, an
Euler step, and as input an artificial road of that class, which has nothing to do with the road
under the wheel. It exists to be measured against: `immuf` is the corrected filter.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from wheelhop.estimators.immuf import sticky
from wheelhop.estimators.printed_interacting import PrintedForms, printed_interacting
from wheelhop.filtering import Filter, InteractingParams, StateSpaceModel, cubature, unscented
from wheelhop.filtering.sigma_points import Rule
from wheelhop.staging import stage
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.quarter_car import (
    AbsoluteState,
    Accelerations,
    absolute_derivative,
    printed_accelerations,
    printed_step,
)
from wheelhop.vehicle.road.shape_filter import elevations


class AbsoluteCorner(NamedTuple):
    """The paper's state: z_s, z_u [m], v_s, v_u [m/s] and k_t [N/m]."""

    z_s: Any
    z_u: Any
    v_s: Any
    v_u: Any
    k_t: Any


class ArtificialRoad(NamedTuple):
    """Elevation [m] of the filter's own road before and after a step, one per mode."""

    before: Any
    now: Any


@dataclass(frozen=True)
class Misprints:
    """Which misprints are kept; False takes the resolution instead.

    Attributes:
        damping: Eq. 1, 15, 16: quadratic damping with the same sign on both masses; resolved as
            c_snl w|w|, which obeys Newton's third law.
        prediction: Eq. 9: mu = Pz mu; resolved with the transpose of the row-stochastic Pz. The
            same for the paper's symmetric Pz.
        weights: Eq. 10, 11: mixing weights of the predicted probabilities, which do not sum to
            one; resolved with those of the step before.
        spread: Eq. 11: no spread of the means in the mixed covariance.
        determinant: Eq. 12: 1/det(Pyy) in the likelihood; resolved as 1/sqrt(det(2 pi Pyy)).
        sensors: Eq. 19, 22: standard deviations on the diagonal of R; resolved as variances.
    """

    damping: bool = True
    prediction: bool = True
    weights: bool = True
    spread: bool = True
    determinant: bool = True
    sensors: bool = True


NONE_OF_THEM = Misprints(*(False for _ in fields(Misprints)))
"""Every misprint resolved; the artificial road and the Euler step stay."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class PrintedParams:
    """Parameters of one member; the road varies in time and is bound at each step.

    Attributes:
        car: the corner.
        road: artificial road of the member.
        dt: sampling interval [s].
        q: q_1 to q_5 of Eq. 18, process variances over dt^3 [unit^2/s^3], by state.
        noise_a_s, noise_a_u: standard deviations of the accelerometers [m/s^2].
    """

    car: QuarterCar
    road: ArtificialRoad
    dt: Any
    q: AbsoluteCorner
    noise_a_s: Any
    noise_a_u: Any


def printed_model(misprints: Misprints = Misprints()) -> StateSpaceModel:
    """Eq. 15, 16, 18 and 19 of Brancati & Tufano 2022."""

    def motion(x: AbsoluteCorner) -> AbsoluteState:
        return AbsoluteState(x.z_s, x.z_u, x.v_s, x.v_u)

    def transition(x: AbsoluteCorner, params: PrintedParams) -> AbsoluteCorner:
        dt, road = params.dt, params.road.before
        if misprints.damping:
            after = printed_step(motion(x), x.k_t, road, dt, params.car)
        else:
            slope = absolute_derivative(motion(x), x.k_t, road, params.car)
            after = jax.tree.map(lambda a, b: a + dt * b, motion(x), slope)
        return AbsoluteCorner(*after, x.k_t)

    def observation(x: AbsoluteCorner, params: PrintedParams) -> Accelerations:
        road = params.road.now
        if misprints.damping:
            return printed_accelerations(motion(x), x.k_t, road, params.car)
        slope = absolute_derivative(motion(x), x.k_t, road, params.car)
        return Accelerations(slope.v_s, slope.v_u)

    def process_cov(x: AbsoluteCorner, params: PrintedParams) -> tuple:
        del x
        cube = params.dt**3
        zero = 0.0 * cube
        return tuple((*[zero] * i, q * cube) for i, q in enumerate(params.q))

    def observation_cov(params: PrintedParams) -> tuple:
        s, u = params.noise_a_s, params.noise_a_u
        return ((s,), (0.0, u)) if misprints.sensors else ((s**2,), (0.0, u**2))

    return StateSpaceModel(stage(transition), stage(observation), process_cov, observation_cov)


@lru_cache(maxsize=64)
def printed_immuf(misprints: Misprints = Misprints(), rule: Rule = cubature) -> Filter:
    """The paper's IMM of unscented filters, Eq. 9-19."""
    forms = PrintedForms(
        misprints.prediction, misprints.weights, misprints.spread, misprints.determinant
    )
    return printed_interacting(unscented(printed_model(misprints), rule), forms)


def printed_params(
    cars: QuarterCar,
    dt: Any,
    q: AbsoluteCorner,
    noise: Any = 0.5,
    stay: Any = 0.97,
) -> InteractingParams:
    """Parameters of the printed filter, one member per car; pure.

    Args:
        cars: the corner as each class's member models it, every leaf an array [modes].
        dt: sampling interval [s].
        q: q_1 to q_5 of Eq. 18.
        noise: of both accelerometers [m/s^2].
        stay: diagonal of Pz, Eq. 17.
    """
    masses = cars.sprung_mass

    def each(number: Any) -> Any:
        return jnp.broadcast_to(jnp.asarray(number, masses.dtype), masses.shape)

    level = ArtificialRoad(each(0.0), each(0.0))
    members = PrintedParams(
        cars, level, each(dt), AbsoluteCorner(*map(each, q)), each(noise), each(noise)
    )
    return InteractingParams(members, *sticky(masses.shape[0], stay))


def bind_road(params: InteractingParams, road: ArtificialRoad) -> InteractingParams:
    """The parameters at a time with these roads [modes]."""
    return replace(params, members=replace(params.members, road=road))


def artificial_roads(key: Any, speed: Any, dt: Any, variances: Any) -> ArtificialRoad:
    """Roads of every class at the distances driven, Eq. 6; pure, so it maps over runs.

    Args:
        key: JAX random key.
        speed: v [m/s], [time].
        dt: sampling interval [s].
        variances: sigma^2 of each class [m^2], [modes].

    Returns:
        Elevations before and after every step, each [time, modes].
    """
    keys = jax.random.split(key, variances.shape[0])
    z = jax.vmap(lambda k, variance: elevations(k, variance, speed * dt))(keys, variances)
    return ArtificialRoad(z[:, :-1].T, z[:, 1:].T)
