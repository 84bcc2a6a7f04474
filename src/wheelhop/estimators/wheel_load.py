"""What the estimators of wheel load share: measurements, inputs, and the form of an observer.

Signals are those of the sensors: an accelerometer shows what it feels less standard gravity, so
that F = S(q, q') + m_u (g + a_s + q'') and dF = S(q, q') - m_s (g + a_s) hold on a slope as well
as on level ground (Filipozzi et al. 2021, Eq. 2-4; S is the strut's force).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from wheelhop.filtering.gaussian import Gaussian
from wheelhop.filtering.interface import Filter


class LoadSample(NamedTuple):
    """What the sensors of a corner say; NaN where a sample is lost.

    Attributes:
        body_acceleration: a_s, vertical accelerometer on the body above the wheel less standard
            gravity [m/s^2].
        deflection: q, compression of the strut [m].
    """

    body_acceleration: Any
    deflection: Any


class WheelLoad(NamedTuple):
    """The unknown inputs of a corner.

    Attributes:
        normal: F, the tyre's normal force [N].
        transfer: dF, load transfer that presses the sprung mass down [N].
    """

    normal: Any
    transfer: Any


class LoadObserver(NamedTuple):
    """An estimator of the load of one corner.

    Attributes:
        filter: with the common interface, over `LoadSample`.
        load: (state) -> `Gaussian` over `WheelLoad`; its covariance is that which the noise of
            the sensors makes, errors of the parameters are not in it.
        delay: samples by which that load is older than the latest measurement.
    """

    filter: Filter
    load: Callable[[Any], Gaussian]
    delay: int = 0
