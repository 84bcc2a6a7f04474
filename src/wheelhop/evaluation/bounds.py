"""The best accuracy that any estimator of tyre stiffness can have: Cramer-Rao bounds.

On a long record the Fisher information of a Gaussian process is its length times a rate, an
integral over its spectral matrix (Whittle 1953). Parameters are logarithms, so that deviations
are relative, but for the waviness [-] and the delay between axles [s].
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from wheelhop.errors import InputError
from wheelhop.evaluation.spectra import (
    CORNER_UNKNOWNS,
    ROAD_UNKNOWNS,
    IsoRoad,
    SampledSpectrum,
    corner_spectrum,
    pair_spectrum,
)
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.tire import pressure_slope, stiffness_from_pressure

UNKNOWNS = (*CORNER_UNKNOWNS, *ROAD_UNKNOWNS, "delay")
"""All that can be unknown; "delay" to an axle pair only."""

SHARED = (*ROAD_UNKNOWNS, "delay")
"""What several wheels have in common."""

_UNSEEN = 1e-11
_GROWTH = 20.0


class Information(NamedTuple):
    """Rate at which a record gathers Fisher information of its unknowns.

    Attributes:
        names: of the unknowns, p.
        rate: information per second, symmetric positive semidefinite, [p, p].
    """

    names: tuple[str, ...]
    rate: np.ndarray


class Bound(NamedTuple):
    """What is known of the unknowns after some time.

    Attributes:
        names: of the unknowns, p.
        time: [s], [time].
        information: inverse of the smallest covariance, [time, p, p].
    """

    names: tuple[str, ...]
    time: np.ndarray
    information: np.ndarray


def spectral_information(spectrum: SampledSpectrum, free: Sequence[str]) -> Information:
    """Whittle's information of a sampled Gaussian process.

    I_ij = integral from 0 to the Nyquist frequency of tr(S^-1 S_i S^-1 S_j) df per second
    (Whittle 1953; Dzhaparidze 1986), by the midpoint rule. With S = L L^H it is the inner product
    of the L^-1 S_i L^-H, so it is positive semidefinite whatever the grid.

    Args:
        spectrum: with slopes along the unknowns.
        free: their names.

    Raises:
        InputError: if an unknown is not in the spectrum, or none is named.
    """
    names = tuple(free)
    _known_names(names, tuple(spectrum.slopes))
    if not names or len(set(names)) < len(names):
        raise InputError("unknown", f"{names} names none, or one twice", "Name each once.")
    root = np.linalg.inv(np.linalg.cholesky(spectrum.density))
    across = np.conj(root.swapaxes(1, 2))
    white = np.stack([(root @ spectrum.slopes[name] @ across).ravel() for name in names])
    step = spectrum.frequency[1] - spectrum.frequency[0]
    return Information(names, np.real(white @ np.conj(white.T)) * step)


def corner_information(
    car: QuarterCar,
    pressure: float,
    road: IsoRoad,
    speed: float,
    noise: tuple[float, float] = (0.5, 0.5),
    free: Sequence[str] = ("k_t", "level"),
    rate: float = 500.0,
) -> Information:
    """Information per second that the two accelerometers of one wheel gather.

    Args:
        car: the corner, its suspension taken as linear; see `linearised` and `corner_spectrum`.
        pressure: of the tyre [Pa].
        road: level and waviness, the truth.
        speed: v [m/s].
        noise: standard deviations of the samples of a_s and a_u [m/s^2].
        free: what is unknown, of `UNKNOWNS` but for the delay; all else is known exactly.
        rate: sampling rate [Hz].

    Raises:
        InputError: for an unknown name, or an argument out of range.
    """
    _known_names(free, (*CORNER_UNKNOWNS, *ROAD_UNKNOWNS))
    return spectral_information(corner_spectrum(car, pressure, road, speed, noise, rate), free)


def pair_information(
    cars: tuple[QuarterCar, QuarterCar],
    pressures: tuple[float, float],
    road: IsoRoad,
    speed: float,
    wheelbase: float,
    coherence: float,
    noise: tuple[float, float] = (0.5, 0.5),
    free: Sequence[str] = ("k_t", "level", "delay"),
    rate: float = 500.0,
) -> Information:
    """Information per second of a front wheel and the rear wheel that follows in its track.

    Args:
        cars: front and rear corner, their suspensions taken as linear.
        pressures: of their tyres [Pa].
        road: level and waviness under both, the truth.
        speed: v [m/s].
        wheelbase: l [m]; the rear wheel meets the road l / v later.
        coherence: of the two roads, 0 to 1; see `pair_spectrum`.
        noise: standard deviations of the samples of a_s and a_u [m/s^2].
        free: what is unknown, of `UNKNOWNS`; "k_t" stands for one unknown of each wheel,
            "k_t front" and "k_t rear", as all of `CORNER_UNKNOWNS` do.
        rate: sampling rate [Hz].

    Raises:
        InputError: for an unknown name, or an argument out of range.
    """
    _known_names(free, UNKNOWNS)
    delay = wheelbase / speed
    spectrum = pair_spectrum(cars, pressures, road, speed, delay, coherence, noise, rate)
    names: list[str] = []
    for name in free:
        names += [name] if name in SHARED else [f"{name} front", f"{name} rear"]
    return spectral_information(spectrum, names)


def pooled(parts: Mapping[str, Information]) -> Information:
    """Information of independent records that share level, waviness and delay.

    Four corners whose roads are independent but equally rough: a part for each wheel. A car whose
    left and right tracks are independent: an axle pair for each side.

    Args:
        parts: by label; an unknown that is not shared is named "k_t FL" after its part's label.

    Raises:
        InputError: without parts.
    """
    if not parts:
        raise InputError("parts", "there are none", "Give at least one record.")
    renamed = {
        label: [n if n in SHARED else f"{n} {label}" for n in part.names]
        for label, part in parts.items()
    }
    names = tuple(dict.fromkeys(name for part in renamed.values() for name in part))
    total = np.zeros((len(names), len(names)))
    for label, part in parts.items():
        places = [names.index(name) for name in renamed[label]]
        total[np.ix_(places, places)] += part.rate
    return Information(names, total)


def bound(
    information: Information,
    time: np.ndarray,
    prior: Mapping[str, float] | None = None,
    walk: Mapping[str, float] | None = None,
) -> Bound:
    """What is known at best after some time, with a Gaussian prior and random walks.

    Without a walk, prior + t I. With walks of covariance Q per second the posterior bound
    (Tichavsky et al. 1998) follows Sigma' = Q - Sigma I Sigma, solved exactly:
    [X; Y]' = [[0, I], [Q, 0]] [X; Y] for Sigma^-1 = X Y^-1.

    Args:
        information: rate at the operating point.
        time: since the start [s], increasing and not negative, [time].
        prior: standard deviation before the record, by name, of those that have one.
        walk: standard deviation of a random walk after one second, by name.

    Raises:
        InputError: for a name that is not an unknown here, a deviation that is not positive, or
            times that do not increase.
    """
    t = np.atleast_1d(np.asarray(time, float))
    if (
        t.ndim != 1
        or not t.size
        or not np.all(np.isfinite(t))
        or t[0] < 0
        or np.any(np.diff(t) < 0)
    ):
        raise InputError("time", "is not a row of increasing times", "Give times [s] from 0 on.")
    rate = information.rate
    start = _diagonal(information.names, prior, "prior", -2.0)
    if not walk:
        return Bound(information.names, t, start + t[:, None, None] * rate)
    drift = _diagonal(information.names, walk, "walk", 2.0)
    known, result, before = start, [], 0.0
    for now in t:
        known = _riccati(known, rate, drift, now - before)
        result.append(known)
        before = now
    return Bound(information.names, t, np.stack(result))


def deviation(found: Bound, name: str, minus: str | None = None) -> np.ndarray:
    """Smallest standard deviation of an unknown, or of the difference of two, [time].

    Infinite where the record does not determine it: common factors of masses, springs and
    dampers leave the accelerations as they are.

    Args:
        found: from `bound`.
        name: of the unknown.
        minus: of another one, whose deviation from the first is asked.

    Raises:
        InputError: for a name that is not an unknown here.
    """
    _known_names([name, *([minus] if minus else [])], found.names)
    direction = np.zeros(len(found.names))
    direction[found.names.index(name)] = 1.0
    if minus:
        direction[found.names.index(minus)] -= 1.0
    return np.array([_deviation(each, direction) for each in found.information])


def pressure_deviation(relative: np.ndarray, car: QuarterCar, pressure: float) -> np.ndarray:
    """Standard deviation of the pressure [Pa] for one of ln k_t, at a pressure [Pa]."""
    stiffness = stiffness_from_pressure(pressure, car.tire)
    return np.asarray(relative * float(stiffness * pressure_slope(car.tire)))


def _riccati(known: np.ndarray, rate: np.ndarray, drift: np.ndarray, span: float) -> np.ndarray:
    """Information after `span` [s], in pieces over which nothing grows beyond rounding."""
    scale = 1.0 / np.sqrt(np.where(np.diag(rate) > 0, np.diag(rate), 1.0))
    speed = np.sqrt(np.linalg.norm(scale[:, None] * rate * scale, 2) * np.max(drift / scale**2))
    pieces = max(1, int(np.ceil(span * speed / _GROWTH)))
    x, none = known * scale * scale[:, None], np.zeros_like(rate)
    both = [[none, rate * scale * scale[:, None]], [drift / scale / scale[:, None], none]]
    step = expm(np.block(both) * (span / pieces))
    p = len(rate)
    for _ in range(pieces):
        y = step[p:, :p] @ x + step[p:, p:]
        x = np.linalg.solve(y.T, (step[:p, :p] @ x + step[:p, p:]).T).T
        x = 0.5 * (x + x.T)
    return x / scale / scale[:, None]


def _deviation(information: np.ndarray, direction: np.ndarray) -> float:
    diagonal = np.diag(information)
    scale = 1.0 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    values, vectors = np.linalg.eigh(information * scale * scale[:, None])
    along = vectors.T @ (direction * scale)
    unseen = values < _UNSEEN * max(values[-1], np.finfo(float).tiny)
    if np.any(np.abs(along[unseen]) > 1e-6 * np.linalg.norm(direction * scale)):
        return float("inf")
    return float(np.sqrt(np.sum(along[~unseen] ** 2 / values[~unseen])))


def _diagonal(
    names: tuple[str, ...], given: Mapping[str, float] | None, field: str, power: float
) -> np.ndarray:
    """Diagonal matrix of the given deviations to a power, zero where none is given."""
    given = given or {}
    _known_names(given, names)
    for name, value in given.items():
        if not (np.isfinite(value) and value > 0):
            raise InputError(f"{field} of {name}", f"{value:g}", "Give a positive number.")
    return np.diag([float(given[n]) ** power if n in given else 0.0 for n in names])


def _known_names(given: Iterable[str], names: Sequence[str]) -> None:
    for name in given:
        if name not in names:
            raise InputError(
                "unknown", f"{name!r} is not one of this record", f"Use {', '.join(names)}."
            )
