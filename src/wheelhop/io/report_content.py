"""What a study's report holds: findings with their verdicts, tables, figures, chapters."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from wheelhop.errors import InputError
from wheelhop.io.report_text import is_number, table_entry

HOLDS = "holds"
IN_PART = "holds in part"
FAILS = "does not hold"
OPEN = "cannot be judged here"
VERDICTS = (HOLDS, IN_PART, FAILS, OPEN)

_PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"


@dataclass(frozen=True)
class Finding:
    """One claim and what became of it.

    Args:
        where: its place in the paper, such as "Section 5.3, Fig. 6".
        claim: what the paper says there, in own words.
        measured: what was found, with units.
        verdict: one of `VERDICTS`.
        why: the reason, in plain words.

    Raises:
        InputError: if a text is empty or the verdict unknown.
    """

    where: str
    claim: str
    measured: str
    verdict: str
    why: str

    def __post_init__(self) -> None:
        for name in ("where", "claim", "measured", "why"):
            _require_text(name, getattr(self, name))
        if self.verdict not in VERDICTS:
            raise InputError(
                "verdict",
                f"{self.verdict!r} of {self.where!r} is unknown",
                f"Use one of: {', '.join(VERDICTS)}.",
            )


@dataclass(frozen=True)
class DataTable:
    """A small table.

    Args:
        title: what it shows.
        columns: header, with its unit, to entries; all of one length. A number that is not whole
            is shown to `digits` significant digits, None and NaN as a dash.
        note: a line below the table.
        digits: significant digits, 1 or more.

    Raises:
        InputError: if there is no column, lengths differ or `digits` is below 1.
    """

    title: str
    columns: Mapping[str, Collection[Any]]
    note: str = ""
    digits: int = 3

    def __post_init__(self) -> None:
        _require_text("title", self.title)
        lengths = {name: len(entries) for name, entries in self.columns.items()}
        if len(set(lengths.values())) != 1:
            raise InputError(
                "columns",
                f"the lengths in {self.title!r} are {lengths}",
                "Give one or more columns of equal length.",
            )
        if self.digits < 1:
            raise InputError("digits", f"{self.digits} is below 1", "Give 1 or more.")

    @property
    def numeric(self) -> list[bool]:
        """Whether a column holds nothing but numbers and gaps."""
        return [all(map(is_number, entries)) for entries in self.columns.values()]

    @property
    def rows(self) -> list[list[str]]:
        """The entries as text, row by row."""
        texts = [[table_entry(e, self.digits) for e in column] for column in self.columns.values()]
        return [list(row) for row in zip(*texts, strict=True)]


@dataclass(frozen=True)
class FigureFile:
    """A figure that lies on disk already.

    Args:
        file: a PNG image in the report's directory or below it.
        caption: what it shows.
        data: the file with the plotted numbers, likewise.

    Raises:
        InputError: if a file does not exist or the figure is no PNG image.
    """

    file: Path
    caption: str
    data: Path | None = None

    def __post_init__(self) -> None:
        _require_text("caption", self.caption)
        for name, path in (("file", self.file), ("data", self.data)):
            if path is not None and not path.is_file():
                raise InputError(name, f"{path} does not exist", "Write it before the report.")
        with self.file.open("rb") as stream:
            if stream.read(8) != _PNG_SIGNATURE:
                raise InputError("file", f"{self.file} is no PNG image", "Save it as PNG.")


@dataclass(frozen=True)
class Section:
    """A chapter: paragraphs, then findings, tables and figures.

    Raises:
        InputError: if the title is empty or `text` is one string.
    """

    title: str
    text: Sequence[str] = ()
    findings: Sequence[Finding] = ()
    tables: Sequence[DataTable] = ()
    figures: Sequence[FigureFile] = ()

    def __post_init__(self) -> None:
        _require_text("title", self.title)
        _require_paragraphs("text", self.text)


@dataclass(frozen=True)
class Report:
    """A study's report.

    Args:
        title: its heading.
        summary: paragraphs at the top.
        sections: the chapters, in order.
        made_by: command, versions, settings, duration: name to value, or to a mapping of such.
            Absolute paths are shortened to their last name when it is written.

    Raises:
        InputError: if the title is empty or `summary` is one string.
    """

    title: str
    summary: Sequence[str]
    sections: Sequence[Section]
    made_by: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        _require_text("title", self.title)
        _require_paragraphs("summary", self.summary)


def count_verdicts(report: Report) -> dict[str, int]:
    """How many findings got each of `VERDICTS`, in that order."""
    given = [finding.verdict for section in report.sections for finding in section.findings]
    return {verdict: given.count(verdict) for verdict in VERDICTS}


def _require_text(name: str, text: str) -> None:
    if not text.strip():
        raise InputError(name, "the text is empty", "Say it in words.")


def _require_paragraphs(name: str, paragraphs: Iterable[str]) -> None:
    if isinstance(paragraphs, str):
        raise InputError(name, "one string was given", "Give a sequence of paragraphs.")
