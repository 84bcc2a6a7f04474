"""The loss of many candidates at once: value, gradient and Gauss-Newton matrix.

The optimisers minimise the unexplained share J: the sum of the records' mean square errors over
that of the measured accelerations. The norm of the paper's 18 root mean square errors is
sqrt(J) times a constant, so both have their minimum at the same parameters.
"""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from wheelhop.identification.drives import Drives
from wheelhop.identification.loss import Sums, block_squares, block_sums
from wheelhop.identification.parameters import SearchSpace
from wheelhop.staging import stage
from wheelhop.vehicle.parameters import QuarterCar

FORWARD_LIMIT = 12
"""Most parameters whose gradient is carried forward: faster up to all nine there are (0.2 s
against 1.3 s); reverse mode, whose cost does not grow with them, is for longer lists to come."""

_LOST = 1e12
_LANES = 8
_SHORT = 4


class Evaluation(NamedTuple):
    """What is known of candidates.

    Attributes:
        loss: J, [candidates]; a huge number where the simulation left the finite numbers.
        gradient: of J by the free numbers, [candidates, n].
        normal: Gauss-Newton matrix of J, sum of de/dtheta_i de/dtheta_j scaled as J is,
            [candidates, n, n]; zeros in reverse mode.
    """

    loss: Any
    gradient: Any
    normal: Any


class Task(NamedTuple):
    """What candidates are judged by: arrays only.

    Attributes:
        base: the parameters that are not fitted.
        drives: the records.
        weight: 1 / (counted samples times the sum of measured mean squares), [records, 2].
    """

    base: QuarterCar
    drives: Drives
    weight: Any


def task_of(base: QuarterCar, drives: Drives) -> Task:
    """The task of fitting these records."""
    base = jax.tree.map(lambda a: jnp.asarray(a, drives.rise.dtype), base)
    counts = jnp.stack([c.sum((1, 2)) for c in (drives.count_s, drives.count_u)], axis=1)
    squares = jnp.stack([(a * a).sum((1, 2)) for a in (drives.a_s, drives.a_u)], axis=1)
    return Task(base, drives, 1.0 / (counts * (squares / counts).sum()))


def mean_squares(free: Any, task: Task, space: SearchSpace) -> Any:
    """Mean square errors [candidates, records, 2] of free numbers [candidates, n]."""
    drives = task.drives
    sums = _square_sums(free, task, space)
    counts = jnp.stack([c.sum((1, 2)) for c in (drives.count_s, drives.count_u)], axis=1)
    return jnp.moveaxis(sums, 1, 0) / counts[None]


def losses(free: Any, task: Task, space: SearchSpace) -> Any:
    """J of candidates [candidates, n] alone: a fraction of the cost of its derivatives."""
    loss = jnp.einsum("rc,rsc->s", task.weight, _square_sums(free, task, space))
    return jnp.where(jnp.isfinite(loss), jnp.minimum(loss, _LOST), _LOST)


def evaluate(free: Any, task: Task, space: SearchSpace, mode: str = "forward") -> Evaluation:
    """Loss and derivatives of candidates.

    Args:
        free: free numbers, [candidates, n].
        task: what they are judged by.
        space: the fitted parameters.
        mode: "forward" carries the derivatives along, "reverse" goes back through the record.
    """
    if mode == "forward":
        return of_sums(candidate_sums(free, task, space), task)
    return _safe(*_reverse(free, task, space))


def of_sums(sums: Sums, task: Task) -> Evaluation:
    """Loss and derivatives from the sums of candidates."""
    sums = jax.tree.map(lambda a: a.sum(2), sums)
    return _safe(
        jnp.einsum("rc,rsc->s", task.weight, sums.squares),
        2.0 * jnp.einsum("rc,rscn->sn", task.weight, sums.gradient),
        jnp.einsum("rc,rscnm->snm", task.weight, sums.normal),
    )


def _safe(loss: Any, gradient: Any, normal: Any) -> Evaluation:
    good = jnp.isfinite(loss) & (loss < _LOST) & jnp.isfinite(gradient).all(1)
    good = good & jnp.isfinite(normal).all((1, 2))
    return Evaluation(
        jnp.where(good, loss, _LOST),
        jnp.where(good[:, None], gradient, 0.0),
        jnp.where(good[:, None, None], normal, 0.0),
    )


def _square_sums(free: Any, task: Task, space: SearchSpace) -> Any:
    def one(f: Any, drive: Drives) -> Any:
        return block_squares(space.car(f, task.base), drive).sum(0)

    return _over(one, free, task.drives)


def lost(loss: Any) -> Any:
    """Whether a loss stands for a simulation that left the finite numbers."""
    return loss >= _LOST


def gradient_mode(space: SearchSpace) -> str:
    """The faster way to a gradient for this number of parameters."""
    return "forward" if len(space.names) <= FORWARD_LIMIT else "reverse"


def candidate_sums(free: Any, task: Task, space: SearchSpace) -> Sums:
    """Errors and derivatives of candidates [candidates, n], [records, candidates, blocks, 2, ...].

    For many parameters there are always `_LANES` candidates or more: with fewer lanes the compiler
    unrolls them, and takes gigabytes for the derivatives.
    """
    missing = _LANES - free.shape[0] if free.shape[1] > _SHORT else 0
    padded = jnp.concatenate([free, jnp.repeat(free[-1:], max(missing, 0), axis=0)])
    sums = _over(lambda f, drive: block_sums(f, space, task.base, drive), padded, task.drives)
    return jax.tree.map(lambda a: a[:, : free.shape[0]], sums)


def _reverse(free: Any, task: Task, space: SearchSpace) -> tuple[Any, Any, Any]:
    def losses(free: Any) -> Any:
        def one(f: Any, drive: Drives) -> Any:
            return block_squares(space.car(f, task.base), drive).sum(0)

        sums = jax.vmap(lambda drive: jax.vmap(lambda f: one(f, drive))(free))(task.drives)
        return jnp.einsum("rc,rsc->s", task.weight, sums)

    loss, back = jax.vjp(losses, free)
    (gradient,) = back(jnp.ones_like(loss))
    n = free.shape[1]
    return loss, gradient, jnp.zeros((free.shape[0], n, n), loss.dtype)


def _over(one: Any, free: Any, drives: Drives) -> Any:
    """A function of candidate and record over all of both, [records, candidates, ...].

    Candidates are the innermost axis, so that they fill the SIMD lanes; all is one stage.
    """

    def everything(free: Any, drives: Drives) -> Any:
        return jax.vmap(lambda drive: jax.vmap(partial(one, drive=drive))(free))(drives)

    return stage(everything)(free, drives)
