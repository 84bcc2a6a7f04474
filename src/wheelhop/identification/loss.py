"""Acceleration errors of a simulated quarter car against records: sums, gradient, Gauss-Newton.

Brancati & Tufano 2022, Eq. 20 and 21, for accelerations, as their text says (the printed symbols
are displacements). The loss is the Euclidean norm of the root mean square errors of all records
and both accelerations: the distance of the paper's Pareto point from the origin.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from wheelhop.identification.drives import Drives
from wheelhop.identification.parameters import SearchSpace
from wheelhop.staging import stage
from wheelhop.vehicle.integrate import rk4
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.quarter_car import (
    Accelerations,
    RelativeState,
    accelerations,
    relative_derivative,
)
from wheelhop.vehicle.tire import stiffness_from_pressure


class Sums(NamedTuple):
    """Sums over the counted samples of each block, leading axis 2: sprung, unsprung.

    Attributes:
        squares: of the errors e [m^2/s^4], [2].
        gradient: of e de/dtheta_i, [2, n].
        normal: of de/dtheta_i de/dtheta_j, [2, n, n].
    """

    squares: Any
    gradient: Any
    normal: Any


def step(
    x: RelativeState, car: QuarterCar, pressure: Any, rise: Any, slopes: tuple[Any, Any], dt: Any
) -> tuple[RelativeState, Accelerations]:
    """The quarter car one step later, and its accelerations then; of fourth order in the step.

    The road's velocity is the parabola with the given rise and end slopes.

    Args:
        x: state.
        car: parameters.
        pressure: of the tyre [Pa].
        rise: of the road over the step [m].
        slopes: the road's velocity at the step's beginning and end [m/s].
        dt: step [s].
    """
    stiffness = stiffness_from_pressure(pressure, car.tire)
    first, last = slopes
    middle = 1.5 * rise / dt - 0.25 * (first + last)

    def slope(at: tuple[Any, RelativeState]) -> tuple[Any, RelativeState]:
        t, state = at
        velocity = (
            first * (1.0 - 2.0 * t) * (1.0 - t)
            + 4.0 * middle * t * (1.0 - t)
            + last * t * (2.0 * t - 1.0)
        )
        return jnp.ones_like(dt) / dt, relative_derivative(state, stiffness, velocity, car)

    _, x = rk4(slope, (jnp.zeros_like(dt), x), dt, staged=False)
    return x, accelerations(x, stiffness, car, last)


def block_squares(car: QuarterCar, drive: Drives) -> Any:
    """Sums of squared errors of one record, [blocks, 2]; differentiable in reverse mode.

    Each block is computed anew in the backward pass, so memory holds states of one block.

    Args:
        car: parameters.
        drive: one record, leaves without the record axis.
    """
    advance = stage(step)

    def sample(carry: Any, now: Any) -> tuple[Any, None]:
        x, total = carry
        rise, slopes, pressure, a_s, a_u, count_s, count_u = now
        x, a = advance(x, car, pressure, rise, slopes, drive.dt)
        e_s, e_u = count_s * (a.a_s - a_s), count_u * (a.a_u - a_u)
        return (x, (total[0] + e_s * e_s, total[1] + e_u * e_u)), None

    @jax.checkpoint
    def block(x: RelativeState, piece: Any) -> tuple[RelativeState, Any]:
        zero = jnp.zeros_like(x.v_s)
        (x, total), _ = jax.lax.scan(sample, (x, (zero, zero)), piece)
        return x, jnp.stack(total)

    return jax.lax.scan(block, _rest(drive), inputs_of(drive))[1]


def block_sums(free: Any, space: SearchSpace, base: QuarterCar, drive: Drives) -> Sums:
    """Errors of one record with their derivatives, carried forward in one pass.

    Args:
        free: free numbers [n] of the search space.
        space: the fitted parameters.
        base: the others.
        drive: one record, leaves without the record axis.

    Returns:
        Sums with a leading axis [blocks].
    """
    n = len(space.names)
    car, by_free = _car_and_tangents(free, space, base)

    def advance(x: Any, tangents: Any, c: Any, d: Any, p: Any, r: Any, s: Any, dt: Any) -> Any:
        (x, a), along = jax.linearize(lambda z, car: step(z, car, p, r, s, dt), x, c)
        moved = [along(tangent, by) for tangent, by in zip(tangents, d, strict=True)]
        return (x, a), ([m[0] for m in moved], [m[1] for m in moved])

    moving, add = stage(advance), stage(_added)

    def sample(carry: Any, now: Any) -> tuple[Any, None]:
        x, tangents, total = carry
        rise, slopes, pressure, a_s, a_u, count_s, count_u = now
        (x, a), (tangents, a_by) = moving(
            x, tangents, car, by_free, pressure, rise, slopes, drive.dt
        )
        by_channel = ([b.a_s for b in a_by], [b.a_u for b in a_by])
        return (x, tangents, add(total, a, by_channel, (a_s, a_u), (count_s, count_u))), None

    def block(carry: Any, piece: Any) -> tuple[Any, Sums]:
        zero = jnp.zeros_like(carry[0].v_s)
        empty = tuple((zero, [zero] * n, [[zero] * (i + 1) for i in range(n)]) for _ in range(2))
        (x, tangents, total), _ = jax.lax.scan(sample, (*carry, empty), piece)
        return (x, tangents), _stacked(total)

    rest = _rest(drive)
    return jax.lax.scan(block, (rest, [rest] * n), inputs_of(drive))[1]


def inputs_of(drive: Drives) -> tuple[Any, ...]:
    """What a step takes of a record: rise, both slopes, pressure, measurements, counts."""
    before = jnp.concatenate([jnp.zeros_like(drive.slope.ravel()[:1]), drive.slope.ravel()[:-1]])
    slopes = (before.reshape(drive.slope.shape), drive.slope)
    return (drive.rise, slopes, *drive[2:-1])


def _added(total: Any, a: Any, a_by: Any, measured: Any, counts: Any) -> Any:
    """Sums with one sample's products added, entry by entry: elementwise work stays in lanes."""
    new = []
    for (squares, gradient, normal), value, slope, y, count in zip(
        total, a, a_by, measured, counts, strict=True
    ):
        e = count * (value - y)
        d = [count * slope[i] for i in range(len(gradient))]
        new.append(
            (
                squares + e * e,
                [g + e * s for g, s in zip(gradient, d, strict=True)],
                [[h + d[i] * d[j] for j, h in enumerate(row)] for i, row in enumerate(normal)],
            )
        )
    return tuple(new)


def _stacked(total: Any) -> Sums:
    n = len(total[0][1])
    squares = jnp.stack([channel[0] for channel in total])
    gradient = jnp.stack([jnp.stack(channel[1]) for channel in total])
    normal = jnp.stack(
        [
            jnp.stack([jnp.stack([c[2][max(i, j)][min(i, j)] for j in range(n)]) for i in range(n)])
            for c in total
        ]
    )
    return Sums(squares, gradient, normal)


def _car_and_tangents(free: Any, space: SearchSpace, base: QuarterCar) -> tuple[Any, Any]:
    """The quarter car, and its derivatives by each free number."""
    zero = jnp.zeros_like(free[0])
    base = jax.tree.map(lambda a: jnp.asarray(a, zero.dtype) + zero, base)
    car, along = jax.linearize(lambda f: space.car(f, base), free)
    return car, [along(row) for row in jnp.eye(len(space.names), dtype=zero.dtype)]


def _rest(drive: Drives) -> RelativeState:
    zero = jnp.zeros_like(drive.rise[0, 0])
    return RelativeState(zero, zero, zero, zero)
