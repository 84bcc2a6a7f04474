"""What the maneuvers' errors consist of, computed from the drives alone."""

from __future__ import annotations

import math
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from wheelhop.estimators.algebraic_load import WeightDistribution, distribution_of
from wheelhop.estimators.youla_design import shaping_transfer
from wheelhop.studies.filipozzi.drives import (
    BRAKE,
    LANE_CHANGE,
    SLOPE,
    SWEEP,
    Drive,
)
from wheelhop.studies.filipozzi.maneuvers import (
    LONGEST_DELAY,
    SETTLED,
    WORDS,
    Maneuvers,
    Score,
)
from wheelhop.studies.filipozzi.methods import DERIVATIVE, UNBIASED, YOULA
from wheelhop.studies.filipozzi.vehicles import paper_vehicle
from wheelhop.vehicle.corner_suspension import CornerSuspension, corner_suspensions
from wheelhop.vehicle.full_vehicle_state import STANDARD_GRAVITY

PAPER_DRIVES = (BRAKE, LANE_CHANGE, SWEEP, SLOPE)

OBSERVERS = (YOULA, UNBIASED)

GOOD = 0.1
"""Rms error, per rms of the load's own change, that counts as good."""

SIMILAR = 0.1
"""Rms difference of two estimates, likewise, up to which they count as similar."""


class Wave(NamedTuple):
    """The waves of a sine sweep under one corner, [waves].

    Attributes:
        time: of their middle [s].
        frequency: [Hz].
        road: amplitude of the elevation [m].
        load: amplitude of the load [N].
    """

    time: np.ndarray
    frequency: np.ndarray
    road: np.ndarray
    load: np.ndarray


def waves(drive: Drive, load: np.ndarray, corner: int) -> Wave:
    """Amplitudes from one upward crossing of the road's zero to the next.

    The last two waves, in which the sweep fades out, are left out.

    Args:
        drive: of the sine sweep.
        load: true or estimated, [time, 4] N.
        corner: 0 to 3.
    """
    z = drive.elevation[:, corner]
    crossings = np.flatnonzero((z[:-1] < 0) & (z[1:] >= 0))[:-2]
    spans = list(pairwise(crossings))

    def amplitude(signal: np.ndarray) -> np.ndarray:
        return np.array([0.5 * np.ptp(signal[a:b]) for a, b in spans])

    period = np.array([drive.t[b] - drive.t[a] for a, b in spans])
    middle = np.array([0.5 * (drive.t[a] + drive.t[b]) for a, b in spans])
    return Wave(middle, 1.0 / period, amplitude(z), amplitude(load[:, corner]))


def body_frequency(corner: int) -> float:
    """Of the body on its springs at a corner [Hz]."""
    c = _corners()
    return math.sqrt(float(c.stiffness[corner]) / float(c.sprung_mass[corner])) / (2.0 * math.pi)


def tilt_error(drive: Drive) -> np.ndarray:
    """What a body tilted against the road adds to the sum of the observers' loads [N], [time].

    Observers sum up what the body's accelerometers show along *its* vertical axis; of the force
    normal to the road that axis holds m f cos, and of the tyres' horizontal force the sine:
    m (a_x sin(pitch) - a_y sin(roll)) + m g (1 - cos(pitch) cos(roll)), angles against the road.

    Args:
        drive: true motion and road.
    """
    d = distribution()
    z = drive.elevation
    # wheelbase and track lie along the road, not along the horizontal
    downhill = np.arcsin((z[:, 2:].mean(1) - z[:, :2].mean(1)) / float(d.wheelbase))
    leftward = np.arcsin((z[:, 0::2].mean(1) - z[:, 1::2].mean(1)) / float(d.track))
    pitch, roll = drive.pitch - downhill, drive.roll - leftward
    along = drive.a_x * np.sin(pitch) - drive.a_y * np.sin(roll)
    return float(d.mass) * (along + STANDARD_GRAVITY * (1.0 - np.cos(pitch) * np.cos(roll)))


def shaped(drive: Drive, bandwidth: float) -> np.ndarray:
    """The true loads behind the Youla observer's shaping filter, Eq. 8, [time, 4] N.

    By Fourier series of the whole record, so that its first and last tenths of a second are off.

    Args:
        drive: noise-free.
        bandwidth: [Hz].
    """
    mean = drive.load.mean(0)
    frequency = np.fft.rfftfreq(len(drive.t), drive.t[1] - drive.t[0])
    transfer = shaping_transfer(2j * np.pi * frequency, bandwidth)[:, None]
    content = np.fft.rfft(drive.load - mean, axis=0)
    return mean + np.fft.irfft(content * transfer, len(drive.t), axis=0)


def steady(result: Maneuvers, name: str, method: str) -> np.ndarray:
    """Mean error over a drive's last half second by corner [N], [4]."""
    drive = result.drives[name]
    off = result.loads[name][method] - drive.load
    return np.asarray(np.nanmean(off[drive.t >= drive.t[-1] - 0.5], axis=0))


def static_part(drive: Drive, load: np.ndarray) -> tuple[float, float]:
    """Rms of a load's error that a fixed map of a_x and a_y explains, and of the rest [N].

    Args:
        drive: noise-free.
        load: estimated, [time, 4] N, without gaps.
    """
    late = drive.t >= SETTLED
    off = (load - drive.load)[late]
    inputs = np.stack([drive.a_x, drive.a_y, np.ones_like(drive.t)], 1)[late]
    fitted = inputs @ np.linalg.lstsq(inputs, off, rcond=None)[0]
    return rms(fitted), rms(off - fitted)


def missed_body(result: Maneuvers, name: str) -> tuple[float, float, float]:
    """Eq. 16 against Eq. 15: rms difference, the same aligned in time, and what is then left.

    What is left is the aligned difference less -m_u a_s, the body's acceleration that Eq. 16 takes
    for nothing [N].
    """
    drive, loads = result.drives[name], result.loads[name]
    dt = float(drive.t[1] - drive.t[0])
    late = drive.t >= SETTLED
    missed = -np.asarray(_corners().unsprung_mass) * drive.body_acceleration
    here, there = loads[DERIVATIVE], loads[YOULA]
    aligned, left = [], []
    for k in range(round(LONGEST_DELAY / dt) + 1):
        end = len(drive.t) - k
        off = (here[:end] - there[k:])[late[:end]]
        aligned.append(rms(off))
        left.append(rms(off - missed[:end][late[:end]]))
    return aligned[0], min(aligned), min(left)


def delay_in_words(score: Score) -> str:
    """A delay in whole milliseconds; `LONGEST_DELAY` as "50 or more"."""
    longest = score.delay >= LONGEST_DELAY - 1e-9
    return f"{1e3 * score.delay:.0f}" + (" or more" if longest else "")


def inner(drive: Drive) -> np.ndarray:
    """Samples that are settled, and away from the end that an estimator's delay leaves open."""
    return np.asarray((drive.t >= SETTLED) & (drive.t < drive.t[-1] - 0.5))


@lru_cache(maxsize=1)
def _corners() -> CornerSuspension:
    return corner_suspensions(paper_vehicle())


@lru_cache(maxsize=1)
def distribution() -> WeightDistribution:
    """Of the paper's vehicle."""
    return distribution_of(paper_vehicle())


def short(name: str) -> str:
    """A drive's name without the number of its figure."""
    return WORDS[name].split(": ")[-1]


def rms(values: np.ndarray) -> float:
    """Root mean square of the numbers that are there."""
    return float(np.sqrt(np.nanmean(np.square(values))))
