"""One sample at a time: a step whose state is one vector, for low latency.

A jitted call pays for every array it takes and returns. Packing the state, the parameters and
the result into one vector each leaves three, which makes the call several times faster.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from wheelhop.filtering.drive import Keep, keep_all
from wheelhop.filtering.interface import Filter, Params, State
from wheelhop.staging import staged_jit


class Packed(NamedTuple):
    """A filter for streaming.

    Attributes:
        state: the state now, one vector.
        params: the parameters, one vector.
        step: jitted (state, y [m], params) -> (state, result), all vectors.
        unpack_state: vector -> the filter's state.
        unpack_result: vector -> what `keep` chose, its leaves in the floating type.
        pack_params: parameters of the same structure -> vector.
    """

    state: Any
    params: Any
    step: Callable[[Any, Any, Any], tuple[Any, Any]]
    unpack_state: Callable[[Any], State]
    unpack_result: Callable[[Any], Any]
    pack_params: Callable[[Params], Any]


def packed(
    filter: Filter, state: State, params: Params, measurement: type, keep: Keep = keep_all
) -> Packed:
    """A filter whose step takes and returns vectors.

    Args:
        filter: any `Filter`.
        state: state one sampling interval before the first sample.
        params: the filter's parameters; later ones may differ in value.
        measurement: NamedTuple type of the measurement; `step` takes its entries as an array [m].
        keep: chooses what a step returns beside the state.

    Raises:
        ValueError: if the state holds anything but floating-point numbers.
    """
    dtype = jnp.result_type(*jax.tree.leaves(state))
    if not jnp.issubdtype(dtype, jnp.floating):
        raise ValueError(f"the state holds {dtype}; a packed state is of one floating type")
    state_vector, unpack_state = _ravel(state, dtype)
    params_vector, unpack_params = _ravel(params, dtype)
    y = measurement(*(jnp.zeros((), dtype) for _ in measurement._fields))  # type: ignore[attr-defined]
    kept = jax.eval_shape(lambda s, p: keep(*filter.step(s, y, p)), state, params)
    _, unpack_result = _ravel(jax.tree.map(lambda a: jnp.zeros(a.shape, dtype), kept), dtype)

    @staged_jit
    def step(state: Any, y: Any, params: Any) -> tuple[Any, Any]:
        entries = measurement(*(y[k] for k in range(y.shape[0])))
        new, info = filter.step(unpack_state(state), entries, unpack_params(params))
        return _ravel(new, dtype)[0], _ravel(keep(new, info), dtype)[0]

    return Packed(
        state_vector,
        params_vector,
        step,
        unpack_state,
        unpack_result,
        lambda p: _ravel(p, dtype)[0],
    )


def _ravel(tree: Any, dtype: Any) -> tuple[Any, Callable[[Any], Any]]:
    """All leaves in one vector, and the way back."""
    leaves, structure = jax.tree.flatten(tree)
    shapes = [jnp.shape(leaf) for leaf in leaves]
    ends = [0]
    for shape in shapes:
        ends.append(ends[-1] + math.prod(shape))
    vector = jnp.concatenate([jnp.ravel(jnp.asarray(leaf).astype(dtype)) for leaf in leaves])

    def unravel(vector: Any) -> Any:
        parts = [
            vector[start:stop].reshape(shape)
            for start, stop, shape in zip(ends[:-1], ends[1:], shapes, strict=True)
        ]
        return jax.tree.unflatten(structure, parts)

    return vector, unravel
