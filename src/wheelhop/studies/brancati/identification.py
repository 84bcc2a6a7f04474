"""The identification of Brancati & Tufano 2022, section 5.2 and Table 3, on our full vehicle.

One suspension per ISO 8608 class from nine straight drives whose road and pressure are known, one
for all roads, and one with more parameters free, beside the printed sets on the same records.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.errors import InputError, require_in_range
from wheelhop.identification.identify import Identification, identify
from wheelhop.identification.parameters import SUSPENSION, search_space
from wheelhop.studies.brancati.records import (
    DriveSettings,
    Progress,
    Scenario,
    scenarios_of,
    validate_drives,
)
from wheelhop.studies.corner_errors import Errors, errors_of
from wheelhop.vehicle.corner_modes import (
    CornerModes,
    CriticalDampingRatio,
    corner_modes,
    critical_damping_ratio,
    equivalent_damping,
)
from wheelhop.vehicle.full_vehicle_parameters import suv
from wheelhop.vehicle.parameters import (
    BRANCATI_TABLE_3,
    QuarterCar,
    brancati_suv,
    with_suspension,
)
from wheelhop.vehicle.record import CornerRecord
from wheelhop.vehicle.strut import damper_force

EXTENDED = (
    *SUSPENSION,
    "sprung_mass",
    "unsprung_mass",
    "tire.damping",
    "tire.pressure_coefficient",
)
"""The larger set. The tyre's stiffness stays known: masses, springs and dampers scaled by one
number move alike, so that one of them must be."""

READING_PRESSURE = 180e3
"""Pressure [Pa] at which the sets' modes are told."""

START, ALL, MORE = "start", "all roads", "extended"


@dataclass(frozen=True)
class StudySettings:
    """Of the study.

    Attributes:
        classes: ISO 8608 classes, each with its own set.
        drives: what is driven on the roads of each.
        starts: starting points of each fit.
        extended: parameters of the larger set fitted to all roads; none leaves it out.
    """

    classes: tuple[str, ...] = ("A", "B", "C", "D")
    drives: DriveSettings = field(default_factory=DriveSettings)
    starts: int = 8
    extended: tuple[str, ...] = EXTENDED


QUICK = StudySettings(
    classes=("B",),
    drives=DriveSettings(speeds=(60 / 3.6,), duration=4.0),
    starts=2,
    extended=(),
)
"""Three drives of 4 s and one set: to see that all works, not what is true."""


@dataclass(frozen=True)
class Reading:
    """What a set means as a car.

    Attributes:
        velocity_rms: of the suspension on the set's own roads [m/s].
        damping: c_s + c_snl sqrt(8 / pi) velocity_rms [Ns/m].
        ratio: over critical damping, of body and wheel by themselves.
        modes: of the whole corner.
    """

    velocity_rms: float
    damping: float
    ratio: CriticalDampingRatio
    modes: CornerModes


@dataclass(frozen=True)
class IdentificationStudy:
    """Results of the study.

    Attributes:
        settings: that made it.
        scenarios: the drives, in the order of every array.
        measured_rms: of the records' a_s and a_u [m/s^2], [scenarios, 2].
        cars: quarter car of every set by name: "start", "paper A", "ours A", "all roads".
        fits: the identifications behind ours, by the same names.
        errors: of every set in `cars`, in that order, on all scenarios.
        readings: of every set.
    """

    settings: StudySettings
    scenarios: tuple[Scenario, ...]
    measured_rms: np.ndarray
    cars: dict[str, QuarterCar]
    fits: dict[str, Identification]
    errors: Errors
    readings: dict[str, Reading]

    def rows(self, road_class: str) -> np.ndarray:
        """Indices of the scenarios on roads of a class."""
        return np.array([k for k, s in enumerate(self.scenarios) if s.road_class == road_class])

    def norm(self, name: str, road_class: str) -> float:
        """Euclidean norm [m/s^2] of a set's errors on the roads of a class: 18 for nine drives."""
        rmse = self.errors.rmse[list(self.cars).index(name)]
        return float(np.linalg.norm(rmse[self.rows(road_class)]))

    def measured_norm(self, road_class: str) -> float:
        """The same norm [m/s^2] of a model that predicts nothing."""
        return float(np.linalg.norm(self.measured_rms[self.rows(road_class)]))


