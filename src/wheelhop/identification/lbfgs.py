"""Compiled parts of a descent: derivatives, and one L-BFGS iteration of all starts (optax)."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import jax
import optax
from jax.custom_batching import custom_vmap

from wheelhop.identification.loss import Sums
from wheelhop.identification.objective import (
    Evaluation,
    Task,
    candidate_sums,
    evaluate,
    losses,
    of_sums,
)
from wheelhop.identification.parameters import SearchSpace
from wheelhop.identification.whitening import moved
from wheelhop.staging import staged_jit

_LINE_STEPS = 8


@lru_cache(maxsize=16)
def _solver(memory: int) -> optax.GradientTransformationExtraArgs:
    search = optax.scale_by_backtracking_linesearch(
        _LINE_STEPS, decrease_factor=0.4, increase_factor=4.0, max_learning_rate=1.0
    )
    return optax.lbfgs(memory_size=memory, linesearch=search)


@lru_cache(maxsize=32)
def sums_and_derivatives(space: SearchSpace) -> Callable[[Any, Task], tuple[Sums, Evaluation]]:
    """Compiled sums of candidates, and their loss and derivatives carried forward."""

    def both(free: Any, task: Task) -> tuple[Sums, Evaluation]:
        sums = candidate_sums(free, task, space)
        return sums, of_sums(sums, task)

    return staged_jit(both)


@lru_cache(maxsize=32)
def derivatives(space: SearchSpace, mode: str) -> Callable[[Any, Task], Evaluation]:
    """Compiled loss and derivatives of candidates."""
    if mode == "forward":
        return lambda free, task: sums_and_derivatives(space)(free, task)[1]
    return staged_jit(lambda free, task: evaluate(free, task, space, mode))


@lru_cache(maxsize=16)
def compiled_advance(space: SearchSpace, memory: int) -> Callable[..., Any]:
    """Direction and line search of one L-BFGS iteration of all starts, compiled."""
    solver = _solver(memory)

    @custom_vmap
    def value(free: Any, task: Task) -> Any:
        return losses(free[None], task, space)[0]

    @value.def_vmap
    def _values(size: int, batched: Any, free: Any, task: Task) -> tuple[Any, bool]:
        del size, batched
        return losses(free, task, space), True

    def advance(
        z: Any, state: Any, found: Evaluation, center: Any, w: Any, reach: Any, task: Task
    ) -> Any:
        _, back = jax.vjp(lambda z: moved(center, w, z, reach), z)
        (slope,) = back(found.gradient)

        def one(z: Any, state: Any, slope: Any, loss: Any, center: Any, w: Any, r: Any) -> Any:
            def along(z: Any) -> Any:
                return value(moved(center[None], w[None], z[None], r[None])[0], task)

            updates, state = solver.update(slope, state, z, value=loss, grad=slope, value_fn=along)
            return optax.apply_updates(z, updates), state

        z, state = _strong(jax.vmap(one)(z, state, slope, found.loss, center, w, reach))
        return z, moved(center, w, z, reach), state, state[-1].info.num_linesearch_steps

    return staged_jit(advance)


@lru_cache(maxsize=16)
def first_state(memory: int) -> Any:
    """The solver's first state."""
    return jax.jit(lambda z: _strong(jax.vmap(_solver(memory).init)(z)))


def _strong(tree: Any) -> Any:
    """Arrays of definite type, so that a later state does not compile anew."""
    return jax.tree.map(lambda a: jax.lax.convert_element_type(a, a.dtype), tree)
