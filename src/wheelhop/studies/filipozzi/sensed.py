"""What noisy sensors report of the study's drives."""

from __future__ import annotations

import math
from typing import Any, NamedTuple
from zlib import crc32

import numpy as np

from wheelhop.errors import InputError
from wheelhop.studies.filipozzi.drives import Drive
from wheelhop.studies.filipozzi.settings import (
    ACCELERATION_PSD,
    CORRELATION_TIME,
    DEFLECTION_PSD,
    FilipozziSettings,
)
from wheelhop.vehicle.vehicle_record import SensorSuite

PAPER_NOISE, DATASHEET_NOISE = "paper", "datasheet"


class Sensed(NamedTuple):
    """What noisy sensors report of a drive, [runs, time, 4], as in `Drive`."""

    body_acceleration: Any
    wheel_acceleration: Any
    compression: Any


def noisy(drive: Drive, settings: FilipozziSettings, name: str, kind: str = PAPER_NOISE) -> Sensed:
    """What noisy sensors report, `settings.runs` times.

    `PAPER_NOISE` is the noise of Filipozzi et al. 2021, Fig. 10 as Simulink's band-limited white
    noise makes it: Gaussian numbers of variance PSD / correlation time, each held for the
    correlation time of 10 ms; 0.1 m/s^2 for PSD 1e-4 (the wheel carriers' sensors too, which the
    paper has not), 0.316 mm for 1e-9. `DATASHEET_NOISE` is white at the rate of the record, with
    the deviations of `SensorSuite`: 0.5 m/s^2 and 0.5 mm.

    Args:
        drive: noise-free.
        settings: runs, seed and rate.
        name: of the drive; two drives have different noise.
        kind: one of the two.

    Raises:
        InputError: for another kind.
    """
    rng = np.random.default_rng([settings.seed, crc32(name.encode()), crc32(kind.encode())])
    samples, runs = len(drive.t), settings.runs
    if kind == PAPER_NOISE:
        hold = max(1, round(CORRELATION_TIME * settings.rate))
        acceleration = math.sqrt(ACCELERATION_PSD / CORRELATION_TIME)
        deflection = math.sqrt(DEFLECTION_PSD / CORRELATION_TIME)
        deviations = [acceleration, acceleration, deflection]
    elif kind == DATASHEET_NOISE:
        suite, hold = SensorSuite(), 1
        sensors = (suite.body_acceleration, suite.wheel_acceleration, suite.compression)
        deviations = [float(sensor.noise) for sensor in sensors]
    else:
        known = (PAPER_NOISE, DATASHEET_NOISE)
        raise InputError("kind", f"{kind!r} is unknown", f"Use one of {known}.")
    clean = (drive.body_acceleration, drive.wheel_acceleration, drive.compression)

    def added(signal: np.ndarray, deviation: float) -> np.ndarray:
        drawn = rng.standard_normal((runs, -(-samples // hold), 4))
        return signal + deviation * np.repeat(drawn, hold, axis=1)[:, :samples]

    return Sensed(*(added(s, d) for s, d in zip(clean, deviations, strict=True)))
