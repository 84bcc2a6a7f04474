"""The Kalman filter: a linear Gaussian model given by its matrices."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax

from wheelhop.filtering.extended import extended
from wheelhop.filtering.interface import Filter, Lower, Named, StateSpaceModel


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class LinearGaussian:
    """x' = F x + w, y = H x + v.

    Attributes:
        transition: F [n, n].
        observation: H [m, n].
        process_cov: cov(w) [n, n]; may be of any rank.
        observation_cov: cov(v) [m, m].
    """

    transition: Any
    observation: Any
    process_cov: Any
    observation_cov: Any


def kalman(measurement: type) -> Filter:
    """Kalman filter whose parameters are the matrices of a `LinearGaussian`.

    Kalman 1960; the covariance update is a sum of squares, so it stays positive semidefinite.

    Args:
        measurement: NamedTuple type of the measurement, its fields in the order of H's rows.

    Returns:
        A `Filter` over `Gaussian` states of any NamedTuple type and `LinearGaussian` parameters.
    """
    return extended(linear_model(measurement))


def linear_model(measurement: type) -> StateSpaceModel:
    """State-space model whose parameters are the matrices of a `LinearGaussian`."""

    def transition(x: Named, params: LinearGaussian) -> Named:
        return type(x)(*_product(params.transition, x))

    def observation(x: Named, params: LinearGaussian) -> Named:
        return measurement(*_product(params.observation, x))

    def process_cov(x: Named, params: LinearGaussian) -> Lower:
        del x
        return _lower(params.process_cov)

    def observation_cov(params: LinearGaussian) -> Lower:
        return _lower(params.observation_cov)

    return StateSpaceModel(transition, observation, process_cov, observation_cov)


def _lower(matrix: Any) -> Lower:
    return tuple(tuple(matrix[i, j] for j in range(i + 1)) for i in range(matrix.shape[0]))


def _product(matrix: Any, x: Named) -> list[Any]:
    rows, columns = matrix.shape[:2]
    return [sum(matrix[i, j] * x[j] for j in range(columns)) for i in range(rows)]
