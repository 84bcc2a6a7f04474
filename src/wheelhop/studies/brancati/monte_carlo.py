"""The Monte Carlo of Brancati & Tufano 2022, section 5.3 and Fig. 6, of any number of runs."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop import __version__
from wheelhop.estimators.candidate import Track
from wheelhop.evaluation.tracking import LAST, Interval, Tracking, rms_gain, tracking
from wheelhop.io.results import write_atomically
from wheelhop.io.source import source_digest
from wheelhop.studies.brancati.contenders import (
    FLOOR,
    TunedFilter,
    floor_track,
    true_stiffness,
)
from wheelhop.studies.brancati.plant import FLEET, RATE, Drive, Driven, Plant, drive_all
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.tire import pressure_slope

PRESSURES = (130e3, 230e3)
SPEEDS = (40 / 3.6, 80 / 3.6)
CLASSES = "ABCD"
"""Ranges of Brancati & Tufano 2022, Table 4, each uniform [Pa, m/s]."""

TRAINING = 1_000_000
"""Number of the first training run; runs of the Monte Carlo count from 0."""

STRIDE = 25
"""Every so many samples are kept of a run: 20 a second."""

Progress = Callable[[int, int], None]


class RunTracks(NamedTuple):
    """What is kept of each run of one filter, [runs, time]: k_t and its stated sigma [N/m]."""

    stiffness: np.ndarray
    sigma: np.ndarray


@dataclass(frozen=True)
class MonteCarlo:
    """A Monte Carlo of all filters on the same runs.

    Attributes:
        t: time [s], [time].
        drives: what was driven.
        pressure: of the front-left tyre [Pa], [runs].
        truth: k_t [N/m], [runs].
        tracks: by name of the filter; the constant prior is one of them.
        figures: by name of the filter.
        slope: dp/dk_t [Pa m/N].
    """

    t: np.ndarray
    drives: tuple[Drive, ...]
    pressure: np.ndarray
    truth: np.ndarray
    tracks: dict[str, RunTracks]
    figures: dict[str, Tracking]
    slope: float

    def gain(self, name: str, other: str) -> Interval:
        """How much smaller a filter's final rms pressure error is than another's [Pa].

        Both are compared on the same runs, in pairs.
        """
        last = self.t > self.t[-1] - LAST
        errors = [
            self.slope * (self.tracks[n].stiffness[:, last] - self.truth[:, None])
            for n in (name, other)
        ]
        return rms_gain(*errors)


def sample_drives(numbers: Sequence[int], seed: int) -> list[Drive]:
    """Random scenarios of Table 4; each depends on the seed and its own number alone.

    Args:
        numbers: of the runs.
        seed: of the study.
    """
    drives = []
    for number in numbers:
        rng = np.random.default_rng([seed, number])
        drives.append(
            Drive(
                int(number),
                float(rng.uniform(*SPEEDS)),
                float(rng.uniform(*PRESSURES)),
                CLASSES[int(rng.integers(len(CLASSES)))],
            )
        )
    return drives


def monte_carlo(
    plant: Plant,
    car: QuarterCar,
    filters: Sequence[TunedFilter],
    runs: int,
    store: Path | None = None,
    on_progress: Progress | None = None,
    driven: Driven | None = None,
    fleet: int = FLEET,
) -> MonteCarlo:
    """Drive, filter and judge runs 0 to `runs` - 1, a fleet at a time.

    Args:
        plant: what the drives share.
        car: the corner, for the truth.
        filters: to compare.
        runs: number of them.
        store: directory where each fleet's results are kept; those of the same plant and filters
            found there are not computed again.
        on_progress: called with runs done and in all.
        driven: the first runs, where they have been driven already.
        fleet: runs in a fleet.

    Raises:
        DivergenceError: naming the filter or vehicle that left the finite numbers.
    """
    key = _key(plant, filters)
    size = min(fleet, runs)
    pieces = []
    for first in range(0, runs, size):
        count = min(size, runs - first)
        # the last fleet is filled up, so that all compile once
        numbers = range(first, first + size)
        file = None if store is None else Path(store) / f"{plant.convention}-{first:07d}.npz"
        piece = None if file is None else _load(file, key, count)
        if piece is None:
            if driven is not None and len(driven.records) >= numbers.stop:
                part = driven.part(slice(numbers.start, numbers.stop))
            else:
                part = drive_all(plant, sample_drives(numbers, plant.seed), fleet=fleet)
            piece = _filtered(part, car, filters, numbers, plant.seed)
            if file is not None:
                _save(file, piece, key)
        pieces.append({name: value[:count] for name, value in piece.items()})
        if on_progress is not None:
            on_progress(first + count, runs)
    joined = {name: np.concatenate([p[name] for p in pieces]) for name in pieces[0]}
    return _judged(plant, car, filters, runs, joined)


def _filtered(
    part: Driven,
    car: QuarterCar,
    filters: Sequence[TunedFilter],
    numbers: Sequence[int],
    seed: int,
) -> dict[str, np.ndarray]:
    kept: dict[str, np.ndarray] = {
        "pressure": part.pressure[:, -1],
        "truth": true_stiffness(part, car)[:, -1],
    }
    for number, filter in enumerate(filters):
        found: Track = filter.track(part, list(numbers), seed, STRIDE)
        kept[f"stiffness_{number}"] = found.stiffness
        kept[f"sigma_{number}"] = found.sigma
    return kept


def _judged(
    plant: Plant,
    car: QuarterCar,
    filters: Sequence[TunedFilter],
    runs: int,
    joined: dict[str, np.ndarray],
) -> MonteCarlo:
    samples = joined["stiffness_0"].shape[1]
    t = kept_times(plant, samples)
    tracks = {
        filter.name: RunTracks(joined[f"stiffness_{k}"], joined[f"sigma_{k}"])
        for k, filter in enumerate(filters)
    }
    floor = floor_track(car, runs, samples)
    tracks[FLOOR] = RunTracks(floor.stiffness, floor.sigma)
    truth = np.broadcast_to(joined["truth"][:, None], (runs, samples))
    slope = float(pressure_slope(car.tire))
    settling = min(2.0, 0.25 * plant.duration)
    figures = {
        name: tracking(t, track.stiffness, track.sigma, truth, slope, settling=settling)
        for name, track in tracks.items()
    }
    drives = tuple(sample_drives(range(runs), plant.seed))
    return MonteCarlo(t, drives, joined["pressure"], joined["truth"], tracks, figures, slope)


def kept_times(plant: Plant, samples: int, stride: int = STRIDE) -> np.ndarray:
    """Time [s] of the samples that are kept."""
    last = plant.samples
    return (last - stride * np.arange(samples)[::-1]) / RATE


def _key(plant: Plant, filters: Sequence[TunedFilter]) -> str:
    """What results depend on, as text."""
    content: dict[str, Any] = {
        "plant": {k: v for k, v in asdict(plant).items() if k != "measured"},
        "filters": [[f.name, dict(f.tuned.tuning)] for f in filters],
        "settings": [
            [np.asarray(a).tolist() for a in jax.tree.leaves(f.candidate.setting)] for f in filters
        ],
        "source": source_digest(),
        "precision": str(jnp.zeros(()).dtype),
        "versions": [__version__, jax.__version__],
    }
    return json.dumps(content, sort_keys=True)


def _save(file: Path, piece: dict[str, Any], key: str) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)

    def write(path: Path) -> None:
        with path.open("wb") as stream:
            np.savez(stream, made_of=np.array(key), **piece)

    write_atomically(file, write)


def _load(file: Path, key: str, count: int) -> dict[str, np.ndarray] | None:
    """Results of these very runs and filters, or None where they are others' or damaged."""
    try:
        with np.load(io.BytesIO(file.read_bytes())) as content:
            if str(content["made_of"]) != key or len(content["truth"]) < count:
                return None
            return {name: content[name] for name in content.files if name != "made_of"}
    except (OSError, EOFError, ValueError, KeyError, zipfile.BadZipFile):
        return None
