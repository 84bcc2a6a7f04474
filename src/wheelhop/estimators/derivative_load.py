"""Load from the deflection alone by derivative filters: Filipozzi et al. 2021, Eq. 16.

F = m_u F_d(F_d(q)) + b F_d(q) + k q with F_d = s / (1 + s / w_d), after Moschuk et al. 2012, who
take the body to have no vertical acceleration.
"""

from __future__ import annotations

import math
from functools import lru_cache

import jax.numpy as jnp

from wheelhop.errors import require_in_range
from wheelhop.estimators.inverse_load import (
    Inverse,
    InverseParams,
    LoadSensors,
    inverse_observer,
)
from wheelhop.estimators.wheel_load import LoadObserver, WheelLoad
from wheelhop.estimators.youla_load import FASTEST, checked_sensors, constant_loads, corner_noise
from wheelhop.filtering import rational
from wheelhop.filtering.rational import Method
from wheelhop.vehicle.corner_suspension import CornerSuspension, validate

DOUBLE_POLE = math.sqrt(math.sqrt(2.0) - 1.0)
"""Frequency at which two equal poles pass -3 dB, per that of the poles."""


def derivative_params(
    corner: CornerSuspension,
    dt: float,
    bandwidth: float = 30.0,
    sensors: LoadSensors | None = None,
    method: Method = "bilinear",
) -> InverseParams:
    """Parameters of the observer.

    Args:
        corner: the corner, entries [] or [runs].
        dt: sampling interval [s].
        bandwidth: w_d / (2 pi) of a derivative filter [Hz]; the paper gives none.
        sensors: their noise; they must follow at once.
        method: of discretisation, see `rational.chain`.

    Raises:
        InputError: naming the figure that is out of range.
    """
    require_in_range("dt", dt, 1e-6, 10.0, "s")
    require_in_range("bandwidth", bandwidth, 0.01, FASTEST / dt, "Hz")
    validate(corner)
    sensors = checked_sensors(LoadSensors() if sensors is None else sensors, undoes=False)
    shaping = rational.chain(jnp.asarray([1.0, 2.0, 1.0]), 2.0 * math.pi * bandwidth, dt, method)
    return InverseParams(corner, shaping, sensors)


@lru_cache(maxsize=1)
def derivative_filters() -> LoadObserver:
    """The observer of one corner over `LoadSample`, whose acceleration it does not use."""
    return inverse_observer(derivative_inverse, WheelLoad, corner_noise)


def derivative_inverse(params: InverseParams) -> Inverse:
    """Eq. 16 over (1 + s / w_d)^2, and the load transfer that it makes of a body at rest."""
    c, w = params.corner, params.shaping.scale
    spring = [c.stiffness, 2.0 * c.stiffness / w, c.stiffness / (w * w)]
    strut = [spring[0], spring[1] + c.damping, spring[2] + c.damping / w]
    normal = [*strut[:2], strut[2] + c.unsprung_mass]
    return Inverse((([], normal), ([], strut)), constant_loads(c))
