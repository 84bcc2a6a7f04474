"""Reports of a study: what was claimed beside what was measured, as HTML and Markdown."""

from __future__ import annotations

import base64
import os
import struct
from collections.abc import Iterator
from functools import cache
from itertools import count
from pathlib import Path
from typing import NamedTuple
from urllib.parse import quote

from jinja2 import Environment, PackageLoader, StrictUndefined

from wheelhop.errors import InputError
from wheelhop.io.report_content import (
    FAILS,
    HOLDS,
    IN_PART,
    OPEN,
    VERDICTS,
    DataTable,
    FigureFile,
    Finding,
    Report,
    Section,
    count_verdicts,
)
from wheelhop.io.report_text import (
    flat,
    html_lines,
    made_by_rows,
    markdown_inline,
    markdown_paragraph,
)
from wheelhop.io.results import output_directory, write_atomically

__all__ = [
    "FAILS",
    "HOLDS",
    "IN_PART",
    "OPEN",
    "VERDICTS",
    "DataTable",
    "FigureFile",
    "Finding",
    "Report",
    "Section",
    "count_verdicts",
    "write_report",
]

# names of the style sheet's classes
_COLOURS = {HOLDS: "good", IN_PART: "mixed", FAILS: "bad", OPEN: "unknown"}


def write_report(report: Report, directory: Path) -> tuple[Path, Path]:
    """Write report.html, which embeds its figures, and report.md, which links to them.

    Both are complete before the first is put in place, and each replaces its predecessor whole.

    Args:
        report: the content.
        directory: made if needed; holds the figures and their data, so that links are relative.

    Returns:
        The paths of the HTML and the Markdown file.

    Raises:
        InputError: if a figure or its data lies outside the directory, or writing fails.
    """
    directory = output_directory(directory)
    numbers = count(1)
    content = {
        "report": report,
        "counts": count_verdicts(report),
        "sections": [_shown(section, directory, numbers) for section in report.sections],
        "made_by": made_by_rows(report.made_by),
        "colours": _COLOURS,
    }
    html, markdown = (
        _environment(name).get_template(f"{name}.j2").render(content).encode()
        for name in ("report.html", "report.md")
    )
    return (
        write_atomically(directory / "report.html", lambda path: path.write_bytes(html)),
        write_atomically(directory / "report.md", lambda path: path.write_bytes(markdown)),
    )


class _Figure(NamedTuple):
    caption: str
    link: str
    data: str | None
    base64: str
    width: int
    height: int


class _Section(NamedTuple):
    content: Section
    findings: list[tuple[int, Finding]]
    figures: list[_Figure]


def _shown(section: Section, directory: Path, numbers: Iterator[int]) -> _Section:
    """A section as the templates need it; findings take their numbers from `numbers`."""
    figures = []
    for figure in section.figures:
        image = figure.file.read_bytes()
        figures.append(
            _Figure(
                figure.caption,
                _link("file", figure.file, directory),
                None if figure.data is None else _link("data", figure.data, directory),
                base64.b64encode(image).decode(),
                *struct.unpack(">II", image[16:24]),  # width and height stand in PNG's first chunk
            )
        )
    return _Section(section, [(next(numbers), f) for f in section.findings], figures)


def _link(name: str, file: Path, directory: Path) -> str:
    """Address of a file relative to the report, percent-encoded."""
    relative = Path(os.path.relpath(file, directory))
    if relative.is_absolute() or ".." in relative.parts:
        raise InputError(
            name, f"{file} lies outside {directory}", "Write figures and data below the report."
        )
    return quote(relative.as_posix())


@cache
def _environment(name: str) -> Environment:
    """Jinja settings for a template: whatever it prints is escaped for its format."""
    is_html = name.endswith(".html")
    environment = Environment(
        loader=PackageLoader("wheelhop.io", "templates"),
        autoescape=is_html,
        finalize=None if is_html else markdown_inline,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {"flat": flat, "lines": html_lines, "paragraph": markdown_paragraph}
    return environment
