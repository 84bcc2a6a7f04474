"""What an unmeasured road does to the quarter car within one sampling interval."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp

from wheelhop.staging import stage
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.quarter_car import RelativeState

# three-point Gauss-Legendre rule on [0, 1]: nodes and weights
_NODES = ((0.5 - 0.15**0.5, 5 / 18), (0.5, 8 / 18), (0.5 + 0.15**0.5, 5 / 18))
_SERIES = (1.0, 1.0, 1 / 2, 1 / 6, 1 / 24)


@stage
def road_noise_cov(
    stiffness: Any, intensity: Any, dt: Any, car: QuarterCar, substeps: int = 1
) -> tuple:
    """Covariance of the relative state after dt from a road that is white in velocity.

    The integral of q h(t) h(t)^T over the interval, with h the response of the linear quarter
    car (d, e, v_s, v_u) to a step of the road: Taylor series of fourth order and three-point
    Gauss-Legendre quadrature in every substep, so positive semidefinite by construction.

    Args:
        stiffness: tyre stiffness k_t [N/m].
        intensity: q of the road velocity [m^2/s]; see `road_velocity_intensity`.
        dt: interval [s].
        car: parameters; the suspension enters by its linear part.
        substeps: pieces of the interval.

    Returns:
        Lower triangle of the 4 x 4 covariance, entries in the order of `RelativeState`.
    """
    fine = dt / substeps
    zero = 0.0 * stiffness * intensity * fine
    start = RelativeState(zero, 1.0 + zero, zero, zero)
    if substeps == 1:
        return _piece(start, stiffness, intensity, fine, car)[1]

    def step(carry: tuple, _: None) -> tuple:
        response, total = carry
        response, share = _piece(response, stiffness, intensity, fine, car)
        return (response, jax.tree.map(jnp.add, total, share)), None

    none = tuple(tuple(zero for _ in range(i + 1)) for i in range(4))
    (_, total), _ = jax.lax.scan(step, (start, none), length=substeps)
    return total


def _piece(h: RelativeState, stiffness: Any, intensity: Any, dt: Any, car: QuarterCar) -> tuple:
    """Response a time dt later, and the covariance gathered on the way."""
    powers = [h]
    for _ in _SERIES[1:]:
        powers.append(_linear_derivative(powers[-1], stiffness, car))

    def at(t: Any) -> list[Any]:
        return [
            sum(c * t**k * p[i] for k, (c, p) in enumerate(zip(_SERIES, powers, strict=True)))
            for i in range(4)
        ]

    samples = [(weight, at(node * dt)) for node, weight in _NODES]
    scale = intensity * dt
    cov = tuple(
        tuple(scale * sum(w * x[i] * x[j] for w, x in samples) for j in range(i + 1))
        for i in range(4)
    )
    return RelativeState(*at(dt)), cov


def _linear_derivative(h: RelativeState, stiffness: Any, car: QuarterCar) -> RelativeState:
    w = h.v_s - h.v_u
    force = car.suspension.stiffness * h.deflection + car.suspension.damping * w
    wheel = (force - stiffness * h.tyre_deflection) / car.unsprung_mass
    return RelativeState(w, h.v_u, -force / car.sprung_mass, wheel)
