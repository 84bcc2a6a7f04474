"""What wrong springs and dampers do to the front left load, in figures."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from wheelhop.studies.filipozzi.drives import (
    BRAKE,
    BRAKE_DAMPING,
    BRAKE_DIGRESSIVE,
    BRAKE_STIFFNESS,
    Drive,
)
from wheelhop.studies.filipozzi.maneuvers import JOINT
from wheelhop.studies.filipozzi.methods import UNBIASED, YOULA
from wheelhop.studies.filipozzi.robustness import (
    REST,
    TRANSIENT,
    JointBelief,
    Robustness,
    Transfer,
    transfer,
)
from wheelhop.studies.filipozzi.settings import BRAKE_BEGIN
from wheelhop.vehicle.full_vehicle_state import STANDARD_GRAVITY

LINEAR_JOINT = f"{JOINT}, linear damper"
"""The joint filter that believes in linear dampers."""


class Axis(NamedTuple):
    """Steady error of all four loads with the right springs.

    Attributes:
        measured: sum of the four errors [N].
        expected: part of the brake forces along the pitched body's own axis, less what that axis
            misses of the weight [N].
        pitch: of the body [rad].
    """

    measured: float
    expected: float
    pitch: float


def stiffness_transfer(result: Robustness, counted: str, factor: float, method: str) -> Transfer:
    """Of one estimator with wrong springs, front left."""
    drive = result.drives[BRAKE_STIFFNESS[factor]]
    return transfer(drive, result.stiffness[counted][factor][method])


def joint_transfer(result: Robustness, factor: float) -> Transfer:
    """Of the joint filter that believes in the right springs, front left."""
    return transfer(result.drives[BRAKE_STIFFNESS[factor]], result.joint[factor].load)


def fitted_transfer(result: Robustness, factor: float) -> Transfer:
    """Of the joint filter that finds the springs, front left."""
    return transfer(result.drives[BRAKE_STIFFNESS[factor]], result.fitted[factor].load)


def joint_rms(drive: Drive, one: JointBelief) -> tuple[float, float, float]:
    """Rms error of its four loads, deviation stated [N], and mean surprise, while braking."""
    late = drive.t >= BRAKE_BEGIN
    error, stated = (one.load - drive.load)[late], one.sigma[late]
    return (
        float(np.sqrt(np.mean(error**2))),
        float(np.sqrt(np.mean(stated**2))),
        float(np.mean(one.surprise[late])),
    )


def damping_transfer(result: Robustness, factor: float, method: str) -> Transfer:
    """Of one estimator with wrong dampers, front left."""
    return transfer(result.drives[BRAKE_DAMPING[factor]], result.damping[factor][method])


def swing(drive: Drive, load: np.ndarray) -> float:
    """Rms error of the front left load while the brakes come on, about its steady value [N].

    Args:
        drive: what truly happened.
        load: estimate, [time, 4] N.
    """
    off = load[:, 0] - drive.load[:, 0]
    end = (drive.t >= drive.t[-1] - 0.5) & np.isfinite(off)
    after = (drive.t >= BRAKE_BEGIN) & (drive.t < BRAKE_BEGIN + TRANSIENT)
    return float(np.sqrt(np.mean((off[after] - off[end].mean()) ** 2)))


def damping_swing(result: Robustness, factor: float, method: str) -> float:
    """`swing` of one estimator with wrong dampers [N]."""
    return swing(result.drives[BRAKE_DAMPING[factor]], result.damping[factor][method])


def digressive_swing(result: Robustness, method: str) -> float:
    """`swing` of one estimator with the nonlinear damper [N]."""
    return swing(result.drives[BRAKE_DIGRESSIVE], result.digressive[method])


def static_offset(result: Robustness, factor: float) -> float:
    """Offset expected where the mass is taken from wrong free springs, m_s g (1 / f - 1) [N]."""
    return float(result.linear.preload[0]) * (1.0 / factor - 1.0)


def apart(result: Robustness) -> tuple[float, float]:
    """Rms and largest difference of the two methods' loads in any of the drives [N]."""
    rms = largest = 0.0
    late = result.drives[BRAKE].t > 0.5 * BRAKE_BEGIN
    for loads in _pairs(result):
        between = (loads[YOULA] - loads[UNBIASED])[late]
        rms = max(rms, float(np.sqrt(np.nanmean(between**2))))
        largest = max(largest, float(np.nanmax(np.abs(between))))
    return rms, largest


def axis_error(result: Robustness) -> Axis:
    """How far the four loads are off in the steady state with the right springs, and why.

    Accelerometers and struts lie along the body's axis; a body that pitches by theta tilts it, and
    m a_x sin(theta) of the tyres' brake forces acts along it, and m g (1 - cos(theta)) of the
    weight does not.
    """
    drive = result.drives[BRAKE]
    load = result.stiffness[REST][1.0][YOULA]
    end = (drive.t >= drive.t[-1] - 0.5) & np.isfinite(load).all(1)
    mass = drive.load[end].sum(1).mean() / STANDARD_GRAVITY
    pitch = float(drive.pitch[end].mean())
    weight = STANDARD_GRAVITY * (1.0 - np.cos(pitch))
    expected = mass * (drive.a_x[end].mean() * np.sin(pitch) + weight)
    return Axis(float((load - drive.load)[end].sum(1).mean()), float(expected), pitch)


def _pairs(result: Robustness) -> Iterator[dict[str, np.ndarray]]:
    yield from (loads for by in result.stiffness.values() for loads in by.values())
    yield from result.damping.values()
    yield result.digressive
