"""Tyre pressures of a vehicle's record of four corners, and the alarms on them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import numpy as np

from wheelhop.errors import InputError
from wheelhop.estimators.alarms import AlarmOutput, AlarmSettings, alarm_params, run_alarms
from wheelhop.estimators.calibration import Calibration, bias_cov
from wheelhop.estimators.changing import ChangeTuning, changing_modes
from wheelhop.estimators.four_corners import (
    VEHICLE_TUNING,
    WHEELS,
    bind_speed,
    changing_four_corner_filter,
    changing_four_corner_params,
    changing_four_corner_prior,
)
from wheelhop.estimators.hop_band import (
    HOP_TUNING,
    MEAN_OVER,
    hop_filter,
    hop_params,
    hop_prior,
    means,
)
from wheelhop.estimators.hop_band import bind_speed as bind_hop_speed
from wheelhop.estimators.hop_model import WheelAcceleration
from wheelhop.estimators.pressure import StiffnessBelief
from wheelhop.estimators.pressure_estimate import filter_record, measured_as
from wheelhop.estimators.stiffness import StiffnessTuning, validate_tuning
from wheelhop.filtering import Info, InteractingState, SensitivityState
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.quarter_car import Accelerations
from wheelhop.vehicle.record import CornerRecord
from wheelhop.vehicle.tire import Tire, pressure_from_stiffness, pressure_slope, require_stiff

REPORT_RATE = 10.0
"""Rate [Hz] of what is reported; the filter itself runs at the rate of the record."""

COMMON_DRIFT, SINGLE_DRIFT = 0.015, 0.005
"""Standard deviation of what may have changed in ln k_t since a calibration, beside the pressure:
common to the wheels (load, temperature of rubber, speed) and of each by itself."""

COMMON_LAW, SINGLE_LAW = 0.04, 0.01
"""The same without a calibration: what is not known of the tyres' law and of the corners."""


@dataclass(frozen=True)
class VehicleEstimate:
    """Tyre pressures over time.

    Attributes:
        t: time [s], [time].
        stiffness: belief over ln k_t, wheels FL, FR, RL, RR.
        pressure: [Pa], [time, 4].
        pressure_sigma: its standard deviation [Pa], [time, 4].
        level: of the road, Gd(W0) [m^3/rad], [time].
        level_sigma: standard deviation of ln G, [time].
        modes: names of the filter's modes.
        mode_probabilities: [time, modes].
        nis: normalised innovation squared, mean over the time since the last report; `entries`
            where the model fits, [time].
        missing: measurements left out since the last report, [time].
        entries: number of measurements in a step.
    """

    t: np.ndarray
    stiffness: StiffnessBelief
    pressure: np.ndarray
    pressure_sigma: np.ndarray
    level: np.ndarray
    level_sigma: np.ndarray
    modes: tuple[str, ...]
    mode_probabilities: np.ndarray
    nis: np.ndarray
    missing: np.ndarray
    entries: int


class _Kept(NamedTuple):
    theta: Any
    log_probabilities: Any
    nis: Any
    missing: Any
    nonfinite: Any


