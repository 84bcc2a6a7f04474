"""What is known and how many wheels there are: the cases that a bound on pressure turns on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from wheelhop.evaluation.bounds import (
    Bound,
    Information,
    bound,
    corner_information,
    deviation,
    pair_information,
    pooled,
)
from wheelhop.evaluation.linearisation import linearised
from wheelhop.evaluation.spectra import IsoRoad
from wheelhop.vehicle.parameters import QuarterCar

CORNERS = ("FL", "FR", "RL", "RR")

COHERENCES = (1.0, 0.99, 0.9, 0.0)
"""Of the road under front and rear wheel."""


@dataclass(frozen=True)
class BoundSettings:
    """A drive, the sensors, and what is known beforehand.

    Attributes:
        cars: front and rear corner.
        pressures: of their tyres [Pa].
        road: level and waviness, the truth.
        speed: v [m/s].
        wheelbase: l [m].
        noise: standard deviation of the samples of a_s and of a_u [m/s^2].
        rate: sampling rate [Hz].
        more: what is unknown besides k_t and the level in the case of more unknowns; empty for no
            such case.
        prior: standard deviation of ln k_t of each wheel before the drive; None for no knowledge.
        walk: standard deviation of the random walk of each ln k_t after one second, or None.
    """

    cars: tuple[QuarterCar, QuarterCar]
    pressures: tuple[float, float]
    road: IsoRoad
    speed: float
    wheelbase: float
    noise: tuple[float, float] = (0.5, 0.5)
    rate: float = 500.0
    more: tuple[str, ...] = ("m_s", "k_s", "c_s")
    prior: float | None = None
    walk: float | None = None


class BoundCase(NamedTuple):
    """Best accuracy in one case.

    Attributes:
        key: short name for a table's column.
        label: in words.
        difference: whether it is that of a difference between two wheels.
        relative: standard deviation of ln k_t of the front(-left) wheel, or of the difference of
            two wheels' ln k_t, [time].
    """

    key: str
    label: str
    difference: bool
    relative: np.ndarray


def bound_cases(settings: BoundSettings, time: np.ndarray) -> list[BoundCase]:
    """Bounds of one corner, four corners and axle pairs, from one drive's settings.

    The four corners have independent roads of one level; the axle pairs know neither level nor
    delay. Suspensions are linearised on the road (`linearised`).

    Args:
        settings: of the drive.
        time: since the start [s], increasing, [time].

    Raises:
        InputError: for a setting out of range or an unknown name.
    """
    s = settings
    front, rear = (
        linearised(car, pressure, s.road, s.speed)
        for car, pressure in zip(s.cars, s.pressures, strict=True)
    )

    def corner(car: QuarterCar, pressure: float, *free: str) -> Information:
        free = ("k_t", *free)
        return corner_information(car, pressure, s.road, s.speed, s.noise, free, s.rate)

    def at_best(information: Information) -> Bound:
        return bound(information, time, _each(information, s.prior), _each(information, s.walk))

    lone = {"known": ("road level known", ()), "unknown": ("road level unknown", ("level",))}
    if s.more:
        label = f"road level, {', '.join(s.more)} unknown"
        lone["more"] = (label, tuple(dict.fromkeys(("level", *s.more))))
    cases = [
        BoundCase(
            key, label, False, deviation(at_best(corner(front, s.pressures[0], *free)), "k_t")
        )
        for key, (label, free) in lone.items()
    ]
    wheels = [corner(car, p, "level") for car, p in zip((front, rear), s.pressures, strict=True)]
    four = at_best(pooled({name: wheels[name[0] == "R"] for name in CORNERS}))
    cases += [
        BoundCase("four", "four corners, one level unknown", False, deviation(four, "k_t FL")),
        BoundCase("four_difference", "four corners", True, deviation(four, "k_t FL", "k_t FR")),
    ]
    for coherence in COHERENCES:
        pair = at_best(
            pair_information(
                (front, rear),
                s.pressures,
                s.road,
                s.speed,
                s.wheelbase,
                coherence,
                s.noise,
                ("k_t", "level", "delay"),
                s.rate,
            )
        )
        key, label = f"pair_{coherence:g}", f"front and rear, coherence {coherence:g}"
        both = deviation(pair, "k_t front", "k_t rear")
        cases += [
            BoundCase(key, label, False, deviation(pair, "k_t front")),
            BoundCase(f"{key}_difference", label, True, both),
        ]
    return cases


def _each(information: Information, sigma: float | None) -> Mapping[str, float]:
    """The same deviation for the stiffness of every wheel."""
    if sigma is None:
        return {}
    return {name: sigma for name in information.names if name.split()[0] == "k_t"}


def shown_times(last: float, count: int = 4) -> Sequence[float]:
    """Round times [s], 1, 2 or 5 times a power of ten, up to a last one; at most `count`."""
    steps = [m * 10.0**e for e in range(-2, 6) for m in (1.0, 2.0, 5.0)]
    return [*[t for t in steps if t < 0.99 * last][-(count - 1) :], last]
