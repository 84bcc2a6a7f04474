"""What the lateral estimators say of many records: which tyres are soft, over time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.estimators.failure_modes import level_table, stacked_tires
from wheelhop.estimators.lateral import (
    LateralSample,
    SwitchedParams,
    SwitchTuning,
    switched,
)
from wheelhop.estimators.lateral_bank import (
    bank_prior,
    bind_drive,
    lateral_bank,
    lateral_params,
    readings_and_inputs,
)
from wheelhop.estimators.lateral_model import LateralTuning
from wheelhop.filtering import drive, run_batch
from wheelhop.vehicle.lateral_tire import ARCTANGENT, TireLaw
from wheelhop.vehicle.two_track import TwoTrack, Wheels

EVERY = 10
"""Samples of a record for each one that is kept of a verdict."""

BANK_EVERY = 2
"""Samples of a record for each one that the bank of filters takes: 50 Hz of 100."""

LANES = 128
"""Runs that are judged at once; fewer are filled up, so that every number of runs shares one
compiled function."""


class Verdicts(NamedTuple):
    """What an estimator says over the records, at `EVERY` sample.

    Attributes:
        selected: mode believed, from zero, [runs, time].
        probability: of that mode [-]; NaN for an estimator that has none, [runs, time].
        soft: probability that each tyre is soft, 0 or 1 without probabilities, [runs, time, 4].
        friction: mean of the road's friction; NaN where none is estimated, [runs, time].
    """

    selected: np.ndarray
    probability: np.ndarray
    soft: np.ndarray
    friction: np.ndarray


def by_switching(
    samples: LateralSample,
    dt: float,
    car: TwoTrack,
    levels: Sequence[Any] | Wheels,
    tuning: SwitchTuning,
    slip: str = "observer",
    printed: bool = False,
    law: TireLaw = ARCTANGENT,
    lanes: int = LANES,
) -> Verdicts:
    """Verdicts of the switched models.

    Args:
        samples: of the sensors, [runs, time].
        dt: sampling interval [s].
        car: the vehicle as the estimator knows it.
        levels: tyres from the softest to the sound one, as in `failure_modes.stacked_tires`.
        tuning: of the cost and the observer.
        slip, printed, law: as in `lateral.switched`.
        lanes: runs judged at once.
    """
    params = SwitchedParams(car, stacked_tires(levels), dt, tuning)
    params = jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.result_type(float)), params)
    run = _switched(slip, printed, law)
    found = [
        np.asarray(run(piece, params))[:, EVERY - 1 :: EVERY] for piece in _pieces(samples, lanes)
    ]
    selected = np.concatenate(found)[: np.shape(samples.steer)[0]].astype(int)
    nothing = np.full(selected.shape, np.nan)
    soft = _below_sound(jax.tree.leaves(params.tires)[0].shape[0])[selected]
    return Verdicts(selected, nothing, soft, nothing)


@lru_cache(maxsize=8)
def _switched(slip: str, printed: bool, law: TireLaw) -> Any:
    bank = switched(slip, printed, law)

    def one(y: LateralSample, params: SwitchedParams) -> Any:
        def keep(state: Any, info: Any) -> Any:
            del state
            return info.selected.astype(jnp.int16)

        return drive.run(bank, bank.init(params), y, params, keep=keep)

    return jax.jit(jax.vmap(one, in_axes=(0, None)))


def by_filters(
    samples: LateralSample,
    dt: float,
    car: TwoTrack,
    levels: Sequence[Any] | Wheels,
    tuning: LateralTuning,
    temper: float = 1.0,
    law: TireLaw = ARCTANGENT,
    lanes: int = LANES,
) -> Verdicts:
    """Verdicts of the bank of filters, which takes every `BANK_EVERY` sample.

    Args:
        samples, dt, car, levels, law, lanes: as in `by_switching`.
        tuning: of the filters.
        temper: exponent of the likelihoods.
    """
    params = lateral_params(car, levels, BANK_EVERY * dt, tuning=tuning, temper=temper)
    filter = lateral_bank(law)
    state = filter.init(bank_prior(params), params)
    stride = EVERY // BANK_EVERY
    found = []
    for piece in _pieces(samples, lanes):
        thin = jax.tree.map(lambda a: a[:, BANK_EVERY - 1 :: BANK_EVERY], piece)
        ys, inputs = readings_and_inputs(thin)
        kept = run_batch(
            filter, state, ys, params, inputs=inputs, bind=bind_drive, keep=_kept, lanes=lanes
        )
        found.append([np.asarray(a, float)[:, stride - 1 :: stride] for a in kept])
    count = np.shape(samples.steer)[0]
    log_p, ln_friction = (np.concatenate(a)[:count] for a in zip(*found, strict=True))
    p = np.exp(log_p)
    soft = p @ _below_sound(p.shape[-1])
    return Verdicts(p.argmax(-1), p.max(-1), soft, np.exp(ln_friction))


def _kept(state: Any, info: Any) -> Any:
    del info
    return state.log_probabilities, state.combined.mean.ln_friction


def _below_sound(modes: int) -> np.ndarray:
    """Whether each tyre is below its sound level in each mode, 0 or 1, [modes, 4]."""
    levels = round(modes**0.25)
    return np.asarray(level_table(levels) < levels - 1, float)


def _pieces(samples: LateralSample, lanes: int) -> Iterator[LateralSample]:
    """Pieces of equal length, the last run repeated to fill the last."""
    count = np.shape(samples.steer)[0]
    for begin in range(0, count, lanes):
        index = np.minimum(np.arange(begin, begin + lanes), count - 1)
        yield jax.tree.map(lambda a, i=index: jnp.asarray(np.asarray(a)[i]), samples)
