"""The filters that are compared in every row, and how they are tuned.

A filter joins by one line in `CONTENDERS`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.estimators.candidate import Candidate, Track, constant_track, track
from wheelhop.estimators.candidates import (
    NOISE,
    PRIOR_PRESSURE,
    PRIOR_SIGMA,
    all_corrected,
    all_printed,
    class_a_corrected,
    class_a_printed,
)
from wheelhop.estimators.likelihood_candidate import maximum_likelihood
from wheelhop.estimators.tuning import Tuned, TuningSettings, tune
from wheelhop.studies.brancati.plant import RATE, Driven
from wheelhop.studies.brancati.tuning_store import keep_tuning, kept_tuning, tuning_key
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.tire import pressure_slope, stiffness_from_pressure


class Contender(NamedTuple):
    """A filter that is compared.

    Attributes:
        make: (cars by class, sampling interval [s], convention of road levels, noise of the
            accelerometers [m/s^2]) -> candidate.
        words: what it is, for the report.
        parent: of a filter of one class, the number of that over all classes, whose tuning it
            takes where it gets none of its own.
    """

    make: Callable[[Mapping[str, QuarterCar], float, str, float], Candidate]
    words: str
    parent: int | None = None


CONTENDERS = (
    Contender(
        all_printed,
        "absolute state with k_t, an artificial road of each class as input, an Euler step, and "
        "every misprint of section 3 but the mixing weights, with which it does not work",
    ),
    Contender(
        all_corrected,
        "state relative to the road, the road as process noise, ln k_t in the state, and the "
        "textbook's interacting multiple model",
    ),
    Contender(class_a_printed, "its first member by itself", parent=0),
    Contender(class_a_corrected, "its first member by itself", parent=1),
    Contender(
        maximum_likelihood,
        "four states conditioned on ln k_t and the road's level, which climb the likelihood; the "
        "modes are what changes, not road classes; nothing is tuned",
    ),
)
"""Every filter of the comparison."""

PRINTED = 0
"""Number of the printed filter among them."""

_FILTERS = 2
"""Folded into the seed for the filters' own draws; roads take 0 and sensors 1."""

UNTUNED = ", before tuning"
"""What is added to the name of a filter before it was tuned."""

FLOOR = "constant 180 kPa"
"""Name of what every filter must beat: the middle of the range, and nothing learnt."""


@dataclass(frozen=True)
class TunedFilter:
    """A candidate and the tuning it is judged with."""

    candidate: Candidate
    tuned: Tuned

    @property
    def name(self) -> str:
        """As in tables."""
        return self.candidate.name

    def track(self, driven: Driven, numbers: Any, seed: int, stride: int = 1) -> Track:
        """Filter drives; a run whose filter leaves the finite numbers is NaN from there on.

        Args:
            driven: the drives.
            numbers: of the drives [runs]; they seed initial states and artificial roads.
            seed: of the study.
            stride: keep every so many samples.
        """
        keys = filter_keys(numbers, seed)
        tuning = self.tuned.tuning
        return track(self.candidate, driven.records, keys, tuning, stride=stride, check=False)

    def untuned(self) -> TunedFilter:
        """The same filter with the tuning that the candidate starts from, named so."""
        named = replace(self.candidate, name=self.name + UNTUNED)
        return TunedFilter(named, replace(self.tuned, tuning=self.candidate.default))


def candidates(
    cars: Mapping[str, QuarterCar], convention: str, noise: float = NOISE
) -> list[Candidate]:
    """Every contender for a road convention.

    Args:
        cars: the corner by road class.
        convention: "iso8608" or "brancati2022".
        noise: of the accelerometers [m/s^2].
    """
    return [c.make(cars, 1.0 / RATE, convention, noise) for c in CONTENDERS]


def filter_keys(numbers: Any, seed: int) -> Any:
    """A random key for each run's initial state and artificial roads [runs].

    Args:
        numbers: of the runs.
        seed: of the study.
    """
    key = jax.random.fold_in(jax.random.key(seed), _FILTERS)
    return jax.vmap(lambda n: jax.random.fold_in(key, n))(jnp.asarray(np.asarray(numbers)))


def true_stiffness(driven: Driven, car: QuarterCar) -> np.ndarray:
    """k_t [N/m] that the true pressure means by Brancati & Tufano 2022, Eq. 3, [runs, time]."""
    return np.asarray(stiffness_from_pressure(driven.pressure, car.tire))


def tune_all(
    chosen: list[Candidate],
    car: QuarterCar,
    training: tuple[Driven, Any],
    test: tuple[Driven, Any],
    settings: TuningSettings,
    seed: int = 0,
    starts: Mapping[str, Tuned] | None = None,
    on_progress: Callable[[int, int], None] | None = None,
    store: Path | None = None,
    made_of: Mapping[str, Any] | None = None,
) -> list[TunedFilter]:
    """Tune every candidate in the same way on the same runs.

    Args:
        chosen: the candidates.
        car: the corner, for the truth.
        training: drives and their numbers.
        test: drives that are not trained on, and their numbers.
        settings: of the descent.
        seed: of the study.
        starts: where to begin by candidate name; their defaults where it says nothing.
        on_progress: called with iterations done and in all.
        store: directory of tunings; one made of the same is read and not made again.
        made_of: what the drives depend on, for `store`.
    """
    found = []
    for k, candidate in enumerate(chosen):

        def advance(done: int, most: int, best: float, k: int = k) -> None:
            del best
            if on_progress is not None:
                on_progress(k * most + done, len(chosen) * most)

        before = (starts or {}).get(candidate.name)
        start = None if before is None else before.tuning
        key = tuning_key(candidate, settings, start, made_of or {})
        tuned = kept_tuning(store, key, candidate)
        if tuned is None:
            tuned = tune(
                candidate,
                training[0].records,
                true_stiffness(training[0], car),
                filter_keys(training[1], seed),
                test=(test[0].records, true_stiffness(test[0], car), filter_keys(test[1], seed)),
                start=start,
                settings=settings,
                on_progress=advance,
            )
            keep_tuning(store, key, candidate, tuned)
        advance(settings.iterations, settings.iterations, tuned.train)
        found.append(TunedFilter(candidate, tuned))
    return found


def floor_track(car: QuarterCar, runs: int, samples: int) -> Track:
    """The constant prior as a track."""
    stiffness = float(stiffness_from_pressure(PRIOR_PRESSURE, car.tire))
    return constant_track(stiffness, PRIOR_SIGMA / float(pressure_slope(car.tire)), runs, samples)
