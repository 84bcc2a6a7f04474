"""Sigma-point rules: where the points lie and what they weigh.

Every rule here is a central point plus symmetric pairs, mean +- L u. A pair is kept as its odd
and even part, which gives covariances as sums of squares: nothing is subtracted.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache
from itertools import product
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.filtering import smallmat
from wheelhop.filtering.interface import Lower, Named
from wheelhop.filtering.lanes import elementwise
from wheelhop.staging import stage


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


class SigmaRule(NamedTuple):
    """A central point and n pairs along the Cholesky columns, all pairs of one weight.

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

    def points(self, mean: Named, factor: Lower) -> Named:
        """The points for N(mean, L L^T) [k, ...]: pairs first, the central point last."""
        points = []
        for component, row in zip(mean, smallmat.rows_of(factor), strict=True):
            center = component[None]
            parts = [center + self.spread * row, center - self.spread * row]
            points.append(jnp.concatenate([*parts, center] if self.has_center else parts))
        return type(mean)(*points)

    def weigh(self, values: Named) -> Moments:
        """Moments from the function's values at the points, entries [k, ...]."""
        n = values[0].shape[0] // 2
        pair_sum = [v[:n] + v[n : 2 * n] for v in values]
        average = [self.pair_weight * jnp.sum(s, 0) for s in pair_sum]
        if self.has_center:
            average = [
                m + self.center_mean * v[2 * n] for m, v in zip(average, values, strict=True)
            ]
        scale = math.sqrt(2.0 * self.pair_weight)
        odd = tuple(0.5 * scale * (v[:n] - v[n : 2 * n]) for v in values)
        even = smallmat.gram(
            [scale * (0.5 * s - m[None]) for s, m in zip(pair_sum, average, strict=True)]
        )
        if self.center_cov != 0.0:
            center = [v[2 * n] - m for v, m in zip(values, average, strict=True)]
            even = _add_outer(even, self.center_cov, center)
        return Moments(type(values)(*average), odd, even)


class PairRule(NamedTuple):
    """A central point and pairs in any directions, each with its weight.

    Attributes:
        directions: [pairs][n], coordinates in Cholesky columns of one point of each pair;
            sum_k 2 w_k u_k u_k^T = I.
        pair_weights: [pairs], weight of each of the two points of a pair.
        center: weight of the central point; 0 leaves it out.
    """

    directions: tuple[tuple[float, ...], ...]
    pair_weights: tuple[float, ...]
    center: float

    @property
    def spread(self) -> float:
        """Largest distance of a point, in standard deviations."""
        return max(math.hypot(*u) for u in self.directions)

    def points(self, mean: Named, factor: Lower) -> Named:
        """The points for N(mean, L L^T) [k, ...]: pairs first, the central point last."""
        points = []
        for component, row in zip(mean, factor, strict=True):
            center = component[None]
            offset = sum(self._column(j, entry) * entry[None] for j, entry in enumerate(row))
            parts = [center + offset, center - offset]
            points.append(jnp.concatenate([*parts, center] if self.center else parts))
        return type(mean)(*points)

    def weigh(self, values: Named) -> Moments:
        """Moments from the function's values at the points, entries [k, ...].

        With O_k = sqrt(2 w_k) (f_k+ - f_k-) / 2 and V = [sqrt(2 w_k) u_k], whose columns are
        orthonormal, G = O V, and O O^T = G G^T + (O - G V^T)(O - G V^T)^T: still no subtraction
        of covariances.
        """
        pairs, n = len(self.directions), len(self.directions[0])
        like = values[0]
        weight = self._constant(self.pair_weights, like)
        root = self._constant([math.sqrt(2.0 * w) for w in self.pair_weights], like)
        total = [v[:pairs] + v[pairs : 2 * pairs] for v in values]
        average = [jnp.sum(weight * s, 0) for s in total]
        if self.center:
            average = [m + self.center * v[-1] for m, v in zip(average, values, strict=True)]
        odd, pieces = [], []
        for v, s, m in zip(values, total, average, strict=True):
            columns = 0.5 * root * (v[:pairs] - v[pairs : 2 * pairs])
            v_columns = [root * self._column(j, m) for j in range(n)]
            slopes = [jnp.sum(columns * c, 0) for c in v_columns]
            residual = columns - sum(g[None] * c for g, c in zip(slopes, v_columns, strict=True))
            odd.append(jnp.stack(slopes))
            pieces.append(jnp.concatenate([residual, root * (0.5 * s - m[None])]))
        even = smallmat.gram(pieces)
        if self.center:
            center = [v[-1] - m for v, m in zip(values, average, strict=True)]
            even = _add_outer(even, self.center, center)
        return Moments(type(values)(*average), tuple(odd), even)

    def _column(self, j: int, like: Any) -> Any:
        return self._constant([u[j] for u in self.directions], like[None])

    @staticmethod
    def _constant(numbers: Sequence[float], like: Any) -> Any:
        """Numbers along the leading axis, of the type and number of axes of an array."""
        return jnp.asarray(numbers, like.dtype).reshape((-1,) + (1,) * (like.ndim - 1))


