"""The whole validation of Brancati & Tufano 2022, sections 2 to 5, on our plant."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from wheelhop.errors import InputError, InputWarning, require_in_range
from wheelhop.estimators.candidate import Candidate
from wheelhop.estimators.tuning import OBJECTIVES, TuningSettings
from wheelhop.studies.brancati.contenders import (
    CONTENDERS,
    PRINTED,
    TunedFilter,
    candidates,
    tune_all,
)
from wheelhop.studies.brancati.identification import QUICK as QUICK_IDENTIFICATION
from wheelhop.studies.brancati.identification import (
    IdentificationStudy,
    StudySettings,
    identification_study,
    validate_study,
)
from wheelhop.studies.brancati.measured_road import MeasuredRoadStudy, measured_road
from wheelhop.studies.brancati.misprints import MisprintEffect, misprint_effects, variants
from wheelhop.studies.brancati.monte_carlo import (
    CLASSES,
    TRAINING,
    MonteCarlo,
    monte_carlo,
    sample_drives,
)
from wheelhop.studies.brancati.plant import FLEET, Driven, Plant, drive_all
from wheelhop.studies.brancati.records import drive_classes, stored_drives
from wheelhop.studies.brancati.road_rules import QUICK as QUICK_ROADS
from wheelhop.studies.brancati.road_rules import RoadSettings
from wheelhop.studies.brancati.roads import RoadStudy, road_study
from wheelhop.studies.brancati.scenarios import CASES, Case, CaseResult, case_drives, judge_cases
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.record import CornerRecord
from wheelhop.vehicle.road.build import SPACING
from wheelhop.vehicle.road.profile import elevation_at
from wheelhop.vehicle.road.shape_filter import CONVENTIONS

Bar = Callable[[str, str], AbstractContextManager[Callable[[int, int], None]]]
"""(label, unit) -> a context with a function of work done and work in all."""


TEST_RUNS = 100
"""First runs of the Monte Carlo that tunings are tested on, at most."""


@dataclass(frozen=True)
class ValidationSettings:
    """Of the whole validation.

    Attributes:
        conventions: of road levels; each has its own plant, filters and results.
        runs: of the Monte Carlo.
        training: runs that the filters are tuned on; none of the Monte Carlo is among them.
        repetitions: of each single drive on other roads of the kind.
        duration: of a drive [s].
        noise: of both accelerometers [m/s^2].
        seed: of roads, sensors and scenarios.
        tuning: of the descent, for every filter.
        second_objective: the printed and corrected filters are tuned on this one too, to
            compare; None for not.
        tune_singles: tune the filters of one class by themselves; otherwise they take the tuning
            of the filter over all classes.
        identification: of the quarter car.
        roads: of the road study.
        all_misprints: run the printed filter with each misprint by itself.
        measured: file of the measured road, or None.
    """

    conventions: tuple[str, ...] = CONVENTIONS
    runs: int = 100
    training: int = 40
    repetitions: int = 16
    duration: float = 10.0
    noise: float = 0.5
    seed: int = 0
    tuning: TuningSettings = field(default_factory=lambda: TuningSettings(iterations=25, rate=0.25))
    second_objective: str | None = "log_score"
    tune_singles: bool = True
    identification: StudySettings = field(
        default_factory=lambda: StudySettings(starts=4, extended=())
    )
    roads: RoadSettings = field(default_factory=RoadSettings)
    all_misprints: bool = True
    measured: Path | None = None


QUICK = ValidationSettings(
    runs=16,
    training=12,
    repetitions=2,
    duration=5.0,
    tuning=TuningSettings(iterations=8, rate=0.4, settling=1.0),
    second_objective=None,
    tune_singles=False,
    identification=QUICK_IDENTIFICATION,
    roads=QUICK_ROADS,
    all_misprints=False,
)
"""Small: to see that all works, not what is true."""


@dataclass(frozen=True)
class ConventionResult:
    """Everything that depends on the convention of road levels.

    Attributes:
        convention: "iso8608" or "brancati2022".
        plant: what was driven.
        identification: of the quarter car on this plant.
        records: that it was fitted to, by class.
        cars: the corner by road class, as the filters take it.
        filters: tuned.
        second: printed and corrected filters tuned on the second objective.
        monte_carlo: of `filters`.
        second_monte_carlo: of `second`, on its first runs; None without.
        untuned_monte_carlo: of the filters over all classes before they were tuned, likewise.
        cases: single drives, of the filters and of those before tuning.
        misprints: variants of the printed filter.
    """

    convention: str
    plant: Plant
    identification: IdentificationStudy
    records: dict[str, tuple[CornerRecord, ...]]
    cars: dict[str, QuarterCar]
    filters: list[TunedFilter]
    second: list[TunedFilter]
    monte_carlo: MonteCarlo
    second_monte_carlo: MonteCarlo | None
    untuned_monte_carlo: MonteCarlo
    cases: list[CaseResult]
    misprints: list[MisprintEffect]


@dataclass(frozen=True)
class Validation:
    """All results.

    Attributes:
        settings: that made them.
        roads: Eq. 5 to 7.
        measured: Fig. 12; None without the file.
        conventions: results by convention.
    """

    settings: ValidationSettings
    roads: RoadStudy
    measured: MeasuredRoadStudy | None
    conventions: dict[str, ConventionResult]


def validate_validation(settings: ValidationSettings) -> ValidationSettings:
    """The same settings, checked.

    Raises:
        InputError: naming the setting that is out of range.
    """
    require_in_range("--runs", settings.runs, 2, 1_000_000, "runs")
    require_in_range("--training", settings.training, 2, 100_000, "runs")
    require_in_range("--repetitions", settings.repetitions, 2, 1000, "drives")
    require_in_range("--duration", settings.duration, 4.0, 60.0, "s")
    require_in_range("--noise", settings.noise, 0.0, 100.0, "m/s^2")
    for convention in settings.conventions:
        if convention not in CONVENTIONS:
            raise InputError(
                "--convention", f"{convention!r} is unknown", f"Use one of {CONVENTIONS}."
            )
    if settings.second_objective is not None and settings.second_objective not in OBJECTIVES:
        raise InputError(
            "second_objective",
            f"{settings.second_objective!r} is unknown",
            f"Use one of {OBJECTIVES}.",
        )
    if settings.measured is not None and not settings.measured.is_file():
        raise InputError(
            "--measured-road", f"{settings.measured} is no file", "Name a road profile."
        )
    validate_study(settings.identification)
    return settings


def refuse_other_store(settings: ValidationSettings, store: Path) -> None:
    """Raise `InputError` if a store holds drives of other settings."""
    for convention in settings.conventions:
        chosen = _identification(settings, convention)
        stored_drives(Path(store) / convention / "records", chosen.drives, chosen.classes)


def validation(settings: ValidationSettings, store: Path | None, bar: Bar) -> Validation:
    """Run everything; what is finished in `store` is not computed again.

    Args:
        settings: of the validation.
        store: directory for records and Monte Carlo runs, or None.
        bar: makes a progress bar.

    Raises:
        InputError: for settings out of range, or a store of other drives.
        DivergenceError: naming the drive or filter that left the finite numbers.
    """
    validate_validation(settings)
    measured = None if settings.measured is None else measured_road(settings.measured)
    with bar("random roads", "classes") as advance:
        roads = road_study(replace(settings.roads, seed=settings.seed), advance)
    results: dict[str, ConventionResult] = {}
    for convention in settings.conventions:
        results[convention] = _of_convention(settings, convention, measured, store, bar)
    return Validation(settings, roads, measured, results)


def _of_convention(
    settings: ValidationSettings,
    convention: str,
    measured: MeasuredRoadStudy | None,
    store: Path | None,
    bar: Bar,
) -> ConventionResult:
    place = None if store is None else Path(store) / convention
    identification, records = _identified(settings, convention, place, bar)
    cars = filter_cars(identification)
    plant = Plant(
        settings.duration,
        convention,
        settings.seed,
        settings.noise,
        measured=None if measured is None else _points(measured),
    )
    training, runs, singles = _driven(settings, plant, bar)
    car = cars["A"]
    train_numbers = list(range(TRAINING, TRAINING + settings.training))
    test = (runs, list(range(len(runs.records))))
    data = (car, (training, train_numbers), test)
    chosen = candidates(cars, convention, settings.noise)
    filters, second = _tuned(settings, chosen, data, bar, place)
    with bar("Monte Carlo", "runs") as advance:
        campaign = monte_carlo(plant, car, filters, settings.runs, place, advance, runs)
    count = len(runs.records)
    honest = None
    if second:
        honest = monte_carlo(plant, car, second, count, driven=runs)
    over_all = [f for f, c in zip(filters, CONTENDERS, strict=True) if c.parent is None]
    before_tuning = [f.untuned() for f in over_all if f.candidate.knobs]
    untuned = monte_carlo(plant, car, before_tuning, count, driven=runs)
    with bar("single drives", "sets") as advance:
        cases = judge_cases(
            plant,
            car,
            [*filters, *before_tuning],
            cases_of(settings),
            settings.repetitions,
            singles,
        )
        advance(1, 1)
    names = None if settings.all_misprints else dict(list(variants().items())[:2])
    with bar("misprints", "variants") as advance:
        effects = misprint_effects(plant, cars, runs, filters[PRINTED].tuned.tuning, names, advance)
    return ConventionResult(
        convention,
        plant,
        identification,
        records,
        cars,
        filters,
        second,
        campaign,
        honest,
        untuned,
        cases,
        effects,
    )


def _tuned(
    settings: ValidationSettings,
    chosen: list[Candidate],
    data: tuple[QuarterCar, tuple[Driven, Any], tuple[Driven, Any]],
    bar: Bar,
    store: Path | None,
) -> tuple[list[TunedFilter], list[TunedFilter]]:
    """All filters, and those over all classes on the second objective too."""
    made_of = {n: getattr(settings, n) for n in ("training", "duration", "noise", "seed")}
    made_of["test"] = min(settings.runs, TEST_RUNS)
    own = [k for k, c in enumerate(CONTENDERS) if settings.tune_singles or c.parent is None]
    with bar("tuning", "iterations") as advance:
        found = tune_all(
            [chosen[k] for k in own],
            *data,
            settings.tuning,
            settings.seed,
            None,
            advance,
            store,
            made_of,
        )
    by_number = dict(zip(own, found, strict=True))
    for k, contender in enumerate(CONTENDERS):
        if k not in by_number and contender.parent is not None:
            by_number[k] = TunedFilter(chosen[k], by_number[contender.parent].tuned)
    filters = [by_number[k] for k in range(len(CONTENDERS))]
    if settings.second_objective is None:
        return filters, []
    other = replace(settings.tuning, objective=settings.second_objective)
    over_all = [k for k, c in enumerate(CONTENDERS) if c.parent is None and chosen[k].knobs]
    starts = {f.name: f.tuned for f in filters}
    with bar("tuning for honest errors", "iterations") as advance:
        second = tune_all(
            [chosen[k] for k in over_all],
            *data,
            other,
            settings.seed,
            starts,
            advance,
            store,
            made_of,
        )
    return filters, second


def cases_of(settings: ValidationSettings) -> list[Case]:
    """The single drives; without a measured road those of random roads."""
    return [c for c in CASES if settings.measured is not None or c.road != "measured"]


def filter_cars(identification: IdentificationStudy) -> dict[str, QuarterCar]:
    """The corner by road class; a class that was not identified takes its nearest."""
    identified = identification.settings.classes

    def nearest(wanted: str) -> str:
        return min(identified, key=lambda known: abs(ord(known) - ord(wanted)))

    return {c: identification.fits[f"ours {nearest(c)}"].car for c in CLASSES}


def _identified(
    settings: ValidationSettings, convention: str, place: Path | None, bar: Bar
) -> tuple[IdentificationStudy, dict[str, tuple[CornerRecord, ...]]]:
    chosen = _identification(settings, convention)
    drives = chosen.drives
    store = None if place is None else place / "records"
    with bar(f"driving for Table 3 ({convention})", "drives") as advance:
        records = drive_classes(drives, chosen.classes, store, advance)
    with bar("identification", "iterations at most") as advance, warnings.catch_warnings():
        # what speaks against a fit stands in its results
        warnings.simplefilter("ignore", InputWarning)
        return identification_study(chosen, records, advance), records


def _identification(settings: ValidationSettings, convention: str) -> StudySettings:
    drives = replace(settings.identification.drives, convention=convention, seed=settings.seed)
    return replace(settings.identification, drives=drives)


def _driven(settings: ValidationSettings, plant: Plant, bar: Bar) -> tuple[Driven, Driven, Driven]:
    """Training runs, the first runs of the Monte Carlo, and single drives, in common fleets."""
    count = min(settings.runs, TEST_RUNS)
    drives = sample_drives(range(TRAINING, TRAINING + settings.training), plant.seed)
    drives += sample_drives(range(count), plant.seed)
    drives += case_drives(cases_of(settings), settings.repetitions, settings.duration)
    with bar("driving the plant", "drives") as advance:
        driven = drive_all(plant, drives, advance, fleet=min(FLEET, len(drives)))
    a, b = settings.training, settings.training + count
    return driven.part(slice(0, a)), driven.part(slice(a, b)), driven.part(slice(b, None))


def _points(road: MeasuredRoadStudy) -> np.ndarray:
    """Elevation of the measured road every `SPACING` [m]."""
    profile = road.profile
    x = np.arange(0.0, profile.length, SPACING)
    return np.asarray(elevation_at(profile, x))
