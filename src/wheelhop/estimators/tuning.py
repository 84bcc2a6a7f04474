"""Tune a candidate's noise and prior by gradient descent through the filter itself."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax

from wheelhop.errors import DivergenceError, InputError, require_in_range
from wheelhop.estimators.candidate import (
    Candidate,
    Records,
    Tuning,
    as_float,
    checked_tuning,
    draw,
    starter,
)
from wheelhop.filtering import Filter, total_batch
from wheelhop.staging import staged_jit

OBJECTIVES = ("mse", "nll", "log_score")


@dataclass(frozen=True)
class TuningSettings:
    """Of the descent.

    Attributes:
        objective: "mse", mean-square error of the stiffness; "nll", negative log-likelihood of
            the measurements; "log_score", negative log of the Gaussian density that the filter
            gives the true stiffness, which rewards honest standard deviations too.
        iterations: of Adam.
        rate: learning rate, in the logarithm of the knobs.
        settling: time [s] at the start that is not judged.
        held: names of knobs that stay as they are.
    """

    objective: str = "mse"
    iterations: int = 60
    rate: float = 0.15
    settling: float = 2.0
    held: tuple[str, ...] = ()


@dataclass(frozen=True)
class Tuned:
    """A tuned candidate.

    Attributes:
        tuning: the best found on the training runs.
        start: where the descent began.
        history: objective on the training runs after each iteration [iterations + 1]; NaN where
            the filter left the finite numbers and the step was taken back.
        train, test: objective of the best on both sets of runs; test NaN without a test set.
        start_test: objective of the start on the test runs.
        settings: of the descent.
    """

    tuning: dict[str, float]
    start: dict[str, float]
    history: np.ndarray
    train: float
    test: float
    start_test: float
    settings: TuningSettings

    @property
    def start_train(self) -> float:
        """Objective of the start on the training runs."""
        return float(self.history[0])


def tune(
    candidate: Candidate,
    records: Records,
    stiffness: Any,
    keys: Any,
    *,
    test: tuple[Records, Any, Any] | None = None,
    start: Tuning | None = None,
    settings: TuningSettings = TuningSettings(),
    on_progress: Callable[[int, int, float], None] | None = None,
) -> Tuned:
    """Descend on an objective through the filter, averaged over runs and time.

    Adam on the logarithms of the knobs, with gradients clipped to length one, since a few runs on
    the brink of losing track have gradients that say little; a step that leads to numbers that are
    not finite is taken back and the rate halved.

    Args:
        candidate: the filter.
        records: training runs.
        stiffness: true k_t [N/m], [runs, time].
        keys: JAX random keys of the training runs [runs].
        test: records, stiffness and keys of runs that are not trained on.
        start: tuning to begin with; the candidate's default for None.
        settings: of the descent.
        on_progress: called with iterations done, in all, and the best objective.

    Returns:
        The best tuning met and how it was found. The objective is in (kN/m)^2 for "mse", and in
        nats per sample otherwise.

    Raises:
        InputError: for settings or a tuning that cannot be used.
        DivergenceError: if the filter leaves the finite numbers where tuning starts.
    """
    validate_settings(candidate, settings)
    first = checked_tuning(candidate, start)
    held = {name: as_float(first[name]) for name in settings.held}
    free = {name: jnp.log(as_float(v)) for name, v in first.items() if name not in held}
    value, slope = objective_of(candidate, records, stiffness, keys, settings, held)
    if not free:
        return _as_it_is(candidate, float(value(free)), first, held, test, settings)

    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        adam = optax.chain(optax.clip_by_global_norm(1.0), optax.adam(1.0, b2=0.98))
        memory = adam.init(free)
    best, best_loss, history, rate = free, np.inf, [], settings.rate
    here = free
    loss, gradient = slope(here)
    best_gradient = gradient
    for k in range(settings.iterations + 1):
        finite = bool(np.isfinite(loss)) and all(np.isfinite(g) for g in gradient.values())
        history.append(float(loss) if finite else np.nan)
        if k == 0 and not finite:
            raise DivergenceError(
                f"{candidate.name} leaves the finite numbers with the tuning it starts from; "
                "raise its process noise"
            )
        if finite and loss < best_loss:
            best, best_loss, best_gradient = here, float(loss), gradient
        if not finite:
            here, gradient, rate = best, best_gradient, 0.5 * rate
            memory = adam.init(free)
        if on_progress is not None:
            on_progress(k, settings.iterations, best_loss)
        if k == settings.iterations:
            break
        with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
            step, memory = adam.update(gradient, memory)
            now = rate * 0.5 * (1.0 + np.cos(np.pi * k / settings.iterations)) + 0.05 * rate
            here = {name: here[name] + now * step[name] for name in here}
        loss, gradient = slope(here)

    tested, untuned = np.nan, np.nan
    if test is not None:
        value, _ = objective_of(candidate, *test, settings, held)
        tested, untuned = float(value(best)), float(value(free))
    found = {name: float(np.exp(best[name])) if name in best else first[name] for name in first}
    return Tuned(found, first, np.asarray(history), best_loss, tested, untuned, settings)


def _as_it_is(
    candidate: Candidate,
    train: float,
    first: dict[str, float],
    held: Mapping[str, Any],
    test: tuple[Records, Any, Any] | None,
    settings: TuningSettings,
) -> Tuned:
    """A candidate of which nothing is tuned."""
    if not np.isfinite(train):
        raise DivergenceError(f"{candidate.name} leaves the finite numbers on the training runs")
    tested = np.nan
    if test is not None:
        tested = float(objective_of(candidate, *test, settings, held)[0]({}))
    return Tuned(first, first, np.array([train]), train, tested, tested, settings)


def objective_of(
    candidate: Candidate,
    records: Records,
    stiffness: Any,
    keys: Any,
    settings: TuningSettings = TuningSettings(),
    held: Mapping[str, Any] | None = None,
) -> tuple[Callable[[Any], Any], Callable[[Any], Any]]:
    """The objective, and the objective with its gradient, of the logarithms of the free knobs.

    Args:
        candidate: the filter.
        records: runs.
        stiffness: true k_t [N/m], [runs, time].
        keys: JAX random keys of the runs [runs].
        settings: which objective, and what is not judged.
        held: knobs that are no argument, by name.

    Raises:
        InputError: for a truth of another shape, or a settling time that leaves nothing.
    """
    data = _data(candidate, records, stiffness, keys, settings)
    kind = (candidate.filter, candidate.prior, candidate.params, candidate.bind)
    score = _score(settings.objective, candidate.read)
    fixed = dict(held or {})

    def compiled(gradient: bool) -> Callable[[Any], Any]:
        return lambda logs: _compiled(*kind, score, gradient)(logs, fixed, candidate.setting, data)

    return compiled(False), compiled(True)


def validate_settings(candidate: Candidate, settings: TuningSettings) -> TuningSettings:
    """The same settings, checked.

    Raises:
        InputError: naming the setting that cannot be used.
    """
    if settings.objective not in OBJECTIVES:
        raise InputError(
            "objective", f"{settings.objective!r} is unknown", f"Use one of {OBJECTIVES}."
        )
    require_in_range("iterations", settings.iterations, 0, 100_000, "iterations")
    require_in_range("rate", settings.rate, 1e-6, 10.0, "(of the logarithm)")
    require_in_range("settling", settings.settling, 0.0, 1e6, "s")
    for name in settings.held:
        if name not in candidate.knobs:
            raise InputError(
                "held", f"{name!r} is no knob of {candidate.name}", f"Use {list(candidate.knobs)}."
            )
    return settings


def _data(
    candidate: Candidate, records: Records, stiffness: Any, keys: Any, settings: TuningSettings
) -> Any:
    """Arrays that the objective needs, measurements and targets among them."""
    truth = as_float(stiffness)
    if truth.shape != records.speed.shape:
        raise InputError(
            "stiffness",
            f"its shape is {truth.shape}, that of the records {records.speed.shape}",
            "Give the true stiffness at every sample.",
        )
    late = records.dt * np.arange(1, truth.shape[1] + 1) > settings.settling
    if not late.any():
        raise InputError(
            "settling",
            f"{settings.settling:g} s leave nothing of {records.dt * truth.shape[1]:g} s",
            "Judge a part of the records.",
        )
    weight = jnp.broadcast_to(as_float(late / late.mean()), truth.shape)
    measured, speed = as_float((records.measured, records.speed))
    drawn = draw(candidate, Records(measured, speed, records.dt), keys)
    return measured, drawn, (truth, weight)


@lru_cache(maxsize=16)
def _compiled(
    filter: Filter, prior: Any, params: Any, bind: Any, score: Any, gradient: bool
) -> Callable[..., Any]:
    """Mean of the score over runs and time, of (logs, held, setting, data); or with its slope."""
    start = starter(filter, prior, params)

    def objective(logs: Any, held: Any, setting: Any, data: Any) -> Any:
        measured, (normals, inputs), targets = data
        tuning = {name: jnp.exp(value) for name, value in logs.items()} | held
        states, found = start(tuning, setting, normals)
        sums = total_batch(
            filter,
            states,
            measured,
            found,
            score,
            targets=targets,
            inputs=inputs,
            bind=bind,
            in_axes=(0, 0, None, 0),
        )
        return jnp.mean(sums) / targets[0].shape[1]

    return staged_jit(jax.value_and_grad(objective) if gradient else objective)


@lru_cache(maxsize=32)
def _score(objective: str, read: Callable[[Any], Any]) -> Callable[[Any, Any, Any], Any]:
    def score(state: Any, info: Any, target: Any) -> Any:
        truth, weight = target
        if objective == "nll":
            return -weight * info.log_likelihood
        reading = read(state)
        error = 1e-3 * (reading.stiffness - truth)
        if objective == "mse":
            return weight * error * error
        sigma = 1e-3 * reading.sigma
        return weight * (0.5 * (error / sigma) ** 2 + jnp.log(sigma))

    return score
