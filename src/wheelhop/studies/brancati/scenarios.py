"""The single drives of Brancati & Tufano 2022, section 5.4: Fig. 7 to 11 and 13."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wheelhop.estimators.candidate import Track
from wheelhop.evaluation.courses import Course, course_of
from wheelhop.evaluation.tracking import Tracking, tracking
from wheelhop.studies.brancati.contenders import FLOOR, TunedFilter, floor_track, true_stiffness
from wheelhop.studies.brancati.monte_carlo import STRIDE, kept_times
from wheelhop.studies.brancati.plant import RATE, Drive, Driven, Plant
from wheelhop.vehicle.parameters import BRANCATI_TABLE_1, QuarterCar
from wheelhop.vehicle.tire import pressure_from_stiffness, pressure_slope

FIRST = 2_000_000
"""Number of the first of these drives."""

SPEED = 60 / 3.6
PRESSURE = 220e3
"""Speed [m/s] and pressure [Pa] where the paper states none."""

CHANGE = 0.5
"""Part of the drive after which road or pressure change: 5 of 10 s."""

LOSS = 1.5
"""Duration [s] of the loss of pressure, Fig. 10."""

BODY_MASSES = (1788.0, 1928.0, 2218.0)
"""Sprung mass of the vehicle [kg], Fig. 11: empty, +8 %, +24 %."""


@dataclass(frozen=True)
class Case:
    """A scenario.

    Attributes:
        figure: number of the paper's figure.
        title: in plain words.
        road: class or "measured".
        then: class after the change, or None.
        pressure: at the start [Pa].
        end_pressure: after the loss [Pa], or None.
        payload: on the body [kg].
    """

    figure: int
    title: str
    road: str
    then: str | None = None
    pressure: float = PRESSURE
    end_pressure: float | None = None
    payload: float = 0.0

    @property
    def name(self) -> str:
        """Of files and tables."""
        return f"fig{self.figure:02d}" + (f"_{self.payload:.0f}kg" if self.figure == 11 else "")


CASES = (
    Case(7, "class A road", "A"),
    Case(8, "class D road", "D"),
    Case(9, "from class A to class D midway", "A", then="D"),
    Case(10, "230 to 180 kPa within 1.5 s, class B road", "B", pressure=230e3, end_pressure=180e3),
    *(
        Case(
            11,
            f"sprung mass {mass:.0f} kg, class B road",
            "B",
            payload=mass - BRANCATI_TABLE_1.chassis_mass,
        )
        for mass in BODY_MASSES
    ),
    Case(13, "measured road", "measured"),
)


@dataclass(frozen=True)
class CaseResult:
    """All filters on one scenario and its repetitions on other roads of the kind.

    Attributes:
        case: the scenario.
        truth: pressure of the front-left tyre [Pa], [time].
        courses: by name of the filter.
        figures: over the repetitions, by name of the filter; convergence counts from the loss of
            pressure, where there is one.
        pressure: estimates of all repetitions by name of the filter [Pa], [repetitions, time].
        probabilities: of the modes likewise, [repetitions, time, modes].
    """

    case: Case
    truth: np.ndarray
    courses: dict[str, Course]
    figures: dict[str, Tracking]
    pressure: dict[str, np.ndarray]
    probabilities: dict[str, np.ndarray]


def case_drives(cases: Sequence[Case], repetitions: int, duration: float) -> list[Drive]:
    """Drives [s] of all cases, repetitions of each together; repetition k has road k in all."""
    return [
        Drive(
            FIRST + k,
            SPEED,
            case.pressure,
            case.road,
            then=case.then,
            change=CHANGE * duration,
            end_pressure=case.end_pressure,
            loss=(CHANGE * duration, LOSS),
            payload=case.payload,
        )
        for case in cases
        for k in range(repetitions)
    ]


def judge_cases(
    plant: Plant,
    car: QuarterCar,
    filters: Sequence[TunedFilter],
    cases: Sequence[Case],
    repetitions: int,
    driven: Driven,
) -> list[CaseResult]:
    """Filter the drives of `case_drives` and judge every case.

    Args:
        plant: what the drives share.
        car: the corner, for the truth.
        filters: to compare.
        cases: the scenarios.
        repetitions: of each.
        driven: the drives.
    """
    numbers = [d.number for d in case_drives(cases, repetitions, plant.duration)]
    tracks = {f.name: f.track(driven, numbers, plant.seed, STRIDE) for f in filters}
    samples = next(iter(tracks.values())).stiffness.shape[1]
    modes = {f.name: f.candidate.modes for f in filters}
    tracks[FLOOR] = floor_track(car, len(numbers), samples)
    modes[FLOOR] = ("prior",)
    t = kept_times(plant, samples)
    at = np.round(t * RATE).astype(int) - 1
    truth = true_stiffness(driven, car)[:, at]
    slope = float(pressure_slope(car.tire))
    settling = min(2.0, 0.25 * plant.duration)
    results = []
    for k, case in enumerate(cases):
        own = slice(k * repetitions, (k + 1) * repetitions)
        parts = {name: Track(*(leaf[own] for leaf in track)) for name, track in tracks.items()}
        since = CHANGE * plant.duration if case.end_pressure is not None else 0.0
        results.append(
            CaseResult(
                case,
                driven.pressure[own][0, at],
                {name: course_of(t, part, modes[name], car) for name, part in parts.items()},
                {
                    name: tracking(
                        t,
                        part.stiffness,
                        part.sigma,
                        truth[own],
                        slope,
                        settling=settling,
                        since=since,
                    )
                    for name, part in parts.items()
                },
                {
                    name: np.asarray(pressure_from_stiffness(part.stiffness, car.tire))
                    for name, part in parts.items()
                },
                {name: part.probabilities for name, part in parts.items()},
            )
        )
    return results