def estimate_vehicle(
    records: Sequence[CornerRecord],
    cars: Sequence[QuarterCar],
    *,
    tuning: StiffnessTuning = VEHICLE_TUNING,
    changes: ChangeTuning = ChangeTuning(),
    on_progress: Callable[[int, int], None] | None = None,
) -> VehicleEstimate:
    """Estimate four pressures by recursive maximum likelihood with one road roughness.

    Every sample of all eight accelerations is used, on a road of waviness 2: at the bound for
    quarter cars on such roads, and far off for a real vehicle; see `estimate_by_hop`. The roads
    of the four wheels are taken as independent; where front and rear wheels share a track, the
    standard deviation of what is common to the wheels is too small, by 1.4 at most.

    Args:
        records: checked records of the corners FL, FR, RL, RR on one time grid.
        cars: the corners.
        tuning: noise, priors and walks.
        changes: how roads and tyres change.
        on_progress: called with samples done and in all.

    Raises:
        InputError: if there are not four records on one time grid, or tuning is not usable.
        DivergenceError: if the filter leaves the finite numbers.
    """
    first = _checked(records)
    for car in cars:
        require_stiff(car.tire, validate_tuning(tuning).prior_pressure)
    dt = first.dt
    filter = changing_four_corner_filter(dt)
    params = changing_four_corner_params(cars, float(first.v[0]), dt, tuning, changes)
    dtype = params.initial.dtype
    each = [measured_as(record, dtype) for record in records]
    ys = Accelerations(*(np.stack(entries, axis=-1) for entries in zip(*each, strict=True)))
    kept = filter_record(
        filter,
        filter.init(changing_four_corner_prior(params, tuning), params),
        ys,
        params,
        first.v.astype(dtype),
        first.t,
        bind_speed,
        _keep,
        on_progress,
        whole=False,
    )
    names = changing_modes(dt, tuning, changes).names
    return _estimate(first.t, kept, names, [car.tire for car in cars], tuning.prior_level, dt, 8)


def estimate_by_hop(
    records: Sequence[CornerRecord],
    cars: Sequence[QuarterCar],
    *,
    tuning: StiffnessTuning = HOP_TUNING,
    on_progress: Callable[[int, int], None] | None = None,
) -> VehicleEstimate:
    """Estimate four pressures from the wheels' accelerations in the band of the wheel hop.

    For a vehicle that is no quarter car, and roads of any waviness (`hop_band`); slower on
    quarter cars, since it leaves out what lies above 30 Hz and the body. Standard deviations as
    in `estimate_vehicle`; tyres that change abruptly are followed as the walk allows.

    Args:
        records, cars, tuning, on_progress: as in `estimate_vehicle`.

    Raises:
        InputError: if there are not four records on one time grid, the sampling rate is too low,
            or tuning is not usable.
        DivergenceError: if the filter leaves the finite numbers.
    """
    first = _checked(records)
    for car in cars:
        require_stiff(car.tire, validate_tuning(tuning).prior_pressure)
    block = max(1, round(MEAN_OVER / first.dt))
    dt = block * first.dt
    if dt > 1.5 * MEAN_OVER:
        raise InputError(
            "t",
            f"{1.0 / first.dt:.4g} Hz are too few for means over {1e3 * MEAN_OVER:g} ms",
            "Log at 60 Hz or more, or use the other method.",
        )
    filter = hop_filter(dt)
    params = hop_params(cars, dt, tuning, block)
    prior = hop_prior(params, tuning)
    dtype = params.inner.patch.dtype
    wheels = means(np.stack([r.a_u for r in records], axis=-1), block).astype(dtype)
    speed = means(first.v[:, None], block)[:, 0].astype(dtype)
    t = first.t[block - 1 :: block][: len(wheels)]
    kept = filter_record(
        filter,
        filter.init(prior, params),
        WheelAcceleration(wheels),
        params,
        speed,
        t,
        bind_hop_speed,
        _keep_hop,
        on_progress,
        whole=False,
    )
    tires = [car.tire for car in cars]
    return _estimate(t, kept, ("steady",), tires, tuning.prior_level, dt, len(WHEELS))


