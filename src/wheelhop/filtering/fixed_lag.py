"""Fixed-lag smoothing: what the samples so far say of the state some samples ago.

The lagged belief p(x_{k-lag} | y_1..y_k) comes from a window of filtered states and any
fixed-interval smoother (Rauch, Tung & Striebel 1965 for one model; an IMM's for several), so
it equals that smoother's result on the record cut at k. A step costs `lag` smoother steps
more than the filter's.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from wheelhop.filtering.gaussian import Gaussian, trailing
from wheelhop.filtering.interface import Filter, Info, Named, Params, State


class FixedLagState(NamedTuple):
    """State of a fixed-lag smoother.

    Attributes:
        current: the filter's own state after the last sample, k.
        window: the filter's last lag + 1 states, oldest first, on a leading axis; before
            `lag` samples it begins with copies of the state before the first sample.
        params: the parameters of the steps that led to the window's states, likewise: the
            backward pass needs them as they were, and a filter is handed nothing else of
            what varies in time.
        samples: number of samples seen.
        smoothed: the filter's state at sample k - lag given samples 1..k; for k < lag the
            state one interval before the first sample, given samples 1..k.
    """

    current: State
    window: State
    params: Params
    samples: Any
    smoothed: State


def fixed_lag(filter: Filter, smoother: Callable[..., State], lag: int) -> Filter:
    """Fixed-lag smoother of any filter that has a fixed-interval smoother.

    Args:
        filter: an `extended`, `unscented`, `kalman` or `interacting` filter.
        smoother: its fixed-interval smoother, (states [time], params, inputs=, bind=) ->
            states [time], such as `unscented_smoother(model)` with the filter's own rule.
        lag: number of samples between the last one and the smoothed state; 0 is the filter.

    Returns:
        A `Filter` over `FixedLagState`, with the filter's own `Info`. Its `init` wants the
        parameters as a step will see them. In a long run keep `state.smoothed` alone: the
        whole state is a window per sample.

    In `run_batch`, mark all parameters as mapped: the window stores them per run.

    Raises:
        ValueError: if `lag` is negative; at a step, if its parameters are not shaped as
            those given to `init`; always by `mix`.
    """
    if lag < 0:
        raise ValueError(f"lag={lag}: give 0 or more samples; a negative lag would predict")

    def init(prior: Gaussian, params: Params) -> FixedLagState:
        state = filter.init(prior, params)
        dtype = jax.tree.leaves(state)[0].dtype
        slots = jax.tree.map(lambda leaf: _typed(leaf, dtype), params)
        samples = jnp.zeros((), jnp.int32)
        return FixedLagState(state, _repeat(state, lag), _repeat(slots, lag), samples, state)

    def step(state: FixedLagState, y: Named, params: Params) -> tuple[FixedLagState, Info]:
        _check(state.params, params)
        current, info = filter.step(state.current, y, params)
        window = _push(state.window, current)
        slots = _push(state.params, params)
        samples = state.samples + 1
        beliefs = smoother(window, params, inputs=slots, bind=_params_of_slot)
        chosen = jnp.maximum(lag - samples, 0)
        smoothed = jax.tree.map(lambda leaf: _pick(leaf, chosen), beliefs)
        return FixedLagState(current, window, slots, samples, smoothed), info

    return Filter(init, step, _no_mixture)


def _no_mixture(weights: Any, stacked: State) -> State:
    raise ValueError(
        "a fixed-lag smoother cannot be a member of an IMM, since mixed windows are no "
        "history of one filter; smooth the IMM instead: "
        "fixed_lag(interacting(member), interacting_..._smoother(model), lag)"
    )


def _params_of_slot(params: Params, slot: Params) -> Params:
    del params
    return slot


def _typed(leaf: Any, dtype: Any) -> Any:
    """A parameter as an array; a plain Python number takes the type of the state."""
    array = jnp.asarray(leaf)
    plain = array.weak_type and jnp.issubdtype(array.dtype, jnp.floating)
    return array.astype(dtype) if plain else array


def _repeat(tree: Any, lag: int) -> Any:
    return jax.tree.map(lambda leaf: jnp.stack([jnp.asarray(leaf)] * (lag + 1)), tree)


def _push(window: Any, newest: Any) -> Any:
    """The window a sample later: without its oldest entry, with a new one."""
    return jax.tree.map(
        lambda old, new: jnp.concatenate([old[1:], jnp.asarray(new, old.dtype)[None]]),
        window,
        newest,
    )


def _pick(leaf: Any, slot: Any) -> Any:
    """leaf[slot] by selection, so that every lane may have its own slot."""
    slots = trailing(jnp.arange(leaf.shape[0], dtype=slot.dtype), leaf.ndim)
    slot = slot.reshape((1,) * (leaf.ndim - slot.ndim) + slot.shape)
    return jnp.sum(jnp.where(slots == slot, leaf, jnp.zeros_like(leaf)), 0)


def _check(slots: Params, params: Params) -> None:
    """Refuse parameters of a step that do not fit those `init` was given."""
    expected, structure = jax.tree_util.tree_flatten_with_path(slots)
    found: Any = jax.tree.structure(params)
    if found != structure:
        raise ValueError(
            f"params have the structure {found} at a step and {structure} at init; "
            "give init the parameters of a step, with the inputs bound"
        )
    for (path, slot), leaf in zip(expected, jax.tree.leaves(params), strict=True):
        exact = jnp.issubdtype(jnp.result_type(leaf), jnp.inexact)
        if jnp.shape(leaf) != slot.shape[1:] or exact != jnp.issubdtype(slot.dtype, jnp.inexact):
            raise ValueError(
                f"params{jax.tree_util.keystr(path)} is {jnp.result_type(leaf)}{jnp.shape(leaf)} "
                f"at a step and {slot.dtype}{slot.shape[1:]} at init; give init the parameters "
                "of a step, with the inputs bound"
            )
