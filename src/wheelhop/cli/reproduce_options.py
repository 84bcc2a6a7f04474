"""What `wheelhop reproduce` was asked for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class ReproduceOptions:
    """Options of a reproduction; None where the table decides.

    Units are those of the command line: s, m/s^2.
    """

    classes: str | None
    duration: float | None
    noise: float | None
    starts: int | None
    runs: int | None
    measured_road: Path | None
    seed: int
    precision: str
    quick: bool


Reproduction = Callable[[ReproduceOptions, Path], None]
