"""The estimators that the full vehicle's logs are given to."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from wheelhop.estimators import four_corners, hop_band
from wheelhop.estimators.hop_model import WheelAcceleration
from wheelhop.estimators.stiffness import StiffnessTuning
from wheelhop.filtering import run_batch
from wheelhop.studies.stiffness.frame import StiffnessSettings
from wheelhop.studies.stiffness.vehicle_drives import VehicleLogs
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.quarter_car import Accelerations

TUNING = StiffnessTuning(
    stiffness_walk=0.001, level_walk=0.3, waviness_sigma=0.4, damping_sigma=0.15
)
"""Of the estimators: tyres that hold, a road that is not equally rough all along."""

_CERTAIN = 1e-3


class Followed(NamedTuple):
    """What an estimator says once a second: theta and the covariance of ln k_t.

    Attributes:
        theta: [runs, time, p], ln k_t of the four wheels first.
        cov: of ln k_t, [runs, time, 4, 4].
    """

    theta: np.ndarray
    cov: np.ndarray


Follow = Callable[[Sequence[QuarterCar], VehicleLogs, float], Followed]
"""(corners, logs, factor on the known speed) -> what the estimator says."""


def in_band(tuning: StiffnessTuning, settings: StiffnessSettings) -> Follow:
    """The estimator of `hop_band` in a tuning."""
    tuning = _with_noise(tuning, settings)

    def follow(cars: Sequence[QuarterCar], logs: VehicleLogs, speed: float = 1.0) -> Followed:
        dt = hop_band.BLOCK * logs.dt
        measured = WheelAcceleration(_float(hop_band.means(logs.measured.a_u)))
        count = measured.a_u.shape[1]
        v = hop_band.means(logs.speed[:, :, None])[:, :count, 0]
        params = hop_band.hop_params(cars, dt, tuning)
        prior = hop_band.hop_prior(params, tuning)
        filter = hop_band.hop_filter(dt)
        return _followed(filter, prior, params, measured, speed * v, hop_band.bind_speed, dt)

    return follow


def bare(tuning: StiffnessTuning, settings: StiffnessSettings) -> Follow:
    """`four_corner_filter`: every sample of both accelerometers, waviness 2, known dampers."""
    tuning = replace(_with_noise(tuning, settings), level_walk=0.0)

    def follow(cars: Sequence[QuarterCar], logs: VehicleLogs, speed: float = 1.0) -> Followed:
        params = four_corners.four_corner_params(cars, 15.0, logs.dt, tuning)
        prior = four_corners.four_corner_prior(params, tuning)
        filter = four_corners.four_corner_filter(logs.dt)
        measured = Accelerations(_float(logs.measured.a_s), _float(logs.measured.a_u))
        bind = four_corners.bind_speed
        return _followed(filter, prior, params, measured, speed * logs.speed, bind, logs.dt)

    return follow


BARE, BAND, FREE_WAVINESS, MAIN = (
    "every sample, both accelerometers",
    "band of the wheel hop",
    "and the waviness free",
    "and the damping free",
)

ROWS: dict[str, tuple[Callable[..., Follow], StiffnessTuning]] = {
    BARE: (bare, TUNING),
    BAND: (in_band, replace(TUNING, waviness_sigma=_CERTAIN, damping_sigma=_CERTAIN)),
    FREE_WAVINESS: (in_band, replace(TUNING, damping_sigma=_CERTAIN)),
    MAIN: (in_band, TUNING),
}
"""What is left out of the model, step by step; the last is the estimator."""


def _with_noise(tuning: StiffnessTuning, settings: StiffnessSettings) -> StiffnessTuning:
    return replace(tuning, noise_a_s=settings.noise, noise_a_u=settings.noise)


def _float(values: np.ndarray) -> Any:
    return jnp.asarray(values, float)


def _keep(state: Any, info: Any) -> tuple:
    del info
    return tuple(state.theta.mean), tuple(row[:4] for row in state.theta.cov[:4])


def _followed(
    filter: Any, prior: Any, params: Any, measured: Any, speed: np.ndarray, bind: Any, dt: float
) -> Followed:
    state = filter.init(prior, params)
    mean, rows = run_batch(
        filter, state, measured, params, inputs=_float(speed), bind=bind, keep=_keep
    )
    count = next(iter(measured)).shape[1]
    places = np.round(np.arange(1.0, count * dt + 1e-6) / dt).astype(int) - 1
    places = np.minimum(places, count - 1)
    theta = np.stack([np.asarray(m)[:, places] for m in mean], -1)
    cov = np.empty((*theta.shape[:2], 4, 4))
    for i, row in enumerate(rows):
        for j, entry in enumerate(row[: i + 1]):
            cov[..., i, j] = cov[..., j, i] = np.asarray(entry)[:, places]
    return Followed(theta, cov)