def watch(
    estimate: VehicleEstimate,
    cars: Sequence[QuarterCar],
    placard: Any,
    *,
    tuning: StiffnessTuning = VEHICLE_TUNING,
    calibration: Calibration | None = None,
    settings: AlarmSettings = AlarmSettings(),
) -> AlarmOutput:
    """Alarms over an estimate, every leaf [time, 4].

    Args:
        estimate: of the drive.
        cars: the corners, for their tyres' law.
        placard: recommended pressure [Pa], [] or [4].
        tuning: that of the estimate.
        calibration: of this vehicle at a known pressure; without one the law is believed within
            `COMMON_LAW` and `SINGLE_LAW`.
        settings: of the alarms.
    """
    tire = jax.tree.map(lambda *a: np.array(a, float), *(car.tire for car in cars))
    n = len(WHEELS)
    bias = COMMON_LAW**2 * np.ones((n, n)) + SINGLE_LAW**2 * np.eye(n)
    mean = estimate.stiffness.mean
    if calibration is not None:
        bias = bias_cov(calibration, COMMON_DRIFT, SINGLE_DRIFT)
        mean = mean - np.asarray(calibration.offset)
    params = alarm_params(
        tire,
        placard,
        wheels=len(WHEELS),
        dt=float(np.median(np.diff(estimate.t))),
        belief_walk=tuning.stiffness_walk,
        bias=bias,
        settings=settings,
    )
    found = _compiled_alarms(StiffnessBelief(mean, estimate.stiffness.cov), params)
    return jax.tree.map(np.asarray, found)


_compiled_alarms = jax.jit(run_alarms)


def _checked(records: Sequence[CornerRecord]) -> CornerRecord:
    if len(records) != len(WHEELS):
        raise InputError("records", f"{len(records)} corners", "Give four: FL, FR, RL, RR.")
    first = records[0]
    for name, record in zip(WHEELS, records, strict=True):
        if len(record.t) != len(first.t) or np.abs(record.t - first.t).max() > 0.5 * first.dt:
            raise InputError(
                f"record of {name}",
                "its times are not those of FL",
                "Bring the four corners to one time grid.",
            )
    return first


def _keep(state: InteractingState, info: Info) -> _Kept:
    return _Kept(
        state.combined.theta,
        state.log_probabilities,
        info.nis,
        info.flags.missing,
        info.flags.nonfinite,
    )


def _keep_hop(state: SensitivityState, info: Info) -> _Kept:
    certain = 0.0 * info.nis[None]
    return _Kept(state.theta, certain, info.nis, info.flags.missing, info.flags.nonfinite)


def _estimate(
    t: np.ndarray,
    kept: _Kept,
    modes: tuple[str, ...],
    tires: Sequence[Tire],
    level: float,
    dt: float,
    entries: int,
) -> VehicleEstimate:
    stride = max(1, round(1.0 / (REPORT_RATE * dt)))
    first = (len(t) - 1) % stride
    thin = slice(first, None, stride)
    mean, low = kept.theta
    n = len(WHEELS)
    ln_k = np.stack([np.asarray(mean[i][thin], float) for i in range(n)], axis=-1)
    cov = np.empty((*ln_k.shape, n))
    for i in range(n):
        for j in range(i + 1):
            cov[:, i, j] = cov[:, j, i] = low[i][j][thin]
    stiffness = np.exp(ln_k)
    slope = np.array([float(pressure_slope(tire)) for tire in tires])
    sigma = stiffness * np.sqrt(np.diagonal(cov, axis1=1, axis2=2))
    pressure = [
        np.asarray(pressure_from_stiffness(stiffness[:, i], tire)) for i, tire in enumerate(tires)
    ]
    return VehicleEstimate(
        t=t[thin],
        stiffness=StiffnessBelief(ln_k, cov),
        pressure=np.stack(pressure, axis=-1),
        pressure_sigma=sigma * slope,
        level=level * np.exp(np.asarray(mean[n][thin], float)),
        level_sigma=np.sqrt(np.asarray(low[n][n][thin], float)),
        modes=modes,
        mode_probabilities=np.exp(np.asarray(kept.log_probabilities[thin], float)),
        nis=_per_report(kept.nis, first, stride, np.mean),
        missing=_per_report(kept.missing, first, stride, np.sum),
        entries=entries,
    )


def _per_report(values: np.ndarray, first: int, stride: int, of: Any) -> np.ndarray:
    """Mean or sum over the samples since the report before."""
    begins = np.concatenate([[0], np.arange(first, len(values) - 1, stride) + 1])
    ends = np.arange(first, len(values), stride) + 1
    return np.array([of(values[a:b]) for a, b in zip(begins, ends, strict=True)])
