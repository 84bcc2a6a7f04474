"""What every filter of this room looks like from outside.

A filter is a NamedTuple of pure functions of one run; batching is `jax.vmap`.
States and measurements are NamedTuples of named scalars, parameters are any pytree.

Lanes: a step is also elementwise over trailing axes. Where the scalars of a state, of a
measurement and (if they differ) of the parameters are arrays [runs], the step filters all runs
at once with the same arithmetic; structure (sigma points, modes, matrix rows) always leads.
That layout is what `run_batch` uses, because it is the fast one.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, runtime_checkable

import jax
import jax.numpy as jnp

State = Any
"""A filter's own state: a pytree; a `Gaussian` for the plain filters."""

Params = Any
"""Any pytree. It is passed at each call and never captured, so nothing recompiles."""

Named = Any
"""A NamedTuple of named scalars: a state vector or a measurement vector."""

Lower = tuple[tuple[Any, ...], ...]
"""Lower triangle of a symmetric matrix: `a[i][j]`, j <= i, each entry a scalar."""


class StateSpaceModel(NamedTuple):
    """x' = transition(x) + w, y = observation(x) + v, with additive Gaussian w and v.

    Attributes:
        transition: (x, params) -> x, both the same NamedTuple. Written elementwise: its
            entries may be arrays of any one shape (the sigma points), not only scalars.
        observation: (x, params) -> y, a NamedTuple of measured entries; elementwise too. An angle
            that may wrap has no innovation in this sense: measure its cosine and its sine.
        process_cov: (x, params) -> lower triangle of cov(w), evaluated at the mean the
            step starts from, so that it may depend on the state.
        observation_cov: (params) -> lower triangle of cov(v).
    """

    transition: Callable[[Named, Params], Named]
    observation: Callable[[Named, Params], Named]
    process_cov: Callable[[Named, Params], Lower]
    observation_cov: Callable[[Params], Lower]


class Flags(NamedTuple):
    """What happened in a step that a user must be able to see.

    Attributes:
        missing: number of measurement entries that were not finite and were left out.
        guarded: True where the relative pivot guard of a Cholesky factor acted.
        nonfinite: True where the step's result holds a NaN or an infinity.
        rejected: number of entries that a gate left out as outliers.
        lost_members: number of an IMM's members whose step was not finite and which were
            restarted from the others; 0 for a plain filter.
    """

    missing: Any
    guarded: Any
    nonfinite: Any
    lost_members: Any = 0
    rejected: Any = 0


class Info(NamedTuple):
    """Report of one step.

    Attributes:
        innovation: y - E[y | past], a NamedTuple like y; 0 where y is missing.
        innovation_cov: lower triangle of its covariance; a missing entry has variance 1
            and no correlation, so that it adds nothing to the two figures below.
        log_likelihood: log p(y | past) of the entries that are present.
        nis: normalised innovation squared, chi-square with as many degrees of freedom
            as entries are present.
        flags: `Flags`.
    """

    innovation: Named
    innovation_cov: Lower
    log_likelihood: Any
    nis: Any
    flags: Flags


Update = Callable[..., tuple[Any, Info]]
"""(predicted, factor, moments, noise, y, guarded) -> (Gaussian, Info), as `update.condition`."""


class Filter(NamedTuple):
    """A recursive filter: one `step` predicts over the sampling interval, then updates.

    Attributes:
        init: (prior: Gaussian, params) -> state, the state before the first sample.
        step: (state, y, params) -> (state, Info).
        mix: (weights [m], states stacked on a leading axis [m, ...]) -> one state with
            the mixture's moments; this is what makes any filter a member of an IMM.
    """

    init: Callable[[Any, Params], State]
    step: Callable[[State, Named, Params], tuple[State, Info]]
    mix: Callable[[Any, State], State]


@runtime_checkable
class Recursion(Protocol):
    """Anything that steps through a record: a `Filter`, or an estimator that is no filter."""

    @property
    def step(self) -> Callable[[State, Named, Params], tuple[State, Any]]:
        """(state, y, params) -> (state, report)."""


def all_finite(tree: Any) -> Any:
    """Whether every leaf of a pytree is finite, per lane.

    Leaves may have leading axes of structure before the lanes; a leaf without any has the lanes
    alone.
    """
    leaves = [jnp.isfinite(leaf) for leaf in jax.tree.leaves(tree)]
    lanes = min(leaf.ndim for leaf in leaves)
    first, *rest = [jnp.all(leaf, tuple(range(leaf.ndim - lanes))) for leaf in leaves]
    for leaf in rest:
        first = first & leaf
    return first
