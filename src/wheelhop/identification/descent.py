"""Descent from many starts: Adam to get near, then L-BFGS on whitened coordinates (optax)."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax

from wheelhop.errors import InputError, require_in_range
from wheelhop.identification.lbfgs import compiled_advance, derivatives, first_state
from wheelhop.identification.objective import (
    Evaluation,
    Task,
    lost,
)
from wheelhop.identification.parameters import SearchSpace
from wheelhop.identification.whitening import (
    REACH,
    just_inside,
    promised_decrease,
    promises_nothing,
    put_on_bounds,
    released,
    whitening_of,
)

_SHORTEST = 1e-2


class Settings(NamedTuple):
    """Of a descent.

    Attributes:
        warm_up: Adam iterations.
        learning_rate: of Adam, in free numbers.
        iterations: most L-BFGS iterations.
        refresh: L-BFGS iterations after which the coordinates are whitened anew.
        tolerance: a start has converged where the quadratic model promises a smaller decrease,
            relative to its loss.
        memory: of L-BFGS.
    """

    warm_up: int = 10
    learning_rate: float = 0.15
    iterations: int = 40
    refresh: int = 6
    tolerance: float = 1e-8
    memory: int = 8


class Descended(NamedTuple):
    """Where the starts ended.

    Attributes:
        free: free numbers, [starts, n].
        loss: J, [starts].
        converged: whether no step promises a smaller loss, [starts].
        history: lowest J so far after each iteration, [iterations, starts].
        seconds: since the beginning, [iterations].
        evaluations: simulations of all records by then, of all starts, [iterations].
        warm_up: how many of the iterations are Adam's.
    """

    free: np.ndarray
    loss: np.ndarray
    converged: np.ndarray
    history: np.ndarray
    seconds: np.ndarray
    evaluations: np.ndarray
    warm_up: int


OnProgress = Callable[[int, int, float], None]
"""Called with iterations done, iterations at most, and the best loss so far."""


def validate(settings: Settings) -> Settings:
    """The same settings, checked.

    Raises:
        InputError: naming the setting that is out of range.
    """
    for name, low in (("warm_up", 0), ("iterations", 0), ("refresh", 1), ("memory", 1)):
        value = getattr(settings, name)
        if not value >= low:
            raise InputError(f"settings.{name}", f"{value}", f"Give at least {low}.")
    require_in_range("settings.learning_rate", settings.learning_rate, 1e-6, 10.0, "")
    require_in_range("settings.tolerance", settings.tolerance, 0.0, 1.0, "(relative)")
    return settings


def descend(
    starts: np.ndarray,
    task: Task,
    space: SearchSpace,
    mode: str,
    settings: Settings = Settings(),
    on_progress: OnProgress | None = None,
) -> Descended:
    """Descend from all starts together.

    In whitened coordinates z, theta = theta_0 + W z with W W^T the inverse of the Gauss-Newton
    matrix at theta_0, the loss is nearly |z|^2, whatever the parameters' scales and correlations.

    Args:
        starts: free numbers, [starts, n].
        task: what candidates are judged by.
        space: the fitted parameters.
        mode: of the gradient, "forward" or "reverse".
        settings: of the descent.
        on_progress: told after every iteration.
    """
    # optax mixes integers and floats, which the user may have forbidden
    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        return _descend(starts, task, space, mode, settings, on_progress)


def _descend(
    starts: np.ndarray,
    task: Task,
    space: SearchSpace,
    mode: str,
    settings: Settings,
    on_progress: OnProgress | None,
) -> Descended:
    log = _Log(settings.warm_up + settings.iterations, len(starts), on_progress)
    advance = compiled_advance(space, settings.memory)
    derive = derivatives(space, mode)
    free = jnp.asarray(starts, task.weight.dtype)
    free, best = _warm_up(free, derive, task, settings, log)

    tolerance = max(settings.tolerance, 20 * float(jnp.finfo(free.dtype).eps))
    reach = jnp.full((len(starts),), REACH, free.dtype)
    done = 0
    while True:
        free, best = _at_bounds(
            free, _with_normal(free, best, task, space, mode), derive, task, log
        )
        best = _with_normal(free, best, task, space, mode)
        log.note(np.asarray(best.loss))
        whitening = whitening_of(best.normal, best.gradient, free)
        promised = promised_decrease(best.gradient, whitening)
        converged = promises_nothing(promised, best.loss, tolerance)
        stuck = np.asarray(reach < _SHORTEST)
        if done >= settings.iterations or (converged | stuck).all():
            break
        before, center = best.loss, free
        z, found = jnp.zeros_like(free), best
        state = first_state(settings.memory)(z)
        for _ in range(min(settings.refresh, settings.iterations - done)):
            z, new, state, trials = advance(z, state, found, center, whitening, reach, task)
            found = derive(new, task)
            done += 1
            free, best = _chosen(found.loss < best.loss, (new, found), (free, best))
            log.add(np.asarray(best.loss), len(starts) * (1 + int(np.max(trials))))
            promised = promised_decrease(found.gradient, whitening)
            if promises_nothing(promised, found.loss, tolerance).all():
                break
        # a start that a round brought nothing looks nearer by, with a new memory
        gained = before - best.loss > tolerance * before
        reach = jnp.where(gained, REACH, 0.2 * reach)
    gone = np.asarray(lost(best.loss))
    return Descended(
        np.asarray(free),
        np.asarray(best.loss),
        converged & ~gone,
        np.array(log.losses),
        np.array(log.seconds),
        np.array(log.evaluations),
        settings.warm_up,
    )


def _with_normal(
    free: Any, best: Evaluation, task: Task, space: SearchSpace, mode: str
) -> Evaluation:
    """With the Gauss-Newton matrix, which reverse mode does not give."""
    if mode == "forward":
        return best
    return best._replace(normal=derivatives(space, "forward")(free, task).normal)


def _at_bounds(
    free: Any, best: Evaluation, derive: Callable[..., Evaluation], task: Task, log: _Log
) -> tuple[Any, Evaluation]:
    """Puts parameters on the bound they run to, and back inside where the loss falls inwards."""
    inside = just_inside(free)
    if bool(jnp.any(inside != free)):
        found = derive(inside, task)
        log.count(len(free))
        back = released(free, inside, found)
        if bool(jnp.any(back != free)):
            found = derive(back, task)
            log.count(len(free))
            free, best = _chosen(found.loss <= best.loss, (back, found), (free, best))
    there = put_on_bounds(free, best)
    if bool(jnp.any(there != free)):
        found = derive(there, task)
        log.count(len(free))
        free, best = _chosen(found.loss <= best.loss, (there, found), (free, best))
    return free, best


class _Log:
    """What happened, for the history and the progress bar."""

    def __init__(self, most: int, starts: int, on_progress: OnProgress | None):
        self.most, self.on_progress = most, on_progress
        self.best = np.full(starts, np.inf)
        self.losses: list[np.ndarray] = []
        self.seconds: list[float] = []
        self.evaluations: list[int] = []
        self.first_state, self._count = time.perf_counter(), 0

    def count(self, evaluations: int) -> None:
        self._count += evaluations

    def note(self, losses: np.ndarray) -> None:
        """Better losses beside an iteration, which belong to the last one."""
        self.best = np.minimum(self.best, losses)
        self.losses[-1] = self.best

    def add(self, losses: np.ndarray, evaluations: int) -> None:
        self.best = np.minimum(self.best, losses)
        self.count(evaluations)
        self.losses.append(self.best)
        self.seconds.append(time.perf_counter() - self.first_state)
        self.evaluations.append(self._count)
        if self.on_progress is not None:
            self.on_progress(len(self.losses), self.most, float(self.best.min()))


def _warm_up(
    free: Any, derive: Callable[..., Evaluation], task: Task, settings: Settings, log: _Log
) -> tuple[Any, Evaluation]:
    """Adam from every start; returns each start's best place and what is known there."""
    adam = optax.adam(settings.learning_rate)
    state = adam.init(free)
    best = derive(free, task)
    place = free
    log.add(np.asarray(best.loss), len(free))
    found = best
    for _ in range(settings.warm_up):
        # every start's own scale: losses of different starts differ by decades
        slope = found.gradient / jnp.maximum(found.loss, 1e-30)[:, None]
        updates, state = adam.update(slope, state)
        free = optax.apply_updates(free, updates)
        found = derive(free, task)
        better = found.loss < best.loss
        place, best = _chosen(better, (free, found), (place, best))
        log.add(np.asarray(found.loss), len(free))
    return place, best


def _chosen(mask: Any, new: Any, old: Any) -> Any:
    """Start by start, the new where the mask says so."""
    mask = jnp.asarray(mask)
    return jax.tree.map(
        lambda a, b: jnp.where(jnp.expand_dims(mask, tuple(range(1, a.ndim))), a, b), new, old
    )
