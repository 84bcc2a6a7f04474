"""Smooth maps between constrained parameters and free numbers, for learning by gradient.

A `Bijection` covers one leaf, or one subtree, of a parameter pytree; a pytree of them says
which parameters are learned. An optimiser then sees free numbers only, none of which can
leave the domain of a covariance or of a probability. Free numbers are clipped far out, so that
every value is finite and, where it must be, positive in float32 too.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.filtering import smallmat
from wheelhop.filtering.interface import Lower


class Bijection(NamedTuple):
    """A pair of pure functions, each the inverse of the other.

    Attributes:
        constrain: free numbers -> value, defined for all finite numbers.
        unconstrain: value -> free numbers.
    """

    constrain: Callable[[Any], Any]
    unconstrain: Callable[[Any], Any]


fixed = Bijection(lambda free: free, lambda value: value)
"""Marks what is not learned; the default values stay."""


def unconstrain(params: Any, how: Any) -> Any:
    """Free numbers of the learned parameters, to hand to an optimiser.

    Args:
        params: parameter pytree.
        how: pytree of the same structure, or a prefix of it, of `Bijection` or `fixed`.

    Returns:
        A pytree like `how` with free numbers in place of every `Bijection` and None (no leaf)
        in place of `fixed`.

    Raises:
        ValueError: if a value that is known at the call lies outside its domain.
    """
    return jax.tree.map(
        lambda b, value: None if b is fixed else b.unconstrain(value), how, params, is_leaf=_is_map
    )


def constrain(free: Any, params: Any, how: Any) -> Any:
    """Parameters with the learned ones taken from free numbers, the others from `params`."""
    return jax.tree.map(
        lambda b, value, numbers: value if b is fixed else b.constrain(numbers),
        how,
        params,
        free,
        is_leaf=_is_map,
    )


def positive() -> Bijection:
    """value = exp(free): for scales over decades, as variances and stiffnesses.

    Leaves of a subtree are mapped one by one.
    """

    def inverse(value: Any) -> Any:
        _require(value > 0, "positive", value, "give a positive number, or mark it `fixed`")
        return jnp.log(value)

    return Bijection(_leafwise(lambda x: jnp.exp(_clipped(x, 0.95))), _leafwise(inverse))


def softplus() -> Bijection:
    """value = log(1 + exp(free)): positive, and linear where it is large.

    Leaves of a subtree are mapped one by one.
    """

    def forward(x: Any) -> Any:
        return jax.nn.softplus(jnp.maximum(x, -0.95 * _largest_exponent(x)))

    def inverse(value: Any) -> Any:
        _require(value > 0, "softplus", value, "give a positive number, or mark it `fixed`")
        return value + jnp.log(-jnp.expm1(-value))

    return Bijection(_leafwise(forward), _leafwise(inverse))


def bounded(lower: float, upper: float) -> Bijection:
    """value = lower + (upper - lower) / (1 + exp(-free)).

    Leaves of a subtree are mapped one by one.

    Args:
        lower, upper: ends of the open interval, in the value's unit.

    Raises:
        ValueError: unless lower < upper, both finite.
    """
    if not -math.inf < lower < upper < math.inf:
        raise ValueError(f"lower={lower}, upper={upper}: give finite bounds, lower < upper")
    width = upper - lower

    def forward(x: Any) -> Any:
        # each half measures from its own end, where digits are needed
        from_lower, from_upper = width * jax.nn.sigmoid(x), width * jax.nn.sigmoid(-x)
        return jnp.where(x < 0, lower + from_lower, upper - from_upper)

    def inverse(value: Any) -> Any:
        _require(
            (value >= lower) & (value <= upper),
            "bounded",
            value,
            f"give a value between {lower} and {upper}",
        )
        margin = width * float(jnp.finfo(jnp.result_type(value)).eps)
        below = jnp.maximum(value - lower, margin)
        above = jnp.maximum(upper - value, margin)
        return jnp.log(below) - jnp.log(above)

    return Bijection(_leafwise(forward), _leafwise(inverse))


def positive_definite(dense: bool = False) -> Bijection:
    """Covariance L L^T from its log-Cholesky factor, rows in units of their diagonal.

    L_ii = exp(free_ii), L_ij = L_ii free_ij (Pinheiro & Bates 1996, with the off-diagonal
    entries scaled, so that all free numbers are without unit and one learning rate suits them).

    Args:
        dense: values are arrays [n, n] instead of lower triangles.

    Returns:
        A `Bijection` whose free numbers are a lower triangle. `unconstrain` raises ValueError
        for a matrix, known at the call, that is not positive definite.
    """

    def forward(free: Lower) -> Any:
        rows = []
        for i, row in enumerate(free):
            scale = jnp.exp(_clipped(row[i], 1 / 3))
            rows.append((*(scale * entry for entry in row[:i]), scale))
        cov = _squared(tuple(rows))
        return smallmat.to_dense(cov) if dense else cov

    def inverse(value: Any) -> Lower:
        cov = smallmat.from_dense(jnp.asarray(value)) if dense else value
        root, guarded = smallmat.cholesky(jax.tree.map(_floating, cov))
        _require(
            ~guarded & (root[-1][-1] > 0) & (root[0][0] > 0),
            "positive_definite",
            value,
            "a covariance of deficient rank has no free form: learn its factor or its scale",
        )
        return tuple(
            (*(entry / row[i] for entry in row[:i]), jnp.log(row[i])) for i, row in enumerate(root)
        )

    return Bijection(forward, inverse)


def simplex() -> Bijection:
    """Probabilities [n, ...] from log-ratios [n - 1, ...] to the last one.

    p_i = exp(free_i) / (1 + sum_j exp(free_j)) (Aitchison 1986).
    """

    def forward(free: Any) -> Any:
        free = _clipped(free, 0.45)
        return jax.nn.softmax(jnp.concatenate([free, jnp.zeros_like(free[:1])]), axis=0)

    def inverse(value: Any) -> Any:
        logs = _log_probabilities(value, "simplex")
        return logs[:-1] - logs[-1:]

    return Bijection(forward, inverse)


def row_stochastic() -> Bijection:
    """Transition matrix [m, m, ...] from log-ratios [m, m - 1, ...] to its diagonal.

    Row i holds log(P_ij / P_ii) for j != i: large negative numbers for modes that last.
    """

    def others(m: int) -> np.ndarray:
        return np.array([[j for j in range(m) if j != i] for i in range(m)], int).reshape(m, m - 1)

    def forward(free: Any) -> Any:
        m = free.shape[0]
        logits = jnp.zeros((m, m, *free.shape[2:]), free.dtype)
        logits = logits.at[np.arange(m)[:, None], others(m)].set(_clipped(free, 0.45))
        return jax.nn.softmax(logits, axis=1)

    def inverse(value: Any) -> Any:
        rows = np.arange(value.shape[0])[:, None]
        logs = _log_probabilities(value, "row_stochastic")
        return logs[rows, others(len(rows))] - logs[rows, rows]

    return Bijection(forward, inverse)


def _is_map(node: Any) -> bool:
    return isinstance(node, Bijection)


def _leafwise(function: Callable[[Any], Any]) -> Callable[[Any], Any]:
    return lambda tree: jax.tree.map(lambda leaf: function(_floating(leaf)), tree)


def _floating(value: Any) -> Any:
    """As a floating array of definite type, so that a Python number does not compile anew."""
    value = jnp.asarray(value)
    return jnp.asarray(value, value.dtype if jnp.issubdtype(value.dtype, jnp.floating) else float)


def _squared(root: Lower) -> Lower:
    """L L^T."""
    n = len(root)
    return tuple(
        tuple(sum(root[i][k] * root[j][k] for k in range(j + 1)) for j in range(i + 1))
        for i in range(n)
    )


def _log_probabilities(value: Any, name: str) -> Any:
    value = _floating(value)
    _require(value >= 0, name, value, "give probabilities")
    return jnp.log(jnp.maximum(value, float(jnp.finfo(value.dtype).tiny)))


def _largest_exponent(x: Any) -> float:
    return math.log(float(jnp.finfo(jnp.result_type(x)).max))


def _clipped(x: Any, share: float) -> Any:
    """x within a share of the exponents that the floating type can hold."""
    largest = share * _largest_exponent(x)
    return jnp.clip(x, -largest, largest)


def _require(condition: Any, name: str, value: Any, remedy: str) -> None:
    """Raise where a condition is known at the call and does not hold."""
    if not isinstance(condition, jax.core.Tracer) and not np.all(condition):
        raise ValueError(f"{name}: {value} is outside the domain; {remedy}")
