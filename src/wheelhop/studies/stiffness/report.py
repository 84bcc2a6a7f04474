"""The report of the stiffness study, and everything it writes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from wheelhop.io.report import (
    FigureFile,
    Finding,
    Report,
    Section,
    count_verdicts,
    write_report,
)
from wheelhop.io.results import output_directory, write_figure, write_json, write_table
from wheelhop.studies.stiffness.frame import StudyFigure
from wheelhop.studies.stiffness.study import StiffnessStudy

TITLE = "Tyre pressure at the Cramer-Rao bound, on a road nobody measured"

_QUICK_WARNING = (
    "This was a quick run: a handful of short drives, to see that everything works. Its numbers "
    "and verdicts mean nothing."
)


def write_stiffness_study(
    study: StiffnessStudy,
    directory: Path,
    made_by: Mapping[str, Any],
    quick: bool = False,
    on_progress: Callable[[int, int], None] | None = None,
) -> tuple[list[str], list[Finding]]:
    """Write figures, their data, results and report.

    Args:
        study: the results.
        directory: made if needed.
        made_by: command, versions, settings, for the report's end.
        quick: say that the numbers mean nothing.
        on_progress: called with parts done and in all.

    Returns:
        Names of the files, and all findings.
    """
    directory = output_directory(directory)
    names: list[str] = []
    sections = []
    for done, part in enumerate(study.parts):
        result = study.results[part.name]
        files = []
        for figure in part.figures(result):
            files.append(_written(directory, figure))
            names += [f"{figure.name}.png", f"{figure.name}.parquet"]
        sections.append(
            Section(
                part.title,
                part.text(study.settings),
                part.findings(result),
                part.tables(result),
                files,
            )
        )
        if on_progress is not None:
            on_progress(done + 1, len(study.parts))
    findings = [finding for section in sections for finding in section.findings]
    content = {
        **made_by,
        "findings": [asdict(f) for f in findings],
        "results": {part.name: part.numbers(study.results[part.name]) for part in study.parts},
    }
    write_json(directory / "results.json", content)
    verdicts = count_verdicts(Report(TITLE, ("...",), sections, made_by))
    report = Report(TITLE, _summary(study, verdicts, quick), sections, made_by)
    write_report(report, directory)
    return ["report.html", "report.md", "results.json", *names], findings


def _written(directory: Path, figure: StudyFigure) -> FigureFile:
    image = write_figure(directory / f"{figure.name}.png", figure.figure)
    data = write_table(
        directory / f"{figure.name}.parquet", dict(figure.columns), dict(figure.units)
    )
    return FigureFile(Path(image), figure.caption, Path(data))


def _summary(study: StiffnessStudy, verdicts: Mapping[str, int], quick: bool) -> tuple[str, ...]:
    counted = ", ".join(f"{n} x {verdict}" for verdict, n in verdicts.items() if n)
    text = (
        "Tyre stiffness and pressure from the accelerations of body and wheel, by recursive "
        "maximum likelihood on a road that nobody measured, against the best that any estimator "
        "can do. The quarter cars are simulated at a finer step than the filter's, on roads of "
        f"the exact ISO 8608 spectrum, logged at 500 Hz with {study.settings.noise:g} m/s^2 of "
        "noise.",
        f"Rows by verdict: {counted}. Targets are given beforehand; verdicts follow from the "
        "figures, and intervals hold with 95 % probability.",
    )
    return (_QUICK_WARNING, *text) if quick else text