def validate_study(settings: StudySettings) -> StudySettings:
    """The same settings, checked.

    Raises:
        InputError: naming the setting that is out of range.
    """
    validate_drives(settings.drives)
    for road_class in settings.classes:
        if road_class not in BRANCATI_TABLE_3:
            raise InputError(
                "--classes",
                f"{road_class!r} is not in the paper's Table 3",
                f"Use some of {''.join(BRANCATI_TABLE_3)}.",
            )
    if not settings.classes or len(set(settings.classes)) != len(settings.classes):
        raise InputError("--classes", f"{settings.classes}", "Give each class once, as ABCD.")
    require_in_range("--starts", settings.starts, 1, 1000, "starting points")
    if settings.extended:
        search_space(settings.extended)
    return settings


def identification_study(
    settings: StudySettings,
    records: Mapping[str, Sequence[CornerRecord]],
    on_progress: Progress | None = None,
) -> IdentificationStudy:
    """Fit all sets and judge them.

    Args:
        settings: of the study.
        records: of each class, in the order of `scenarios_of`.
        on_progress: called with iterations done and in all, at most.

    Raises:
        InputError: for settings or records that cannot be used.
        DivergenceError: if no start of a fit gave a finite simulation.
    """
    validate_study(settings)
    scenarios = tuple(s for c in settings.classes for s in scenarios_of(settings.drives, c))
    everything = [record for c in settings.classes for record in records[c]]
    fits = _fits(settings, records, on_progress)
    cars = {START: brancati_suv()}
    cars |= {
        f"paper {c}": with_suspension(brancati_suv(), BRANCATI_TABLE_3[c]) for c in settings.classes
    }
    cars |= {name: fit.car for name, fit in fits.items()}
    errors = errors_of(list(cars.values()), everything)
    measured = np.concatenate([fits[f"ours {c}"].measured_rms for c in settings.classes])
    readings = {}
    for k, (name, car) in enumerate(cars.items()):
        own = [name.endswith(s.road_class) for s in scenarios]
        velocity = errors.velocity_rms[k]
        # sets of no single class are read on all roads
        velocity = velocity[own] if name[-1] in settings.classes else velocity
        readings[name] = reading_of(car, float(np.sqrt(np.mean(velocity**2))))
    return IdentificationStudy(settings, scenarios, measured, cars, fits, errors, readings)


def _fits(
    settings: StudySettings,
    records: Mapping[str, Sequence[CornerRecord]],
    on_progress: Progress | None,
) -> dict[str, Identification]:
    jobs: list[tuple[str, tuple[str, ...], tuple[str, ...]]] = [
        (f"ours {c}", (c,), SUSPENSION) for c in settings.classes
    ]
    if len(settings.classes) > 1:
        jobs.append((ALL, settings.classes, SUSPENSION))
    if settings.extended:
        jobs.append((MORE, settings.classes, settings.extended))
    fits = {}
    for k, (name, classes, names) in enumerate(jobs):

        def advance(done: int, most: int, best: float, k: int = k) -> None:
            del best
            if on_progress is not None:
                on_progress(k * most + min(done, most), len(jobs) * most)

        fits[name] = identify(
            [record for c in classes for record in records[c]],
            brancati_suv(),
            names=[str(s) for c in classes for s in scenarios_of(settings.drives, c)],
            space=search_space(names),
            starts=settings.starts,
            seed=settings.drives.seed,
            on_progress=advance,
        )
    return fits


def reading_of(car: QuarterCar, velocity_rms: float, pressure: float = READING_PRESSURE) -> Reading:
    """What a quarter car means at a suspension velocity [m/s] and a pressure [Pa]."""
    return Reading(
        velocity_rms,
        equivalent_damping(car, velocity_rms),
        critical_damping_ratio(car, pressure, velocity_rms),
        corner_modes(car, pressure, velocity_rms),
    )


def plant_damping(velocity_rms: float, anti_roll: bool = True) -> float:
    """Linear damping [Ns/m] nearest to the full vehicle's front damper at a Gaussian velocity.

    Args:
        velocity_rms: root mean square of the suspension's velocity [m/s].
        anti_roll: whether the vehicle has its anti-roll bars.
    """
    strut = suv(anti_roll=anti_roll).strut
    unit = np.linspace(-6.0, 6.0, 2001)
    weight = np.exp(-0.5 * unit * unit)
    w = velocity_rms * unit
    dtype = jnp.asarray(0.0).dtype
    front = jax.tree.map(lambda a: jnp.ravel(jnp.asarray(a, dtype))[:1], strut.damper)
    force = damper_force(jnp.asarray(w, dtype), replace(strut, damper=front))
    return float((weight * w * np.asarray(force)).sum() / (weight * w * w).sum())


def plant_damping_on(study: IdentificationStudy, road_class: str) -> float:
    """The vehicle's damping [Ns/m], linearised at the motion of the set fitted to a class."""
    velocity = study.readings[f"ours {road_class}"].velocity_rms
    return plant_damping(velocity, study.settings.drives.anti_roll)
