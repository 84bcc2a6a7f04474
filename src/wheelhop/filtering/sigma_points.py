"""Sigma-point rules: where the points lie and what they weigh.

Every rule here is a central point plus n symmetric pairs, mean +- spread * column_j of the
Cholesky factor. A pair is kept as its odd and even part, which gives covariances as sums of
squares: nothing is subtracted.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp

from wheelhop.filtering import smallmat
from wheelhop.filtering.interface import Lower, Named


class SigmaRule(NamedTuple):
    """A symmetric rule for n dimensions.

    Attributes:
        spread: distance of the points in Cholesky columns.
        pair_weight: weight of each of the 2n outer points, in mean and covariance.
        center_mean: weight of the central point in the mean.
        center_cov: weight of the central point in the covariance.
    """

    spread: float
    pair_weight: float
    center_mean: float
    center_cov: float

    @property
    def has_center(self) -> bool:
        """Whether the central point must be evaluated at all."""
        return self.center_mean != 0.0 or self.center_cov != 0.0


Rule = Callable[[int], SigmaRule]
"""A rule for any dimension: n -> SigmaRule."""


class Moments(NamedTuple):
    """Moments of a function of a Gaussian, from its sigma points.

    Attributes:
        mean: a NamedTuple, what the function returned.
        odd: per entry, [n, ...]: the matrix G with cov(x, f) = L G^T and cov(f) = G G^T + even.
        even: lower triangle of the part of cov(f) that is even in x: its nonlinearity.
    """

    mean: Named
    odd: tuple[Any, ...]
    even: Lower


def scaled(alpha: float = 1.0, beta: float = 2.0, kappa: float = 0.0) -> Rule:
    """Scaled unscented rule of Julier, Uhlmann and Merwe (Wan & van der Merwe 2000).

    The defaults keep every weight nonnegative. A small alpha puts weights of 1/alpha^2 on
    differences of nearly equal numbers.

    Raises:
        ValueError: when used, if alpha^2 (n + kappa) is not positive.
    """

    def rule(n: int) -> SigmaRule:
        total = alpha**2 * (n + kappa)
        if not total > 0:
            raise ValueError(
                f"alpha={alpha}, kappa={kappa}: alpha^2 (n + kappa) = {total} must be positive "
                f"for n = {n}; raise kappa above {-n} and alpha above 0"
            )
        center = (total - n) / total
        return SigmaRule(math.sqrt(total), 0.5 / total, center, center + 1 - alpha**2 + beta)

    return rule


def cubature(n: int) -> SigmaRule:
    """Third-degree spherical-radial rule (Arasaratnam & Haykin 2009): 2n equal points."""
    return SigmaRule(math.sqrt(n), 0.5 / n, 0.0, 0.0)


def transform(
    function: Callable[[Named], Named], mean: Named, factor: Lower, rule: SigmaRule
) -> Moments:
    """Moments of `function(x)` for x ~ N(mean, L L^T), exact to the rule's degree.

    Args:
        function: elementwise map of the named components; evaluated once, on entries
            [2n or 2n + 1] that hold all sigma points.
        mean: named components.
        factor: lower Cholesky factor L of the covariance.
        rule: the sigma-point rule for n = len(mean).
    """
    n = len(mean)
    points = []
    for component, row in zip(mean, smallmat.rows_of(factor), strict=True):
        center = component[None]
        parts = [center + rule.spread * row, center - rule.spread * row]
        points.append(jnp.concatenate([*parts, center] if rule.has_center else parts))
    values = function(type(mean)(*points))
    shape = points[0].shape
    values = type(values)(*(jnp.broadcast_to(v, shape) for v in values))

    pair_sum = [v[:n] + v[n : 2 * n] for v in values]
    average = [rule.pair_weight * jnp.sum(s, 0) for s in pair_sum]
    if rule.has_center:
        average = [m + rule.center_mean * v[2 * n] for m, v in zip(average, values, strict=True)]
    scale = math.sqrt(2.0 * rule.pair_weight)
    odd = tuple(0.5 * scale * (v[:n] - v[n : 2 * n]) for v in values)
    deviation = [scale * (0.5 * s - m[None]) for s, m in zip(pair_sum, average, strict=True)]
    even = smallmat.gram(deviation)
    if rule.center_cov != 0.0:
        center_dev = [v[2 * n] - m for v, m in zip(values, average, strict=True)]
        even = tuple(
            tuple(
                entry + rule.center_cov * center_dev[i] * center_dev[j]
                for j, entry in enumerate(row)
            )
            for i, row in enumerate(even)
        )
    return Moments(type(values)(*average), odd, even)
