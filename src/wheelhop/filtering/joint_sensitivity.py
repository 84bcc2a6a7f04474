"""Recursive maximum likelihood over several filters that share some of their parameters."""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import jax
import jax.numpy as jnp

from wheelhop.filtering import smallmat
from wheelhop.filtering.gaussian import Gaussian, moment_match
from wheelhop.filtering.interface import Filter, Info, Named
from wheelhop.filtering.sensitivity import (
    BindTheta,
    SensitivityParams,
    SensitivityPrior,
    SensitivityState,
    derivative_along,
    information_columns,
    newton_step,
    restart,
    units,
    walk_cov,
)


def joint_sensitivity(
    filter: Filter,
    bind: BindTheta,
    local: type,
    places: Sequence[Sequence[int]],
    limit: float = 2.0,
) -> Filter:
    """Recursive maximum likelihood over n filters that run side by side.

    Filter i is conditioned on the components `places[i]` of one theta, so that a component in
    several places is what these filters share. Given theta the records are independent: scores
    and informations add. A filter carries tangents only along its own components, so that the
    cost is n times that of `sensitivity` over the local components, whatever n.

    Args:
        filter: one of the n filters; its step is vmapped over leaves with a leading axis [n].
        bind: (parameters of a filter, its theta) -> parameters in which theta has taken effect.
        local: NamedTuple class of a filter's theta.
        places: for every filter, the components of theta in the order of `local`.
        limit: longest move of theta at one sample; see `sensitivity`.

    Returns:
        A `Filter` over `SensitivityState`, whose inner state has a leading axis [n] and whose
        tangents [n, p]; parameters are `SensitivityParams` with inner leaves [n], the prior is a
        `SensitivityPrior` whose inner prior has leaves [n], a measurement has entries [n]. Its
        `Info` holds the n innovations side by side, with a block-diagonal covariance.

    Raises:
        ValueError: if `limit` is not positive or `places` do not fit `local`; at the first call,
            if walk or prior do not fit theta.
    """
    if not limit > 0:
        raise ValueError(f"limit={limit}: theta could not move; give a positive one, as 2")
    fixed = tuple(tuple(p) for p in places)
    size = len(getattr(local, "_fields", ()))
    if not fixed or any(len(p) != size or len(set(p)) != size for p in fixed):
        raise ValueError(
            f"places={fixed}: give every filter {size} different components, one for each entry "
            f"of {local.__name__}"
        )

    def spread(theta: Named) -> Named:
        """Theta of every filter, entries [n, ...]."""
        return local(*(jnp.stack([theta[p[j]] for p in fixed]) for j in range(size)))

    def init(prior: Any, params: SensitivityParams) -> SensitivityState:
        if not isinstance(prior, SensitivityPrior):
            raise ValueError(
                f"prior is a {type(prior).__name__}; give SensitivityPrior(state, theta)"
            )
        walk_cov(params.walk, prior.theta.mean)
        _refuse_misfit(fixed, prior.theta.mean)

        def one(state: Any, theta: Named, inner: Any) -> tuple[Any, Any]:
            def start(at: Named) -> Any:
                return filter.init(state, bind(inner, at))

            return jax.vmap(
                lambda along: derivative_along(start, (theta,), (along,)), out_axes=(None, 0)
            )(units(theta))

        inner, tangents = jax.vmap(one)(prior.state, spread(prior.theta.mean), params.inner)
        return SensitivityState(inner, tangents, prior.theta)

    def step(
        state: SensitivityState, y: Named, params: SensitivityParams
    ) -> tuple[SensitivityState, Info]:
        def one(inner: Any, tangents: Any, y: Named, theta: Named, own: Any) -> tuple:
            def advance(inner: Any, theta: Named) -> tuple[Any, Info]:
                return filter.step(inner, y, bind(own, theta))

            (new, info), (slopes, slope) = jax.vmap(
                lambda *along: derivative_along(advance, (inner, theta), along),
                out_axes=(None, 0),
            )(tangents, units(theta))
            slopes, restarted = restart(new, slopes, jnp.ndim(info.log_likelihood))
            columns = information_columns(
                info.innovation_cov, slope.innovation, slope.innovation_cov
            )
            return new, slopes, info, slope.log_likelihood, jnp.stack(columns), restarted

        inner, tangents, info, score, columns, restarted = jax.vmap(one)(
            state.inner, state.tangents, y, spread(state.theta.mean), params.inner
        )
        predicted = smallmat.add(state.theta.cov, walk_cov(params.walk, state.theta.mean))
        theta, finite, guarded = assemble(
            Gaussian(state.theta.mean, predicted), score, columns, fixed, limit
        )
        report = side_by_side(info)
        flags = report.flags._replace(
            guarded=report.flags.guarded | guarded,
            nonfinite=report.flags.nonfinite | jnp.any(restarted, 0) | ~finite,
        )
        return SensitivityState(inner, tangents, theta), report._replace(flags=flags)

    def mix(weights: Any, stacked: SensitivityState) -> SensitivityState:
        def one(states: Any, tangents: Any) -> tuple[Any, Any]:
            return jax.vmap(
                lambda along: derivative_along(
                    lambda s: filter.mix(weights, s), (states,), (along,)
                ),
                in_axes=1,
                out_axes=(None, 0),
            )(tangents)

        inner, tangents = jax.vmap(one, in_axes=1)(stacked.inner, stacked.tangents)
        return SensitivityState(inner, tangents, moment_match(weights, stacked.theta))

    return Filter(init, step, mix)


