"""Results out: tables, summaries and figures, written whole or not at all."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from wheelhop.errors import InputError


def output_directory(path: Path) -> Path:
    """The directory for results, made if needed.

    Raises:
        InputError: if it cannot be made or written to.
    """
    require_writable(path)
    try:
        Path(path).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            "--out", f"{path} cannot be made ({error.strerror})", "Name another directory."
        ) from error
    return Path(path)


def require_writable(path: Path) -> None:
    """Refuse a place for results that cannot be made, before any work is done for it.

    Args:
        path: the directory that will hold the results; nothing is created yet.

    Raises:
        InputError: if it, or the nearest parent that exists, is not a writable directory.
    """
    place = Path(path).absolute()
    while not place.exists() and place != place.parent:
        place = place.parent
    if not place.is_dir():
        raise InputError(
            "--out", f"{path} is no usable directory ({place} is a file)", "Name another one."
        )
    if not os.access(place, os.W_OK | os.X_OK):
        raise InputError("--out", f"{place} cannot be written to", "Name another directory.")


def write_atomically(path: Path, write: Callable[[Path], Any]) -> Path:
    """Let `write` fill a temporary file beside `path`, then rename it into place.

    An interrupted or failing write leaves the previous file, if any, untouched.

    Raises:
        InputError: if the file system refuses.
    """
    path = Path(path)
    if path.is_dir():
        raise InputError("--out", f"{path} is a directory", "Name a file, or another directory.")
    try:
        handle, name = tempfile.mkstemp(
            prefix=f".{path.stem}-", suffix=path.suffix, dir=path.parent
        )
        os.close(handle)
        temporary = Path(name)
        try:
            write(temporary)
            temporary.chmod(0o666 & ~_umask())
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise InputError(
            "--out", f"{path} cannot be written ({error.strerror})", "Free space or name another."
        ) from error
    return path


def write_json(path: Path, content: Mapping[str, Any]) -> Path:
    """Write a summary as JSON; NaN becomes null."""
    text = json.dumps(_plain(content), indent=2, allow_nan=False) + "\n"
    return write_atomically(path, lambda p: p.write_text(text))


def write_table(path: Path, columns: Mapping[str, Any], units: Mapping[str, str]) -> Path:
    """Write columns of equal length as Parquet or CSV, by the file's ending.

    Parquet columns carry their unit as field metadata (`unit`); a CSV header reads
    `name [unit]`.

    Raises:
        InputError: for another file ending.
    """
    path = Path(path)
    names = list(columns)
    arrays = [pa.array(np.asarray(columns[name])) for name in names]
    if path.suffix == ".parquet":
        fields = [
            pa.field(n, a.type, metadata={"unit": units.get(n, "")} if n in units else None)
            for n, a in zip(names, arrays, strict=True)
        ]
        table = pa.Table.from_arrays(arrays, schema=pa.schema(fields))
        return write_atomically(path, lambda p: pq.write_table(table, p))
    if path.suffix == ".csv":
        header = ",".join(f"{n} [{units[n]}]" if n in units else n for n in names)
        rows = np.column_stack([np.asarray(columns[n], float) for n in names])
        return write_atomically(
            path,
            lambda p: np.savetxt(p, rows, fmt="%.9g", delimiter=",", header=header, comments=""),
        )
    raise InputError("--out", f"{path.name} has no known ending", "Use .parquet or .csv.")


def write_figure(path: Path, figure: Any) -> Path:
    """Save a Matplotlib figure as PNG."""
    return write_atomically(path, lambda p: figure.savefig(p, dpi=120))


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _plain(value: Any) -> Any:
    """JSON-ready copy: arrays to lists, NumPy scalars to Python's, non-finite to null."""
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [_plain(v) for v in value]
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    if isinstance(value, (int, np.integer)):
        return int(value)
    if isinstance(value, (float, np.floating)) or hasattr(value, "dtype"):
        number = float(value)
        return number if np.isfinite(number) else None
    return value if value is None else str(value)
