"""What every part of the stiffness study is made of, and what it is given."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from wheelhop import __version__
from wheelhop.io.report import FAILS, HOLDS, IN_PART, DataTable, Finding
from wheelhop.io.results import write_atomically
from wheelhop.io.source import source_digest

RATE = 500.0
"""Sampling rate of every log [Hz]."""

SPEEDS = (40 / 3.6, 80 / 3.6)
"""Between which speeds are drawn [m/s]."""

PRESSURES = (130e3, 230e3)
"""Between which pressures are drawn [Pa]."""

Advance = Callable[[int, int], None]
"""Called with work done and work in all."""

Bar = Callable[[str, str], AbstractContextManager[Advance]]
"""(label, unit) -> a context with an `Advance`."""


@dataclass(frozen=True)
class StiffnessSettings:
    """Of every part.

    Attributes:
        runs: of each Monte Carlo.
        noise: of every accelerometer [m/s^2].
        seed: of roads, sensors and scenarios.
        substeps: simulation steps per sample.
        longest: duration of the longest drives [s]; a part's own duration where that is shorter.
        bound_runs: runs over whose operating points a bound is averaged, at most.
    """

    runs: int = 200
    noise: float = 0.5
    seed: int = 0
    substeps: int = 8
    longest: float = 60.0
    bound_runs: int = 40


QUICK = StiffnessSettings(runs=4, longest=10.0, substeps=4, bound_runs=4)
"""Small: to see that all works, not what is true."""


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
class Part:
    """A part of the study; it joins by one line in `study.PARTS`.

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
    run: Callable[[StiffnessSettings, Store, Advance], Any]
    text: Callable[[StiffnessSettings], Sequence[str]]
    findings: Callable[[Any], Sequence[Finding]]
    tables: Callable[[Any], Sequence[DataTable]]
    figures: Callable[[Any], Iterable[StudyFigure]]
    numbers: Callable[[Any], Mapping[str, Any]]


def drive_settings(settings: StiffnessSettings) -> dict[str, Any]:
    """What every Monte Carlo depends on; how many bounds are averaged is none of it."""
    content = asdict(settings)
    del content["bound_runs"]
    return content


def verdict_of(passed: Iterable[Any]) -> str:
    """Holds where all passed, in part where at least half did, and not where fewer did."""
    passed = [bool(p) for p in passed]
    half = 2 * sum(passed) >= len(passed)
    return HOLDS if all(passed) else IN_PART if half else FAILS
