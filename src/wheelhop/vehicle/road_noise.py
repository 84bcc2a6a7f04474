"""What an unmeasured road does to the quarter car within one sampling interval."""

from __future__ import annotations

from typing import Any

from wheelhop.vehicle.parameters import QuarterCar


def road_noise_cov(stiffness: Any, intensity: Any, dt: Any, car: QuarterCar) -> tuple:
    """Covariance of the relative state after dt from a road that is white in velocity.

    The integral of q h(t) h(t)^T over the interval, h = G + A G t + A^2 G t^2 / 2 the response
    of (d, e, v_s, v_u) to a step of the road, G = (0, 1, 0, 0). Positive semidefinite, and
    short of the matrix exponential by the third order in c_s dt / m_u.

    Args:
        stiffness: tyre stiffness k_t [N/m].
        intensity: q of the road velocity [m^2/s]; see `road_velocity_intensity`.
        dt: interval [s].
        car: parameters; the suspension enters by its linear damping.

    Returns:
        Lower triangle of the 4 x 4 covariance, entries in the order of `RelativeState`.
    """
    b = -stiffness / car.unsprung_mass
    damping = car.suspension.damping
    zero = 0.0 * b
    response = (
        (zero, zero, -b),
        (1.0 + zero, zero, b),
        (zero, zero, damping / car.sprung_mass * b),
        (zero, b, -damping / car.unsprung_mass * b),
    )
    factorial = (1.0, 1.0, 2.0)

    def entry(i: int, j: int) -> Any:
        return intensity * sum(
            response[i][m]
            * response[j][n]
            * dt ** (m + n + 1)
            / ((m + n + 1) * factorial[m] * factorial[n])
            for m in range(3)
            for n in range(3)
        )

    return tuple(tuple(entry(i, j) for j in range(i + 1)) for i in range(4))
