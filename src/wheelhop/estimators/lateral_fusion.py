"""One posterior of four tyres from how the car corners and from how its wheels hop.

A lateral estimator gives the probability of every combination h of levels, each level a pressure
that was assumed; a vertical one a Gaussian over x = ln k_t of the four tyres. Both speak of the
same tyres, and are taken as independent given these (a wrong load, or a wrong belief about what
pressure does, moves both), so that

    p(h, x | both) ~ p(h | lateral) N(x; a_h, D_h^2) l(x),

a_h and D_h being what the levels stand for, and l(x) the likelihood of the vertical data alone:
the belief divided by its own prior (`vertical_evidence`), which would otherwise count beside that
of the levels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import logsumexp, ndtr

from wheelhop.errors import InputError, require_in_range
from wheelhop.estimators.failure_modes import level_table
from wheelhop.estimators.pressure import StiffnessBelief
from wheelhop.estimators.vertical_evidence import VerticalEvidence
from wheelhop.filtering.smallmat import log_det
from wheelhop.filtering.symmetric import factor_of, inverse, solved, whitened
from wheelhop.vehicle.tire import (
    Tire,
    pressure_from_stiffness,
    pressure_slope,
    require_stiff,
    stiffness_from_pressure,
)

LOW = 0.85
"""Default pressure, relative to the sound one, under which a tyre is called low."""

_WHEELS = 4
_RIDGE = 1e-6


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class FusionParams:
    """What the levels stand for; see `fusion_params`.

    Attributes:
        reference: ln k_t of a sound tyre, from which x is counted, [4].
        level: x of every mode, [modes, 4].
        spread: its standard deviation [-], [modes, 4].
        log_prior: of the modes, [modes].
        at_zero: pressure at which the law has no stiffness [Pa], [4].
        per_ratio: pressure per stiffness over that of a sound tyre [Pa], [4].
        low: x under which a tyre is low, [4].
    """

    reference: Any
    level: Any
    spread: Any
    log_prior: Any
    at_zero: Any
    per_ratio: Any
    low: Any


class Fused(NamedTuple):
    """What both say.

    Attributes:
        log_probabilities: of the modes, [modes].
        pressure: mean [Pa], [4].
        pressure_sd: [Pa], [4].
        low: probability that a tyre is low, [4].
        stiffness: mean and covariance of ln k_t, [4], [4, 4], as `alarms` takes them.
        agreement: ln Bayes factor of one set of tyres behind both over two sets that have nothing
            to do with each other; negative where the two contradict each other, zero where one of
            them is silent.
        distance: squared distance of the vertical estimate from the lateral one over the covariance
            of their difference; of the order of `degrees` where both are right.
        degrees: directions that the vertical data tell of.
        gap: vertical less lateral estimate of every tyre, in standard deviations, [4].
    """

    log_probabilities: Any
    pressure: Any
    pressure_sd: Any
    low: Any
    stiffness: StiffnessBelief
    agreement: Any
    distance: Any
    degrees: Any
    gap: Any


def fusion_params(
    pressures: Sequence[float] | np.ndarray,
    tire: Tire,
    *,
    spread: float | None = None,
    prior: Any = None,
    low: float | None = None,
) -> FusionParams:
    """Parameters of `fuse`, checked.

    A bank tries a few pressures, a tyre has any: a level stands for the pressures around it.
    Half the distance between levels as their standard deviation leaves no gap between them.

    Args:
        pressures: of the levels from the softest to the sound one [Pa], [levels] or [levels, 4].
        tire: vertical law, entries [] or [4].
        spread: standard deviation of the pressure about its level [Pa]; half the distance of
            neighbouring levels by default, where these differ that of the closest.
        prior: probabilities of the modes before any data, as the lateral estimator has them; equal
            by default.
        low: pressure under which a tyre is low [Pa]; `LOW` times the sound one by default.

    Raises:
        InputError: naming what is out of range.
    """
    levels = np.asarray(pressures, float)
    if levels.ndim == 1:
        levels = np.repeat(levels[:, None], _WHEELS, axis=1)
    if levels.ndim != 2 or levels.shape[1] != _WHEELS:
        raise InputError("pressures", f"has shape {levels.shape}", "Give [levels] or [levels, 4].")
    table = level_table(len(levels))
    for value in levels.ravel():
        require_in_range("pressures", value, 2e4, 1.5e6, "Pa")
    steps = np.diff(levels, axis=0)
    if not (steps > 0).all():
        raise InputError("pressures", f"{levels.tolist()} do not rise", "Begin with the softest.")
    width = 0.5 * float(steps.min()) if spread is None else spread
    require_in_range("spread", width, 0.0, 1e6, "Pa")
    below = LOW * levels[-1] if low is None else np.full(_WHEELS, low)
    for value in below:
        require_in_range("low", value, 2e4, 1.5e6, "Pa")
    law = jax.tree.map(lambda a: np.broadcast_to(np.asarray(a, float), (_WHEELS,)), tire)
    softest = np.minimum(levels[0], below)
    for k in range(_WHEELS):
        require_stiff(jax.tree.map(lambda a, k=k: a[k], law), softest[k])

    stiffness = np.asarray(stiffness_from_pressure(levels, law))
    reference = np.log(stiffness[-1])
    slope = np.asarray(pressure_slope(law))
    chosen = (table, np.arange(_WHEELS))
    kind = jnp.result_type(float)
    found = FusionParams(
        reference,
        (np.log(stiffness) - reference)[chosen],
        (width / (slope * stiffness))[chosen],
        np.log(_probabilities(prior, len(table))),
        np.asarray(pressure_from_stiffness(np.zeros(_WHEELS), law)),
        slope * stiffness[-1],
        np.log(np.asarray(stiffness_from_pressure(below, law))) - reference,
    )
    return jax.tree.map(lambda a: jnp.asarray(a, kind), found)


def fuse(log_probabilities: Any, evidence: VerticalEvidence, params: FusionParams) -> Fused:
    """Posterior of one instant from both estimators; map it over time.

    Every mode is a Gaussian that the measurement z corrects, with B = I + D H'H D:
    y = B^-1 D H' (z - H a), mean a + D y, covariance D B^-1 D, and
    ln Z = -(|z - H (a + D y)|^2 + |y|^2 + ln |B|) / 2, which weighs the mode. The pressure is
    linear in k_t = exp(ln k_t), whose moments are those of lognormal numbers.

    The lateral estimator alone is `fuse` with `no_evidence`, the vertical one alone `fuse` with
    the prior's probabilities.

    Args:
        log_probabilities: of the modes by the lateral estimator, prior included, [modes].
        evidence: of the vertical one.
        params: of the fusion.
    """
    a, d = params.level, params.spread
    matrix, value = evidence
    lateral = log_probabilities - logsumexp(log_probabilities)

    def correct(level: Any, spread: Any) -> tuple[Any, Any, Any]:
        scaled = matrix * spread[None, :]
        factor = factor_of(_eye(matrix) + scaled.T @ scaled)
        y = solved(factor, scaled.T @ (value - matrix @ level))
        mean = level + spread * y
        off = value - matrix @ mean
        log_z = -0.5 * (off @ off + y @ y) - 0.5 * log_det(factor)
        root = whitened(factor, spread[:, None] * _eye(matrix))
        return log_z, mean, root.T @ root

    log_z, mean, cov = jax.vmap(correct)(a, d)
    joint = lateral + log_z
    total = logsumexp(joint)
    apart = logsumexp(params.log_prior + log_z)
    weight = jnp.exp(joint - total)
    own = jnp.diagonal(cov, axis1=1, axis2=2)
    pressure, pressure_sd = _pressure(weight, mean, own, params)
    # a level without spread leaves no doubt of its side
    sd = jnp.sqrt(jnp.maximum(own, jnp.finfo(own.dtype).tiny))
    centre, whole = _moments(weight, mean, cov)
    distance, degrees, gap = _contradiction(jnp.exp(lateral), evidence, params)
    return Fused(
        joint - total,
        pressure,
        pressure_sd,
        weight @ ndtr((params.low[None, :] - mean) / sd),
        StiffnessBelief(params.reference + centre, whole),
        total - apart,
        distance,
        degrees,
        gap,
    )


def _pressure(weight: Any, mean: Any, variance: Any, p: FusionParams) -> tuple[Any, Any]:
    """Mean and standard deviation of at_zero + per_ratio exp(x), x a mixture of Gaussians."""
    ratio = jnp.exp(mean + 0.5 * variance)
    centre = weight @ ratio
    within = ratio**2 * jnp.expm1(variance)
    spread = weight @ (within + (ratio - centre[None, :]) ** 2)
    return p.at_zero + p.per_ratio * centre, p.per_ratio * jnp.sqrt(spread)


def _moments(weight: Any, mean: Any, cov: Any) -> tuple[Any, Any]:
    centre = weight @ mean
    off = mean - centre[None, :]
    return centre, jnp.tensordot(weight, cov, axes=1) + (weight[:, None] * off).T @ off


def _contradiction(
    weight: Any, evidence: VerticalEvidence, p: FusionParams
) -> tuple[Any, Any, Any]:
    """Distance of the two estimates, its degrees of freedom, and the gap of every tyre."""
    matrix, value = evidence
    each = (p.spread**2)[:, :, None] * _eye(matrix)[None]
    centre, cov = _moments(weight, p.level, each)
    off = value - matrix @ centre
    factor = factor_of(_eye(matrix) + matrix @ cov @ matrix.T)
    distance = jnp.sum(whitened(factor, off) ** 2)
    degrees = jnp.sum(jnp.any(matrix != 0.0, axis=1))
    information = matrix.T @ matrix
    # a tyre that was not measured is within ten times the scale of the others: no gap
    ridge = _RIDGE * (1.0 + jnp.trace(information))
    alone = inverse(information + ridge * _eye(matrix))
    gap = alone @ (matrix.T @ off) / jnp.sqrt(jnp.diagonal(alone) + jnp.diagonal(cov))
    return distance, degrees, gap


def _eye(like: Any) -> Any:
    return jnp.eye(_WHEELS, dtype=like.dtype)


def _probabilities(prior: Any, modes: int) -> np.ndarray:
    """Of the modes, checked and safe to take the logarithm of."""
    if prior is None:
        return np.full(modes, 1.0 / modes)
    found = np.asarray(prior, float)
    if found.shape != (modes,):
        raise InputError("prior", f"has shape {found.shape} for {modes} modes", "Give one a mode.")
    if not (found > 0).all() or not abs(found.sum() - 1.0) < 1e-4:
        raise InputError(
            "prior",
            f"has entries from {found.min():g} and the sum {found.sum():g}",
            "Give positive probabilities that sum to 1.",
        )
    return found
