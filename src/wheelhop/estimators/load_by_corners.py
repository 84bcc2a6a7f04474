"""Loads of a record corner by corner and axle by axle: Youla, unbiased, derivative filters."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.errors import InputError
from wheelhop.estimators.axle_load import AxleSample, axle_youla, unknown_axle_before
from wheelhop.estimators.derivative_load import (
    DOUBLE_POLE,
    derivative_filters,
    derivative_params,
)
from wheelhop.estimators.inverse_load import LoadSensors
from wheelhop.estimators.joint_load_mixture import WheelLoads
from wheelhop.estimators.unbiased_load import unbiased, unbiased_params
from wheelhop.estimators.wheel_load import LoadSample
from wheelhop.estimators.youla_load import constant_loads, unknown_before, youla_params
from wheelhop.filtering.drive import run_compiled
from wheelhop.vehicle.corner_suspension import CornerSuspension, corner_suspensions, static_load
from wheelhop.vehicle.full_vehicle_state import FullVehicle
from wheelhop.vehicle.load_record import LoadRecord

_AXLES = ((0, 1), (2, 3))
_BEGIN = 5


@dataclass(frozen=True)
class LoadsFound:
    """Loads of the four wheels; NaN where a method says nothing.

    Attributes:
        t: time [s], [time].
        load: normal forces FL, FR, RL, RR [N], [time, 4].
        sigma: their standard deviations [N], [time, 4].
        total: sum of the loads [N], [time].
        total_sigma: its standard deviation [N], [time].
        static: loads at rest on level ground [N], [4].
        joint: all that the joint filter believes, or None.
    """

    t: np.ndarray
    load: np.ndarray
    sigma: np.ndarray
    total: np.ndarray
    total_sigma: np.ndarray
    static: np.ndarray
    joint: WheelLoads | None = None


def loads_by_youla(
    record: LoadRecord, vehicle: FullVehicle, bandwidth: float, sensors: LoadSensors
) -> LoadsFound:
    """By the Youla observer, an axle with its bar as a half car."""
    body, compression = suspension_signals(record)
    corners = corner_suspensions(vehicle)
    observer = axle_youla()
    means: list[Any] = []
    variances: list[Any] = []
    total_variance: Any = 0.0
    for left, right in _AXLES:
        sides = jax.tree.map(lambda leaf, k=left: leaf[k : k + 2], corners)
        params = youla_params(sides, record.dt, bandwidth, sensors=as_numbers(sensors))
        sample = AxleSample(body[left], body[right], compression[left], compression[right])
        begin = jnp.asarray(0.5 * (_begin(compression[left]) + _begin(compression[right])))
        state = observer.filter.init(unknown_axle_before(begin), params)
        found = run_compiled(observer.filter, state, as_numbers(sample), params, keep=_kept_load)
        cov = found.cov
        means += [found.mean.normal_left, found.mean.normal_right]
        variances += [cov[0][0], cov[1][1]]
        total_variance = total_variance + cov[0][0] + cov[1][1] + 2.0 * cov[1][0]
    return loads_found(record, vehicle, means, variances, total_variance)


def loads_by_unbiased(
    record: LoadRecord, vehicle: FullVehicle, bandwidth: float, sensors: LoadSensors
) -> LoadsFound:
    """By the unbiased minimum variance filter."""
    return _by_corners(_unbiased_corner, record, vehicle, bandwidth, sensors)


def loads_by_derivative(
    record: LoadRecord, vehicle: FullVehicle, bandwidth: float, sensors: LoadSensors
) -> LoadsFound:
    """By derivative filters, without accelerometers."""
    return _by_corners(_derivative_corner, record, vehicle, bandwidth, sensors)


def _by_corners(
    estimated: Callable[..., tuple[np.ndarray, np.ndarray]],
    record: LoadRecord,
    vehicle: FullVehicle,
    bandwidth: float,
    sensors: LoadSensors,
) -> LoadsFound:
    """Mean and difference of an axle with a bar are two quarter cars, k and k + 2 k_b."""
    body, compression = suspension_signals(record)
    corners = corner_suspensions(vehicle)
    means: list[Any] = []
    variances: list[Any] = []
    total_variance: Any = 0.0
    for left, right in _AXLES:
        one, other = (jax.tree.map(lambda leaf, k=k: leaf[k], corners) for k in (left, right))
        signals = [(body[k], compression[k]) for k in (left, right)]
        if not float(one.anti_roll):
            found = [
                estimated(c, a, q, record.dt, bandwidth, sensors)
                for c, (a, q) in zip((one, other), signals, strict=True)
            ]
            means += [mean for mean, _ in found]
            variances += [variance for _, variance in found]
            total_variance = total_variance + found[0][1] + found[1][1]
            continue
        _require_alike(one, other)
        (a, q), (b, r) = signals
        halved = sensors._replace(
            acceleration_noise=sensors.acceleration_noise / math.sqrt(2.0),
            deflection_noise=sensors.deflection_noise / math.sqrt(2.0),
        )
        stiffer = replace(one, stiffness=one.stiffness + 2.0 * one.anti_roll)
        (mean, spread), (half, half_spread) = (
            estimated(c, 0.5 * (a + s * b), 0.5 * (q + s * r), record.dt, bandwidth, halved)
            for c, s in ((one, 1.0), (stiffer, -1.0))
        )
        # a half difference has neither preload nor weight
        half = half - float(constant_loads(one)[0])
        means += [mean + half, mean - half]
        variances += [spread + half_spread] * 2
        total_variance = total_variance + 4.0 * spread
    return loads_found(record, vehicle, means, variances, total_variance)


def _unbiased_corner(
    corner: CornerSuspension,
    body: np.ndarray,
    compression: np.ndarray,
    dt: float,
    bandwidth: float,
    sensors: LoadSensors,
) -> tuple[np.ndarray, np.ndarray]:
    """Load and its variance, of the sampling interval before each sample put where it belongs."""
    observer = unbiased()
    params = unbiased_params(corner, dt, bandwidth / DOUBLE_POLE, sensors)
    state = observer.filter.init(unknown_before(jnp.asarray(_begin(compression))), params)
    sample = as_numbers(LoadSample(body, compression))
    found = run_compiled(observer.filter, state, sample, params, keep=_kept_inner_load)
    late = np.full(observer.delay, np.nan)
    return tuple(  # type: ignore[return-value]
        np.append(np.asarray(entry)[observer.delay :], late)
        for entry in (found.mean.normal, found.cov[0][0])
    )


def _derivative_corner(
    corner: CornerSuspension,
    body: np.ndarray,
    compression: np.ndarray,
    dt: float,
    bandwidth: float,
    sensors: LoadSensors,
) -> tuple[np.ndarray, np.ndarray]:
    observer = derivative_filters()
    params = derivative_params(corner, dt, bandwidth / DOUBLE_POLE, as_numbers(sensors))
    state = observer.filter.init(unknown_before(jnp.asarray(_begin(compression))), params)
    sample = as_numbers(LoadSample(body, compression))
    found = run_compiled(observer.filter, state, sample, params, keep=_kept_derivative_load)
    return np.asarray(found.mean.normal), np.asarray(found.cov[0][0])


def loads_found(
    record: LoadRecord, vehicle: FullVehicle, means: list[Any], variances: list[Any], total: Any
) -> LoadsFound:
    """Loads and variances of the four wheels, each [time], and the variance of their sum."""
    load = np.stack([np.asarray(mean, float) for mean in means], 1)
    sigma = np.sqrt(np.stack([np.asarray(v, float) for v in variances], 1))
    spread = np.sqrt(np.asarray(total, float)) + np.zeros(len(load))
    return LoadsFound(record.t, load, sigma, load.sum(1), spread, static_loads(vehicle))


def static_loads(vehicle: FullVehicle) -> np.ndarray:
    """At rest on level ground [N], [4]."""
    return np.asarray(static_load(corner_suspensions(vehicle)), float)


def suspension_signals(record: LoadRecord) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """a_s and compression of the corners.

    Raises:
        InputError: naming the first that the record has not.
    """
    fields = record.sample._asdict()
    for name, entry in fields.items():
        if not name.startswith("a_u") and not np.isfinite(entry).any():
            raise InputError(name, "the log lacks it", "Add it, or use the method algebraic.")
    body = [entry for name, entry in fields.items() if name.startswith("a_s")]
    return body, [entry for name, entry in fields.items() if name.startswith("compression")]


def _require_alike(left: CornerSuspension, right: CornerSuspension) -> None:
    for name in ("sprung_mass", "unsprung_mass", "stiffness", "damping", "preload"):
        one, other = (float(getattr(side, name)) for side in (left, right))
        if not math.isclose(one, other, rel_tol=0.01):
            raise InputError(
                name,
                f"{one:g} on the left and {other:g} on the right of an axle with a bar",
                "Use the method youla, which takes unlike sides.",
            )


def _begin(compression: np.ndarray) -> float:
    """Where a strut stands as the record begins [m]."""
    return float(np.median(compression[np.isfinite(compression)][:_BEGIN]))


def as_numbers(tree: Any) -> Any:
    """Leaves as floating arrays."""
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.result_type(float)), tree)


def _kept_load(state: Any, info: Any) -> Any:
    del info
    return axle_youla().load(state)


def _kept_derivative_load(state: Any, info: Any) -> Any:
    del info
    return derivative_filters().load(state)


def _kept_inner_load(state: Any, info: Any) -> Any:
    del info
    return unbiased().load(state)
