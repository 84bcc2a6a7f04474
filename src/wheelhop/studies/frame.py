"""What every part of a study is made of, how the parts are run, and what they find."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar
from zipfile import BadZipFile

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from wheelhop import __version__
from wheelhop.io.report import FAILS, HOLDS, IN_PART, DataTable, Finding
from wheelhop.io.results import write_atomically
from wheelhop.io.source import source_digest

Advance = Callable[[int, int], None]
"""Called with work done and work in all."""

Bar = Callable[[str, str], AbstractContextManager[Advance]]
"""(label, unit) -> a context with an `Advance`."""

Settings = TypeVar("Settings")
"""Of a study: a frozen dataclass."""


@dataclass(frozen=True)
class Store:
    """Arrays kept on disk, so that an interrupted study does not begin anew.

    Attributes:
        place: directory; None keeps nothing.
    """

    place: Path | None

    def arrays(
        self,
        name: str,
        depends: Any,
        compute: Callable[[], Mapping[str, np.ndarray]],
    ) -> dict[str, np.ndarray]:
        """What `compute` returns, or returned before from the same source, settings and precision.

        Args:
            name: of the file.
            depends: all that the numbers depend on besides the source, as JSON can hold it.
            compute: makes the arrays.
        """
        if self.place is None:
            return {k: np.asarray(v) for k, v in compute().items()}
        key = json.dumps(
            {
                "name": name,
                "depends": depends,
                "precision": str(jnp.zeros(()).dtype),
                "versions": [__version__, jax.__version__],
                "source": source_digest(),
            },
            sort_keys=True,
            default=str,
        )
        digest = hashlib.sha256(key.encode()).hexdigest()[:16]
        file = self.place / f"{name}-{digest}.npz"
        if (found := _read(file)) is not None:
            return found
        arrays = {k: np.asarray(v) for k, v in compute().items()}
        self.place.mkdir(parents=True, exist_ok=True)
        for stale in self.place.glob(f"{name}-{'?' * 16}.npz"):
            stale.unlink(missing_ok=True)
        write_atomically(file, lambda path: _write(path, arrays))
        return arrays


def _read(file: Path) -> dict[str, np.ndarray] | None:
    """Arrays of a file; None where there is none, or it is damaged."""
    try:
        with file.open("rb") as stream, np.load(stream, allow_pickle=False) as content:
            return {k: content[k] for k in content.files}
    except (OSError, ValueError, KeyError, EOFError, BadZipFile):
        return None


def _write(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    with path.open("wb") as stream:
        np.savez(stream, **arrays)  # type: ignore[arg-type]


@dataclass(frozen=True)
class StudyFigure:
    """A figure to write.

    Attributes:
        name: of its files.
        figure: to draw.
        columns: numbers behind it, of equal length.
        units: of the columns that have one.
        caption: what it shows.
    """

    name: str
    figure: Figure
    columns: Mapping[str, Any]
    units: Mapping[str, str]
    caption: str


@dataclass(frozen=True)
class Part(Generic[Settings]):
    """A part of a study; it joins by one entry among the study's parts.

    Its functions are pure: what `run` returns is all that the others need.

    Attributes:
        name: in file names, and key of its results.
        title: of its chapter, and label of its progress bar.
        run: (settings, store, advance) -> result; keeps what is dear in the store.
        text: (settings) -> paragraphs that say what was done.
        findings: (result) -> claims with what became of them.
        tables: (result) -> tables of the chapter.
        figures: (result) -> figures, drawn one after the other.
        numbers: (result) -> every figure by name for results.json; SI units.
    """

    name: str
    title: str
    run: Callable[[Settings, Store, Advance], Any]
    text: Callable[[Settings], Sequence[str]]
    findings: Callable[[Any], Sequence[Finding]]
    tables: Callable[[Any], Sequence[DataTable]]
    figures: Callable[[Any], Iterable[StudyFigure]]
    numbers: Callable[[Any], Mapping[str, Any]]


@dataclass(frozen=True)
class Study(Generic[Settings]):
    """All results.

    Attributes:
        settings: that made them.
        parts: in the order of the report.
        results: of the parts, by their names.
    """

    settings: Settings
    parts: tuple[Part[Settings], ...]
    results: dict[str, Any]


def run_parts(
    settings: Settings, place: Path | None, bar: Bar, parts: Sequence[Part[Settings]]
) -> Study[Settings]:
    """Run every part; what is finished in `place` is not computed again.

    Args:
        settings: of the study, checked.
        place: directory for finished work, or None.
        bar: makes a progress bar.
        parts: to run.
    """
    results = {}
    for part in parts:
        with bar(part.title, "steps") as advance:
            results[part.name] = part.run(settings, Store(place), advance)
    return Study(settings, tuple(parts), results)


def verdict_of(passed: Iterable[Any]) -> str:
    """Holds where all passed, in part where at least half did, and not where fewer did."""
    passed = [bool(p) for p in passed]
    half = 2 * sum(passed) >= len(passed)
    return HOLDS if all(passed) else IN_PART if half else FAILS
