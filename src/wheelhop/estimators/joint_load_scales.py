"""How stiff springs and dampers truly are, from a record with a_x and a_y.

Springs that are not what they are thought to be spoil a load transfer in proportion, since the
transfer is read off their compression. Accelerometers forward and to the left tell the moments of
the tyres' horizontal forces, -m a_x h about the lateral and m a_y h about the longitudinal axis,
which the struts must balance: while braking or cornering the springs are weighed. The loads are
then found with the scales of the whole record, by a filter that is told no moments.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from scipy.special import softmax

from wheelhop.errors import DivergenceError, InputWarning
from wheelhop.estimators.joint_load_model import (
    NEAR,
    joint_load_prior,
    motion_model,
    motion_noise,
    sensor_noise,
)
from wheelhop.estimators.joint_load_params import JointLoadParams
from wheelhop.filtering import Filter, Gaussian, StateSpaceModel, independent, scaled, unscented
from wheelhop.filtering.interface import Lower

RUNAWAY = 4.0
"""Scale of springs or dampers beyond which, or below whose inverse, they are not believed."""

SURPRISING = 2.0
"""Innovation squared per entry from which on a_x and a_y are said not to fit."""


@dataclass(frozen=True)
class Scales:
    """Of the springs' stiffness and of the dampers' force, per those of the vehicle.

    Attributes:
        value: [2].
        ln_sigma: standard deviations of their logarithms, [2].
    """

    value: np.ndarray
    ln_sigma: np.ndarray


class ScaledLoadBelief(NamedTuple):
    """State of the filter; the first 15 entries are those of `JointLoadBelief`.

    Attributes:
        ln_spring: logarithm of the springs' rate over what it is thought to be; their force at the
            design place is taken as known.
        ln_damper: the same of the dampers' force.
    """

    s_FL: Any
    s_FR: Any
    s_RL: Any
    s_RR: Any
    w_FL: Any
    w_FR: Any
    w_RL: Any
    w_RR: Any
    load_FL: Any
    load_FR: Any
    load_RL: Any
    load_RR: Any
    roll_moment: Any
    pitch_moment: Any
    ln_mass: Any
    ln_spring: Any
    ln_damper: Any


@lru_cache(maxsize=1)
def scaled_load_model() -> StateSpaceModel:
    """State-space model over `ScaledLoadBelief`, `VehicleLoadSample` and `JointLoadParams`.

    `a_x` and `a_y` of the parameters are those of the sample, finite.
    """
    transition, observation = motion_model(
        lambda b: (jnp.exp(b.ln_spring)[None], jnp.exp(b.ln_damper)[None])
    )

    def process_cov(b: ScaledLoadBelief, p: JointLoadParams) -> Any:
        rows = [list(row) for row in motion_noise(len(b), p, p.tuning.told_moment_walk)]
        for k in (15, 16):
            rows[k][k] = p.tuning.scale_walk**2 * p.dt
        # noise of a_x and a_y moves the body that is predicted
        for i, row in enumerate(_told_noise(p)):
            for j, entry in enumerate(row):
                rows[4 + i][4 + j] = rows[4 + i][4 + j] + p.dt**2 * entry
        return tuple(tuple(row) for row in rows)

    return StateSpaceModel(transition, observation, process_cov, _observation_cov)


@lru_cache(maxsize=1)
def scaled_load_filter() -> Filter:
    """Unscented filter of the model; entries of a sample that are NaN are left out."""
    return unscented(scaled_load_model(), scaled(alpha=NEAR))


def scaled_load_prior(p: JointLoadParams) -> Gaussian:
    """Belief before the first sample: near rest, the scales about one."""
    t, z = p.tuning, jnp.zeros_like(p.body_mass)
    known = joint_load_prior(p)
    spread = [jnp.sqrt(known.cov[k][k]) for k in range(len(known.mean))]
    spread[12] = spread[13] = z + t.told_moment
    scale = z + t.scale_prior
    return independent(
        ScaledLoadBelief._make((*known.mean, z, z)), ScaledLoadBelief._make((*spread, scale, scale))
    )


def _observation_cov(p: JointLoadParams) -> Any:
    """Noise of the sensors, and of a_x and a_y as they move the body in the model."""
    rows = [list(row) for row in sensor_noise(p)]
    for i, row in enumerate(_told_noise(p)):
        for j, entry in enumerate(row):
            rows[i][j] = rows[i][j] + entry
    return tuple(tuple(row) for row in rows)


def _told_noise(p: JointLoadParams) -> Lower:
    """Covariance of the body's accelerations above the wheels by the noise of a_x and a_y."""
    total = p.body_mass + jnp.sum(p.wheel_mass, 0)
    moment = (p.tuning.horizontal_acceleration * total * p.lever) ** 2
    along, across = moment / p.pitch_inertia**2, moment / p.roll_inertia**2
    return tuple(
        tuple(along * p.x[i] * p.x[j] + across * p.y[i] * p.y[j] for j in range(i + 1))
        for i in range(4)
    )


def scales_of(
    last: np.ndarray, variance: np.ndarray, log_likelihood: np.ndarray, doubt: tuple[float, float]
) -> Scales:
    """What a bank of filters says of the scales at the end of a record.

    The bank's members are weighed by how well each has foretold the whole record, in effect the
    best alone counts: one that lets the loads change too slowly for the road takes their changes
    for those of springs and dampers. Members that have left the finite numbers are left out.

    Args:
        last: logarithms of the scales, [members, 2].
        variance: theirs, [members, 2].
        log_likelihood: of the whole record, [members].
        doubt: of springs and dampers, relative, that no noise explains.

    Raises:
        DivergenceError: if no member has kept finite numbers.
    """
    finite = np.isfinite(last).all(1) & np.isfinite(variance).all(1) & np.isfinite(log_likelihood)
    if not finite.any():
        raise DivergenceError(
            "the filter of the springs' scale leaves the finite numbers; check the units of the "
            "record, the vehicle, and the noise of the tuning"
        )
    last, variance = last[finite], variance[finite]
    weight = softmax(log_likelihood[finite])
    mean = weight @ last
    spread = weight @ (variance + (last - mean) ** 2) + np.square(doubt)
    return Scales(np.exp(mean), np.sqrt(spread))


def tell_doubts(scales: Scales, surprise: float) -> None:
    """Warn of scales that are not to be believed.

    Args:
        scales: found.
        surprise: normalised innovation squared per entry, about one where a_x and a_y, sensors and
            struts agree.
    """
    check = (
        "Check a_x (forward) and a_y (to the left): signs, unit, place at the centre of mass; the "
        "vehicle, the shape of its dampers' curve, and the noise of the sensors. The loads are not "
        "to be trusted."
    )
    for name, one in zip(("springs", "dampers"), scales.value, strict=True):
        if not 1.0 / RUNAWAY < one < RUNAWAY:
            warnings.warn(
                f"the {name} seem {one:.3g} times as strong as those of the vehicle: no scale "
                f"explains the record. {check}",
                InputWarning,
                stacklevel=3,
            )
    if surprise > SURPRISING:
        warnings.warn(
            f"a_x and a_y do not fit what the struts do: innovations squared are {surprise:.3g} "
            f"times those expected. {check}",
            InputWarning,
            stacklevel=3,
        )
