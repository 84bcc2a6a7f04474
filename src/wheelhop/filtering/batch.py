"""Many runs at once, in lanes: the fast way to filter a Monte Carlo.

`run_batch` gives what `jax.vmap(drive.run)` gives. Instead of batching every operation it lays the
runs along the trailing axis of every entry, where they fill the SIMD lanes, in chunks that fit the
cache; chunks are shared among the devices.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.filtering import drive
from wheelhop.filtering.drive import Bind, Keep, Score, constant_params
from wheelhop.filtering.interface import Filter, Named, Params, State
from wheelhop.filtering.lanes import keeps_lanes
from wheelhop.staging import staged_jit

LANES = 128
"""Runs per chunk: enough to fill the vector units, few enough for the cache."""

Axes = Any
"""(state, ys, params, inputs): 0 where a tree or a part of it leads with a run axis, else None."""

_ONE_RECORD_PER_RUN = (None, 0, None, 0)


def run_batch(
    filter: Filter,
    state: State,
    ys: Named,
    params: Params,
    *,
    inputs: Any = None,
    bind: Bind = constant_params,
    keep: Keep = drive.keep_all,
    in_axes: Axes = _ONE_RECORD_PER_RUN,
    lanes: int = LANES,
    devices: Sequence[Any] | None = None,
) -> Any:
    """Filter many records; equal to `drive.run` vmapped over them.

    Called with concrete arrays it compiles once per filter and shape; inside `jit` or `grad` it is
    traced into the caller, who gets the staged speed from `staging.staged_jit`.

    Args:
        filter: any `Filter`. Its model functions, `bind` and `keep` must be elementwise: they meet
            entries [lanes] where `drive.run` gives them scalars.
        state: state one sampling interval before the first sample.
        ys: measurements, entries [runs, time].
        params: the filter's parameters.
        inputs: what varies in time, leaves [runs, time, ...].
        bind: puts the inputs of one time into the parameters.
        keep: chooses what to store of each step.
        in_axes: which of (state, ys, params, inputs) have a leading run axis, as in `jax.vmap`:
            each 0, None or a tree of these.
        lanes: runs per chunk.
        devices: that share the chunks; all by default. On CPUs JAX shows as many as
            `jax_num_cpu_devices` says.

    Returns:
        What `keep` chose, leaves [runs, time, ...].

    Raises:
        ValueError: if `lanes` is not positive or the run axes differ in length.
    """
    work = _Run(filter, bind, keep)
    return _batched(work, (state, ys, params, inputs), in_axes, lanes, devices)


def log_likelihood_batch(
    filter: Filter,
    state: State,
    ys: Named,
    params: Params,
    *,
    inputs: Any = None,
    bind: Bind = constant_params,
    in_axes: Axes = _ONE_RECORD_PER_RUN,
    lanes: int = LANES,
    segment: int | None = None,
    devices: Sequence[Any] | None = None,
) -> Any:
    """log p(y_1..y_T | params) of every run [runs]; `drive.log_likelihood` in lanes.

    Arguments as `run_batch`; `segment` as `drive.log_likelihood`.
    """
    work = _LogLikelihood(filter, bind, segment)
    return _batched(work, (state, ys, params, inputs), in_axes, lanes, devices)


def total_batch(
    filter: Filter,
    state: State,
    ys: Named,
    params: Params,
    score: Score,
    *,
    targets: Any = None,
    inputs: Any = None,
    bind: Bind = constant_params,
    in_axes: Axes = _ONE_RECORD_PER_RUN,
    lanes: int = LANES,
    segment: int | None = None,
    devices: Sequence[Any] | None = None,
) -> Any:
    """Sum of a score over the steps of every run [runs]; `drive.total` in lanes.

    Arguments as `run_batch`; `score`, which must be elementwise, and `segment` as `drive.total`.
    `targets` lead with a run axis where the inputs do.
    """
    work = _Total(filter, _first(bind), score, segment)
    *others, axis = in_axes
    trees = (state, ys, params, (inputs, targets))
    return _batched(work, trees, (*others, (axis, axis)), lanes, devices)


class _Run(tuple):
    """What to do with one chunk; a tuple, so that equal work compiles once."""

    def __new__(cls, filter: Filter, bind: Bind, keep: Keep) -> _Run:
        return super().__new__(cls, (filter, bind, keep))

    def __call__(self, state: Any, ys: Any, params: Any, inputs: Any) -> Any:
        filter, bind, keep = self
        return drive.run(
            filter, state, ys, params, inputs=inputs, bind=bind, keep=partial(keeps_lanes, keep)
        )


class _LogLikelihood(tuple):
    def __new__(cls, filter: Filter, bind: Bind, segment: int | None) -> _LogLikelihood:
        return super().__new__(cls, (filter, bind, segment))

    def __call__(self, state: Any, ys: Any, params: Any, inputs: Any) -> Any:
        filter, bind, segment = self
        return drive.log_likelihood(
            filter, state, ys, params, inputs=inputs, bind=bind, segment=segment
        )


class _Total(tuple):
    def __new__(cls, filter: Filter, bind: Bind, score: Score, segment: int | None) -> _Total:
        return super().__new__(cls, (filter, bind, score, segment))

    def __call__(self, state: Any, ys: Any, params: Any, inputs: Any) -> Any:
        filter, bind, score, segment = self
        return drive.total(
            filter,
            state,
            ys,
            params,
            score,
            targets=inputs[1],
            inputs=inputs,
            bind=bind,
            segment=segment,
        )


@lru_cache(maxsize=64)
def _first(bind: Bind) -> Bind:
    """`bind` with the first of (inputs, targets)."""
    return lambda params, both: bind(params, both[0])


def _batched(
    work: Any, trees: tuple, in_axes: Axes, lanes: int, devices: Sequence[Any] | None
) -> Any:
    if lanes < 1:
        raise ValueError(f"lanes={lanes}: give at least 1 run per chunk")
    leaves, structure = jax.tree.flatten(trees)
    mapped = tuple(_flat_axes(in_axes, trees))
    lengths = {leaf.shape[0] for leaf, m in zip(leaves, mapped, strict=True) if m}
    if len(lengths) != 1:
        raise ValueError(
            f"in_axes={in_axes}: run axes of length {sorted(lengths)}; mark with 0 what has a "
            "leading run axis, all of one length"
        )
    (runs,) = lengths
    _refuse_stray_axes(work, jax.tree.unflatten(structure, _one_run(leaves, mapped)), in_axes)
    description = (work, structure, mapped, runs, lanes, tuple(devices or jax.devices()))
    if any(isinstance(leaf, jax.core.Tracer) for leaf in leaves):
        return _function(*description)(leaves)
    return _compiled(*description)(leaves)


@lru_cache(maxsize=64)
def _compiled(*description: Any) -> Callable[[list[Any]], Any]:
    return staged_jit(_function(*description))


def _function(
    work: Any,
    structure: Any,
    mapped: tuple[bool, ...],
    runs: int,
    lanes: int,
    devices: tuple[Any, ...],
) -> Callable[[list[Any]], Any]:
    """From leaves with leading run axes to results with leading run axes, by chunks in lanes."""
    share = -(-runs // len(devices))
    width = min(lanes, share)
    chunks = -(-share // width) * len(devices)
    padding = chunks * width - runs
    mapped_tree = jax.tree.unflatten(structure, mapped)

    def chunked(leaf: Any) -> Any:
        """[runs, ...] to [chunks, ..., width], the last run repeated to fill up."""
        leaf = jnp.asarray(leaf)
        if padding:
            fill = jnp.broadcast_to(leaf[-1:], (padding, *leaf.shape[1:]))
            leaf = jnp.concatenate([leaf, fill])
        return jnp.moveaxis(leaf.reshape(chunks, width, *leaf.shape[1:]), 1, -1)

    def restored(leaf: Any) -> Any:
        leaf = jnp.moveaxis(leaf, -1, 1)
        return leaf.reshape(chunks * width, *leaf.shape[2:])[:runs]

    def one_chunk(shared: list[Any], own: list[Any]) -> Any:
        own_leaves, shared_leaves = iter(own), iter(shared)
        both = [next(own_leaves) if m else next(shared_leaves) for m in mapped]
        state, ys, params, inputs = jax.tree.unflatten(structure, both)
        state = jax.tree.map(partial(_repeat, width), state, mapped_tree[0])
        ys = jax.tree.map(partial(_repeat, width), ys, mapped_tree[1])
        return work(state, ys, params, inputs)

    def share_of_device(shared: list[Any], own: list[Any]) -> Any:
        if chunks == len(devices):
            first = one_chunk(shared, [leaf[0] for leaf in own])
            return jax.tree.map(lambda a: a[None], first)
        return jax.lax.map(lambda chunk: one_chunk(shared, chunk), own)

    def whole(leaves: list[Any]) -> Any:
        own = [chunked(leaf) for leaf, m in zip(leaves, mapped, strict=True) if m]
        shared = [jnp.asarray(leaf) for leaf, m in zip(leaves, mapped, strict=True) if not m]
        function = share_of_device
        if len(devices) > 1:
            mesh = jax.sharding.Mesh(np.asarray(devices), ("chunks",))
            split = jax.sharding.PartitionSpec("chunks")
            function = jax.shard_map(
                share_of_device,
                mesh=mesh,
                in_specs=(jax.sharding.PartitionSpec(), split),
                out_specs=split,
                check_vma=False,
            )
        return jax.tree.map(restored, function(shared, own))

    return whole


def _repeat(width: int, leaf: Any, mapped: bool) -> Any:
    """A leaf without a run axis, repeated in every lane."""
    return leaf if mapped else jnp.broadcast_to(leaf[..., None], (*leaf.shape, width))


def _one_run(leaves: list[Any], mapped: Sequence[bool]) -> list[Any]:
    """Shapes and types of the leaves of a single run."""
    return [
        jax.ShapeDtypeStruct(jnp.shape(leaf)[1 if m else 0 :], jnp.result_type(leaf))
        for leaf, m in zip(leaves, mapped, strict=True)
    ]


def _refuse_stray_axes(work: Any, one_run: tuple, in_axes: Axes) -> None:
    """Raise unless one run's first step is a step on scalars."""
    state, ys, params, inputs = one_run
    filter, bind = work[:2]
    if not all(leaf.shape for leaf in jax.tree.leaves((ys, inputs))):
        raise ValueError(
            f"in_axes={in_axes}: the measurements or inputs of one run have no time axis; give "
            "[runs, time], or None for one record shared by all runs"
        )
    first = jax.tree.map(lambda a: jax.ShapeDtypeStruct(a.shape[1:], a.dtype), (ys, inputs))

    def step(state: Any, first: Any, params: Any) -> Any:
        return filter.step(state, first[0], bind(params, first[1]))

    after, info = jax.eval_shape(step, state, first, params)
    before = [leaf.shape for leaf in jax.tree.leaves(state)]
    if info.log_likelihood.shape or before != [leaf.shape for leaf in jax.tree.leaves(after)]:
        raise ValueError(
            f"in_axes={in_axes}: a step of one run is not one of scalars (log-likelihood of shape "
            f"{info.log_likelihood.shape}); mark with 0 every argument that has a run axis"
        )


def _flat_axes(in_axes: Axes, trees: tuple) -> list[bool]:
    """Whether each leaf has a run axis, from a prefix tree of 0 and None."""
    found: list[bool] = []

    def spread(axis: Any, tree: Any) -> None:
        if axis not in (0, None):
            raise ValueError(f"in_axes={in_axes}: run axes lead, so each entry is 0 or None")
        found.extend([axis == 0] * len(jax.tree.leaves(tree)))

    jax.tree.map(spread, tuple(in_axes), trees, is_leaf=lambda a: a is None)
    return found
