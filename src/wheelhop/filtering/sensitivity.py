"""Recursive maximum likelihood: any filter, its tangents in its parameters, and their Gaussian.

Ljung & Soderstrom 1983. The inner filter is conditioned on parameters theta; its state is
carried with the tangents d state / d theta, and every sample moves theta by one Gauss-Newton
step on the log-likelihood. Unlike a joint state, this uses what the size of the innovations
says of theta, and how the gain depends on theta.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.filtering import smallmat
from wheelhop.filtering.gaussian import Gaussian, moment_match
from wheelhop.filtering.interface import Filter, Info, Lower, Named, Params, State, all_finite

BindTheta = Callable[[Params, Named], Params]
"""(inner parameters, theta) -> inner parameters in which theta has taken effect."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class SensitivityParams:
    """Parameters of a recursive maximum likelihood filter over p parameters theta.

    Attributes:
        inner: the inner filter's parameters, before `bind` puts theta into them.
        walk: random walk of theta, its variance per step: a NamedTuple like theta, or the
            lower triangle of a covariance where components walk together. Zero: a constant.
    """

    inner: Any
    walk: Any


class SensitivityPrior(NamedTuple):
    """Belief before the first sample.

    Attributes:
        state: what the inner filter's `init` takes.
        theta: `Gaussian` of theta. A component of zero variance (and walk) is held fixed.
    """

    state: Any
    theta: Gaussian


class SensitivityState(NamedTuple):
    """State of a recursive maximum likelihood filter.

    Attributes:
        inner: the inner filter's state, conditioned on the mean of theta.
        tangents: d inner / d theta, every leaf with a leading axis [p]; zero for a leaf that
            is not a floating number.
        theta: `Gaussian` of theta.
    """

    inner: Any
    tangents: Any
    theta: Gaussian


