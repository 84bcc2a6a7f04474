"""A campaign: chunks of runs, each stored as it ends, resumed where it stopped."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop import __version__
from wheelhop.errors import DivergenceError, InputError
from wheelhop.io.results import write_atomically, write_json
from wheelhop.montecarlo.run import RunResult, run_many
from wheelhop.montecarlo.scenarios import CampaignSettings, validate_settings
from wheelhop.staging import staged_jit
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.tire import require_stiff

CHUNK = 100
"""Runs in one jitted call: they fit the cache, and an interruption loses one call at most."""


def run_campaign(
    settings: CampaignSettings,
    car: QuarterCar,
    store: Path | None = None,
    on_progress: Callable[[int, int], None] | None = None,
) -> RunResult:
    """Run a campaign, one compiled call per chunk of runs.

    Args:
        settings: of the campaign.
        car: the corner, in the truth and in the filter.
        store: directory for finished chunks; a campaign of the same settings found there is
            resumed, and its finished chunks are not run again.
        on_progress: called with runs done and in all.

    Returns:
        Results as NumPy arrays with a leading axis [runs].

    Raises:
        InputError: for settings out of range, or a store that holds another campaign.
        DivergenceError: if a run left the finite numbers.
    """
    validate_settings(settings)
    require_stiff(car.tire, min(settings.pressure[0], settings.tuning.prior_pressure))
    key = _key(settings, car)
    if store is not None:
        _open_store(Path(store), key)
    size = min(CHUNK, settings.runs)
    chunk = staged_jit(partial(run_many, settings))
    car = jax.tree.map(lambda a: jnp.asarray(a, float), car)
    pieces = []
    for first in range(0, settings.runs, size):
        count = min(size, settings.runs - first)
        file = None if store is None else Path(store) / f"runs-{first:07d}.npz"
        piece = None if file is None else _load(file, key)
        if piece is None:
            piece = jax.tree.map(np.asarray, chunk(car, first + jnp.arange(size)))
            piece = jax.tree.map(lambda a, n=count: a[:n], piece)
            _raise_if_diverged(piece, first)
            if file is not None:
                _save(file, piece, key)
        pieces.append(piece)
        if on_progress is not None:
            on_progress(first + count, settings.runs)
    return jax.tree.map(lambda *a: np.concatenate(a), *pieces)


def finished_runs(store: Path, settings: CampaignSettings, car: QuarterCar) -> int:
    """Number of runs of this very campaign that a store already holds."""
    key = _key(settings, car)
    files = sorted(Path(store).glob("runs-*.npz"))
    return sum(len(piece.error) for f in files if (piece := _load(f, key)) is not None)


def _key(settings: CampaignSettings, car: QuarterCar) -> str:
    """What a result depends on, as text: settings, vehicle, precision and versions."""
    content = {
        "settings": asdict(settings),
        "car": jax.tree.map(float, asdict(car)),
        "precision": str(jnp.zeros(()).dtype),
        "wheelhop": __version__,
        "jax": jax.__version__,
    }
    return json.dumps(content, sort_keys=True)


def _open_store(store: Path, key: str) -> None:
    store.mkdir(parents=True, exist_ok=True)
    file = store / "campaign.json"
    if file.is_file():
        try:
            found = json.dumps(json.loads(file.read_text()), sort_keys=True)
        except ValueError:
            found = ""
        if found != key:
            raise InputError(
                "--out",
                f"{store} holds finished runs of another campaign (settings, vehicle, precision "
                "or version differ)",
                "Give another directory, or remove that one to start afresh.",
            )
    write_json(file, json.loads(key))


def _save(file: Path, piece: RunResult, key: str) -> None:
    def write(path: Path) -> None:
        with path.open("wb") as stream:
            np.savez(stream, campaign=np.array(key), **piece._asdict())

    write_atomically(file, write)


def _load(file: Path, key: str) -> RunResult | None:
    """A finished chunk of this campaign, or None where it is another's or damaged."""
    try:
        with np.load(io.BytesIO(file.read_bytes())) as content:
            if str(content["campaign"]) != key:
                return None
            return RunResult(**{name: content[name] for name in RunResult._fields})
    except (OSError, ValueError, KeyError, zipfile.BadZipFile):
        return None


def _raise_if_diverged(piece: Any, first: int) -> None:
    bad = np.flatnonzero(piece.nonfinite)
    if bad.size:
        raise DivergenceError(
            f"{bad.size} runs left the finite numbers, the first is run {first + bad[0]}; "
            "raise the accelerometer noise in the tuning, or run in float64"
        )
