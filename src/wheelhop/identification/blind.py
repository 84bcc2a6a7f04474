"""Fit parameters of a quarter car to records whose road nobody measured."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.errors import DivergenceError, InputError, InputWarning, require_in_range
from wheelhop.identification.descent import Descended, OnProgress
from wheelhop.identification.likelihood import (
    FILTERS,
    LEVEL,
    Fitted,
    Given,
    LikelihoodSums,
    compiled_sums,
    waviness_of,
)
from wheelhop.identification.loss import Sums
from wheelhop.identification.parameters import (
    SearchSpace,
    search_space,
    starting_points,
    with_values,
)
from wheelhop.identification.scoring import Ascent, Point, ascend
from wheelhop.identification.uncertainty import Uncertainty, uncertainty
from wheelhop.identification.unknown_road import RATE, SETTLING, Laid, lay
from wheelhop.vehicle.parameters import QuarterCar, validate
from wheelhop.vehicle.record import CornerRecord
from wheelhop.vehicle.road import CLASSES, class_level, class_of_level

STARTS = 4
"""Default number of starting points."""

NOISE = 0.5
"""Default standard deviation of both accelerometers [m/s^2]."""

MISFIT = 0.1
"""Deviation of the mean NIS from 2 beyond which the model is said not to fit."""

_EDGE = 23.0
_FLAT = 1e-3
_MANY = 1e12


@dataclass(frozen=True)
class BlindIdentification:
    """A quarter car and roads fitted to accelerations alone.

    Attributes:
        car: the fitted quarter car.
        start: the quarter car it began from.
        space: the fitted parameters of the car.
        values: of these, [n].
        labels: of everything fitted: the car's names, "waviness", "noise_a_s" and "noise_a_u"
            where fitted, and "road level of <record>" for each.
        estimates: of everything fitted, in the order of `labels`; levels in m^3/rad.
        uncertainty: of everything fitted, in that order; expected information, and robust.
        at_bound: "lower", "upper" or "" for each parameter of the car.
        names: of the records.
        levels: Gd(W0) of each record's road [m^3/rad].
        classes: ISO 8608 class whose range holds each level.
        waviness: of all roads.
        noise: standard deviations of a_s and a_u [m/s^2].
        nis: mean normalised innovation squared of each record; 2 where the model fits.
        log_likelihood: of all records.
        start_log_likelihood: of the start, with its best road levels of the classes' centres.
        ascent: history of all starts; its losses are negative log-likelihoods.
        problems: what speaks against the result, in plain words; empty where nothing does.
    """

    car: QuarterCar
    start: QuarterCar
    space: SearchSpace
    values: np.ndarray
    labels: tuple[str, ...]
    estimates: np.ndarray
    uncertainty: Uncertainty
    at_bound: tuple[str, ...]
    names: tuple[str, ...]
    levels: np.ndarray
    classes: tuple[str, ...]
    waviness: float
    noise: tuple[float, float]
    nis: np.ndarray
    log_likelihood: float
    start_log_likelihood: float
    ascent: Descended
    problems: tuple[str, ...]


def identify_blind(
    records: Sequence[CornerRecord],
    start: QuarterCar,
    *,
    names: Sequence[str] | None = None,
    space: SearchSpace | None = None,
    waviness: float | None = 2.0,
    noise: tuple[float, float] | None = (NOISE, NOISE),
    starts: int = STARTS,
    seed: int = 0,
    settling: float = SETTLING,
    rate: float = RATE,
    filter: str = "extended",
    settings: Ascent = Ascent(),
    on_progress: OnProgress | None = None,
) -> BlindIdentification:
    """Maximise the likelihood of the accelerations over the car and the level of each road.

    The road is a random input of unknown level: what a filter cannot predict of the accelerations
    must have the covariance that it states (Ljung 1999, prediction-error methods). Masses and
    stiffnesses of one corner cannot all be fitted: accelerations leave a factor common to them
    all undetermined, and the result then names that direction. The tyre's damper is left out, as
    the filter has no road velocity to put into it.

    Args:
        records: checked ones with pressure, over one or several roads; no elevation is read.
        start: quarter car to begin from; what is not fitted keeps its values.
        names: of the records.
        space: what to fit of the car; the four suspension parameters by default.
        waviness: w of all roads, between 1 and 3; fitted if None. The default 2 needs no shaping
            states. A fitted one is that of the shaping states: a road that keeps its slope beyond
            their 5 cycles/m looks further from 2 than it is, and its level moves along.
        noise: standard deviations of a_s and a_u [m/s^2]; fitted if None.
        starts: starting points, the given one and random ones around it.
        seed: of the random ones.
        settling: time at each record's start that does not count [s].
        rate: highest sampling rate that is kept [Hz]; faster records are thinned.
        filter: "extended" or "unscented".
        settings: of the ascent.
        on_progress: told after every iteration.

    Returns:
        The best fit. What speaks against it is in `problems`, and told as an `InputWarning`.

    Raises:
        InputError: for records or settings that cannot be used.
        DivergenceError: if no start gave a finite likelihood.
    """
    space = search_space() if space is None else space
    _check(space, waviness, noise, starts, filter)
    validate(start)
    first = space.free(start)
    laid = lay(records, names, settling, rate, (0.0, 0.0) if noise is None else noise)
    fitted = Fitted(space, waviness is None, noise is None, waviness != 2.0, filter, laid.substeps)
    work = _Work(fitted, laid, start, waviness, noise, starts)
    points = work.with_roads(starting_points(first, starts, seed))
    begun = work.evaluate(points).log_likelihood[0]
    found = ascend(points, work.evaluate, settings, on_progress, work.precision)
    if not np.isfinite(found.loss).any():
        raise DivergenceError(
            f"none of {starts} starts gave a finite likelihood; start from parameters of a real "
            "vehicle, narrow the bounds, or check the records' units"
        )
    return _result(work, found, start, float(begun))


class _Work:
    """The records' likelihood as a function of all free numbers [starts, m].

    These are the car's, the waviness, the noises, and one for every record's level.
    """

    def __init__(
        self,
        fitted: Fitted,
        laid: Laid,
        base: QuarterCar,
        waviness: float | None,
        noise: tuple[float, float] | None,
        starts: int,
    ):
        self.fitted, self.laid, self.starts = fitted, laid, starts
        self.given = Given(
            jax.tree.map(lambda a: jnp.asarray(a, float), base),
            jnp.asarray(2.0 if waviness is None else waviness, float),
            jnp.asarray((NOISE, NOISE) if noise is None else noise, float),
        )
        records, shared = len(laid.names), fitted.shared
        self.size = shared + records
        # which of all free numbers each record has, [records, p]
        common = np.tile(np.arange(shared), (records, 1))
        self.own = np.concatenate([common, shared + np.arange(records)[:, None]], 1)

    @property
    def precision(self) -> float:
        """Relative rounding of a log-likelihood."""
        return float(jnp.finfo(self.given.waviness.dtype).eps)

    @property
    def labels(self) -> tuple[str, ...]:
        roads = ("waviness",) * self.fitted.waviness
        noises = ("noise_a_s", "noise_a_u") * self.fitted.noise
        levels = tuple(f"road level of {name}" for name in self.laid.names)
        return (*self.fitted.space.names, *roads, *noises, *levels)

    def sums(self, points: np.ndarray) -> LikelihoodSums:
        """Sums by block and record, the starts last, in double precision."""
        free = jnp.asarray(points.T[self.own.T], float)
        found = compiled_sums(self.fitted)(free, self.laid.course, self.given)
        return jax.tree.map(lambda a: np.asarray(a, np.float64), found)

    def evaluate(self, points: np.ndarray) -> Point:
        s = self.sums(points)
        count = len(points)
        score, information = np.zeros((count, self.size)), np.zeros((count, self.size, self.size))
        for r, own in enumerate(self.own):
            score[:, own] += s.score[:, :, r].sum(0).T
            shares = np.moveaxis(s.information[:, :, :, r].sum(0), -1, 0)
            information[:, own[:, None], own] += shares
        value = s.log_likelihood.sum((0, 1))
        good = np.isfinite(value) & np.isfinite(score).all(1) & np.isfinite(information).all((1, 2))
        return Point(
            np.where(good, value, -np.inf),
            np.where(good[:, None], score, 0.0),
            np.where(good[:, None, None], information, np.eye(self.size)),
        )

    def in_turn(self, points: np.ndarray) -> np.ndarray:
        """Log-likelihoods of any number of points, by as many at a time as there are starts."""
        fill = -len(points) % self.starts
        padded = np.concatenate([points, np.tile(points[-1:], (fill, 1))])
        pieces = padded.reshape(-1, self.starts, self.size)
        values = [self.evaluate(piece).log_likelihood for piece in pieces]
        return np.concatenate(values)[: len(points)]

    def with_roads(self, cars: np.ndarray) -> np.ndarray:
        """All free numbers from those of the cars: each record's most likely class centre."""
        shared = self.fitted.shared
        points = np.zeros((len(cars), self.size))
        points[:, : cars.shape[1]] = cars
        if self.fitted.noise:
            points[:, shared - 2 : shared] = np.log(NOISE)
        grid = np.log([class_level(c) / LEVEL for c in CLASSES[:6]])
        values = []
        for level in grid:
            points[:, shared:] = level
            value = self.sums(points).log_likelihood.sum(0)
            values.append(np.where(np.isfinite(value), value, -np.inf))
        points[:, shared:] = grid[np.argmax(values, axis=0)].T
        return points


