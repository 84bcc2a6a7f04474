"""Youla controller output observer of a corner's load: Filipozzi et al. 2021, Eq. 6-15.

In closed loop Y = M_T [[m_u, m_u s^2 + b s + k], [-m_s, b s + k]] with
M_T = w0^2 / ((s^2 + 2 zeta w0 s + w0^2) (tau s + 1)^2), Eq. 8 and 14; that product is
what runs here.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import jax.numpy as jnp

from wheelhop.errors import InputError, require_in_range
from wheelhop.estimators.inverse_load import (
    Inverse,
    InverseParams,
    LoadSensors,
    inverse_observer,
    times_polynomial,
    undone,
)
from wheelhop.estimators.wheel_load import LoadObserver, LoadSample, WheelLoad
from wheelhop.filtering import rational
from wheelhop.filtering.gaussian import Gaussian
from wheelhop.filtering.rational import Method
from wheelhop.vehicle.corner_suspension import CornerSuspension, validate
from wheelhop.vehicle.full_vehicle_state import STANDARD_GRAVITY

FASTEST = 0.25
"""Largest bandwidth of an observer, per sampling rate."""

_USUAL_ACCELERATION, _USUAL_DEFLECTION = 1.0, 0.03


def youla_params(
    corner: CornerSuspension,
    dt: float,
    bandwidth: float = 30.0,
    damping: float = math.sqrt(0.5),
    lag: float | None = None,
    sensors: LoadSensors | None = None,
    method: Method = "bilinear",
) -> InverseParams:
    """Parameters of the observer for a corner and a sampling interval.

    Args:
        corner: the corner, entries [] or [runs]; with [2] for `axle_load`.
        dt: sampling interval [s].
        bandwidth: w0 / (2 pi) [Hz]; `youla_design.passed_bandwidth` tells where -3 dB comes out.
        damping: zeta [-].
        lag: tau [s]; the paper leaves it open, see `default_lag`.
        sensors: their noise and dynamics.
        method: of discretisation, see `rational.chain` for its accuracy.

    Raises:
        InputError: naming the figure that is out of range.
    """
    require_in_range("dt", dt, 1e-6, 10.0, "s")
    require_in_range("bandwidth", bandwidth, 0.01, FASTEST / dt, "Hz")
    validate(corner)
    require_in_range("damping", damping, 0.05, 10.0, "(ratio)")
    scale = 2.0 * math.pi * bandwidth
    lag = default_lag(bandwidth, dt) if lag is None else lag
    require_in_range("lag", lag, 1e-3 / scale, 10.0 / scale, "s")
    sensors = checked_sensors(LoadSensors() if sensors is None else sensors)
    shaping = rational.chain(shaping_denominator(damping, lag * scale), scale, dt, method)
    return InverseParams(corner, shaping, sensors)


def default_lag(bandwidth: float, dt: float = 0.0) -> float:
    """tau of Eq. 8: a tenth of 1 / w0, but no less than half a sampling interval [s].

    Faster poles would ring in the bilinear discretisation.

    Args:
        bandwidth: w0 / (2 pi) [Hz].
        dt: sampling interval [s].
    """
    return max(0.1 / (2.0 * math.pi * bandwidth), 0.5 * dt)


def shaping_denominator(damping: Any, relative_lag: Any) -> Any:
    """(p^2 + 2 zeta p + 1) (tau w0 p + 1)^2 of Eq. 8 in p = s / w0, ascending, [5].

    Args:
        damping: zeta [-].
        relative_lag: tau w0 [-].
    """
    d = jnp.asarray(damping, jnp.result_type(float))
    e = jnp.asarray(relative_lag, d.dtype)
    one = jnp.ones_like(d)
    return jnp.stack(
        [one, 2.0 * d + 2.0 * e, one + 4.0 * d * e + e * e, 2.0 * e + 2.0 * d * e * e, e * e]
    )


def checked_sensors(sensors: LoadSensors, undoes: bool = True) -> LoadSensors:
    """The same sensors, checked.

    Args:
        sensors: to check.
        undoes: whether the observer undoes their dynamics; otherwise they may have none.

    Raises:
        InputError: naming the figure that is out of range.
    """
    require_in_range("sensors.acceleration_noise", sensors.acceleration_noise, 0.0, 1e3, "m/s^2")
    require_in_range("sensors.deflection_noise", sensors.deflection_noise, 0.0, 1.0, "m")
    for name in ("acceleration_bandwidth", "deflection_bandwidth"):
        value = float(getattr(sensors, name))
        require_in_range(f"sensors.{name}", value, 1e-3, math.inf, "Hz")
        if not undoes and value < math.inf:
            raise InputError(
                f"sensors.{name}",
                f"{value:g} Hz, which this observer does not undo",
                "Leave it infinite, or use the Youla observer.",
            )
    for name in ("acceleration_drift", "deflection_drift"):
        require_in_range(f"sensors.{name}", getattr(sensors, name), 0.0, 1e4, "per root second")
    return sensors


@lru_cache(maxsize=1)
def youla() -> LoadObserver:
    """The observer of one corner over `LoadSample` and `WheelLoad`.

    Its `init` takes a `Gaussian` over `LoadSample`: the signals before the record, as of
    `unknown_before`, with the axes [] or [runs] of the corner.
    """
    return inverse_observer(corner_inverse, WheelLoad, corner_noise)


def unknown_before(deflection: Any = 0.0) -> Gaussian:
    """Prior of a record that begins at any time: signals of usual size about a deflection [m]."""
    q = jnp.asarray(deflection, jnp.result_type(float))
    zero = jnp.zeros_like(q)
    cov = ((zero + _USUAL_ACCELERATION**2,), (zero, zero + _USUAL_DEFLECTION**2))
    return Gaussian(LoadSample(zero, q), cov)


def corner_noise(sensors: LoadSensors) -> tuple[tuple[Any, Any], tuple[Any, Any]]:
    """Standard deviations of a `LoadSample`, and its drifts."""
    return (
        (sensors.acceleration_noise, sensors.deflection_noise),
        (sensors.acceleration_drift, sensors.deflection_drift),
    )


def corner_inverse(params: InverseParams) -> Inverse:
    """Inverse of Eq. 6 with the sensors' own dynamics undone, Eq. 14 without its low-pass."""
    c = params.corner
    a = undone(params.sensors.acceleration_bandwidth)
    q = undone(params.sensors.deflection_bandwidth)
    normal = [
        [c.unsprung_mass * x for x in a],
        times_polynomial([c.stiffness, c.damping, c.unsprung_mass], q),
    ]
    transfer = [
        [-c.sprung_mass * x for x in a],
        times_polynomial([c.stiffness, c.damping], q),
    ]
    return Inverse((normal, transfer), constant_loads(c))


def constant_loads(corner: CornerSuspension) -> tuple[Any, Any]:
    """(F, dF) of a corner with signals of zero [N]."""
    g = STANDARD_GRAVITY
    return corner.preload + corner.unsprung_mass * g, corner.preload - corner.sprung_mass * g
