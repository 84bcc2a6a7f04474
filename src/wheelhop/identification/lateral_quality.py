"""How far a fit of tyres is to be believed: errors, stiffnesses, and what speaks against it."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.identification.lateral_loss import Task
from wheelhop.identification.lateral_records import Cornering
from wheelhop.identification.lateral_step import LIMIT, Descent, eliminated
from wheelhop.identification.loss import Sums
from wheelhop.identification.parameters import SearchSpace
from wheelhop.identification.uncertainty import Uncertainty, uncertainty
from wheelhop.vehicle.lateral_tire import arctangent_stiffness
from wheelhop.vehicle.two_track import Wheels, wheel_loads

WEAK = 0.1
"""Relative standard error of a combination of coefficients beyond which it is called weak."""

POOR_FIT = 2.0
"""Errors, in units of the stated noise, beyond which a fit is called poor."""


def standard_errors(
    sums: Any,
    prepared: Cornering,
    values: np.ndarray,
    slopes: np.ndarray,
    names: tuple[str, ...],
) -> Uncertainty:
    """Standard errors after the records' own numbers are allowed for.

    Args:
        sums: at the estimate, by parameters.
        prepared: the records.
        values: coefficients p, [n].
        slopes: d ln p / d parameters, [n, n].
        names: of the coefficients.
    """
    parts = jax.tree.map(np.asarray, eliminated(jax.tree.map(jnp.asarray, sums)))
    n = len(values)
    scores = sums.scores[..., :n] - np.einsum("rij,rbj->rbi", parts.passed, sums.scores[..., n:])
    back = np.linalg.inv(slopes)
    scores, by_record = scores @ back, back.T @ parts.normal @ back
    counts = prepared.counted.sum((1, 2))
    # only how many blocks there are, and their sum, matters of the matrix
    real = prepared.counted.reshape(len(counts), prepared.blocks, -1).any(2)
    share = real / real.sum(1, keepdims=True)
    normal = np.einsum("rb,rij->rbij", share, by_record)
    squares = share * sums.squares.sum(1)[:, None]
    each = Sums(squares[:, :, None], scores[:, :, None], normal[:, :, None])
    one = np.ones((len(counts), 1))
    space = SearchSpace(names, (0.0,) * n, (np.inf,) * n)
    return uncertainty(each, one, counts[:, None], values, values, space)


def relative_covariance(known: Uncertainty, values: np.ndarray) -> np.ndarray:
    """Of the logarithms of the coefficients, for white residuals, [n, n]."""
    relative = known.standard_errors / values
    return known.correlation * np.outer(relative, relative)


def static_stiffness(
    tires: Wheels, task: Task, known: Uncertainty, values: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Cornering stiffnesses under static load [4] and their standard errors."""
    car = jax.tree.map(float, task.car)
    stiffness, slopes = np.zeros(4), np.zeros((4, 3))
    for k, (load, tire) in enumerate(zip(wheel_loads(0.0, car), tires, strict=True)):
        stiffness[k] = float(arctangent_stiffness(load, tire))
        bracket = max(tire.k1 - load / tire.k2, np.finfo(float).tiny)
        slopes[k] = tire.k1 / bracket, load / tire.k2 / bracket, 1.0
    if not np.isfinite(known.standard_errors).all():
        return stiffness, np.full(4, np.nan)
    change = np.einsum("wc,wcn->wn", slopes, np.asarray(task.assigned))
    variance = np.einsum("wi,ij,wj->w", change, relative_covariance(known, values), change)
    return stiffness, stiffness * np.sqrt(np.maximum(variance, 0.0))


def problems_of(
    found: Descent,
    best: int,
    sums: Any,
    prepared: Cornering,
    names: tuple[str, ...],
    known: Uncertainty,
    loss: float,
) -> tuple[str, ...]:
    """What speaks against a fit, in plain words.

    Args:
        found: all starts.
        best: the one that is taken.
        sums: of its residuals.
        prepared: the records.
        names: of the coefficients.
        known: their uncertainty.
        loss: errors in units of the stated noise, rms.
    """
    problems = []
    if not found.converged[best]:
        problems.append(
            f"the best of {len(found.loss)} starts was still descending when it ended; allow more "
            "iterations, or start elsewhere"
        )
    problems += [
        f"{name} ran to the end of the search, far from its start"
        for name, moved in zip(names, found.theta[best], strict=True)
        if abs(moved) > 0.99 * LIMIT
    ]
    problems += [
        f"the records, which corner at {prepared.peak:.2g} m/s^2, hardly determine {direction}; "
        "corner harder, or hold one of these coefficients"
        for direction in known.directions
        if not direction.relative_error < WEAK
    ]
    guarded = float(sums.overloaded.sum() / prepared.counted.any(2).sum())
    if guarded > 0.0:
        problems.append(
            f"in {guarded:.1%} of the samples a wheel lifts or carries more than k1 k2, where the "
            "arctangent tyre has no force"
        )
    if loss > POOR_FIT:
        problems.append(
            f"the errors are {loss:.2g} times the stated noise: the tyres or the vehicle are not "
            "of the model's form, or the noise is stated too small; errors in time are then "
            "correlated, and the robust standard errors hold"
        )
    return tuple(problems)
