"""How far each disturbance moves the pressure, and the bound that the band leaves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from wheelhop.evaluation.bounds import (
    bound,
    deviation,
    pooled,
    pressure_deviation,
    spectral_information,
)
from wheelhop.evaluation.spectra import IsoRoad, SampledSpectrum, corner_spectrum
from wheelhop.studies.stiffness.frame import RATE
from wheelhop.studies.stiffness.full_vehicle import (
    VehicleStudy,
    pressure_error,
    true_ln_stiffness,
)
from wheelhop.studies.stiffness.vehicle_cases import DISTURBANCES, NOMINAL
from wheelhop.studies.stiffness.vehicle_estimators import TUNING
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.road import class_level

MISTIMED = "speed told 1 % too high"

BAND = (2.0, 30.0)
"""Frequencies [Hz] that means over 16 ms leave."""

_DEAF = 50.0


class Budget(NamedTuple):
    """Pressure on a trial road, relative to the undisturbed drive over the same road [-].

    Attributes:
        names: of the disturbances.
        before: move of the four wheels if the estimator was calibrated before the disturbance
            came, which is that of an estimator without calibration, [disturbances, 4].
        with_it: if it was there already, on another road, [disturbances, 4].
        plain: error without calibration, [disturbances, 4].
        calibrated: error with the calibration of the study, before the disturbance came.
    """

    names: tuple[str, ...]
    before: np.ndarray
    with_it: np.ndarray
    plain: np.ndarray
    calibrated: np.ndarray


def error_budget(study: VehicleStudy, offset: np.ndarray) -> Budget:
    """Moves and errors of every disturbance.

    Args:
        study: its disturbed drives.
        offset: of ln k_t from the calibration, [4].
    """
    truth = true_ln_stiffness(study.disturbed_pressure)
    names = list(DISTURBANCES)
    error = study.disturbed - truth[:, None]
    # the speed is told wrong to the estimator and the vehicle stays as it is
    at = names.index(NOMINAL)
    late = study.mistimed - truth
    names.append(MISTIMED)
    error = np.concatenate([error, late[:, None]], axis=1)
    there, here = error - error[:, at : at + 1]
    pressure, ln_k_t = study.disturbed_pressure[1], truth[1]
    return Budget(
        tuple(names),
        pressure_error(ln_k_t + here, pressure),
        pressure_error(ln_k_t + here - there, pressure),
        pressure_error(ln_k_t + error[1], pressure),
        pressure_error(ln_k_t + error[1] - offset, pressure),
    )


def band_bound(
    cars: Sequence[QuarterCar],
    time: float,
    tracks: int = 2,
    pressure: float = 200e3,
    speed: float = 60 / 3.6,
    noise: float = 0.5,
) -> float:
    """Best relative accuracy of a tyre's pressure from single wheels' accelerations in `BAND` [-].

    On a road of class B whose level and waviness are not known, with dampers known to the prior of
    the estimator (Whittle 1953). Wheels that roll in one track see one road, so that records of
    fewer tracks than wheels are counted in proportion. It holds for an estimator that takes every
    wheel by itself; one that knows that the rear wheel repeats the front's road can do better.

    Args:
        cars: the four corners.
        time: of the record [s].
        tracks: independent roads under the car.
        pressure: of the tyres [Pa].
        speed: v [m/s].
        noise: of the accelerometer's samples [m/s^2].
    """
    road, free = IsoRoad(class_level("B")), ("k_t", "level", "waviness", "c_s")
    parts = {}
    for name, car in zip(("FL", "FR", "RL", "RR"), cars, strict=True):
        whole = corner_spectrum(car, pressure, road, speed, (_DEAF, noise), RATE)
        inside = (whole.frequency >= BAND[0]) & (whole.frequency <= BAND[1])
        part = SampledSpectrum(
            whole.frequency[inside],
            whole.density[inside],
            {n: a[inside] for n, a in whole.slopes.items()},
        )
        parts[name] = spectral_information(part, free)
    prior = {"level": TUNING.prior_level_sigma, "waviness": TUNING.waviness_sigma}
    prior |= {f"c_s {name}": TUNING.damping_sigma for name in parts}
    at = np.array([time * tracks / len(parts)])
    relative = deviation(bound(pooled(parts), at, prior), "k_t FL")
    return float(pressure_deviation(relative, cars[0], pressure)[0] / pressure)
