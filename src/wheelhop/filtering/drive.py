"""Run a filter over a record: scan, log-likelihood, and chunks for long or watched runs."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.filtering.interface import Filter, Info, Named, Params, Recursion, State
from wheelhop.staging import native_jit, staged_jit

Bind = Callable[[Params, Any], Params]
"""(params, inputs at one time) -> params at that time."""

Keep = Callable[[State, Info], Any]
"""What to store of a step; storing less saves memory."""

Score = Callable[[State, Info, Any], Any]
"""(state, info, target) of one time -> a number."""


class Trajectory(NamedTuple):
    """States after every update and the steps' reports, with a leading time axis."""

    state: State
    info: Info


def keep_all(state: State, info: Info) -> Trajectory:
    """The default `Keep`: everything."""
    return Trajectory(state, info)


def constant_params(params: Params, inputs: Any) -> Params:
    """The default `Bind`: nothing varies in time."""
    del inputs
    return params


def scan(
    filter: Recursion,
    state: State,
    ys: Named,
    params: Params,
    *,
    inputs: Any = None,
    bind: Bind = constant_params,
    keep: Keep = keep_all,
) -> tuple[State, Any]:
    """Filter a record and return the final state too.

    Args:
        filter: any `Filter`, or another `Recursion`.
        state: state one sampling interval before the first sample.
        ys: measurements, every entry [time].
        params: the filter's parameters.
        inputs: pytree of what varies in time (speed, dt), every leaf [time, ...].
        bind: puts the inputs of one time into the parameters.
        keep: chooses what to store of each step.

    Returns:
        The final state, and what `keep` chose with a leading time axis.
    """

    def body(carry: State, slices: Any) -> tuple[State, Any]:
        y, u = slices
        new, info = filter.step(carry, y, bind(params, u))
        return new, keep(new, info)

    return jax.lax.scan(body, state, (ys, inputs))


def run(filter: Recursion, state: State, ys: Named, params: Params, **options: Any) -> Any:
    """Filter a record; as `scan`, without the final state."""
    return scan(filter, state, ys, params, **options)[1]


def run_compiled(
    filter: Filter,
    state: State,
    ys: Named,
    params: Params,
    *,
    inputs: Any = None,
    bind: Bind = constant_params,
    keep: Keep = keep_all,
) -> Any:
    """Filter one record as one native function, compiled once per filter and length.

    Results and arguments as `run`, several times faster for a single record; call it at top level,
    not inside `jit`, `vmap` or `grad`. For many records see `run_batch`.
    """
    return _compiled_piece(filter, bind, keep, True)(state, ys, inputs, params)[1]


def log_likelihood(
    filter: Filter,
    state: State,
    ys: Named,
    params: Params,
    *,
    inputs: Any = None,
    bind: Bind = constant_params,
    segment: int | None = None,
) -> Any:
    """log p(y_1..y_T | params), differentiable in reverse mode through long records.

    Args and memory as `total`.

    Raises:
        ValueError: if `segment` is not positive.
    """
    return total(filter, state, ys, params, evidence, inputs=inputs, bind=bind, segment=segment)


def evidence(state: State, info: Info, target: Any) -> Any:
    """The `Score` of `log_likelihood`."""
    del state, target
    return info.log_likelihood


