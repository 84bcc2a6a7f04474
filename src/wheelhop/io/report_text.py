"""Plain text and numbers as HTML and Markdown show them."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import PurePath
from typing import Any

import numpy as np
from markupsafe import Markup, escape

GAP = "–"


def is_number(value: Any) -> bool:
    """Whether a table's entry is a number, or a gap among numbers."""
    if value is None:
        return True
    kind = np.asarray(value).dtype.kind
    return kind in "iuf" and np.ndim(value) == 0


def table_entry(value: Any, digits: int) -> str:
    """A table's entry as text.

    Args:
        value: text, number, truth value, or None for a gap.
        digits: significant digits of a float; digits before its decimal point are all shown.
            Below 1e-4 and from 1e7 on it has an exponent.
    """
    if value is None:
        return GAP
    if isinstance(value, (bool, np.bool_)):
        return "yes" if value else "no"
    if not is_number(value):
        return str(value)
    if np.asarray(value).dtype.kind in "iu":
        return str(int(value))
    number = float(value)
    if not math.isfinite(number):
        return GAP if math.isnan(number) else str(number)
    if number == 0:
        return "0"
    mantissa, exponent = f"{number:.{digits - 1}e}".split("e")
    if not -4 <= int(exponent) < 7:
        return f"{mantissa}e{int(exponent)}"
    return f"{number:.{max(0, digits - 1 - int(exponent))}f}"


def flat(text: str) -> str:
    """The text on one line."""
    return " ".join(text.split())


def html_lines(text: str) -> Markup:
    """HTML of a text whose line breaks are kept."""
    return Markup("<br>").join(escape(line) for line in text.strip().splitlines())


# what GitHub reads as markup within a line; an underscore only at the edge of a word
_INLINE = re.compile(r"[\\`*\[\]<>|~$#]|&(?=#?\w+;)|(?<![A-Za-z0-9])_|_(?![A-Za-z0-9])")
_BLOCK = re.compile(r"^([-+=]|\d+(?=[.)]))")


def markdown_inline(value: Any) -> Markup:
    """Markdown of a plain value, also inside a table: escaped, line breaks as `<br>`."""
    if isinstance(value, Markup):
        return value
    lines = str(value).strip().splitlines()
    return Markup("<br>".join(_INLINE.sub(r"\\\g<0>", line.strip()) for line in lines))


def markdown_paragraph(text: str) -> Markup:
    """Markdown of a plain text at the start of a line, where a dash or `1.` would open a list."""
    escaped = str(markdown_inline(text))
    start = _BLOCK.match(escaped)
    if start is None:
        return Markup(escaped)
    at = start.end() if start.group()[0].isdigit() else 0
    return Markup(escaped[:at] + "\\" + escaped[at:])


def made_by_rows(made_by: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Name and value of what made a report, as text without absolute paths."""
    return [(name, _setting(value)) for name, value in made_by.items()]


def _setting(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {_setting(inner)}" for name, inner in value.items())
    if isinstance(value, (list, tuple)):
        return ", ".join(_setting(inner) for inner in value)
    if isinstance(value, PurePath):
        return value.name if value.is_absolute() else str(value)
    if isinstance(value, float):
        return f"{value:.6g}"
    return _shorten_paths(table_entry(value, 6))


_ROOT = r"(?:(?:~|file://)?/|~\\|(?:[A-Za-z]:|\\)[/\\])"
_QUOTED_PATH = re.compile(rf"""(?P<quote>['"]){_ROOT}(?P<rest>[^'"]*)(?P=quote)""")
_BARE_PATH = re.compile(rf"""(?<![^\s'"(\[=:,;>@]){_ROOT}(?P<rest>[^\s/\\'",;:=][^\s'",;:=]*)""")


def _shorten_paths(text: str) -> str:
    """The text with every absolute path reduced to its last name: a machine's folders are its own.

    Quoted paths may hold spaces.
    """

    def last_name(match: re.Match[str]) -> str:
        mark = match.groupdict().get("quote") or ""
        return mark + re.split(r"[/\\]", match["rest"].rstrip("/\\"))[-1] + mark

    return _BARE_PATH.sub(last_name, _QUOTED_PATH.sub(last_name, text))
