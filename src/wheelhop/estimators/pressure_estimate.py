"""Pressure over time as an estimator gives it, and the loop over a record that makes it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import numpy as np

from wheelhop.errors import DivergenceError
from wheelhop.filtering import Filter, Info, drive
from wheelhop.filtering.drive import Bind, Keep
from wheelhop.vehicle.quarter_car import Accelerations
from wheelhop.vehicle.record import CornerRecord
from wheelhop.vehicle.tire import Tire, pressure_from_stiffness, pressure_slope

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
        modes: names of the filter's modes.
        mode_probabilities: [time, modes].
        nis: normalised innovation squared of the mixture; its mean is 2 for a single filter
            whose model fits, and somewhat less for an IMM (improbable modes widen it).
        missing: number of measurements left out of each step.
        guarded: True where the filter's pivot guard acted.
        lost_members: members that left the finite numbers in a step and were restarted.
        level: road level Gd(W0) [m^3/rad] where the filter estimates it, or None.
        level_sigma: standard deviation of ln G, or None.
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
    level: np.ndarray | None = None
    level_sigma: np.ndarray | None = None


class Kept(NamedTuple):
    """What a loop over a record keeps of every step.

    Attributes:
        ln_k_t, variance: belief over ln k_t.
        log_probabilities: of the modes.
        nis, missing, guarded, lost_members, nonfinite: as in `Info` and its flags.
        ln_level, level_variance: belief over ln G, or None.
    """

    ln_k_t: Any
    variance: Any
    log_probabilities: Any
    nis: Any
    missing: Any
    guarded: Any
    lost_members: Any
    nonfinite: Any
    ln_level: Any = None
    level_variance: Any = None


def kept_of(info: Info, **belief: Any) -> Kept:
    """`Kept` of a step's report and the belief's entries by name."""
    return Kept(
        nis=info.nis,
        missing=info.flags.missing,
        guarded=info.flags.guarded,
        lost_members=info.flags.lost_members,
        nonfinite=info.flags.nonfinite,
        **belief,
    )


def filter_record(
    filter: Filter,
    state: Any,
    ys: Any,
    params: Any,
    speed: np.ndarray,
    t: np.ndarray,
    bind: Bind,
    keep: Keep,
    on_progress: Callable[[int, int], None] | None = None,
    whole: bool = True,
) -> Any:
    """What `keep` chose of every step, arrays [time, ...].

    Args:
        filter: of the record, with its first `state` and `params`.
        state: before the first sample.
        ys: measurements, leaves [time, ...].
        params: parameters; `bind` puts the speed into them.
        speed: v [m/s], [time].
        t: time [s], [time], for messages.
        bind: as in `drive.run`.
        keep: as in `drive.run`; its result has an entry `nonfinite`.
        on_progress: called with samples done and in all.
        whole: as in `drive.run_in_chunks`.

    Raises:
        DivergenceError: if the filter leaves the finite numbers.
    """
    pieces = []
    chunk = min(_CHUNK, len(t))
    for done, kept in drive.run_in_chunks(
        filter, state, ys, params, chunk=chunk, inputs=speed, bind=bind, keep=keep, whole=whole
    ):
        pieces.append(kept)
        _raise_if_diverged(kept.nonfinite, t[:done][-len(kept.nonfinite) :])
        if on_progress is not None:
            on_progress(done, len(t))
    return jax.tree.map(lambda *a: np.concatenate(a), *pieces)


def measured_as(record: CornerRecord, dtype: Any) -> Accelerations:
    """The record's accelerations in a floating type, [time]."""
    return Accelerations(record.a_s.astype(dtype), record.a_u.astype(dtype))


def pressure_estimate(
    t: np.ndarray, kept: Kept, modes: tuple[str, ...], tire: Tire, level: float = 1.0
) -> PressureEstimate:
    """The course of pressure of what was kept.

    Args:
        t: time [s], [time].
        kept: entries [time].
        modes: names.
        tire: turns stiffness into pressure.
        level: Gd(W0) [m^3/rad] from which ln G deviates.
    """
    stiffness = np.exp(kept.ln_k_t.astype(float))
    stiffness_sigma = stiffness * np.sqrt(kept.variance.astype(float))
    known = kept.ln_level is not None
    return PressureEstimate(
        t=t,
        pressure=np.asarray(pressure_from_stiffness(stiffness, tire)),
        pressure_sigma=stiffness_sigma * float(pressure_slope(tire)),
        stiffness=stiffness,
        stiffness_sigma=stiffness_sigma,
        modes=modes,
        mode_probabilities=np.exp(kept.log_probabilities.astype(float)),
        nis=kept.nis.astype(float),
        missing=kept.missing,
        guarded=kept.guarded,
        lost_members=kept.lost_members,
        level=level * np.exp(kept.ln_level.astype(float)) if known else None,
        level_sigma=np.sqrt(kept.level_variance.astype(float)) if known else None,
    )


def _raise_if_diverged(nonfinite: np.ndarray, t: np.ndarray) -> None:
    bad = np.flatnonzero(nonfinite)
    if bad.size:
        raise DivergenceError(
            f"the filter left the finite numbers at t = {t[bad[0]]:.4g} s; check the log there, "
            "raise the accelerometer noise in the tuning, or run in float64"
        )
