"""The text format of tyre property files: sections, keys, tables and units."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path

from wheelhop.errors import InputError

_KEY = re.compile(r"([A-Za-z]\w*)\s*=\s*(.*)")
_UNITS: dict[str, dict[str, float]] = {
    "LENGTH": {"meter": 1.0, "metre": 1.0, "m": 1.0, "mm": 1e-3, "millimeter": 1e-3},
    "FORCE": {"newton": 1.0, "n": 1.0, "knewton": 1e3, "kn": 1e3},
    "ANGLE": {"radian": 1.0, "radians": 1.0, "rad": 1.0},
    "MASS": {"kg": 1.0, "kilogram": 1.0},
    "TIME": {"second": 1.0, "sec": 1.0, "s": 1.0},
    "PRESSURE": {
        "pascal": 1.0,
        "pa": 1.0,
        "kpascal": 1e3,
        "kpa": 1e3,
        "bar": 1e5,
        "psi": 6894.757293168,
    },
}


@dataclass(frozen=True)
class Properties:
    """Keys and tables of a property file, and its units' factors to SI.

    Attributes:
        name: of the file.
        values: text and line number of every key.
        tables: rows of numbers of every section that has such.
        units: quantities whose unit the file declares.
        length, force, pressure: factors to m, N and Pa.
        warnings: what was assumed, a sentence each.
    """

    name: str
    values: dict[str, tuple[str, int]]
    tables: dict[str, list[list[float]]]
    units: tuple[str, ...]
    length: float
    force: float
    pressure: float
    warnings: tuple[str, ...]

    def present(self, *keys: str) -> str | None:
        """The first of the keys that the file has."""
        return next((key for key in keys if key in self.values), None)

    def text(self, key: str, default: str) -> str:
        """A key's value without its quotes."""
        return self.values[key][0] if key in self.values else default

    def number(self, key: str, default: float | None = None) -> float:
        """A key's value as a number, in the file's units.

        Raises:
            InputError: if it is missing and has no default, or is no finite number.
        """
        if key not in self.values:
            if default is not None:
                return default
            raise InputError(
                f"{self.name}: {key}", "the file has no such key", "Complete the file."
            )
        text, line = self.values[key]
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise InputError(
                f"{self.name}, line {line}: {key}", f"{text!r} is no number", "Correct that line."
            )
        return value


def read_properties(path: Path) -> Properties:
    """Read the text of a tyre property file.

    Raises:
        InputError: if there is no such file, it is no property file, or a unit is unknown.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(
            str(path), f"it cannot be read ({error.strerror})", "Name an existing .tir file."
        ) from error
    values: dict[str, tuple[str, int]] = {}
    tables: dict[str, list[list[float]]] = {}
    section = ""
    for number, raw in enumerate(content.decode("latin-1").splitlines(), start=1):
        line = _without_comment(raw).strip()
        if line.startswith("[") and line.endswith("]"):
            section = line[1:-1].strip().upper()
        elif section and (match := _KEY.fullmatch(line)):
            values.setdefault(match[1].upper(), (match[2].strip().strip("'\"").strip(), number))
        elif section and line:
            _add_row(tables.setdefault(section, []), line)
    if not values or b"\0" in content:
        raise InputError(
            str(path),
            "it is no tyre property file: it has no [SECTION] with KEY = value lines",
            "Give a .tir file.",
        )
    factors = {quantity: _factor(path.name, quantity, values) for quantity in _UNITS}
    declared = tuple(quantity for quantity in _UNITS if quantity in values)
    warnings = () if {"LENGTH", "FORCE"} <= set(declared) else ("no units are given; SI assumed",)
    return Properties(
        name=path.name,
        values=values,
        tables=tables,
        units=declared,
        length=factors["LENGTH"],
        force=factors["FORCE"],
        pressure=factors["PRESSURE"],
        warnings=warnings,
    )


def _without_comment(line: str) -> str:
    """The line up to the first $ or ! outside quotes."""
    quoted = False
    for place, character in enumerate(line):
        if character == "'":
            quoted = not quoted
        elif character in "$!" and not quoted:
            return line[:place]
    return line


def _add_row(table: list[list[float]], line: str) -> None:
    """Keep a row of numbers; the table's heading, in braces, is none."""
    try:
        row = [float(word) for word in line.replace(",", " ").split()]
    except ValueError:
        return
    if len(row) == 2:
        table.append(row)


def _factor(name: str, quantity: str, values: dict[str, tuple[str, int]]) -> float:
    if quantity not in values:
        return 1.0
    unit, line = values[quantity]
    known = _UNITS[quantity]
    if unit.lower() not in known:
        raise InputError(
            f"{name}, line {line}: {quantity}",
            f"the unit {unit!r} is not read here",
            f"Convert the file to one of {', '.join(known)}.",
        )
    return known[unit.lower()]
