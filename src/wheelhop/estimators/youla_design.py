"""Design of the Youla observer by frequency: Filipozzi et al. 2021, Eq. 6-13 and Fig. 4."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from wheelhop.errors import require_in_range
from wheelhop.estimators.inverse_load import InverseParams
from wheelhop.estimators.youla_load import corner_inverse, default_lag
from wheelhop.filtering import rational
from wheelhop.vehicle.corner_suspension import CornerSuspension, validate


class LoopTransfers(NamedTuple):
    """Transfer matrices at some frequencies, complex [frequencies, 2, 2].

    Inputs u = (F, dF) [N], measurements y = (a_s [m/s^2], q [m]).

    Attributes:
        plant: G_p from u to y, Eq. 6.
        closed: T_u from u to its estimate, Eq. 9.
        sensitivity: S_u = I - T_u, Eq. 10.
        youla: Y from y to the estimate of u, Eq. 11 and 14; also from the sensors' noise.
        controller: G_c = S_u^-1 Y, Eq. 12 and 13.
        loop: return ratio L_u = G_c G_p.
    """

    plant: np.ndarray
    closed: np.ndarray
    sensitivity: np.ndarray
    youla: np.ndarray
    controller: np.ndarray
    loop: np.ndarray


def loop_transfers(
    corner: CornerSuspension,
    frequency: Any,
    bandwidth: float = 30.0,
    damping: float = math.sqrt(0.5),
    lag: float | None = None,
) -> LoopTransfers:
    """The transfer matrices of a design.

    Args:
        corner: the corner, entries [], concrete.
        frequency: [Hz], [frequencies], above 0: at 0 the controller is infinite.
        bandwidth, damping, lag: as in `youla_params`, for a sampling interval of 0.

    Raises:
        InputError: for a frequency or bandwidth that is not positive, or a corner out of range.
    """
    f = np.asarray(frequency, float)
    for hertz in np.ravel(f).tolist():
        require_in_range("frequency", hertz, 1e-9, 1e9, "Hz")
    require_in_range("bandwidth", bandwidth, 1e-3, 1e6, "Hz")
    validate(corner)
    s = 2j * math.pi * f
    plant = plant_transfer(corner, s)
    shape = shaping_transfer(s, bandwidth, damping, lag)
    youla = shape[:, None, None] * inverse_transfer(corner, s)
    eye = np.eye(2)
    closed = shape[:, None, None] * eye
    # beyond the bandwidth T_u is small and below it S_u is: neither as a difference of ones
    behind = (1.0 - shape)[:, None, None]
    controller = youla / behind
    return LoopTransfers(plant, closed, behind * eye, youla, controller, closed / behind)


def plant_transfer(corner: CornerSuspension, s: np.ndarray) -> np.ndarray:
    """G_p(s) of Eq. 6 from (F, dF) to (a_s, q), complex [frequencies, 2, 2].

    Args:
        corner: entries [], concrete.
        s: complex frequency [rad/s], [frequencies].
    """
    ms, mu, k, b = (
        float(x)
        for x in (corner.sprung_mass, corner.unsprung_mass, corner.stiffness, corner.damping)
    )
    strut = b * s + k
    one = np.ones_like(s)
    rows = np.array([[strut, -(mu * s * s + strut)], [ms * one, mu * one]])
    return np.moveaxis(rows / (ms * mu * s * s + (ms + mu) * strut), -1, 0)


def inverse_transfer(corner: CornerSuspension, s: np.ndarray) -> np.ndarray:
    """G_p(s)^-1, polynomials in s, complex [frequencies, 2, 2]; arguments as `plant_transfer`."""
    ms, mu, k, b = (
        float(x)
        for x in (corner.sprung_mass, corner.unsprung_mass, corner.stiffness, corner.damping)
    )
    one = np.ones_like(s)
    rows = np.array([[mu * one, mu * s * s + b * s + k], [-ms * one, b * s + k]])
    return np.moveaxis(rows, -1, 0)


def shaping_transfer(
    s: np.ndarray, bandwidth: float, damping: float = math.sqrt(0.5), lag: float | None = None
) -> np.ndarray:
    """M_T(s) of Eq. 8, complex [frequencies].

    Args:
        s: complex frequency [rad/s], [frequencies].
        bandwidth, damping, lag: as in `youla_params`.
    """
    w = 2.0 * math.pi * bandwidth
    tau = default_lag(bandwidth) if lag is None else lag
    return np.asarray(w * w / ((s * s + 2.0 * damping * w * s + w * w) * (tau * s + 1.0) ** 2))


def singular_values(matrices: np.ndarray) -> np.ndarray:
    """Singular values, largest first, [frequencies, 2].

    Those of T_u, S_u and L_u have no unit; those of Y, G_c and G_p mix forces, accelerations and
    metres and depend on the units, SI here.
    """
    return np.linalg.svd(matrices, compute_uv=False)


def discrete_youla(params: InverseParams, frequency: Any) -> np.ndarray:
    """Y as it runs, discretised: complex [frequencies, 2, 2].

    Args:
        params: of `youla`, of one corner, concrete.
        frequency: [Hz], [frequencies], below half the sampling rate.
    """
    rows = [
        [rational.response(params.shaping, n, frequency) for n in row]
        for row in corner_inverse(params).numerators
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def passed_bandwidth(params: InverseParams) -> float:
    """Frequency at which an observer, as it runs, passes a load with -3 dB [Hz].

    Args:
        params: of `youla` or `axle_load.axle_youla`, concrete.
    """
    hertz = np.linspace(0.0, 0.5 / params.shaping.dt, 4097)[1:-1]
    gain = np.abs(rational.response(params.shaping, [1.0], hertz))
    below = np.flatnonzero(gain < math.sqrt(0.5))
    return float(hertz[below[0]]) if below.size else float("nan")


def discretisation_error(params: InverseParams, frequency: Any, **design: Any) -> np.ndarray:
    """Largest relative error of an entry of the discrete Y, [frequencies].

    Args:
        params: of `youla`, of one corner, concrete, with ideal sensors.
        frequency: [Hz], [frequencies].
        **design: bandwidth, damping and lag that `params` were made with; give the lag where the
            default of `youla_params` is half a sampling interval.
    """
    exact = loop_transfers(params.corner, frequency, **design).youla
    found = discrete_youla(params, frequency)
    return np.asarray(np.abs(found / exact - 1.0).max((1, 2)))
