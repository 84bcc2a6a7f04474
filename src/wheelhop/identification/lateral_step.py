"""Levenberg-Marquardt steps that fit the coefficients of tyres to records of cornering.

The derivatives are carried along the simulation, which gives the Gauss-Newton matrix with the
gradient. A record's own numbers, initial state and offsets, enter its errors alone: they are
eliminated record by record, so that their number costs nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from wheelhop.estimators.lateral import LateralSample
from wheelhop.filtering.symmetric import factor_of, solved
from wheelhop.identification.lateral_loss import Task, penalty, weighted_errors

LIMIT = 4.0
"""Farthest that a parameter goes from where it started: a factor of 55 of what it is the log of."""

# a promised decrease of chi square that moves no estimate by a thousandth of its standard error
_SETTLED = 1e-6
_RELATIVE = 1e-9
_REACH = 0.5
_LEAST = 1e-7


class Sums(NamedTuple):
    """Of the weighted errors e of a candidate, with J their derivatives by n + 5 numbers.

    Attributes:
        squares: e^2 of the two sensors, [records, 2].
        scores: J^T e over blocks of time, [records, blocks, n + 5].
        normal: J^T J, [records, n + 5, n + 5].
        overloaded: samples in which the guard of the tyre law acts, [records].
    """

    squares: Any
    scores: Any
    normal: Any
    overloaded: Any


class Descent(NamedTuple):
    """Between two steps.

    Attributes:
        theta, own: the best parameters [n] and the records' own numbers [records, 5].
        trial: the next ones to judge, of the same shapes.
        loss: of the best; infinite where none was finite.
        promised: decrease of the loss by the trial.
        damping: of Marquardt.
        sums: at the best.
        converged: whether no step promises a smaller loss.
    """

    theta: Any
    own: Any
    trial: tuple[Any, Any]
    loss: Any
    promised: Any
    damping: Any
    sums: Sums
    converged: Any


def sums(theta: Any, own: Any, task: Task, loads: str, blocks: int) -> Sums:
    """Errors and derivatives of a candidate.

    Args:
        theta, own, task, loads: as in `loss`.
        blocks: of time, a divisor of the number of samples.
    """
    n = theta.shape[0]

    def one(own: Any, drive: LateralSample, weight: Any) -> Sums:
        def errors(both: Any) -> Any:
            e, guarded = weighted_errors(both[:n], both[n:], drive, weight, task, loads)
            return e, (e, guarded)

        slopes, (e, guarded) = jax.jacfwd(errors, has_aux=True)(jnp.concatenate([theta, own]))
        parts = (e[..., None] * slopes).reshape(blocks, -1, slopes.shape[-1])
        flat = slopes.reshape(-1, slopes.shape[-1])
        return Sums((e * e).sum(0), parts.sum(1), flat.T @ flat, guarded.sum())

    return jax.vmap(one)(own, task.drive, task.weight)


class Eliminated(NamedTuple):
    """Normal equations of the parameters, each record's own numbers eliminated.

    Attributes:
        normal: of the parameters, [records, n, n].
        passed: change of a score by a score of the own numbers, [records, n, 5].
        whole: of the own numbers, with their prior, [records, 5, 5].
    """

    normal: Any
    passed: Any
    whole: Any


def eliminated(sums: Sums, damping: Any = 0.0) -> Eliminated:
    """Schur complement of the own numbers in the normal equations.

    Args:
        sums: of a candidate.
        damping: of Marquardt, of the own numbers' diagonal.
    """
    n = sums.normal.shape[-1] - 5
    a, b, c = sums.normal[:, :n, :n], sums.normal[:, :n, n:], sums.normal[:, n:, n:]
    one = jnp.eye(5, dtype=c.dtype)[None]
    whole = c + one
    whole = whole + damping * whole * one
    passed = jnp.swapaxes(_solved(whole, jnp.swapaxes(b, 1, 2)), 1, 2)
    return Eliminated(a - jnp.einsum("rij,rkj->rik", passed, b), passed, whole)


def first(theta: Any, task: Task, blocks: int) -> Descent:
    """A descent that has yet to judge its start [n]."""
    records, n = task.weight.shape[0], theta.shape[0]
    own = jnp.zeros((records, 5), theta.dtype)
    zero = jnp.zeros((), theta.dtype)
    nothing = Sums(
        jnp.zeros((records, 2), theta.dtype),
        jnp.zeros((records, blocks, n + 5), theta.dtype),
        jnp.zeros((records, n + 5, n + 5), theta.dtype),
        jnp.zeros(records, jnp.asarray(0).dtype),
    )
    return Descent(
        theta, own, (theta, own), zero + jnp.inf, zero + 1.0, zero + 0.1, nothing, zero > 1.0
    )


def advance(state: Descent, task: Task, loads: str) -> Descent:
    """Judges the trial, keeps the better, and chooses the next trial.

    Args:
        state: of one start.
        task: what candidates are judged by.
        loads: as in `simulate`.
    """
    found = sums(*state.trial, task, loads, state.sums.scores.shape[1])
    squares = found.squares.sum() + penalty(*state.trial, task)
    better = (squares < state.loss) & jnp.isfinite(found.normal).all()
    # Nielsen 1999: damped by how much of the promise was kept
    kept = 2.0 * (state.loss - squares) / state.promised - 1.0
    eased = state.damping * jnp.where(
        jnp.isfinite(kept), jnp.clip(1.0 - kept * kept * kept, 0.2, 3.0), 1.0
    )
    theta, own, least, best = jax.tree.map(
        lambda new, old: jnp.where(better, new, old),
        (*state.trial, squares, found),
        (state.theta, state.own, state.loss, state.sums),
    )
    damping = jnp.maximum(jnp.where(better, eased, 5.0 * state.damping), _LEAST)
    n, pull = theta.shape[0], 1.0 / (task.spread * task.spread)
    gradient = best.scores.sum(1)
    g, g_own = gradient[:, :n].sum(0) + pull * theta, gradient[:, n:] + own
    step, step_own = _step(best, g, g_own, damping, pull)
    share = jnp.minimum(1.0, _REACH / jnp.maximum(jnp.abs(step).max(), 1e-30))
    step, step_own = share * step, share * step_own
    both = jnp.concatenate([jnp.broadcast_to(step, (own.shape[0], n)), step_own], axis=1)
    bent = jnp.einsum("ri,rij,rj->", both, best.normal, both) + (step_own * step_own).sum()
    bent = bent + pull * (step * step).sum()
    promised = -2.0 * (step @ g + (step_own * g_own).sum()) - bent
    rounding = 20.0 * jnp.finfo(theta.dtype).eps
    enough = _SETTLED + jnp.maximum(_RELATIVE, rounding) * least
    settled = (promised <= enough) & (damping < 1.0) & jnp.isfinite(least)
    trial = jnp.clip(theta + step, -LIMIT, LIMIT), own + step_own
    return Descent(theta, own, trial, least, promised, damping, best, settled)


def _step(best: Sums, g: Any, g_own: Any, damping: Any, pull: Any) -> tuple[Any, Any]:
    """Levenberg-Marquardt step of the parameters [n] and of the own numbers [records, 5]."""
    n = g.shape[0]
    parts = eliminated(best, damping)
    scale = jnp.diagonal(best.normal[:, :n, :n].sum(0)) + pull
    matrix = parts.normal.sum(0) + jnp.diag(pull + damping * scale)
    step = -jnp.linalg.solve(matrix, g - jnp.einsum("rij,rj->i", parts.passed, g_own))
    inner = _solved(parts.whole, g_own)
    return step, -inner - jnp.einsum("i,rij->rj", step, parts.passed)


def _solved(whole: Any, columns: Any) -> Any:
    """The systems of the records' own numbers [records, 5, 5], without LAPACK."""
    return jax.vmap(lambda m, c: solved(factor_of(m), c))(whole, columns)


@lru_cache(maxsize=4)
def compiled_advance(loads: str) -> Callable[[Descent, Task], Descent]:
    """`advance` of all starts of a fit, compiled."""
    return jax.jit(jax.vmap(lambda state, task: advance(state, task, loads), in_axes=(0, None)))
