"""The report of a study made of parts, and everything it writes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
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
from wheelhop.studies.frame import Study, StudyFigure


def write_study(
    study: Study[Any],
    directory: Path,
    made_by: Mapping[str, Any],
    title: str,
    summary: Callable[[str], Sequence[str]],
    on_progress: Callable[[int, int], None] | None = None,
) -> tuple[list[str], list[Finding]]:
    """Write figures, their data, results and report.

    Args:
        study: the results.
        directory: made if needed.
        made_by: command, versions, settings, for the report's end.
        title: of the report.
        summary: (the verdicts counted, as "3 x holds, 1 x does not hold") -> paragraphs on top.
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
    verdicts = count_verdicts(Report(title, ("...",), sections, made_by))
    counted = ", ".join(f"{n} x {verdict}" for verdict, n in verdicts.items() if n)
    report = Report(title, summary(counted), sections, made_by)
    write_report(report, directory)
    return ["report.html", "report.md", "results.json", *names], findings


def _written(directory: Path, figure: StudyFigure) -> FigureFile:
    image = write_figure(directory / f"{figure.name}.png", figure.figure)
    data = write_table(
        directory / f"{figure.name}.parquet", dict(figure.columns), dict(figure.units)
    )
    return FigureFile(Path(image), figure.caption, Path(data))
