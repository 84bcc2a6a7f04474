"""Run an estimator over one corner's record and express the result as tyre pressure."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import numpy as np

from wheelhop.errors import DivergenceError
from wheelhop.estimators.immuf import (
    ROAD_CLASSES,
    Tuning,
    bind_speed,
    immuf,
    immuf_params,
    prior,
)
from wheelhop.filtering import Info, InteractingState, drive
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.quarter_car import Accelerations
from wheelhop.vehicle.record import CornerRecord
from wheelhop.vehicle.tire import pressure_from_stiffness, pressure_slope, require_stiff

_CHUNK = 500


@dataclass(frozen=True)
class PressureEstimate:
    """Tyre pressure over time, every array [time] unless said otherwise.

    Attributes:
        t: time [s].
        pressure: estimate [Pa].
        pressure_sigma: its standard deviation as the filter states it [Pa].
        stiffness: tyre stiffness k_t [N/m].
        stiffness_sigma: its standard deviation [N/m].
        modes: names of the road classes.
        mode_probabilities: [time, modes].
        nis: normalised innovation squared of the mixture; its mean is 2 for a single filter
            whose model fits, and somewhat less for an IMM (improbable modes widen it).
        missing: number of measurements left out of each step.
        guarded: True where the filter's pivot guard acted.
        lost_members: members that left the finite numbers in a step and were restarted.
    """

    t: np.ndarray
    pressure: np.ndarray
    pressure_sigma: np.ndarray
    stiffness: np.ndarray
    stiffness_sigma: np.ndarray
    modes: tuple[str, ...]
    mode_probabilities: np.ndarray
    nis: np.ndarray
    missing: np.ndarray
    guarded: np.ndarray
    lost_members: np.ndarray


class _Kept(NamedTuple):
    ln_k_t: Any
    variance: Any
    log_probabilities: Any
    nis: Any
    missing: Any
    guarded: Any
    lost_members: Any
    nonfinite: Any


def estimate_pressure(
    record: CornerRecord,
    car: QuarterCar,
    *,
    tuning: Tuning = Tuning(),
    cars: Sequence[QuarterCar] | None = None,
    classes: Sequence[str] = ROAD_CLASSES,
    on_progress: Callable[[int, int], None] | None = None,
) -> PressureEstimate:
    """Estimate the pressure with the IMM of unscented filters (`immuf`).

    Args:
        record: a checked record (`wheelhop.vehicle.record.checked_record`).
        car: the corner; its tyre turns stiffness into pressure.
        tuning: the filter's tuning.
        cars: one parameter set per class instead of `car` in the members.
        classes: ISO 8608 classes of the members.
        on_progress: called with samples done and in all.

    Raises:
        InputError: if tuning or classes are not usable.
        DivergenceError: if the filter leaves the finite numbers.
    """
    require_stiff(car.tire, tuning.prior_pressure)
    dt = record.dt
    filter = immuf(dt)
    params = immuf_params(cars or car, record.v[0], dt, tuning, classes)
    state = filter.init(prior(car, tuning), params)
    dtype = params.initial.dtype
    ys = Accelerations(record.a_s.astype(dtype), record.a_u.astype(dtype))

    pieces = []
    for done, kept in drive.run_in_chunks(
        filter,
        state,
        ys,
        params,
        chunk=min(_CHUNK, len(record.t)),
        inputs=record.v.astype(dtype),
        bind=bind_speed,
        keep=_keep,
    ):
        pieces.append(kept)
        _raise_if_diverged(kept, record.t[:done][-len(kept.nis) :])
        if on_progress is not None:
            on_progress(done, len(record.t))
    all_kept: _Kept = jax.tree.map(lambda *a: np.concatenate(a), *pieces)
    stiffness = np.exp(all_kept.ln_k_t.astype(float))
    stiffness_sigma = stiffness * np.sqrt(all_kept.variance.astype(float))
    return PressureEstimate(
        t=record.t,
        pressure=np.asarray(pressure_from_stiffness(stiffness, car.tire)),
        pressure_sigma=stiffness_sigma * float(pressure_slope(car.tire)),
        stiffness=stiffness,
        stiffness_sigma=stiffness_sigma,
        modes=tuple(classes),
        mode_probabilities=np.exp(all_kept.log_probabilities.astype(float)),
        nis=all_kept.nis.astype(float),
        missing=all_kept.missing,
        guarded=all_kept.guarded,
        lost_members=all_kept.lost_members,
    )


def _keep(state: InteractingState, info: Info) -> _Kept:
    belief = state.combined
    return _Kept(
        belief.mean.ln_k_t,
        belief.cov[-1][-1],
        state.log_probabilities,
        info.nis,
        info.flags.missing,
        info.flags.guarded,
        info.flags.lost_members,
        info.flags.nonfinite,
    )


def _raise_if_diverged(kept: _Kept, t: np.ndarray) -> None:
    bad = np.flatnonzero(kept.nonfinite)
    if bad.size:
        raise DivergenceError(
            f"the filter left the finite numbers at t = {t[bad[0]]:.4g} s; check the log there, "
            "raise the accelerometer noise in the tuning, or run in float64"
        )