def assemble(
    theta: Gaussian,
    score: Any,
    columns: Any,
    places: tuple[tuple[int, ...], ...],
    limit: float,
) -> tuple[Gaussian, Any, Any]:
    """The Newton step of theta from the scores and informations of all filters.

    Args:
        theta: before the sample, the random walk included.
        score: of every filter along its own components, [n, p, ...].
        columns: of its information, [n, columns, p, ...].
        places: of the components in theta.
        limit: longest move.

    Returns:
        As `newton_step`.
    """
    zero = jnp.zeros_like(score[0, 0])
    total = [zero] * len(theta.mean)
    rows: list[list[Any]] = [[] for _ in total]
    for i, own in enumerate(places):
        for j, k in enumerate(own):
            total[k] = total[k] + score[i, j]
        for k, row in enumerate(rows):
            own_row = columns[i, :, own.index(k)] if k in own else jnp.zeros_like(columns[i, :, 0])
            row.append(own_row)
    stacked = jnp.stack([jnp.concatenate(row) for row in rows], axis=1)
    return newton_step(theta, total, list(stacked), limit)


def side_by_side(info: Info) -> Info:
    """One report of the n filters whose reports have a leading axis [n]."""
    entries, n = len(info.innovation), info.innovation[0].shape[0]
    kind: Any = type(info.innovation)
    innovation = _flat_type(kind, n)(*(x[i] for i in range(n) for x in info.innovation))
    zero = jnp.zeros_like(info.innovation[0][0])
    cov = []
    for i in range(n):
        for row in info.innovation_cov:
            cov.append((*([zero] * (entries * i)), *(x[i] for x in row)))
    flags = info.flags
    return Info(
        innovation,
        tuple(cov),
        jnp.sum(info.log_likelihood, 0),
        jnp.sum(info.nis, 0),
        flags._replace(
            missing=jnp.sum(flags.missing, 0),
            guarded=jnp.any(flags.guarded, 0),
            nonfinite=jnp.any(flags.nonfinite, 0),
            lost_members=jnp.sum(jnp.asarray(flags.lost_members), 0),
            rejected=jnp.sum(jnp.asarray(flags.rejected), 0),
        ),
    )


@lru_cache(maxsize=32)
def _flat_type(kind: Any, n: int) -> Any:
    return namedtuple(
        f"{kind.__name__}s", [f"{name}_{i}" for i in range(n) for name in kind._fields]
    )


def _refuse_misfit(places: tuple[tuple[int, ...], ...], theta: Named) -> None:
    last = max(k for own in places for k in own)
    if last >= len(theta) or min(k for own in places for k in own) < 0:
        raise ValueError(
            f"places={places} name a component {last} of theta, which has the {len(theta)} "
            f"components {theta._fields}"
        )
