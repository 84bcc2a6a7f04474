"""How well records determine fitted parameters: standard errors, correlation, weak directions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from wheelhop.identification.loss import Sums
from wheelhop.identification.parameters import SearchSpace

WEAK = 0.5
"""Relative standard error of a combination of parameters beyond which it is called weak."""

_NULL = 1e-10
_ROUNDING = 100.0
_INVOLVED = 1e-3


@dataclass(frozen=True)
class Direction:
    """A combination of parameters that the data determine on their own.

    Attributes:
        weights: of the relative parameter changes dp/p, of unit length, by name.
        relative_error: standard error along it [-]; infinite where the data say nothing.
    """

    weights: dict[str, float]
    relative_error: float

    def __str__(self) -> str:
        parts = sorted(self.weights.items(), key=lambda item: -abs(item[1]))
        shown = [f"{w:+.2f} {n}" for n, w in parts if abs(w) > 0.1]
        if len(shown) == 1:
            shown = [n for n, w in parts if abs(w) > 0.1]
        known = (
            "not determined at all"
            if not np.isfinite(self.relative_error)
            else f"known to {100 * self.relative_error:.2g} %"
        )
        return f"{' '.join(shown)} (relative change): {known}"


@dataclass(frozen=True)
class Uncertainty:
    """Standard errors of the parameters in their units, in the order of the search space.

    Attributes:
        standard_errors: for white residuals, [n]; infinite where the data say nothing, NaN for
            a parameter held at its bound.
        robust_errors: also for coloured residuals (sums over blocks), [n], likewise.
        correlation: of the estimates, [n, n]; NaN rows where a parameter is held at its bound.
        directions: from the best known combination to the worst.
    """

    standard_errors: np.ndarray
    robust_errors: np.ndarray
    correlation: np.ndarray
    directions: tuple[Direction, ...]

    @property
    def weak(self) -> tuple[Direction, ...]:
        """Directions that the data hardly determine, worst last."""
        return tuple(d for d in self.directions if not d.relative_error < WEAK)


def uncertainty(
    sums: Sums,
    weight: Any,
    counts: Any,
    slopes: Any,
    values: Any,
    space: SearchSpace,
    held: tuple[int, ...] = (),
) -> Uncertainty:
    """Standard errors from the Gauss-Newton matrix and from the residuals of blocks.

    With H = sum w J^T J: cov = H^-1 (sum w^2 s^2 J^T J) H^-1, s^2 the residual variance of each
    record and accelerometer; robust: H^-1 (sum over blocks of g g^T) H^-1 with g the gradient of a
    block (White 1980; Liang & Zeger 1986), which allows for residuals that are correlated in time.

    Args:
        sums: at the estimate, by free numbers, [records, blocks, 2, ...].
        weight: of each record and accelerometer in the loss, [records, 2].
        counts: samples that count, [records, 2].
        slopes: dp/dfree [n] at the estimate.
        values: parameters p [n].
        space: the fitted parameters.
        held: indices of parameters at a bound, taken as known.
    """
    n = len(space.names)
    used = [k for k in range(n) if k not in held]
    scale = np.asarray(slopes, float)[used]
    normal = np.asarray(sums.normal, float)[..., used, :][..., used] / np.outer(scale, scale)
    gradient = np.asarray(sums.gradient, float)[..., used] / scale
    squares = np.asarray(sums.squares, float).sum(1)
    w, counts = np.asarray(weight, float), np.asarray(counts, float)

    by_record = normal.sum(1)
    total = np.einsum("rc,rcij->ij", w, by_record)
    variance = squares / np.maximum(counts - len(used) * counts / counts.sum(), 1.0)
    inner = np.einsum("rc,rcij->ij", w * w * variance, by_record)
    of_block = np.einsum("rc,rbci->rbi", w, gradient)
    real = (np.abs(normal).sum((2, 3, 4)) > 0).sum()
    correction = real / max(real - len(used), 1)
    outer = correction * np.einsum("rbi,rbj->ij", of_block, of_block)

    precision = _ROUNDING * float(np.finfo(np.asarray(sums.normal).dtype).eps)
    inverse, null = _inverse(total, max(_NULL, precision))
    cov, robust = inverse @ inner @ inverse, inverse @ outer @ inverse
    relative = np.abs(np.asarray(values, float)[used])
    relative = np.where(relative > 0, relative, 1.0)
    names = [space.names[k] for k in used]
    directions = _directions(cov, null, relative, names)
    unseen = [d for d in directions if np.isinf(d.relative_error)]
    lost = np.array([any(abs(d.weights[name]) > _INVOLVED for d in unseen) for name in names])
    correlation = np.full((n, n), np.nan)
    correlation[np.ix_(used, used)] = _correlation(cov)
    return Uncertainty(
        _spread(np.where(lost, np.inf, np.sqrt(np.diag(cov))), used, n),
        _spread(np.where(lost, np.inf, np.sqrt(np.diag(robust))), used, n),
        correlation,
        directions,
    )


def _inverse(matrix: np.ndarray, smallest: float) -> tuple[np.ndarray, np.ndarray]:
    """Inverse on what the data determine, and parameter changes [n, k] that they do not see.

    Decided in units of each parameter's own information, where such changes stand out.

    Args:
        matrix: information [n, n].
        smallest: eigenvalue, relative to the largest, that counts as seen.
    """
    size = np.sqrt(np.maximum(np.diag(matrix), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(matrix / np.outer(size, size))
    dead = values < smallest * values[-1]
    good = vectors[:, ~dead] / np.sqrt(values[~dead]) / size[:, None]
    return good @ good.T, vectors[:, dead] / size[:, None]


def _directions(
    cov: np.ndarray, null: np.ndarray, relative: np.ndarray, names: list[str]
) -> tuple[Direction, ...]:
    values, vectors = np.linalg.eigh(cov / np.outer(relative, relative))
    found = [
        Direction(dict(zip(names, v.tolist(), strict=True)), float(np.sqrt(max(value, 0.0))))
        for value, v in zip(values, vectors.T, strict=True)
    ]
    unseen = null / relative[:, None]
    unseen = unseen / np.linalg.norm(unseen, axis=0)
    lost = [Direction(dict(zip(names, v.tolist(), strict=True)), float("inf")) for v in unseen.T]
    return (*found[len(lost) :], *lost)


def _correlation(cov: np.ndarray) -> np.ndarray:
    sigma = np.sqrt(np.maximum(np.diag(cov), np.finfo(float).tiny))
    return cov / np.outer(sigma, sigma)


def _spread(values: np.ndarray, used: list[int], n: int) -> np.ndarray:
    """Values of the fitted parameters in their places, NaN at a bound."""
    everything = np.full(n, np.nan)
    everything[used] = values
    return everything
