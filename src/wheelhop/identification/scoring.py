"""Ascent of a likelihood from many starts by damped Fisher scoring."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from wheelhop.identification.descent import Descended, OnProgress

BOX = 12.0
"""Largest free number [-]: a logistic parameter is within 1e-5 of its bound there."""

_LONGEST = 1.5
_IDLE = 2
_UNDAMPED = 0.1
_EASIER, _HARDER = 0.2, 6.0
_STUCK = 1e8
_FLAT = 1e-9
_ROUNDING = 4.0


class Ascent(NamedTuple):
    """Settings of an ascent.

    Attributes:
        iterations: most evaluations of all starts.
        tolerance: a start has converged where the quadratic model promises less than this gain
            in log-likelihood; half a unit is one standard error.
        patience: iterations after a start has converged that the others still get.
        damping: first share of the information's diagonal that is added to it.
    """

    iterations: int = 60
    tolerance: float = 1e-4
    patience: int = 4
    damping: float = 1e-2


class Point(NamedTuple):
    """What is known at the starts' places.

    Attributes:
        log_likelihood: [starts]; -inf where it is not finite.
        score: its gradient, [starts, n].
        information: expected, [starts, n, n].
    """

    log_likelihood: np.ndarray
    score: np.ndarray
    information: np.ndarray


def ascend(
    starts: np.ndarray,
    evaluate: Callable[[np.ndarray], Point],
    settings: Ascent = Ascent(),
    on_progress: OnProgress | None = None,
    precision: float = float(np.finfo(np.float64).eps),
) -> Descended:
    """Climb from all starts together.

    theta <- theta + (I + mu diag I)^-1 score, with I the expected information and mu lowered after
    a step that gained and raised after one that did not (Levenberg 1944, Marquardt 1963; Osborne
    1992 for scoring). The information costs next to nothing beside the score, and scoring takes
    few evaluations, of which each is a filter's run over all records. Free numbers stay within
    `BOX`: one that rests on it and wants to leave is held; the others step as if it were known.

    Args:
        starts: free numbers, [starts, n].
        evaluate: what is known at free numbers [starts, n].
        settings: of the ascent.
        on_progress: told after every iteration, with the negative log-likelihood as the loss.
        precision: relative rounding of a log-likelihood.

    Returns:
        Where the starts ended, with the negative log-likelihood as the loss and no warm-up.
    """
    place = np.array(starts, float)
    count = len(place)
    best = evaluate(place)
    mu = np.full(count, settings.damping)
    converged = np.zeros(count, bool)
    idle = np.zeros(count, int)
    left = settings.patience
    stuck = ~np.isfinite(best.log_likelihood)
    history, seconds, evaluations = [-best.log_likelihood], [0.0], [count]
    begin = time.perf_counter()
    while len(history) <= settings.iterations:
        step, promised = _within_box(place, best, mu)
        converged |= ~stuck & (promised < settings.tolerance)
        if (converged | stuck).all():
            break
        left -= bool(converged.any())
        if left < 0:
            break
        active = ~(converged | stuck)
        tried = np.where(active[:, None], np.clip(place + step, -BOX, BOX), place)
        found = evaluate(tried)
        rounding = _ROUNDING * precision * np.abs(best.log_likelihood)
        gained = active & (found.log_likelihood >= best.log_likelihood - rounding)
        # where a step that is all but undamped gains nothing, a few in turn, the top is reached
        least = best.log_likelihood + np.maximum(settings.tolerance, rounding)
        idle = np.where(gained & (mu < _UNDAMPED) & (found.log_likelihood < least), idle + 1, 0)
        mu = np.where(gained, np.maximum(mu * _EASIER, 1e-9), mu * _HARDER)
        converged |= (idle > _IDLE) | (active & (mu > _STUCK))
        place = np.where(gained[:, None], tried, place)
        best = Point(
            *(
                np.where(gained.reshape((-1,) + (1,) * (new.ndim - 1)), new, old)
                for new, old in zip(found, best, strict=True)
            )
        )
        history.append(-best.log_likelihood)
        seconds.append(time.perf_counter() - begin)
        evaluations.append(evaluations[-1] + count)
        if on_progress is not None:
            on_progress(len(history) - 1, settings.iterations, float(np.min(history[-1])))
    return Descended(
        place,
        -best.log_likelihood,
        converged,
        np.array(history),
        np.array(seconds),
        np.array(evaluations),
        0,
    )


def _within_box(place: np.ndarray, point: Point, mu: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Steps that do not leave the box, and what undamped ones promise."""
    held = np.zeros(place.shape, bool)
    while True:
        step, promised = _steps(point, mu, held)
        leaving = (np.abs(place) >= BOX) & (step * place > 0) & ~held
        if not leaving.any():
            return step, promised
        held |= leaving


def _steps(point: Point, mu: np.ndarray, held: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Damped steps [starts, n], no entry longer than a limit, and what undamped ones promise."""
    both = held[:, :, None] | held[:, None, :]
    information = np.where(both, 0.0, point.information)
    diagonal = np.einsum("snn->sn", information)
    size = np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    slope = np.where(held, 0.0, point.score) / size
    scaled = information / (size[:, :, None] * size[:, None, :])
    values, vectors = np.linalg.eigh(scaled)
    along = np.einsum("snk,sn->sk", vectors, slope)
    step = np.einsum("snk,sk->sn", vectors, along / (np.maximum(values, 0.0) + mu[:, None])) / size
    seen = values > _FLAT * values[:, -1:]
    promised = 0.5 * np.sum(np.where(seen, along**2 / np.where(seen, values, 1.0), 0.0), axis=1)
    return np.clip(step, -_LONGEST, _LONGEST), promised
