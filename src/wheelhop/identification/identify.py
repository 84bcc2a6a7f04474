"""Fit parameters of a quarter car to records whose road and pressure are known."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.errors import DivergenceError, InputError, InputWarning
from wheelhop.identification.descent import (
    Descended,
    OnProgress,
    Settings,
    descend,
)
from wheelhop.identification.descent import validate as validate_settings
from wheelhop.identification.drives import SETTLING, Drives, Prepared, prepare
from wheelhop.identification.lbfgs import sums_and_derivatives
from wheelhop.identification.objective import (
    Task,
    gradient_mode,
    lost,
    mean_squares,
    task_of,
)
from wheelhop.identification.parameters import (
    SearchSpace,
    search_space,
    starting_points,
    value_of,
    with_values,
)
from wheelhop.identification.uncertainty import Uncertainty, uncertainty
from wheelhop.identification.whitening import ON_BOUND
from wheelhop.staging import staged_jit
from wheelhop.vehicle.parameters import QuarterCar, validate
from wheelhop.vehicle.record import CornerRecord

STARTS = 8
"""Default number of starting points."""

POOR_FIT = 0.5
"""Unexplained share of the measured accelerations beyond which a fit is called poor."""


@dataclass(frozen=True)
class Identification:
    """A fitted quarter car and what is known of it.

    Attributes:
        car: the fitted quarter car.
        start: the quarter car it began from.
        space: the fitted parameters, whose order all arrays keep.
        values: of the fitted parameters, [n].
        uncertainty: standard errors, correlation, weak directions.
        at_bound: "lower", "upper" or "" for each parameter.
        names: of the records.
        rmse: root mean square errors [m/s^2] of a_s and a_u, [records, 2].
        start_rmse: the same of the start.
        measured_rms: of the measured accelerations [m/s^2], [records, 2].
        loss: Euclidean norm of all `rmse` [m/s^2].
        unexplained: sum of the mean square errors over that of the measured accelerations.
        descent: history of all starts.
        problems: what speaks against the result, in plain words; empty where nothing does.
    """

    car: QuarterCar
    start: QuarterCar
    space: SearchSpace
    values: np.ndarray
    uncertainty: Uncertainty
    at_bound: tuple[str, ...]
    names: tuple[str, ...]
    rmse: np.ndarray
    start_rmse: np.ndarray
    measured_rms: np.ndarray
    loss: float
    unexplained: float
    descent: Descended
    problems: tuple[str, ...]


def identify(
    records: Sequence[CornerRecord],
    start: QuarterCar,
    *,
    names: Sequence[str] | None = None,
    space: SearchSpace | None = None,
    starts: int = STARTS,
    seed: int = 0,
    settling: float = SETTLING,
    settings: Settings = Settings(),
    mode: str | None = None,
    on_progress: OnProgress | None = None,
) -> Identification:
    """Fit by gradient descent on the norm of the acceleration errors (`loss`).

    Args:
        records: checked ones with pressure and elevation, over one or several roads.
        start: quarter car to begin from; what is not fitted keeps its values.
        names: of the records.
        space: what to fit; the four suspension parameters by default.
        starts: starting points, the given one and random ones around it.
        seed: of the random ones.
        settling: time at each record's start that is not judged [s].
        settings: of the descent.
        mode: of the gradient, "forward" or "reverse"; by the number of parameters if None.
        on_progress: told after every iteration.

    Returns:
        The best fit. What speaks against it is in `problems`, and told as an `InputWarning`.

    Raises:
        InputError: for records or settings that cannot be used.
        DivergenceError: if no start gave a finite simulation.
    """
    space = search_space() if space is None else space
    mode = gradient_mode(space) if mode is None else mode
    if mode not in ("forward", "reverse"):
        raise InputError("mode", f"{mode!r} is unknown", "Use 'forward' or 'reverse'.")
    if starts < 1:
        raise InputError("starts", f"{starts}", "Give at least 1 starting point.")
    validate(start)
    validate_settings(settings)
    first = space.free(start)
    prepared = prepare(records, names, settling)
    task = task_of(start, prepared.drives)
    points = starting_points(first, starts, seed)
    found = descend(points, task, space, mode, settings, on_progress)
    if lost(found.loss).all():
        raise DivergenceError(
            f"none of {starts} starts gave a finite simulation; start from parameters of a real "
            "vehicle, narrow the bounds, or check the records' units"
        )
    return _result(found, first, prepared, task, space, start)


def _result(
    found: Descended,
    first: np.ndarray,
    prepared: Prepared,
    task: Task,
    space: SearchSpace,
    start: QuarterCar,
) -> Identification:
    best = int(np.argmin(found.loss))
    free = jnp.asarray(found.free[best], task.weight.dtype)
    bounds = [int(np.sign(f)) if abs(f) >= ON_BOUND else 0 for f in free.tolist()]
    unseen = _unseen(free, float(found.loss[best]), task, space)
    # what the records do not see keeps its start
    free = jnp.where(jnp.asarray(unseen), jnp.asarray(first, free.dtype), free)
    bounds = [0 if gone else b for b, gone in zip(bounds, unseen, strict=True)]
    exact = [
        (space.lower[k] if b < 0 else space.upper[k]) if b else float(v)
        for k, (b, v) in enumerate(zip(bounds, space.values(free), strict=True))
    ]
    exact = [
        float(value_of(start, name)) if gone else v
        for name, v, gone in zip(space.names, exact, unseen, strict=True)
    ]
    values = np.array(exact)
    # as many candidates as there were starts: that is compiled already
    same = jnp.tile(free, (len(found.loss), 1))
    sums = jax.tree.map(lambda a: np.asarray(a[:, 0]), sums_and_derivatives(space)(same, task)[0])
    drives = prepared.drives
    counts = _counts(drives)
    slopes = np.diag(np.asarray(jax.jacobian(space.values)(free)))
    known = uncertainty(
        sums,
        task.weight,
        counts,
        slopes,
        values,
        space,
        tuple(k for k, b in enumerate(bounds) if b),
    )
    both = jnp.stack([free, jnp.asarray(space.free(start, 1e-12), free.dtype)])
    both = jnp.tile(both, (len(free), 1))  # as many as the bounds take: compiled already
    squares = np.asarray(_compiled_squares(space)(both, task))
    measured = np.stack([np.asarray(a * a).sum((1, 2)) for a in (drives.a_s, drives.a_u)], 1)
    car = space.car(free, start)
    car = jax.tree.map(float, _exactly(car, space, values))
    at_bound = tuple({-1: "lower", 0: "", 1: "upper"}[b] for b in bounds)
    unexplained = float(squares[0].sum() / (measured / counts).sum())
    problems = _problems(found, best, space, at_bound, known, unexplained)
    for problem in problems:
        warnings.warn(f"identification: {problem}", InputWarning, stacklevel=3)
    return Identification(
        car=car,
        start=start,
        space=space,
        values=values,
        uncertainty=known,
        at_bound=at_bound,
        names=prepared.names,
        rmse=np.sqrt(squares[0]),
        start_rmse=np.sqrt(squares[1]),
        measured_rms=np.sqrt(measured / counts),
        loss=float(np.sqrt(squares[0].sum())),
        unexplained=unexplained,
        descent=found,
        problems=problems,
    )


@lru_cache(maxsize=32)
def _compiled_squares(space: SearchSpace) -> Any:
    return staged_jit(lambda free, task: mean_squares(free, task, space))


def _unseen(free: Any, loss: float, task: Task, space: SearchSpace) -> list[bool]:
    """Whether a parameter may lie anywhere between its bounds without changing the loss."""
    n = len(free)
    moved = [free.at[k].set(side * ON_BOUND) for k in range(n) for side in (-1, 1)]
    squares = _compiled_squares(space)(jnp.stack(moved), task)
    shares = np.einsum("rc,src->s", np.asarray(task.weight) * _counts(task.drives), squares)
    there = np.nan_to_num(shares, nan=np.inf).reshape(n, 2)
    rounding = 100 * float(np.finfo(np.asarray(free).dtype).eps)
    return [bool(np.all(np.abs(pair - loss) <= rounding * loss)) for pair in there]


def _counts(drives: Drives) -> np.ndarray:
    """Samples that count, [records, 2]."""
    return np.stack([np.asarray(c).sum((1, 2)) for c in (drives.count_s, drives.count_u)], 1)


def _exactly(car: QuarterCar, space: SearchSpace, values: np.ndarray) -> QuarterCar:
    return with_values(car, dict(zip(space.names, values.tolist(), strict=True)))


def _problems(
    found: Descended,
    best: int,
    space: SearchSpace,
    at_bound: Sequence[str],
    known: Uncertainty,
    unexplained: float,
) -> tuple[str, ...]:
    problems = []
    if not found.converged[best]:
        problems.append(
            f"the best of {len(found.loss)} starts was still descending when it ended; allow more "
            "iterations, or start elsewhere"
        )
    gone = int(np.sum(lost(found.loss)))
    if gone:
        problems.append(f"{gone} of {len(found.loss)} starts left the finite numbers")
    for k, (name, side) in enumerate(zip(space.names, at_bound, strict=True)):
        if side:
            bound = space.lower[k] if side == "lower" else space.upper[k]
            problems.append(
                f"{name} is at its {side} bound, {bound:g} {space.units[k]}: the records want "
                "it beyond, so the model's form may not be theirs; it is held there and has no "
                "standard error"
            )
    problems += [f"the records hardly determine {direction}" for direction in known.weak]
    if unexplained > POOR_FIT:
        problems.append(
            f"{unexplained:.0%} of the mean square accelerations stay unexplained: check the "
            "record's units, signs, timing against the road, and the pressure"
        )
    return tuple(problems)
