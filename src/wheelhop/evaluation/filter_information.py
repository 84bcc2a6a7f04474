"""Fisher information of a corner as the estimators' own filter gathers it, in the time domain.

It shares the model with the filter and nothing with the spectra: integration of the motion, road
noise over a step, gain and innovations of the stationary Kalman filter. Where it agrees with
Whittle's information, a filter that carries its tangents can reach the bound.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import jax
import numpy as np
from scipy.linalg import solve_discrete_are, solve_discrete_lyapunov

from wheelhop.errors import InputError
from wheelhop.estimators.road_model import RoadModelParams, ShapedState, corner_on_road
from wheelhop.evaluation.bounds import Information
from wheelhop.evaluation.spectra import CORNER_UNKNOWNS, ROAD_UNKNOWNS, IsoRoad, require_drive
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.quarter_car import RelativeState

_STEP = 1e-4


class _System(NamedTuple):
    """x' = F x + w, y = C x + v, with the stationary gain and innovation covariance."""

    transition: np.ndarray
    observation: np.ndarray
    gain: np.ndarray
    innovation_cov: np.ndarray


def filter_information(
    car: QuarterCar,
    pressure: float,
    road: IsoRoad,
    speed: float,
    noise: tuple[float, float] = (0.5, 0.5),
    free: Sequence[str] = ("k_t", "level"),
    rate: float = 500.0,
) -> Information:
    """Information per second that the innovations of the stationary Kalman filter carry.

    E[r_i' S^-1 r_j] + 1/2 tr(S^-1 S_i S^-1 S_j) a sample, with innovation r, covariance S and
    their tangents. Prediction and tangents are one linear system driven by the innovations, so
    the expectation is that of its stationary covariance (Gupta & Mehra 1974). The model is
    `corner_on_road`: its coloured form where the waviness is free or not 2.

    Args:
        car: the corner; the linear terms of its suspension.
        pressure: of the tyre [Pa].
        road: level and waviness.
        speed: v [m/s].
        noise: standard deviations of the samples of a_s and a_u [m/s^2].
        free: what is unknown, of `CORNER_UNKNOWNS` and `ROAD_UNKNOWNS`.
        rate: sampling rate [Hz].

    Raises:
        InputError: for an unknown name, or an argument out of range.
    """
    for name in free:
        if name not in (*CORNER_UNKNOWNS, *ROAD_UNKNOWNS):
            known = ", ".join((*CORNER_UNKNOWNS, *ROAD_UNKNOWNS))
            raise InputError("unknown", f"{name!r} is not one of a corner", f"Use {known}.")
    require_drive(car, pressure, road, speed, noise, rate)
    coloured = "waviness" in free or road.waviness != 2.0
    suspension = replace(car.suspension, cubic_stiffness=0.0, quadratic_damping=0.0)
    params = RoadModelParams(
        replace(car, suspension=suspension),
        road.level,
        road.waviness,
        *noise,
        speed=speed,
        pressure=pressure,
        dt=1.0 / rate,
    )
    with jax.enable_x64(True):
        here = _system(params, coloured)
        around = [
            [_system(_moved(params, name, way * _STEP), coloured) for way in (-1.0, 1.0)]
            for name in free
        ]
    slopes = [
        _System(*((b - a) / (2.0 * _STEP) for a, b in zip(low, high, strict=True)))
        for low, high in around
    ]
    return Information(tuple(free), rate * _per_sample(here, slopes))


def _per_sample(here: _System, slopes: list[_System]) -> np.ndarray:
    n, m, p = len(here.transition), len(here.innovation_cov), len(slopes)
    f, c, k = here.transition, here.observation, here.gain
    # prediction x and its tangents x_i: r_i = -C_i x - C x_i
    system = np.zeros(((1 + p) * n, (1 + p) * n))
    drive = np.zeros(((1 + p) * n, m))
    system[:n, :n], drive[:n] = f, f @ k
    innovation_slopes = np.zeros((p, m, (1 + p) * n))
    for i, slope in enumerate(slopes):
        rows = slice((1 + i) * n, (2 + i) * n)
        system[rows, :n] = slope.transition - f @ k @ slope.observation
        system[rows, rows] = f @ (np.eye(n) - k @ c)
        drive[rows] = slope.transition @ k + f @ slope.gain
        innovation_slopes[i, :, :n] = -slope.observation
        innovation_slopes[i, :, rows] = -c
    cov = solve_discrete_lyapunov(system, drive @ here.innovation_cov @ drive.T)
    inverse = np.linalg.inv(here.innovation_cov)
    means = np.einsum(
        "iab,bc,jdc,ad->ij", innovation_slopes, cov, innovation_slopes, inverse, optimize=True
    )
    white = [inverse @ slope.innovation_cov for slope in slopes]
    return means + 0.5 * np.array([[np.trace(a @ b) for b in white] for a in white])


def _system(params: RoadModelParams, coloured: bool) -> _System:
    model = corner_on_road(coloured)
    state = ShapedState if coloured else RelativeState
    n = len(state._fields)
    # every entry a row of unit vectors: the functions are linear and elementwise
    units = state(*np.eye(n))
    f = np.stack([np.asarray(row, float) for row in model.transition(units, params)])
    c = np.stack([np.asarray(row, float) for row in model.observation(units, params)])
    q = _symmetric(model.process_cov(state(*np.zeros(n)), params))
    r = _symmetric(model.observation_cov(params))
    predicted = solve_discrete_are(f.T, c.T, q, r)
    innovation_cov = c @ predicted @ c.T + r
    return _System(f, c, np.linalg.solve(innovation_cov, c @ predicted).T, innovation_cov)


def _symmetric(lower: tuple) -> np.ndarray:
    n = len(lower)
    return np.array([[float(lower[max(i, j)][min(i, j)]) for j in range(n)] for i in range(n)])


def _moved(params: RoadModelParams, name: str, by: float) -> RoadModelParams:
    factor = float(np.exp(by))
    car = params.car
    if name == "level":
        return replace(params, level=params.level * factor)
    if name == "waviness":
        return replace(params, waviness=params.waviness + by)
    if name == "k_t":
        tire = replace(car.tire, stiffness=car.tire.stiffness * factor)
        return replace(params, car=replace(car, tire=tire))
    if name == "m_s":
        return replace(params, car=replace(car, sprung_mass=car.sprung_mass * factor))
    if name == "m_u":
        return replace(params, car=replace(car, unsprung_mass=car.unsprung_mass * factor))
    part = {"k_s": "stiffness", "c_s": "damping"}[name]
    value = getattr(car.suspension, part) * factor
    return replace(params, car=replace(car, suspension=replace(car.suspension, **{part: value})))