def sensitivity(filter: Filter, bind: BindTheta, limit: float = 2.0) -> Filter:
    """Recursive maximum likelihood estimation of a filter's parameters.

    With innovation r and its covariance S, and their tangents r_i and S_i along theta_i,

        score_i = d log p(y | past) / d theta_i
        info_ij = r_i' S^-1 r_j + 1/2 tr(S^-1 S_i S^-1 S_j)
        Sigma  <- inv(inv(Sigma + walk) + info),  theta <- theta + Sigma score.

    The score is the tangent of the log-likelihood that the inner filter reports: for a
    Gaussian innovation -r_i' S^-1 r + 1/2 r' S^-1 S_i S^-1 r - 1/2 tr(S^-1 S_i), for a mixture
    or a robust update the score of that likelihood. The information is that of the Gaussian
    with the reported r and S; for a mixture, of its moments. A missing entry adds nothing.

    State and tangents are evaluated at theta before the step's update. They are not
    recomputed when theta moves: they forget the old theta as the filter forgets its past.
    The covariance is that of a Gauss-Newton method: honest once theta is near the truth on
    the scale over which the likelihood is quadratic.

    Args:
        filter: the inner filter; its `Info` is passed on.
        bind: (inner parameters, theta) -> inner parameters; theta is the NamedTuple of the
            prior's mean, its entries scalars or lanes.
        limit: longest move of theta at one sample, in its standard deviations after it. It
            acts where the prior is wide: the likelihood of a log variance is far from
            quadratic, and its first full steps would overshoot beyond return.

    Returns:
        A `Filter` over `SensitivityState` and `SensitivityParams`, whose prior is a
        `SensitivityPrior`. Where the update of theta is not finite theta keeps its prediction,
        and a tangent that is not finite restarts at zero; both set `flags.nonfinite`.
        Mixing treats theta as one quantity that all modes estimate: moments matched, with
        spread, and tangents those of the mixed state when every mode's theta shifts alike, the
        weights held. What differs between modes (the level of a road class) belongs into
        their parameters, where `bind` adds theta as the deviation from it.

    Raises:
        ValueError: if `limit` is not positive; at the first call, if `walk` does not fit theta
            or the prior is no `SensitivityPrior`.
    """
    if not limit > 0:
        raise ValueError(f"limit={limit}: theta could not move; give a positive one, as 2")

    def init(prior: Any, params: SensitivityParams) -> SensitivityState:
        if not isinstance(prior, SensitivityPrior):
            raise ValueError(
                f"prior is a {type(prior).__name__}; give SensitivityPrior(state, theta), the "
                "inner filter's prior and the Gaussian of theta"
            )
        walk_cov(params.walk, prior.theta.mean)

        def start(theta: Named) -> State:
            return filter.init(prior.state, bind(params.inner, theta))

        inner, tangents = jax.vmap(
            lambda along: derivative_along(start, (prior.theta.mean,), (along,)), out_axes=(None, 0)
        )(units(prior.theta.mean))
        return SensitivityState(inner, tangents, prior.theta)

    def step(
        state: SensitivityState, y: Named, params: SensitivityParams
    ) -> tuple[SensitivityState, Info]:
        def advance(inner: State, theta: Named) -> tuple[State, Info]:
            return filter.step(inner, y, bind(params.inner, theta))

        at = (state.inner, state.theta.mean)
        (inner, info), (tangents, slope) = jax.vmap(
            lambda *along: derivative_along(advance, at, along), out_axes=(None, 0)
        )(state.tangents, units(state.theta.mean))
        tangents, restarted = restart(inner, tangents, jnp.ndim(info.log_likelihood))

        predicted = smallmat.add(state.theta.cov, walk_cov(params.walk, state.theta.mean))
        columns = information_columns(info.innovation_cov, slope.innovation, slope.innovation_cov)
        theta, finite, guarded = newton_step(
            Gaussian(state.theta.mean, predicted), tuple(slope.log_likelihood), columns, limit
        )
        flags = info.flags._replace(
            guarded=info.flags.guarded | guarded,
            nonfinite=info.flags.nonfinite | restarted | ~finite,
        )
        return SensitivityState(inner, tangents, theta), info._replace(flags=flags)

    def mix(weights: Any, stacked: SensitivityState) -> SensitivityState:
        inner, tangents = jax.vmap(
            lambda along: derivative_along(
                lambda states: filter.mix(weights, states), (stacked.inner,), (along,)
            ),
            in_axes=1,
            out_axes=(None, 0),
        )(stacked.tangents)
        return SensitivityState(inner, tangents, moment_match(weights, stacked.theta))

    return Filter(init, step, mix)


def information_columns(cov: Lower, innovation_slope: Named, cov_slope: Lower) -> list[Any]:
    """Columns of B with information B B^T, so that it is positive semidefinite by construction.

    With S = L L^T and A_i = L^-1 S_i L^-T, row i of B holds L^-1 r_i, the diagonal of A_i over
    sqrt(2), and what lies below it.

    Args:
        cov: S, lower triangle of m rows.
        innovation_slope: r_i, entries [p, ...].
        cov_slope: S_i, lower triangle, entries [p, ...].

    Returns:
        m + m (m + 1) / 2 columns, each [p, ...].
    """
    m = len(cov)
    factor, _ = smallmat.cholesky(cov)
    root = tuple(tuple(entry[None] for entry in row) for row in factor)
    half_white = [
        smallmat.solve_lower(root, [cov_slope[max(i, j)][min(i, j)] for i in range(m)])
        for j in range(m)
    ]
    columns = list(smallmat.solve_lower(root, tuple(innovation_slope)))
    for i in range(m):
        white = smallmat.solve_lower(root, [column[i] for column in half_white])
        columns += [*white[:i], white[i] * math.sqrt(0.5)]
    return columns


