"""How quarter cars do on records of one corner: simulated again, compared, not fitted."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.identification.drives import Drives, prepare
from wheelhop.identification.loss import inputs_of, step
from wheelhop.identification.replay import replay
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.quarter_car import RelativeState
from wheelhop.vehicle.record import CornerRecord


class Errors(NamedTuple):
    """How sets of parameters do on records.

    Attributes:
        rmse: root mean square errors [m/s^2] of a_s and a_u, [sets, records, 2].
        velocity_rms: root mean square of the model's suspension velocity [m/s], [sets, records].
    """

    rmse: np.ndarray
    velocity_rms: np.ndarray


def errors_of(cars: Sequence[QuarterCar], records: Sequence[CornerRecord]) -> Errors:
    """Errors of quarter cars on records, as `identify` counts them.

    Args:
        cars: the sets of parameters.
        records: with pressure and elevation.
    """
    drives = prepare(records).drives
    dtype = drives.rise.dtype
    stacked = jax.tree.map(lambda *a: jnp.stack([jnp.asarray(x, dtype) for x in a]), *cars)
    squares, velocity = _compiled_errors()(stacked, drives)
    return Errors(np.sqrt(np.asarray(squares)), np.sqrt(np.asarray(velocity)))


@lru_cache(maxsize=1)
def _compiled_errors() -> Any:
    def one(car: QuarterCar, drive: Drives) -> tuple[Any, Any]:
        def sample(carry: Any, now: Any) -> tuple[Any, None]:
            x, (sum_s, sum_u, sum_w) = carry
            rise, slopes, pressure, a_s, a_u, count_s, count_u = now
            x, a = step(x, car, pressure, rise, slopes, drive.dt)
            e_s, e_u = count_s * (a.a_s - a_s), count_u * (a.a_u - a_u)
            w = count_u * (x.v_s - x.v_u)
            return (x, (sum_s + e_s * e_s, sum_u + e_u * e_u, sum_w + w * w)), None

        flat = jax.tree.map(jnp.ravel, inputs_of(drive))
        zero = jnp.zeros_like(drive.dt)
        rest = RelativeState(zero, zero, zero, zero)
        (_, sums), _ = jax.lax.scan(sample, (rest, (zero, zero, zero)), flat)
        count_s, count_u = drive.count_s.sum(), drive.count_u.sum()
        return jnp.stack([sums[0] / count_s, sums[1] / count_u]), sums[2] / count_u

    of_cars = jax.vmap(one, in_axes=(0, None))
    return jax.jit(jax.vmap(of_cars, in_axes=(None, 0), out_axes=1))


def unsprung_acceleration(car: QuarterCar, record: CornerRecord) -> np.ndarray:
    """Wheel acceleration [m/s^2] of a quarter car on a record's road and pressure, [time]."""
    return replay([record], car, car)[0].fit.a_u
