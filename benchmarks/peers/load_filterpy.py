"""filterpy's unscented filter on the joint model of wheel loads, the model written in NumPy."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import numpy as np
from scipy.interpolate import CubicHermiteSpline

from wheelhop.estimators.joint_load_model import (
    NEAR,
    joint_load_model,
    joint_load_prior,
)
from wheelhop.estimators.joint_load_params import JointLoadTuning, joint_load_params
from wheelhop.vehicle.full_vehicle import FullVehicle
from wheelhop.vehicle.full_vehicle_parameters import as_arrays

GRAVITY = 9.80665


def joint(
    vehicle: FullVehicle, dt: float, walk: float, tuning: JointLoadTuning
) -> Callable[[np.ndarray], np.ndarray]:
    """A filter of records [time, 12]; it returns the loads [time, 4] N.

    Args:
        vehicle: parameters.
        dt: sampling interval [s].
        walk: of the loads [N/s^0.5].
        tuning: noise and priors.
    """
    from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

    kept = joint_load_params(as_arrays(vehicle), dt, tuning, walk)
    prior = joint_load_prior(kept)
    p = jax.tree.map(lambda leaf: np.asarray(leaf, float), kept)
    c = p.strut.stop
    rubber = CubicHermiteSpline(c.x, c.y, c.slope)

    def stop(x: np.ndarray) -> Any:
        return rubber(np.clip(x, c.x[0], c.x[-1])) + c.slope[-1] * np.maximum(x - c.x[-1], 0.0)

    noise = joint_load_model()
    mean = np.array([float(m) for m in prior.mean])
    process = _dense(noise.process_cov(prior.mean, kept))
    sensors = _dense(noise.observation_cov(kept))
    start = _dense(prior.cov)

    def transition(x: np.ndarray, dt: float) -> np.ndarray:
        motion, rest = x[:8], x[8:]

        def slope(at: np.ndarray) -> np.ndarray:
            body, wheel = _shown(at[:4], at[4:], rest, p, stop)
            return np.concatenate([at[4:], wheel - body])

        a = slope(motion)
        b = slope(motion + 0.5 * dt * a)
        c = slope(motion + 0.5 * dt * b)
        d = slope(motion + dt * c)
        return np.concatenate([motion + dt / 6.0 * (a + 2 * b + 2 * c + d), rest])

    def observation(x: np.ndarray) -> np.ndarray:
        body, wheel = _shown(x[:4], x[4:8], x[8:], p, stop)
        return np.concatenate([body, x[:4], wheel])

    def run(ys: np.ndarray) -> np.ndarray:
        points = MerweScaledSigmaPoints(len(mean), alpha=NEAR, beta=2.0, kappa=0.0)
        filter = UnscentedKalmanFilter(len(mean), 12, dt, observation, transition, points)
        filter.x, filter.P, filter.Q, filter.R = mean.copy(), start.copy(), process, sensors
        loads = np.empty((len(ys), 4))
        for k, y in enumerate(ys):
            filter.predict()
            # ours redraws its points after the prediction
            filter.sigmas_f = points.sigma_points(filter.x, filter.P)
            filter.update(y)
            loads[k] = filter.x[8:12]
        return loads

    return run


def _shown(s: np.ndarray, w: np.ndarray, rest: np.ndarray, p: Any, stop: Any) -> tuple[Any, Any]:
    load, (roll_moment, pitch_moment, ln_mass) = rest[:4], rest[4:]
    strut, d = p.strut, p.strut.damper
    force = strut.preload + strut.stiffness * s + strut.cubic_stiffness * s**3
    force = force + stop(s - strut.bump_clearance) - stop(-s - strut.rebound_clearance)
    fading = 1.0 + d.digression * np.sqrt(w * w + 1e-6)
    force = force + d.damping * w * (1.0 - d.asymmetry * np.tanh(w / d.knee)) / fading
    force = force + d.quadratic * w * np.abs(w)
    across = np.array([s[0] - s[1], s[1] - s[0], s[2] - s[3], s[3] - s[2]])
    force = force + across * np.repeat([p.bars.front, p.bars.rear], 2)
    heavier = np.exp(ln_mass)
    up = force.sum() / (p.body_mass * heavier) - GRAVITY
    roll = (p.y @ force + roll_moment) / (p.roll_inertia * heavier)
    pitch = (pitch_moment - p.x @ force) / (p.pitch_inertia * heavier)
    sunk = s + (load - p.static_load) / p.tire_stiffness
    behind = p.x - p.x.mean()
    leaning, diving = -(p.y @ sunk) / (p.y @ p.y), (behind @ sunk) / (behind @ behind)
    share = load / max(load.sum(), 0.1 * p.static_load.sum())
    lengthwise = p.brake_share if pitch_moment > 0.0 else p.drive_share
    tilted = leaning * roll_moment * share + diving * pitch_moment * lengthwise
    along = load - tilted / p.lever
    return up + roll * p.y - pitch * p.x, (along - force) / p.wheel_mass - GRAVITY


def _dense(lower: Any) -> np.ndarray:
    size = len(lower)
    full = np.zeros((size, size))
    for i, row in enumerate(lower):
        for j, entry in enumerate(row):
            full[i, j] = full[j, i] = float(entry)
    return full