def total(
    filter: Filter,
    state: State,
    ys: Named,
    params: Params,
    score: Score,
    *,
    targets: Any = None,
    inputs: Any = None,
    bind: Bind = constant_params,
    segment: int | None = None,
) -> Any:
    """Sum of a score over the steps, differentiable in reverse mode through long records.

    Steps and segments of the record are rematerialised in the backward pass, so that memory
    holds the states at the segments' ends and those of one segment: flat in practice, about
    2 sqrt(T) states.

    Args:
        filter, state, ys, params, inputs, bind: as in `scan`.
        score: (state, info, target) of one time -> a number.
        targets: pytree of what the score compares with, every leaf [time, ...].
        segment: samples per segment; the square root of the record's length by default.

    Raises:
        ValueError: if `segment` is not positive.
    """
    samples = jax.tree.leaves(ys)[0].shape[0]
    segment = max(1, math.isqrt(samples)) if segment is None else segment
    if segment < 1:
        raise ValueError(f"segment={segment}: give at least 1 sample per segment")
    segments = -(-samples // segment)

    def cut(array: Any) -> Any:
        extra = segments * segment - samples
        if extra:
            fill = jnp.broadcast_to(array[-1:], (extra, *array.shape[1:]))
            array = jnp.concatenate([array, fill])
        return array.reshape(segments, segment, *array.shape[1:])

    def add(carry: tuple[State, Any], slices: Any) -> tuple[tuple[State, Any], None]:
        y, u, target, real = slices
        new, info = filter.step(carry[0], y, bind(params, u))
        value = score(new, info, target)
        if segments * segment > samples:  # padding must not run on: its gradient could overflow
            new = jax.tree.map(lambda a, b: jnp.where(real, a, b), new, carry[0])
        return (new, carry[1] + jnp.where(real, value, 0.0)), None

    def add_segment(carry: Any, slices: Any) -> tuple[Any, None]:
        return jax.lax.scan(jax.checkpoint(add), carry, slices)

    record = jax.tree.map(cut, (ys, inputs, targets))
    real = jnp.arange(segments * segment).reshape(segments, segment) < samples
    zero = jnp.zeros(jax.tree.leaves(ys)[0].shape[1:], jax.tree.leaves(state)[0].dtype)
    (_, found), _ = jax.lax.scan(jax.checkpoint(add_segment), (state, zero), (*record, real))
    return found


def run_in_chunks(
    filter: Filter,
    state: State,
    ys: Named,
    params: Params,
    *,
    chunk: int,
    inputs: Any = None,
    bind: Bind = constant_params,
    keep: Keep = keep_all,
    whole: bool = True,
) -> Iterator[tuple[int, Any]]:
    """Filter a long record piece by piece, in one compiled function.

    Memory is that of one chunk, and the caller can show progress. The last chunk is padded
    with missing measurements and the last inputs, and the padding is cut off again.

    Args:
        chunk: samples per piece.
        whole: compile the whole loop as one native function; otherwise stage by stage, which
            takes a tenth of the compile time for a large filter and several times the run time.

    Yields:
        The number of samples done so far, and what `keep` chose for this piece as NumPy arrays.

    Raises:
        ValueError: if `chunk` is not positive.
    """
    if chunk < 1:
        raise ValueError(f"chunk={chunk}: give at least 1 sample per piece")
    ys = jax.tree.map(np.asarray, ys)
    inputs = jax.tree.map(np.asarray, inputs)
    total = jax.tree.leaves(ys)[0].shape[0]

    piece = _compiled_piece(filter, bind, keep, whole)
    for start in range(0, total, chunk):
        stop = min(start + chunk, total)
        pad = start + chunk - stop
        y = _cut(ys, start, stop, pad, np.nan)
        u = _cut(inputs, start, stop, pad, None)
        state, kept = piece(state, y, u, params)
        yield stop, _cut(jax.tree.map(np.asarray, kept), 0, stop - start, 0, None)


@lru_cache(maxsize=32)
def _compiled_piece(
    filter: Filter, bind: Bind, keep: Keep, whole: bool = True
) -> Callable[..., tuple[State, Any]]:
    """One jitted function per filter, so that the next record does not compile again."""

    def piece(state: State, ys: Named, inputs: Any, params: Params) -> tuple[State, Any]:
        return scan(filter, state, ys, params, inputs=inputs, bind=bind, keep=keep)

    return native_jit(piece) if whole else staged_jit(piece)


def _cut(tree: Any, start: int, stop: int, pad: int, value: float | None) -> Any:
    """Rows start to stop of every leaf, then `pad` rows of `value` (None: the last row)."""

    def leaf(array: Any) -> Any:
        rows = array[start:stop]
        if pad == 0:
            return rows
        fill = rows[-1:] if value is None else np.full_like(rows[-1:], value)
        return np.concatenate([rows, np.repeat(fill, pad, axis=0)])

    return jax.tree.map(leaf, tree)
