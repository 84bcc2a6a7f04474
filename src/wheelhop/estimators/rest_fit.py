"""Weighted least squares over what a vehicle's stands tell of its mass and centre of mass."""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import jax
import numpy as np
from scipy.optimize import least_squares

from wheelhop.estimators.rest_equations import equations, known_of
from wheelhop.vehicle.full_vehicle_state import FullVehicle

_ROUNDS = 3

RANK_TOLERANCE = 1e-3
"""A singular value below this part of the largest counts as none: there 0.1 % of a corner's force
would move the unknown by all of its size. A body that leans 0.2 deg on level ground stays below."""


class RestProblem(NamedTuple):
    """What is fitted.

    Attributes:
        method: "printed" or "equilibrium".
        car: parameters, as arrays.
        measured: q FL, FR, RL, RR, a_x, a_y of every stand, [stands, 6].
        noise: their variances, [6].
        low, high: bounds of the four unknowns, [4].
        scale: size of the four unknowns, [4].
    """

    method: str
    car: FullVehicle
    measured: np.ndarray
    noise: np.ndarray
    low: np.ndarray
    high: np.ndarray
    scale: np.ndarray


class RestFit(NamedTuple):
    """What fits best.

    Attributes:
        theta: sprung mass and place of its centre, [4].
        jacobian: of the equations, [stands, equations, 4].
        whitened: the same in standard deviations, rows of all stands, [rows, 4].
        residual: misfit in standard deviations, [rows].
        told: total mass, l_F, w_L and h, [4].
        outward: their slopes with respect to theta, [4, 4].
    """

    theta: np.ndarray
    jacobian: np.ndarray
    whitened: np.ndarray
    residual: np.ndarray
    told: np.ndarray
    outward: np.ndarray


def fit_rest(problem: RestProblem, start: np.ndarray, free: int) -> RestFit:
    """Weighted least squares over the first `free` of four unknowns."""
    theta = start
    evaluate, car = equations(problem.method), known_of(problem.car)

    @lru_cache(maxsize=1)
    def looked_up(unknown: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
        each = [jax.device_get(evaluate(np.r_[unknown, y], car)) for y in problem.measured]
        value, slopes = zip(*each, strict=True)
        return np.stack(value), np.stack(slopes)

    def at(unknown: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return looked_up(tuple(unknown.tolist()))

    weights = _whitener(at(theta)[1], problem.noise)
    for _ in range(_ROUNDS):

        def residual(part: np.ndarray, weights: Any = weights, rest: Any = theta[free:]) -> Any:
            return np.einsum("sij,sj->si", weights, at(np.r_[part, rest])[0][:, :-4]).ravel()

        def slope(part: np.ndarray, weights: Any = weights, rest: Any = theta[free:]) -> Any:
            jacobian = at(np.r_[part, rest])[1][:, :-4, :free]
            return np.einsum("sij,sjk->sik", weights, jacobian).reshape(-1, free)

        found = least_squares(
            residual,
            theta[:free],
            slope,
            bounds=(problem.low[:free], problem.high[:free]),
            x_scale=problem.scale[:free],
            xtol=1e-13,
            ftol=1e-13,
            gtol=1e-13,
        )
        theta = np.r_[found.x, theta[free:]]
        value, slopes = at(theta)
        before, weights = weights, _whitener(slopes, problem.noise)
        if np.allclose(before, weights, rtol=1e-3, atol=0.0):
            break
    jacobian = slopes[:, :-4, :4]
    whitened = np.einsum("sij,sjk->sik", weights, jacobian).reshape(-1, 4)
    misfit = np.einsum("sij,sj->si", weights, value[:, :-4]).ravel()
    told, outward = value[:, -4:].mean(0), slopes[:, -4:, :4].mean(0)
    return RestFit(theta, jacobian, whitened, misfit, told, outward)


def _whitener(slopes: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Inverse square roots of the equations' covariances, [stands, equations, equations]."""
    by_data = slopes[:, :-4, 4:]
    return np.linalg.inv(np.linalg.cholesky(np.einsum("sij,j,skj->sik", by_data, noise, by_data)))


def covariance_at(whitened: np.ndarray, free: int) -> np.ndarray:
    """Of the first `free` unknowns, the others' zero; infinite where they are not told, [4, 4]."""
    cov = np.zeros((4, 4))
    normal = whitened[:, :free].T @ whitened[:, :free]
    size = 1.0 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
    scaled = size[:, None] * normal * size
    if np.linalg.matrix_rank(scaled, tol=1e-13) < free:
        return np.full((4, 4), np.inf)
    cov[:free, :free] = size[:, None] * np.linalg.inv(scaled) * size
    return cov


def tells_height(fit: RestFit, scale: np.ndarray, rows: np.ndarray, prior_sd: float) -> bool:
    """Whether rank and noise let the stands tell the height better than a prior [m] does."""
    by_data = covariance_at(fit.whitened, 4)[3, 3]
    return singular_values_at(fit, scale, rows)[1] == 4 and bool(by_data < prior_sd**2)


def singular_values_at(fit: RestFit, scale: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, int]:
    """Singular values of the scaled Jacobian, [4], and how many count."""
    relative = (fit.jacobian / rows[:, None] * scale).reshape(-1, 4)
    values = np.zeros(4)
    found = np.linalg.svd(relative, compute_uv=False)
    # what rounding makes of a column that has no effect is none
    values[: found.size] = np.where(found > 1e-14 * found[0], found, 0.0)
    return values, int(np.sum(values > RANK_TOLERANCE * values[0]))
