"""Estimates that stay in a box: the mean projected in the metric of its covariance.

Simon & Chia 2002, and Simon's survey of 2010. The covariance is left as it is: the projected
mean cannot have a larger error than the free one, so that covariance is conservative, whereas
shrinking it along a bound would make the filter deaf to measurements that lead away from it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.filtering import smallmat
from wheelhop.filtering.gaussian import Gaussian
from wheelhop.filtering.interface import Filter, Info, Named, State, all_finite


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class ConstrainedParams:
    """Parameters of a constrained filter.

    Attributes:
        inner: the wrapped filter's parameters.
        lower, upper: bounds of the mean, the same NamedTuple as the mean, each entry in its
            component's unit; -inf and inf where a component is free.
    """

    inner: Any
    lower: Any
    upper: Any


def _itself(state: State) -> Gaussian:
    return state


def _replaced(state: State, belief: Gaussian) -> State:
    del state
    return belief


def constrained(
    filter: Filter,
    belief_of: Callable[[State], Gaussian] = _itself,
    with_belief: Callable[[State, Gaussian], State] = _replaced,
) -> Filter:
    """Filter whose mean is projected into a box before the first sample and after each step.

    The projected mean is fed back, so that the model is evaluated inside the box (a sigma
    point may still lie outside). As a member of an IMM the mixture stays inside as well: a
    box is convex.

    Args:
        filter: any `Filter`.
        belief_of: the `Gaussian` in its state; the state itself by default.
        with_belief: (state, belief) -> the state with that `Gaussian` in its place.

    Returns:
        A `Filter` over the same states and `ConstrainedParams`. Its `Info` is that of the
        wrapped filter, whose innovation precedes the projection. Where a compiled step meets
        lower > upper that component becomes NaN and `Info.flags.nonfinite` is set.

    Raises:
        ValueError: if bounds and mean differ in their fields, or a lower bound that is known
            at the call exceeds the upper one.
    """

    def put(state: State, params: ConstrainedParams) -> State:
        return with_belief(state, project(belief_of(state), params.lower, params.upper))

    def init(prior: Gaussian, params: ConstrainedParams) -> State:
        return put(filter.init(prior, params.inner), params)

    def step(state: State, y: Named, params: ConstrainedParams) -> tuple[State, Info]:
        free, info = filter.step(state, y, params.inner)
        new = put(free, params)
        nonfinite = info.flags.nonfinite | ~all_finite(belief_of(new).mean)
        return new, info._replace(flags=info.flags._replace(nonfinite=nonfinite))

    return Filter(init, step, filter.mix)


def project(belief: Gaussian, lower: Named, upper: Named) -> Gaussian:
    """Gaussian with the mean of the box nearest to its own, its covariance unchanged.

    Minimises (x - m)^T P^-1 (x - m) over lower <= x <= upper. The solution is
    x = m + P_A (P_AA)^-1 (bound_A - m_A) for the set A of bounds it meets, for one bound
    x = m + P_i (bound - m_i) / P_ii. The set is found by the dual active-set method, which
    needs no inverse of P, so that P may be singular: x - m then lies in its range. The
    gradient is that of the formula. A component without variance, or one that no point of
    the range can bring inside together with the others, is moved to its bound alone.

    Args:
        belief: Gaussian over n named components.
        lower, upper: the box, as in `ConstrainedParams`.

    Raises:
        ValueError: as `constrained`.
    """
    mean, low, high = (tuple(side) for side in (belief.mean, lower, upper))
    _refuse_unusable(belief.mean, lower, upper)
    fixed = jax.lax.stop_gradient((mean, belief.cov, low, high))
    held = tuple(_active_set(*fixed))
    bound = [
        jnp.where(h > 0, a, jnp.where(h < 0, b, m))
        for h, a, b, m in zip(held, low, high, mean, strict=True)
    ]
    force = _forces(held, mean, belief.cov, bound)
    moved = [
        jnp.where(h != 0, b, x)
        for h, b, x in zip(held, bound, _moved(mean, belief.cov, force), strict=True)
    ]
    inside = [
        jnp.where(a > b, jnp.nan, jnp.clip(x, a, b))
        for x, a, b in zip(moved, low, high, strict=True)
    ]
    return Gaussian(type(belief.mean)(*inside), belief.cov)


def _forces(held: Any, mean: Any, cov: Any, bound: Any) -> tuple[Any, ...]:
    """Multipliers that put the held components on their bounds, and 0 for the others."""
    n = len(mean)
    masked = tuple(
        tuple(
            jnp.where((held[i] != 0) & (held[j] != 0), cov[i][j], 1.0 if i == j else 0.0)
            for j in range(i + 1)
        )
        for i in range(n)
    )
    gap = [jnp.where(held[i] != 0, bound[i] - mean[i], 0.0) for i in range(n)]
    root, _ = smallmat.cholesky(masked)
    return smallmat.solve_lower_transposed(root, smallmat.solve_lower(root, gap))


def _moved(mean: Any, cov: Any, force: Any) -> list[Any]:
    """m + P force."""
    n = len(mean)
    return [mean[i] + sum(cov[max(i, j)][min(i, j)] * force[j] for j in range(n)) for i in range(n)]


def _active_set(mean: Any, cov: Any, low: Any, high: Any) -> Any:
    """Which bounds the projection meets: 1 the lower, -1 the upper, 0 none; [n, ...].

    Each round either lets go of the bound whose multiplier first turns to the wrong sign, or
    takes in the bound violated most. The dual objective rises with every round, so no set
    comes back; the rounds end when every lane is done.
    """
    n = len(mean)
    epsilon = float(jnp.finfo(jnp.result_type(mean[0])).eps)
    spread = [jnp.sqrt(cov[i][i]) for i in range(n)]

    def one_round(carry: Any) -> Any:
        count, _, held, force = carry
        bound = [
            jnp.where(held[i] > 0, low[i], jnp.where(held[i] < 0, high[i], mean[i]))
            for i in range(n)
        ]
        wanted = jnp.stack(_forces(held, mean, cov, bound))
        wrong = held * wanted < 0
        gap = jnp.where(wrong, force - wanted, 1.0)
        share = jnp.where(wrong, force / jnp.where(gap == 0, 1.0, gap), jnp.inf)
        first = jnp.min(share, 0)
        back = jnp.any(wrong, 0)
        reached = jnp.where(
            back[None], force + jnp.where(back, first, 0.0)[None] * (wanted - force), wanted
        )
        let_go = wrong & (share <= first[None])

        x = _moved(mean, cov, wanted)
        excess = [jnp.maximum(low[i] - x[i], x[i] - high[i]) for i in range(n)]
        violated = jnp.stack(
            [
                jnp.where(
                    (held[i] == 0)
                    & (spread[i] > 0)
                    & (excess[i] > 64 * epsilon * (jnp.abs(x[i]) + spread[i])),
                    excess[i] / jnp.where(spread[i] > 0, spread[i], 1.0),
                    0.0,
                )
                for i in range(n)
            ]
        )
        worst = jnp.max(violated, 0)
        side = jnp.stack([jnp.where(x[i] < low[i], 1.0, -1.0) for i in range(n)]).astype(held.dtype)
        taken = (violated > 0) & (violated >= worst[None]) & ~back[None]
        new = jnp.where(let_go, 0.0, jnp.where(taken, side, held))
        pending = jnp.any(back | (worst > 0))
        return count + 1, pending, new, jnp.where(let_go, 0.0, reached)

    def goes_on(carry: Any) -> Any:
        count, pending, _, _ = carry
        return pending & (count < 10 * n)

    none = jnp.zeros_like(jnp.stack(mean))
    _, _, held, _ = jax.lax.while_loop(goes_on, one_round, (0, jnp.asarray(True), none, none))
    return held


def _refuse_unusable(mean: Named, lower: Named, upper: Named) -> None:
    for name, side in (("lower", lower), ("upper", upper)):
        if side._fields != mean._fields:
            raise ValueError(
                f"{name} has the fields {side._fields} for a mean of {mean._fields}; "
                "give one bound per component, -inf or inf where it is free"
            )
    for field, a, b in zip(mean._fields, lower, upper, strict=True):
        if isinstance(a, jax.core.Tracer) or isinstance(b, jax.core.Tracer):
            continue
        if not np.all(np.asarray(a) <= np.asarray(b)):
            raise ValueError(
                f"{field}: the lower bound {a} exceeds the upper bound {b}; exchange them, or "
                "give -inf and inf for a free component"
            )