Rule = Callable[[int], SigmaRule | PairRule]
"""A rule for any dimension: n -> SigmaRule or PairRule."""


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


def gauss_hermite(order: int = 3) -> Rule:
    """Gauss-Hermite product rule (Ito & Xiong 2000), order^n points.

    Exact for polynomials of degree 2 order - 1 in each Cholesky coordinate.

    Args:
        order: points per dimension, 2 or more; 3 is usual.

    Raises:
        ValueError: if `order` is below 2, or when used, beyond 20,000 points.
    """
    if order < 2:
        raise ValueError(f"order={order}: one point per dimension sees no spread; use 2 or more")
    return _gauss_hermite(order)


@lru_cache(maxsize=16)
def _gauss_hermite(order: int) -> Rule:
    """One rule per order, so that equal filters compile once."""

    @lru_cache(maxsize=16)
    def rule(n: int) -> PairRule:
        if order**n > 20_000:
            raise ValueError(
                f"order={order}: {order}^{n} = {order**n} points for {n} dimensions are too many; "
                "lower the order or use `cubature`"
            )
        nodes, weights = np.polynomial.hermite_e.hermegauss(order)
        weights = weights / weights.sum()
        half = order**n // 2  # the product grid mirrors about its middle
        grid = list(product(range(order), repeat=n))
        directions = tuple(tuple(float(nodes[i]) for i in at) for at in grid[:half])
        pair_weights = tuple(float(np.prod(weights[list(at)])) for at in grid[:half])
        center = float(np.prod(weights[list(grid[half])])) if order % 2 else 0.0
        return PairRule(directions, pair_weights, center)

    return rule


def transform(
    function: Callable[[Named], Named],
    mean: Named,
    factor: Lower,
    rule: SigmaRule | PairRule,
    what: str = "function",
) -> Moments:
    """Moments of `function(x)` for x ~ N(mean, L L^T), exact to the rule's degree.

    Args:
        function: map of the named components, evaluated at every point; in lanes elementwise.
        mean: named components.
        factor: lower Cholesky factor L of the covariance.
        rule: the sigma-point rule for n = len(mean).
        what: name of the function for an error.

    Raises:
        ValueError: if the function mixes runs.
    """
    points = stage(rule.points)(mean, factor)
    values = jax.vmap(lambda x: elementwise(function, x, what))(points)
    values = type(values)(*(jnp.broadcast_to(v, points[0].shape) for v in values))
    return stage(rule.weigh)(values)


def _add_outer(a: Lower, weight: float, x: Sequence[Any]) -> Lower:
    """A + weight x x^T, lower triangles."""
    return tuple(
        tuple(entry + weight * x[i] * x[j] for j, entry in enumerate(row))
        for i, row in enumerate(a)
    )
