"""The report of the validation, and everything it writes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from wheelhop.io.report import FigureFile, Report, Section, count_verdicts, write_report
from wheelhop.io.results import output_directory, write_figure, write_json, write_table
from wheelhop.studies.brancati.claims import ROADS, rmse_text
from wheelhop.studies.brancati.claims_drives import case_findings
from wheelhop.studies.brancati.claims_monte_carlo import monte_carlo_findings
from wheelhop.studies.brancati.claims_roads import (
    identification_findings,
    road_findings,
    road_table,
    suspension_table,
)
from wheelhop.studies.brancati.claims_tables import (
    comparison_table,
    misprint_findings,
    misprint_table,
    tuning_table,
)
from wheelhop.studies.brancati.contenders import CONTENDERS
from wheelhop.studies.brancati.figures import all_figures
from wheelhop.studies.brancati.monte_carlo import CLASSES, MonteCarlo
from wheelhop.studies.brancati.study import ConventionResult, Validation

Figures = Mapping[str, list[FigureFile]]

TITLE = "Indirect estimation of tyre pressure: Brancati & Tufano 2022 on our own plant"

_QUICK_WARNING = (
    "This was a quick run: a few short drives and a few iterations, to see that everything works. "
    "Its numbers and verdicts mean nothing."
)


def write_validation(
    study: Validation,
    directory: Path,
    made_by: Mapping[str, Any],
    quick: bool = False,
    on_progress: Callable[[int, int], None] | None = None,
) -> list[str]:
    """Write figures, their data, results and report.

    Args:
        study: the results.
        directory: made if needed.
        made_by: command, versions, settings, for the report's end.
        quick: say that the numbers mean nothing.
        on_progress: called with figures done and in all.

    Returns:
        Names of the files.
    """
    directory = output_directory(directory)
    written: dict[str, list[FigureFile]] = {}
    names = []
    # road, measured road, and of each convention the overlay, tuning, Monte Carlo and drives
    total = 1 + (study.measured is not None)
    total += sum(3 + len({c.case.figure for c in r.cases}) for r in study.conventions.values())
    for figure in all_figures(study):
        image = write_figure(directory / f"{figure.name}.png", figure.figure)
        data = write_table(
            directory / f"{figure.name}.parquet", dict(figure.columns), dict(figure.units)
        )
        file = FigureFile(Path(image), figure.caption, Path(data))
        written.setdefault(figure.section, []).append(file)
        names += [file.file.name, f"{figure.name}.parquet"]
        if on_progress is not None:
            on_progress(len(names) // 2, total)
    write_runs(directory / "monte_carlo.parquet", study)
    report = report_of(study, written, made_by, quick)
    findings = [_plain(asdict(f)) for section in report.sections for f in section.findings]
    content = {**made_by, "findings": findings, "results": results_of(study)}
    write_json(directory / "results.json", content)
    write_report(report, directory)
    return ["report.html", "report.md", "results.json", "monte_carlo.parquet", *names]


def report_of(
    study: Validation, figures: Figures, made_by: Mapping[str, Any], quick: bool = False
) -> Report:
    """The report, row by row.

    Args:
        study: the results.
        figures: that were written, by section.
        made_by: for the report's end.
        quick: say that the numbers mean nothing.
    """
    each = list(study.conventions.values())
    sections = (
        Section(
            "Roads",
            (
                "Random roads by the paper's shape filter, in the convention of ISO 8608 and in "
                "the paper's.",
            ),
            road_findings(study.roads),
            (road_table(study.roads),),
            figures.get("roads", ()),
        ),
        Section(
            "Identification",
            (_drives_in_words(study),),
            identification_findings(study),
            tuple(suspension_table(r) for r in each),
            figures.get("identification", ()),
        ),
        Section(
            "Filters and their tuning",
            _filters_in_words(study),
            (),
            tuple(tuning_table(r) for r in each),
            figures.get("tuning", ()),
        ),
        Section(
            "Monte Carlo",
            (
                f"{study.settings.runs} runs of {study.settings.duration:g} s: pressure, speed "
                "and class uniform in the ranges of Table 4, the initial estimate drawn from "
                "N(x0, P0) with each filter's own P0.",
            ),
            monte_carlo_findings(study),
            tuple(comparison_table(r) for r in each),
            figures.get("monte_carlo", ()),
        ),
        _drives("Single drives: class A and D", study, figures.get("classes", ()), ("7", "8")),
        _drives("Changes of road and pressure", study, figures.get("changes", ()), ("9", "10")),
        _drives("A heavier body", study, figures.get("mass", ()), ("11",)),
        _drives("A measured road", study, figures.get("measured", ()), ("12", "13")),
        Section(
            "Misprints",
            ("Each misprint can be switched; the resolutions are those of the textbooks.",),
            misprint_findings(study),
            tuple(misprint_table(r) for r in each),
        ),
    )
    report = Report(TITLE, ("...",), sections, made_by)
    return Report(TITLE, _summary(study, count_verdicts(report), quick), sections, made_by)


def _drives(title: str, study: Validation, figures: Any, numbers: tuple[str, ...]) -> Section:
    findings = [f for f in case_findings(study) if f.where.split("Fig. ")[-1] in numbers]
    text = (
        f"Each drive is repeated {study.settings.repetitions} times on other roads of its kind, "
        "and judged over all of them; the figures show one, and the middle 80 % of all as a band.",
    )
    if not findings:
        text = ("No measured road was given, so that Fig. 12 and 13 are missing.",)
    return Section(title, text, findings, (), figures)


def _filters_in_words(study: Validation) -> tuple[str, ...]:
    tuning = study.settings.tuning
    first = next(iter(study.conventions.values()))
    filters = " ".join(
        f"{f.name[:1].upper()}{f.name[1:]}: {c.words}."
        for f, c in zip(first.filters, CONTENDERS, strict=True)
    )
    singles = (
        ""
        if study.settings.tune_singles
        else " The filters of one class took the tuning of those over all classes."
    )
    return (
        filters,
        f"Q and P0 were tuned in the same way for all, by gradient descent through the filter: "
        f"{tuning.iterations} iterations of Adam on the mean-square error of k_t over "
        f"{study.settings.training} training runs, from {tuning.settling:g} s on.{singles} The "
        "test runs are the first of the Monte Carlo, and none of them was trained on. R is that of "
        "the sensors. P0 also sets how far the initial estimates lie from the prior's mean, so "
        "that tuning may shrink it for that reason alone.",
        "The vehicle's tyre follows Eq. 3 exactly, whatever its load and speed: the truth that "
        "filters are asked for is the one they assume. A real tyre adds errors of about 10 kPa.",
    )


def _drives_in_words(study: Validation) -> str:
    first = next(iter(study.conventions.values())).identification.settings
    speeds = ", ".join(f"{3.6 * v:.0f}" for v in first.drives.speeds)
    pressures = ", ".join(f"{p / 1e3:.0f}" for p in first.drives.pressures)
    classes = ", ".join(first.classes)
    text = (
        f"Straight drives of {first.drives.duration:g} s on roads of class {classes}, at {speeds} "
        f"km/h and {pressures} kPa, with road and pressure known; four parameters for each class "
        "by gradient descent."
    )
    missing = [c for c in CLASSES if c not in first.classes]
    if missing:
        text += f" Members of class {', '.join(missing)} take the set of the nearest class."
    return text


def _summary(study: Validation, verdicts: Mapping[str, int], quick: bool) -> tuple[str, ...]:
    counted = ", ".join(f"{n} x {verdict}" for verdict, n in verdicts.items() if n)
    best = []
    for result in study.conventions.values():
        figures = result.monte_carlo.figures

        def error(name: str, figures: Any = figures) -> float:
            return float(figures[name].final_rmse.value)

        first = min(figures, key=error)
        best.append(f"on {ROADS[result.convention]} {first}, {rmse_text(figures[first])}")
    text = (
        "The paper estimates tyre pressure from two accelerometers by an interacting multiple "
        "model of unscented filters, one for each class of road. Here its whole validation runs "
        "again: the vehicle is a 14-degree-of-freedom model that no filter knows, the sensors "
        f"have {study.settings.noise:g} m/s^2 of noise, and Q and P0 are tuned by gradient.",
        f"Rows by verdict: {counted}. Smallest final error in the Monte Carlo: "
        + "; ".join(best)
        + ".",
    )
    return (_QUICK_WARNING, *text) if quick else text


def results_of(study: Validation) -> dict[str, Any]:
    """Every figure of the validation by name; SI units."""
    return {
        "roads": _plain(study.roads.tables()["levels"].columns),
        "measured_road": None
        if study.measured is None
        else _plain(study.measured.tables()["summary"].columns),
        **{name: _result(r) for name, r in study.conventions.items()},
    }


def _result(result: ConventionResult) -> dict[str, Any]:
    return {
        "suspension": {c: _plain(asdict(car.suspension)) for c, car in result.cars.items()},
        "tuning": {
            f"{f.name} ({f.tuned.settings.objective})": _plain(asdict(f.tuned))
            for f in (*result.filters, *result.second)
        },
        "monte_carlo": _figures(result.monte_carlo),
        "monte_carlo_second_objective": None
        if result.second_monte_carlo is None
        else _figures(result.second_monte_carlo),
        "monte_carlo_before_tuning": _figures(result.untuned_monte_carlo),
        "cases": [
            {
                "figure": c.case.figure,
                "title": c.case.title,
                "filters": {n: _tracking(f) for n, f in c.figures.items()},
            }
            for c in result.cases
        ],
        "misprints": [_plain(asdict(e)) for e in result.misprints],
    }


def _figures(mc: MonteCarlo) -> dict[str, Any]:
    return {name: _tracking(f) for name, f in mc.figures.items()}


def _tracking(figures: Any) -> dict[str, Any]:
    """Numbers without those over time, which stand beside the figures."""
    content = figures._asdict()
    del content["statistics"], content["nees"]
    content["final_rmse"] = figures.final_rmse._asdict()
    content["nees_at_the_end"] = figures.nees[-1]
    return _plain(content)


def _plain(value: Any) -> Any:
    """Python numbers, lists and dicts, as JSON has them; None for NaN."""
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if hasattr(value, "item"):
        return _plain(value.item())
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value


def write_runs(file: Path, study: Validation) -> Path:
    """One row a run and filter: scenario, truth, final estimate and its stated sigma."""
    parts: dict[str, list[np.ndarray]] = {}
    for convention, result in study.conventions.items():
        mc = result.monte_carlo
        runs = len(mc.truth)
        for name, track in mc.tracks.items():
            columns = {
                "convention": np.repeat(convention, runs),
                "filter": np.repeat(name, runs),
                "run": np.arange(runs),
                "road_class": np.array([d.road for d in mc.drives]),
                "speed": np.array([d.speed for d in mc.drives]),
                "true_pressure": mc.pressure,
                "true_stiffness": mc.truth,
                "final_stiffness": track.stiffness[:, -1],
                "final_sigma": track.sigma[:, -1],
            }
            for column, values in columns.items():
                parts.setdefault(column, []).append(values)
    units = dict.fromkeys(("true_stiffness", "final_stiffness", "final_sigma"), "N/m")
    joined = {name: np.concatenate(values) for name, values in parts.items()}
    return write_table(file, joined, {"speed": "m/s", "true_pressure": "Pa", **units})
