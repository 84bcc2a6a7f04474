"""Every figure of the validation, with the numbers behind it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from wheelhop.estimators.candidates import PRIOR_PRESSURE
from wheelhop.evaluation.courses import Course
from wheelhop.plots.brancati_road import plot_measured_road, plot_road_classes
from wheelhop.plots.error_bounds import ErrorPanel, plot_error_bounds
from wheelhop.plots.pressure_cases import plot_cases
from wheelhop.plots.pressure_courses import plot_modes, plot_tracking
from wheelhop.plots.tuning import plot_tuning
from wheelhop.studies.brancati.claims import ROADS
from wheelhop.studies.brancati.contenders import CONTENDERS, FLOOR, UNTUNED
from wheelhop.studies.brancati.identification_figures import overlay_columns, overlay_figure
from wheelhop.studies.brancati.monte_carlo import MonteCarlo
from wheelhop.studies.brancati.scenarios import CHANGE, CaseResult
from wheelhop.studies.brancati.study import ConventionResult, Validation
from wheelhop.vehicle.tire import pressure_slope


@dataclass(frozen=True)
class StudyFigure:
    """A figure to write.

    Attributes:
        name: of its files.
        figure: to draw.
        columns: numbers behind it, of equal length.
        units: of the columns that have one.
        caption: what it shows.
        section: of the report it belongs to.
    """

    name: str
    figure: Figure
    columns: Mapping[str, Any]
    units: Mapping[str, str]
    caption: str
    section: str


def all_figures(study: Validation) -> Iterator[StudyFigure]:
    """Every figure, drawn one after the other."""
    yield _roads(study)
    if study.measured is not None:
        yield _measured(study)
    for result in study.conventions.values():
        yield from _of_convention(result)


def _of_convention(result: ConventionResult) -> Iterator[StudyFigure]:
    convention = result.convention
    of_roads = ROADS[convention]
    columns, units = overlay_columns(result.identification, result.records)
    yield StudyFigure(
        f"fig05_{convention}",
        overlay_figure(result.identification, result.records),
        columns,
        units,
        f"Fig. 5: wheel acceleration of vehicle and quarter car on a known road; {of_roads}.",
        "identification",
    )
    yield _tuning(result)
    yield _monte_carlo(result)
    shown = {f.name for f, c in zip(result.filters, CONTENDERS, strict=True) if c.parent is None}
    by_figure: dict[int, list[CaseResult]] = {}
    for case in result.cases:
        by_figure.setdefault(case.case.figure, []).append(case)
    for number, cases in by_figure.items():
        yield _case_figure(number, cases, convention, shown)


def _roads(study: Validation) -> StudyFigure:
    table = study.roads.tables()["spectra"]
    figure = plot_road_classes(
        {f"convention {name}": lines for name, lines in study.roads.panels.items()},
        study.roads.indices,
        study.roads.settings.band,
        "With the printed variance, Eq. 5 lies 5 dB below its label",
    )
    return StudyFigure(
        "roads",
        figure,
        table.columns,
        table.units,
        "Eq. 5 to 7: spectra of random roads in both conventions between the ISO 8608 classes, and "
        "their roughness index.",
        "roads",
    )


def _measured(study: Validation) -> StudyFigure:
    road = study.measured
    assert road is not None
    table = road.tables()["spectrum"]
    return StudyFigure(
        "fig12",
        plot_measured_road(road.profile, road.wavenumber, road.density, road.fit, "Measured road"),
        table.columns,
        table.units,
        "Fig. 12: the measured road of the paper, its spectrum between the ISO 8608 classes.",
        "measured",
    )


def _tuning(result: ConventionResult) -> StudyFigure:
    shown = {f.name: f.tuned for f in result.filters}
    shown |= {f"{f.name}, honest": f.tuned for f in result.second}
    floor = result.monte_carlo.figures[FLOOR].statistics.rms
    lengths = [len(t.history) for t in shown.values()]
    names = np.repeat(list(shown), lengths)
    columns = {
        "filter": names,
        "iteration": np.concatenate([np.arange(n) for n in lengths]),
        "objective": np.concatenate([t.history for t in shown.values()]),
        "kind": np.repeat([t.settings.objective for t in shown.values()], lengths),
    }
    return StudyFigure(
        f"tuning_{result.convention}",
        plot_tuning(
            shown,
            f"Tuning through the filters; {ROADS[result.convention]}",
            floors={"mse": float(np.mean((1e-3 * floor) ** 2))},
        ),
        columns,
        {},
        "Objective of each filter on the training runs against iteration, and how far the tuning "
        f"moved; {ROADS[result.convention]}.",
        "tuning",
    )


def _monte_carlo(result: ConventionResult) -> StudyFigure:
    mc = result.monte_carlo
    names = [n for n in mc.figures if n != FLOOR]
    slope = float(pressure_slope(result.cars["A"].tire))
    panels = {n: ErrorPanel(mc.figures[n], mc.tracks[n].stiffness[0] - mc.truth[0]) for n in names}
    runs = len(mc.truth)
    figure = plot_error_bounds(
        mc.t,
        panels,
        f"Errors of the stiffness in {runs} runs; {ROADS[result.convention]}",
        prior=float(mc.figures[FLOOR].statistics.rms[-1]),
        slope=slope,
    )
    columns, units = monte_carlo_columns(mc)
    return StudyFigure(
        f"fig06_{result.convention}",
        figure,
        columns,
        units,
        f"Fig. 6: {runs} Monte Carlo runs; {ROADS[result.convention]}.",
        "monte_carlo",
    )


def monte_carlo_columns(mc: MonteCarlo) -> tuple[dict[str, Any], dict[str, str]]:
    """Statistics over time of every filter: Brancati & Tufano 2022, Eq. 23 to 25."""
    names = list(mc.figures)
    n = len(mc.t)

    def stacked(take: Any) -> np.ndarray:
        return np.concatenate([take(mc.figures[name]) for name in names])

    columns = {
        "filter": np.repeat(names, n),
        "time": np.tile(mc.t, len(names)),
        "mean_error": stacked(lambda f: f.statistics.mean),
        "standard_deviation": stacked(lambda f: f.statistics.std),
        "sigma": stacked(lambda f: f.statistics.sigma),
        "rms_error": stacked(lambda f: f.statistics.rms),
        "nees": stacked(lambda f: f.nees),
        "sample_error": np.concatenate(
            [mc.tracks[name].stiffness[0] - mc.truth[0] for name in names]
        ),
    }
    force = dict.fromkeys(
        ("mean_error", "standard_deviation", "sigma", "rms_error", "sample_error"), "N/m"
    )
    return columns, {"time": "s", **force}


def _case_figure(
    number: int, cases: list[CaseResult], convention: str, shown: set[str]
) -> StudyFigure:
    first = cases[0]
    courses = {n: c for n, c in first.courses.items() if n != FLOOR}
    t = next(iter(courses.values())).t
    of_roads = ROADS[convention]
    title, change = first.case.title, CHANGE * float(t[-1])
    over_all = {n: c for n, c in courses.items() if n.removesuffix(UNTUNED) in shown}
    if number == 13:
        of_roads = f"filters for {of_roads}"
    if number in (7, 8, 9):
        event = (change, f"{first.case.road} to {first.case.then}") if first.case.then else None
        figure = plot_modes(
            t, first.truth, over_all, event, f"{_capital(title)}; {of_roads}", PRIOR_PRESSURE
        )
    elif number == 11:
        figure = plot_cases(
            t,
            {
                c.case.title.split(",")[0]: (
                    c.truth,
                    {n: c.courses[n] for n in over_all},
                )
                for c in cases
            },
            f"A heavier body, class B; {of_roads}",
        )
        title = "sprung mass 1788, 1928 and 2218 kg on a class B road"
    else:
        event = (change, "leak") if number == 10 else None
        figure = plot_tracking(
            t,
            first.truth,
            over_all,
            title=f"{_capital(title)}; {of_roads}",
            event=event,
            prior=PRIOR_PRESSURE,
        )
    columns, units = course_columns(cases)
    section = {7: "classes", 8: "classes", 9: "changes", 10: "changes", 11: "mass", 13: "measured"}
    caption = f"Fig. {number}: {title}; {of_roads}."
    name = f"fig{number:02d}_{convention}"
    return StudyFigure(name, figure, columns, units, caption, section[number])


def course_columns(cases: list[CaseResult]) -> tuple[dict[str, Any], dict[str, str]]:
    """Courses of all filters and cases as flat columns; modes that a filter lacks are NaN."""
    rows: dict[str, list[np.ndarray]] = {}
    every = sorted({m for c in cases for x in c.courses.values() for m in x.modes if len(m) == 1})

    def add(name: str, values: Any) -> None:
        rows.setdefault(name, []).append(np.asarray(values))

    for case in cases:
        for name, x in case.courses.items():
            n = len(x.t)
            add("case", np.repeat(case.case.title, n))
            add("filter", np.repeat(name, n))
            add("time", x.t)
            add("true_pressure", case.truth)
            for column in ("pressure", "sigma", "low", "high"):
                add(column, getattr(x, column))
            for mode in every:
                add(f"pressure_of_mode_{mode}", _mode(x, x.mode_pressure, mode))
                add(f"probability_of_{mode}", _mode(x, x.probabilities, mode))
    columns = {name: np.concatenate(parts) for name, parts in rows.items()}
    units = {
        name: "Pa" for name in columns if "pressure" in name or name in ("sigma", "low", "high")
    }
    return columns, {"time": "s", **units}


def _mode(course: Course, values: np.ndarray, mode: str) -> np.ndarray:
    if mode in course.modes:
        return values[:, course.modes.index(mode)]
    return np.full(len(course.t), np.nan)


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
