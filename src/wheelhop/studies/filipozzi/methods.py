"""Every estimator of wheel load over the drives of the study, four corners at once.

All start uninitialised, as the paper's do: before the record they believe in wheels that hang from
free springs.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.errors import InputError
from wheelhop.estimators.axle_load import AxleSample, axle_youla
from wheelhop.estimators.derivative_load import DOUBLE_POLE, derivative_filters, derivative_params
from wheelhop.estimators.inverse_load import LoadSensors
from wheelhop.estimators.unbiased_load import unbiased, unbiased_params
from wheelhop.estimators.wheel_load import LoadObserver, LoadSample
from wheelhop.estimators.youla_load import youla, youla_params
from wheelhop.filtering import run_batch
from wheelhop.filtering.gaussian import Gaussian
from wheelhop.vehicle.corner_suspension import CornerSuspension

YOULA, UNBIASED, DERIVATIVE = "Youla", "unbiased", "derivative filters"
HALF_CAR = "half car"
QUARTER_CARS = (YOULA, UNBIASED, DERIVATIVE)
"""Estimators that take each corner for a quarter car."""

PERFECT = LoadSensors(acceleration_noise=0.01, deflection_noise=1e-5)
"""What is believed of sensors without noise."""


class Signals(NamedTuple):
    """What the sensors of the four corners say, [..., time, 4] or [runs, time, 4]."""

    body_acceleration: Any
    deflection: Any


class Observed(NamedTuple):
    """Loads by an estimator, [..., time, 4].

    Attributes:
        load: [N].
        sigma: standard deviation that the believed noise of the sensors makes [N].
    """

    load: np.ndarray
    sigma: np.ndarray


def observed(
    method: str,
    signals: Signals,
    corners: CornerSuspension,
    dt: float,
    bandwidth: float,
    sensors: LoadSensors = PERFECT,
) -> Observed:
    """Loads of all corners by one of `QUARTER_CARS` or `HALF_CAR`, moved to the time they are of.

    Args:
        method: name of the estimator.
        signals: [time, 4] or [runs, time, 4].
        corners: as the estimator believes them, leaves [4].
        dt: sampling interval [s].
        bandwidth: at which the load is passed with -3 dB [Hz], alike for all.
        sensors: as the estimator believes them.

    Returns:
        Loads and their standard deviations; NaN in the last samples of an estimator with a delay.

    Raises:
        InputError: for another method.
    """
    if method not in (*QUARTER_CARS, HALF_CAR):
        known = ", ".join((*QUARTER_CARS, HALF_CAR))
        raise InputError("method", f"{method!r} is unknown", f"Use one of {known}.")
    if method == HALF_CAR:
        return _half_car(signals, corners, dt, bandwidth, sensors)
    observer, params, axes = _built(method, corners, dt, bandwidth, sensors)
    shape = np.shape(signals.deflection)
    runs = int(np.prod(shape[:-2], dtype=int))
    sample = LoadSample(*(_corner_runs(a, runs) for a in signals))
    hanging = jnp.asarray(-np.asarray(corners.preload / corners.stiffness))
    prior = _uncertain(jnp.zeros_like(hanging), hanging)
    # leaves [4] of the corners repeat for every run: corner is the faster index
    repeated = jax.tree.map(lambda leaf: jnp.tile(leaf, (runs,) + (1,) * (leaf.ndim - 1)), prior)
    tiled = jax.tree.map(
        lambda axis, leaf: (
            leaf if axis is None else jnp.tile(leaf, (runs,) + (1,) * (leaf.ndim - 1))
        ),
        axes,
        params,
        is_leaf=lambda axis: axis is None,
    )
    state = jax.vmap(observer.filter.init, in_axes=(0, axes))(repeated, tiled)
    found = run_batch(
        observer.filter, state, sample, tiled, in_axes=(0, 0, axes, None), keep=_keeper(observer)
    )
    load, sigma = (_back(a, shape, observer.delay) for a in found)
    return Observed(load, sigma)


def counted_from_free(corners: CornerSuspension, factor: float) -> CornerSuspension:
    """What an estimator with wrong springs believes, where deflections count from free springs.

    It then takes the static load wrong as well (Filipozzi et al. 2021, section 6 on Fig. 8).

    Args:
        corners: the estimator's, leaves [4], with the preload of the true springs.
        factor: stiffness of the plant's springs per that of the estimator's [-].
    """
    return replace(corners, preload=corners.preload / factor)


def _built(
    method: str, corners: CornerSuspension, dt: float, bandwidth: float, sensors: LoadSensors
) -> tuple[LoadObserver, Any, Any]:
    """Observer, parameters, and which of their leaves lead with the corners."""
    pole = bandwidth / DOUBLE_POLE
    if method in (YOULA, DERIVATIVE):
        if method == YOULA:
            observer, shaped = youla(), youla_params(corners, dt, bandwidth, sensors=sensors)
        else:
            observer = derivative_filters()
            shaped = derivative_params(corners, dt, pole, sensors=sensors)
        shared = jax.tree.map(lambda _: None, shaped)
        return observer, shaped, replace(shared, corner=jax.tree.map(lambda _: 0, corners))
    each = [
        unbiased_params(jax.tree.map(lambda leaf, k=k: leaf[k], corners), dt, pole, sensors)
        for k in range(4)
    ]
    system = jax.tree.map(lambda *leaves: jnp.stack(leaves), *(one.system for one in each))
    covs = jnp.stack([one.load_cov for one in each])
    params = replace(each[0], system=system, load_cov=covs)
    axes = jax.tree.map(lambda _: None, params)
    mapped = jax.tree.map(lambda _: 0, system)
    return unbiased(), params, replace(axes, system=mapped, load_cov=0)


def _half_car(
    signals: Signals, corners: CornerSuspension, dt: float, bandwidth: float, sensors: LoadSensors
) -> Observed:
    shape = np.shape(signals.deflection)
    runs = int(np.prod(shape[:-2], dtype=int))
    observer = axle_youla()
    axles = jax.tree.map(lambda leaf: leaf.reshape(2, 2), corners)
    params = youla_params(axles, dt, bandwidth, sensors=sensors)
    axes = replace(jax.tree.map(lambda _: None, params), corner=jax.tree.map(lambda _: 0, axles))
    a, q = (np.reshape(x, (runs, shape[-2], 2, 2)) for x in signals)
    sides = [np.moveaxis(x[..., k], 2, 1).reshape(2 * runs, -1) for x in (a, q) for k in (0, 1)]
    sample = AxleSample(*(jnp.asarray(x) for x in sides))
    hanging = jnp.asarray(-np.asarray(axles.preload / axles.stiffness))
    zero = jnp.zeros_like(hanging[:, 0])
    mean = AxleSample(zero, zero, hanging[:, 0], hanging[:, 1])
    one = jnp.ones_like(zero)
    cov = ((one,), (zero, one), (zero, zero, one), (zero, zero, zero, one))
    tile = lambda leaf: jnp.tile(leaf, (runs,) + (1,) * (leaf.ndim - 1))  # noqa: E731
    tiled = replace(params, corner=jax.tree.map(tile, params.corner))
    state = jax.vmap(observer.filter.init, in_axes=(0, axes))(
        jax.tree.map(tile, Gaussian(mean, cov)), tiled
    )
    found = run_batch(
        observer.filter, state, sample, tiled, in_axes=(0, 0, axes, None), keep=_axle_loads
    )
    both = [
        np.stack([np.asarray(side).reshape(runs, 2, -1) for side in pair], -1) for pair in found
    ]
    load, sigma = (np.moveaxis(x, 1, 2).reshape(shape) for x in both)
    return Observed(load, sigma)


def _uncertain(acceleration: Any, deflection: Any) -> Gaussian:
    zero, one = jnp.zeros_like(deflection), jnp.ones_like(deflection)
    return Gaussian(LoadSample(acceleration, deflection), ((one,), (zero, one)))


def _keeper(observer: LoadObserver) -> Any:
    return _unbiased_load if observer is unbiased() else _inverse_load


def _inverse_load(state: Any, info: Any) -> tuple[Any, Any]:
    del info
    return state.load.mean.normal, jnp.sqrt(state.load.cov[0][0])


def _unbiased_load(state: Any, info: Any) -> tuple[Any, Any]:
    del info
    return state.load.mean.normal, jnp.sqrt(state.load.cov[0][0])


def _axle_loads(state: Any, info: Any) -> tuple[tuple[Any, Any], tuple[Any, Any]]:
    del info
    mean, cov = state.load
    return (mean.normal_left, mean.normal_right), (jnp.sqrt(cov[0][0]), jnp.sqrt(cov[1][1]))


def _corner_runs(signal: Any, runs: int) -> Any:
    """[..., time, 4] -> [runs * 4, time]."""
    a = np.asarray(signal, float)
    return jnp.asarray(np.moveaxis(a.reshape(runs, a.shape[-2], 4), 2, 1).reshape(4 * runs, -1))


def _back(found: Any, shape: tuple[int, ...], delay: int) -> np.ndarray:
    """[runs * 4, time] -> [..., time, 4], moved ahead by the delay."""
    a = np.moveaxis(np.asarray(found).reshape(-1, 4, shape[-2]), 1, 2).reshape(shape)
    if not delay:
        return a
    moved = np.full_like(a, np.nan)
    moved[..., :-delay, :] = a[..., delay:, :]
    return moved
