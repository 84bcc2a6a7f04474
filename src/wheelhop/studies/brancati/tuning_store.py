"""Tunings kept on disk, so that an interrupted validation does not tune again."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop import __version__
from wheelhop.estimators.candidate import Candidate
from wheelhop.estimators.tuning import Tuned, TuningSettings
from wheelhop.io.results import write_json
from wheelhop.io.source import source_digest


def tuning_key(
    candidate: Candidate,
    settings: TuningSettings,
    start: Mapping[str, float] | None,
    training: Mapping[str, Any],
) -> str:
    """What a tuning depends on, as text.

    Args:
        candidate: the filter.
        settings: of the descent.
        start: where it begins; the candidate's default for None.
        training: what the training and test runs depend on.
    """
    content = {
        "candidate": candidate.name,
        "setting": [np.asarray(a).tolist() for a in jax.tree.leaves(candidate.setting)],
        "settings": asdict(settings),
        "start": dict(start or candidate.default),
        "training": dict(training),
        "precision": str(jnp.zeros(()).dtype),
        "versions": [__version__, jax.__version__],
        "source": source_digest(),
    }
    return json.dumps(content, sort_keys=True, default=str)


def kept_tuning(place: Path | None, key: str, candidate: Candidate) -> Tuned | None:
    """The tuning of this key, or None where there is none or another's."""
    if place is None:
        return None
    for file in sorted(place.glob("tuning-*.json")):
        try:
            content = json.loads(file.read_text())
            if content["key"] == key and set(content["tuning"]) == set(candidate.knobs):
                history = [np.nan if x is None else x for x in content["history"]]
                return Tuned(
                    content["tuning"],
                    content["start"],
                    np.asarray(history, float),
                    content["train"],
                    content["test"],
                    content["start_test"],
                    TuningSettings(
                        **{**content["settings"], "held": tuple(content["settings"]["held"])}
                    ),
                )
        except (OSError, ValueError, KeyError, TypeError):  # damaged: tune again
            continue
    return None


def keep_tuning(place: Path | None, key: str, candidate: Candidate, tuned: Tuned) -> None:
    """Store a tuning beside the others."""
    if place is None:
        return
    name = "".join(c if c.isalnum() else "_" for c in candidate.name)
    history = [x if np.isfinite(x) else None for x in tuned.history.tolist()]
    content = {"key": key, **asdict(tuned), "history": history}
    place.mkdir(parents=True, exist_ok=True)
    write_json(place / f"tuning-{name}-{tuned.settings.objective}.json", content)
