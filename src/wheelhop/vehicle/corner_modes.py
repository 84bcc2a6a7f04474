"""What a quarter car's parameters mean: its ride and wheel-hop modes."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from wheelhop.errors import require_in_range
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.tire import stiffness_from_pressure

_SAME = 1e-9


class CornerModes(NamedTuple):
    """The two modes of a linearised quarter car, the slower one first.

    Attributes:
        ride_frequency: undamped natural frequency of the ride mode [Hz].
        ride_damping: its damping ratio [-]; above 1 where the mode does not oscillate.
        hop_frequency: of the wheel-hop mode [Hz].
        hop_damping: its damping ratio [-].
    """

    ride_frequency: float
    ride_damping: float
    hop_frequency: float
    hop_damping: float


class CriticalDampingRatio(NamedTuple):
    """Damping over critical damping [-] of each mass by itself, the other one held still."""

    body: float
    wheel: float


def corner_modes(car: QuarterCar, pressure: Any, velocity_rms: Any = 0.0) -> CornerModes:
    """Natural frequencies and damping ratios by the eigenvalues of the linearised quarter car.

    A pair of eigenvalues l1, l2 has the frequency sqrt(l1 l2) / (2 pi) and the damping ratio
    -(l1 + l2) / (2 sqrt(l1 l2)), whether it is complex or real. Linearised about rest, where the
    cubic spring has no stiffness; for the quadratic damper see `equivalent_damping`.

    Args:
        car: parameters.
        pressure: of the tyre [Pa].
        velocity_rms: root mean square of the suspension's velocity [m/s].

    Raises:
        InputError: for a velocity that is negative or not a number.
    """
    eigenvalues = np.linalg.eigvals(_state_matrix(car, pressure, velocity_rms))
    slow, fast = sorted(_mode(*pair) for pair in _pairs(eigenvalues))
    return CornerModes(*slow, *fast)


def equivalent_damping(car: QuarterCar, velocity_rms: Any = 0.0) -> float:
    """Linear damping [Ns/m] nearest to the damper at a Gaussian velocity of this rms [m/s].

    c_s + c_snl sqrt(8 / pi) sigma_w, which leaves the least mean square force error: stochastic
    linearisation, E[w w|w|] / E[w^2] = sqrt(8 / pi) sigma_w.

    Raises:
        InputError: for a velocity that is negative or not a number.
    """
    require_in_range("velocity_rms", velocity_rms, 0.0, 100.0, "m/s")
    s = car.suspension
    return float(s.damping) + float(s.quadratic_damping) * math.sqrt(8 / math.pi) * float(
        velocity_rms
    )


def critical_damping_ratio(
    car: QuarterCar, pressure: Any, velocity_rms: Any = 0.0
) -> CriticalDampingRatio:
    """Damping ratios of body and wheel as if the other one stood still.

    Body: c_s / (2 sqrt(k_s m_s)). Wheel: (c_s + c_t) / (2 sqrt((k_s + k_t) m_u)).

    Args:
        car: parameters.
        pressure: of the tyre [Pa].
        velocity_rms: root mean square of the suspension's velocity [m/s].

    Raises:
        InputError: for a velocity that is negative or not a number.
    """
    c, k = equivalent_damping(car, velocity_rms), float(car.suspension.stiffness)
    stiff = k + float(stiffness_from_pressure(pressure, car.tire))
    return CriticalDampingRatio(
        body=c / (2 * math.sqrt(k * float(car.sprung_mass))),
        wheel=(c + float(car.tire.damping)) / (2 * math.sqrt(stiff * float(car.unsprung_mass))),
    )


def _state_matrix(car: QuarterCar, pressure: Any, velocity_rms: Any) -> np.ndarray:
    """x' = A x of the states d, e, v_s, v_u."""
    m_s, m_u = float(car.sprung_mass), float(car.unsprung_mass)
    k, c = float(car.suspension.stiffness), equivalent_damping(car, velocity_rms)
    k_t = float(stiffness_from_pressure(pressure, car.tire))
    c_t = float(car.tire.damping)
    return np.array(
        [
            [0.0, 0.0, 1.0, -1.0],
            [0.0, 0.0, 0.0, 1.0],
            [-k / m_s, 0.0, -c / m_s, c / m_s],
            [k / m_u, -k_t / m_u, c / m_u, -(c + c_t) / m_u],
        ]
    )


def _pairs(eigenvalues: np.ndarray) -> list[tuple[complex, complex]]:
    """Conjugates together; of real eigenvalues the two slowest, and the two fastest."""
    up = [v for v in eigenvalues.tolist() if complex(v).imag > _SAME * abs(v)]
    real = sorted(
        (complex(v).real for v in eigenvalues.tolist() if abs(complex(v).imag) <= _SAME * abs(v)),
        key=abs,
    )
    pairs = [(v, v.conjugate()) for v in up]
    return pairs + [(complex(a), complex(b)) for a, b in zip(real[::2], real[1::2], strict=True)]


def _mode(first: complex, second: complex) -> tuple[float, float]:
    """Frequency [Hz] and damping ratio of a pair of eigenvalues."""
    omega = math.sqrt((first * second).real)
    return omega / (2 * math.pi), -(first + second).real / (2 * omega)