def _check(
    space: SearchSpace,
    waviness: float | None,
    noise: tuple[float, float] | None,
    starts: int,
    filter: str,
) -> None:
    if "tire.damping" in space.names:
        raise InputError(
            "parameters",
            "tire.damping cannot be fitted without a road: it needs the road's velocity",
            "Leave it out, or identify on a known road.",
        )
    if waviness is not None:
        require_in_range("waviness", waviness, 1.0, 3.0, "(no unit)")
    if noise is not None:
        require_in_range("noise of a_s", noise[0], 1e-4, 100.0, "m/s^2")
        require_in_range("noise of a_u", noise[1], 1e-4, 100.0, "m/s^2")
    if starts < 1:
        raise InputError("starts", f"{starts}", "Give at least 1 starting point.")
    if filter not in FILTERS:
        raise InputError("filter", f"{filter!r} is unknown", f"Use one of {list(FILTERS)}.")


def _result(work: _Work, found: Descended, start: QuarterCar, begun: float) -> BlindIdentification:
    space, n = work.fitted.space, len(work.fitted.space.names)
    best = int(np.argmin(found.loss))
    point = found.free[best]
    bounds = _at_bounds(work, point, -float(found.loss[best]), n)
    point = np.array([_EDGE * bounds[k] if k < n and bounds[k] else f for k, f in enumerate(point)])
    sums = jax.tree.map(lambda a: a[..., 0], work.sums(np.tile(point, (work.starts, 1))))

    estimates, slopes = _estimates(work, point)
    for k, side in enumerate(bounds):
        if side:
            estimates[k] = space.lower[k] if side < 0 else space.upper[k]
    known = _uncertainty(work, sums, estimates, slopes, tuple(k for k in range(n) if bounds[k]))
    values = estimates[:n]
    car = with_values(
        jax.tree.map(float, start), dict(zip(space.names, values.tolist(), strict=True))
    )
    levels = estimates[work.fitted.shared :]
    fitted = dict(zip(work.labels, estimates.tolist(), strict=True))
    noise = [float(a) for a in work.given.noise]
    at_bound = tuple({-1: "lower", 0: "", 1: "upper"}[b] for b in bounds)
    nis = 2.0 * sums.nis.sum(0) / np.maximum(sums.entries.sum(0), 1.0)
    problems = _problems(work, found, best, at_bound, known, nis)
    for problem in problems:
        warnings.warn(f"identification: {problem}", InputWarning, stacklevel=3)
    return BlindIdentification(
        car=car,
        start=start,
        space=space,
        values=values,
        labels=work.labels,
        estimates=estimates,
        uncertainty=known,
        at_bound=at_bound,
        names=work.laid.names,
        levels=levels,
        classes=tuple(class_of_level(level) for level in levels.tolist()),
        waviness=fitted.get("waviness", float(work.given.waviness)),
        noise=(fitted.get("noise_a_s", noise[0]), fitted.get("noise_a_u", noise[1])),
        nis=nis,
        log_likelihood=float(sums.log_likelihood.sum()),
        start_log_likelihood=begun,
        ascent=found,
        problems=problems,
    )


