"""CSV and Parquet tables with their column units, as read from disk."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from wheelhop.errors import InputError
from wheelhop.io.units import to_si

_HEADER = re.compile(r"^\s*(?P<name>[^\[\]]+?)\s*(?:\[(?P<unit>[^\[\]]*)\])?\s*$")


@dataclass(frozen=True)
class Table:
    """Columns by name, the unit each declares (if any), and where they came from.

    `others` describes columns that were left out because they hold no numbers.
    """

    path: Path
    columns: dict[str, np.ndarray]
    units: dict[str, str]
    others: tuple[str, ...] = ()

    @property
    def contents(self) -> str:
        """What the file holds, for a message."""
        return ", ".join([*self.columns, *self.others])


def read_table(path: Path) -> Table:
    """Read a CSV (header row, `#` comments) or Parquet file.

    A unit stands in brackets behind a column's name, or in Parquet field metadata `unit`.

    Raises:
        InputError: if the file is missing, empty, not readable, of another kind, or holds a
            cell that is not a number.
    """
    path = Path(path)
    if path.is_dir():
        raise InputError(str(path), "it is a directory", "Name the file in it.")
    if not path.is_file():
        raise InputError(str(path), "there is no such file", "Check the path.")
    if path.stat().st_size == 0:
        raise InputError(str(path), "the file is empty", "Give a file with a header and data.")
    if path.suffix.lower() == ".csv":
        return _read_csv(path)
    if path.suffix.lower() == ".parquet":
        return _read_parquet(path)
    raise InputError(
        str(path), f"{path.suffix or 'no ending'!r} is not a known table", "Use .csv or .parquet."
    )


def _read_csv(path: Path) -> Table:
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            lines = [(i, line) for i, line in enumerate(stream, 1) if _is_content(line)]
        rows = list(csv.reader(line for _, line in lines))
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(str(path), "it is not a CSV text", "Export it as CSV in UTF-8.") from error
    except OSError as error:
        raise InputError(
            str(path), f"it cannot be read ({error.strerror})", "Check its permissions."
        ) from error
    if len(lines) < 2:
        raise InputError(str(path), "it has no data rows", "Give a header row and data rows.")
    names, units = _split_units(path, rows[0])
    values = np.empty((len(rows) - 1, len(names)))
    for k, row in enumerate(rows[1:]):
        number = lines[k + 1][0]
        if len(row) != len(names):
            raise InputError(
                str(path),
                f"line {number} has {len(row)} cells and the header {len(names)}",
                "Give one comma-separated cell per column, with a point as decimal mark.",
            )
        values[k] = [_number(path, number, n, cell) for n, cell in zip(names, row, strict=True)]
    return Table(path, {n: values[:, i] for i, n in enumerate(names)}, units)


def _read_parquet(path: Path) -> Table:
    try:
        table = pq.read_table(path)
    except (pa.ArrowException, OSError) as error:
        raise InputError(
            str(path), "it is not a readable Parquet file", "Export it again as Parquet or CSV."
        ) from error
    if table.num_rows == 0:
        raise InputError(str(path), "it has no data rows", "Give a file with data.")
    names, units = _split_units(path, table.schema.names)
    columns: dict[str, np.ndarray] = {}
    others: list[str] = []
    for name, field, column in zip(names, table.schema, table.columns, strict=True):
        if not (pa.types.is_floating(field.type) or pa.types.is_integer(field.type)):
            others.append(f"{name} ({field.type}, no numbers)")
            continue
        columns[name] = column.cast(pa.float64()).to_numpy(zero_copy_only=False)
        declared = (field.metadata or {}).get(b"unit", b"").decode()
        if declared:
            units[name] = declared
    return Table(path, columns, units, tuple(others))


def _split_units(path: Path, header: list[str]) -> tuple[list[str], dict[str, str]]:
    names: list[str] = []
    units: dict[str, str] = {}
    for cell in header:
        match = _HEADER.match(cell)
        if match is None:
            raise InputError(
                str(path), f"the header cell {cell!r} is not 'name [unit]'", "Name every column."
            )
        names.append(match["name"])
        if match["unit"]:
            units[match["name"]] = match["unit"]
    repeated = sorted({n for n in names if names.count(n) > 1})
    if repeated:
        raise InputError(str(path), f"the column {repeated[0]!r} appears twice", "Rename one.")
    return names, units


def _is_content(line: str) -> bool:
    return bool(line.strip()) and not line.lstrip().startswith("#")


def _number(path: Path, line: int, name: str, cell: str) -> float:
    text = cell.strip()
    if text == "" or text.lower() in {"nan", "na", "null"}:
        return float("nan")
    try:
        return float(text)
    except ValueError as error:
        raise InputError(
            str(path),
            f"line {line}, column {name!r}: {text!r} is not a number",
            "Use numbers with a point as decimal mark, and leave missing cells empty.",
        ) from error


def declared_column(
    table: Table,
    field: str,
    quantity: str,
    usual: str,
    units: Mapping[str, str],
    names: Mapping[str, str],
) -> np.ndarray:
    """A column of a log in SI units.

    Args:
        table: the log.
        field: what the column holds, and its name unless `names` has another.
        quantity: a key of `units.UNITS`.
        usual: its usual unit, for messages.
        units, names: by field, as from `settings.read_declaration`.

    Raises:
        InputError: if the column is missing, or declares no unit or a strange one.
    """
    name = names.get(field, field)
    if name not in table.columns:
        raise InputError(
            f"column {name!r}",
            f"{table.path.name} has only {table.contents}",
            f'Add the column, or name it in a TOML file: [columns] {field} = "...".',
        )
    unit = units.get(field) or table.units.get(name)
    if not unit:
        raise InputError(
            f"column {name!r}",
            f"{table.path.name} declares no unit for it",
            f"Write the unit in the header, '{name} [{usual}]', or in a TOML file: "
            f'[units] {field} = "{usual}".',
        )
    return table.columns[name] * to_si(f"column {name!r}", quantity, unit)