def newton_step(
    theta: Gaussian, score: Sequence[Any], columns: Sequence[Any], limit: float = math.inf
) -> tuple[Gaussian, Any, Any]:
    """Gaussian of theta after a sample of this score and information B B^T.

    Potter's square-root update (Bierman 1977), one column b of B at a time: with Sigma = L L^T
    and v = L^T b, L becomes L (I - v v^T / (a + sqrt(a))), a = 1 + v^T v. No matrix is inverted,
    however sharp the information, and a component of zero variance stays where it is.

    Args:
        theta: before the sample, the random walk included.
        score: gradient of the log-likelihood, p entries.
        columns: columns of B, each [p, ...].
        limit: longest step, in standard deviations of the new covariance.

    Returns:
        The new Gaussian, or the old where the new is not finite; whether it is finite; and
        whether the guard of a Cholesky factor acted.
    """
    root, guarded = smallmat.cholesky(theta.cov)
    rows = list(smallmat.rows_of(root))

    def along(direction: Sequence[Any]) -> Any:
        return sum(row * d[None] for row, d in zip(rows, direction, strict=True))

    for column in columns:
        v = along(tuple(column))
        total = 1.0 + jnp.sum(v * v, 0)
        shrink = 1.0 / (total + jnp.sqrt(total))
        rows = [row - (shrink * jnp.sum(row * v, 0))[None] * v for row in rows]
    slope = along(score)
    square = jnp.sum(slope * slope, 0)
    long = square > limit * limit
    slope = slope * jnp.where(long, limit / jnp.sqrt(jnp.where(long, square, 1.0)), 1.0)[None]
    mean = [x + jnp.sum(row * slope, 0) for x, row in zip(theta.mean, rows, strict=True)]
    moved = Gaussian(type(theta.mean)(*mean), smallmat.gram(rows))
    finite = all_finite((theta, moved))
    kept = jax.tree.map(lambda new, old: jnp.where(finite, new, old), moved, theta)
    return kept, finite, guarded


def units(theta: Named) -> Named:
    """The p unit directions of theta, entries [p, ...]."""
    p = len(theta)
    return type(theta)(
        *(
            jnp.stack([jnp.ones_like(x) if i == j else jnp.zeros_like(x) for i in range(p)])
            for j, x in enumerate(theta)
        )
    )


def derivative_along(function: Callable, at: tuple, along: tuple) -> tuple[Any, Any]:
    """Value and directional derivative; leaves without a derivative hold zeros of their type."""

    def enter(value: Any, tangent: Any) -> Any:
        if jnp.issubdtype(jnp.result_type(value), jnp.inexact):
            return tangent
        return np.zeros(jnp.shape(value), jax.dtypes.float0)

    def leave(value: Any, tangent: Any) -> Any:
        return jnp.zeros_like(value) if tangent.dtype == jax.dtypes.float0 else tangent

    value, tangent = jax.jvp(function, at, jax.tree.map(enter, at, along))
    return value, jax.tree.map(leave, value, tangent)


def restart(state: State, tangents: Any, lanes: int) -> tuple[Any, Any]:
    """Tangents with what is not finite set to zero, and where that befell a finite state.

    Args:
        state: the inner filter's.
        tangents: d state / d theta, leaves [p, ...].
        lanes: number of trailing axes of runs.
    """
    lost: Any = False
    for x, t in zip(jax.tree.leaves(state), jax.tree.leaves(tangents), strict=True):
        lost = lost | jnp.any(
            jnp.isfinite(x)[None] & ~jnp.isfinite(t), tuple(range(jnp.ndim(t) - lanes))
        )
    kept = jax.tree.map(lambda t: jnp.where(jnp.isfinite(t), t, jnp.zeros_like(t)), tangents)
    return kept, lost


def walk_cov(walk: Any, theta: Named) -> Lower:
    """Lower triangle of a walk's covariance; see `SensitivityParams`.

    Raises:
        ValueError: if it does not fit theta.
    """
    if len(walk) != len(theta):
        raise ValueError(
            f"walk has {len(walk)} entries for the {len(theta)} components {theta._fields} of "
            "theta; give one variance per component, or a lower triangle of as many rows"
        )
    return smallmat.diagonal(tuple(walk)) if hasattr(walk, "_fields") else walk
