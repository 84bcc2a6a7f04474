"""A fitted quarter car driven along its records again, sample by sample."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.identification.drives import SETTLING, Drives, prepare
from wheelhop.identification.loss import inputs_of, step
from wheelhop.staging import stage, staged_jit
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.quarter_car import Accelerations, RelativeState
from wheelhop.vehicle.record import CornerRecord


class Replay(NamedTuple):
    """A record and what two quarter cars do on its road, every entry [time].

    Attributes:
        name: of the record.
        record: as measured.
        judged: whether a sample lies behind the settling time.
        start: accelerations [m/s^2] of the quarter car that the fit began from.
        fit: of the fitted one.
        start_velocity: of the suspension, v_s - v_u [m/s], of the one it began from.
        fit_velocity: of the fitted one.
    """

    name: str
    record: CornerRecord
    judged: np.ndarray
    start: Accelerations
    fit: Accelerations
    start_velocity: np.ndarray
    fit_velocity: np.ndarray


def replay(
    records: Sequence[CornerRecord],
    start: QuarterCar,
    fit: QuarterCar,
    names: Sequence[str] | None = None,
    settling: float = SETTLING,
) -> tuple[Replay, ...]:
    """Drive two quarter cars along records, from rest, with the steps that the fit was made with.

    Args:
        records: checked ones with pressure and elevation.
        start: the quarter car that the fit began from.
        fit: the fitted one.
        names: of the records.
        settling: time at each record's start that is not judged [s].

    Raises:
        InputError: for records that cannot be used.
    """
    prepared = prepare(records, names, settling)
    dtype = prepared.drives.rise.dtype
    both = jax.tree.map(lambda a, b: jnp.asarray([float(a), float(b)], dtype), start, fit)
    a, velocity = jax.tree.map(np.asarray, driven()(both, prepared.drives))
    replays = []
    for k, (name, record) in enumerate(zip(prepared.names, records, strict=True)):
        m = prepared.steps[k]
        at = slice(m - 1, m * len(record.t), m)
        began, ended = (Accelerations(a.a_s[k, at, c], a.a_u[k, at, c]) for c in range(2))
        judged = record.t - record.t[0] >= settling
        speeds = (velocity[k, at, c] for c in range(2))
        replays.append(Replay(name, record, judged, began, ended, *speeds))
    return tuple(replays)


@lru_cache(maxsize=1)
def driven() -> Any:
    """Accelerations and suspension velocity [records, time, cars] of quarter cars on drives."""

    def along(cars: QuarterCar, drive: Drives) -> Any:
        advance = stage(step)

        def sample(x: RelativeState, now: Any) -> tuple[RelativeState, Any]:
            rise, slopes, pressure = now
            x, a = jax.vmap(lambda s, c: advance(s, c, pressure, rise, slopes, drive.dt))(x, cars)
            return x, (a, x.v_s - x.v_u)

        zero = jnp.zeros_like(cars.sprung_mass)
        rest = RelativeState(zero, zero, zero, zero)
        inputs = jax.tree.map(jnp.ravel, inputs_of(drive)[:3])
        return jax.lax.scan(sample, rest, inputs)[1]

    return staged_jit(lambda cars, drives: jax.vmap(lambda drive: along(cars, drive))(drives))