def _estimates(work: _Work, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What is fitted, in its units, and its derivatives by the free numbers."""

    def of(free: Any) -> Any:
        n = len(work.fitted.space.names)
        parts = [work.fitted.space.values(free[:n])]
        if work.fitted.waviness:
            parts.append(waviness_of(free[n : n + 1]))
        parts.append(jnp.exp(free[n + work.fitted.waviness : work.fitted.shared]))
        parts.append(LEVEL * jnp.exp(free[work.fitted.shared :]))
        return jnp.concatenate(parts)

    free = jnp.asarray(point, float)
    slopes = jnp.diagonal(jax.jacfwd(of)(free))
    return np.array(of(free), np.float64), np.asarray(slopes, np.float64)


def _at_bounds(work: _Work, point: np.ndarray, value: float, n: int) -> list[int]:
    """-1 or 1 where the likelihood does not fall on the way to the lower or upper bound, else 0.

    A parameter that changes nothing on either way is not at a bound: the records do not see it.
    """
    moved = np.tile(point, (2 * n, 1))
    for k in range(n):
        moved[2 * k, k], moved[2 * k + 1, k] = -_EDGE, _EDGE
    there = work.in_turn(moved).reshape(n, 2)
    flat = there >= value - _FLAT
    return [int(high) - int(low) for low, high in flat.tolist()]


def _uncertainty(
    work: _Work,
    sums: LikelihoodSums,
    estimates: np.ndarray,
    slopes: np.ndarray,
    held: tuple[int, ...],
) -> Uncertainty:
    """Inverse information, and the sandwich of the blocks' scores.

    The information takes the place of a Gauss-Newton matrix of residuals of unit variance.
    """
    m, (blocks, records) = work.size, sums.log_likelihood.shape
    normal, gradient = np.zeros((records, blocks, m, m)), np.zeros((records, blocks, m))
    for r, own in enumerate(work.own):
        normal[r][:, own[:, None], own] = sums.information[..., r]
        gradient[r][:, own] = sums.score[..., r]
    counts = np.full((1, 1), _MANY)
    space = SearchSpace(work.labels, (0.0,) * m, (1.0,) * m)
    flat = Sums(
        np.full((1, 1, 1), _MANY - m),
        gradient.reshape(1, records * blocks, 1, m),
        normal.reshape(1, records * blocks, 1, m, m),
    )
    return uncertainty(flat, np.ones((1, 1)), counts, slopes, estimates, space, held)


def _problems(
    work: _Work,
    found: Descended,
    best: int,
    at_bound: Sequence[str],
    known: Uncertainty,
    nis: np.ndarray,
) -> tuple[str, ...]:
    problems = []
    space = work.fitted.space
    if not found.converged[best]:
        problems.append(
            f"the best of {len(found.loss)} starts was still climbing after the last iteration; "
            "allow more iterations"
        )
    gone = int(np.sum(~np.isfinite(found.loss)))
    if gone:
        problems.append(f"{gone} of {len(found.loss)} starts left the finite numbers")
    for k, (name, side) in enumerate(zip(space.names, at_bound, strict=True)):
        if side:
            bound = space.lower[k] if side == "lower" else space.upper[k]
            problems.append(
                f"{name} is at its {side} bound, {bound:g} {space.units[k]}: the records want "
                "it beyond, or say nothing of it; it is held there and has no standard error"
            )
    problems += [f"the records hardly determine {direction}" for direction in known.weak]
    misfits = [
        f"{name} ({value:.2f})"
        for name, value in zip(work.laid.names, nis.tolist(), strict=True)
        if not abs(value - 2.0) < MISFIT * 2.0
    ]
    if misfits:
        problems.append(
            f"the mean NIS is not 2 in {', '.join(misfits)}: above it the accelerations surprise "
            "the model more than it says, so the standard errors are too small; check units, "
            "signs, the noise of the sensors, and the waviness"
        )
    return tuple(problems)
