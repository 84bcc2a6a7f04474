"""The four wheel loads of a vehicle from a record, with their covariance.

A bank of joint filters, which differ in how fast they let the loads change, weighed by how well
each has foretold the record lately: smooth and rough stretches of road need different ones.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy.signal import lfilter
from scipy.special import logsumexp

from wheelhop.errors import DivergenceError
from wheelhop.estimators.joint_load_checks import check_tuning, checked_sample
from wheelhop.estimators.joint_load_model import (
    LOADS,
    joint_load_filter,
    joint_load_prior,
)
from wheelhop.estimators.joint_load_params import (
    JointLoadParams,
    JointLoadTuning,
    joint_load_params,
)
from wheelhop.filtering import Gaussian
from wheelhop.filtering.drive import run_in_chunks
from wheelhop.vehicle.full_vehicle_parameters import as_arrays, validate
from wheelhop.vehicle.full_vehicle_state import FullVehicle
from wheelhop.vehicle.load_record import VehicleLoadSample

FORGETTING = 0.1
"""Time [s] over which the evidence for a filter of the bank is forgotten."""

CHUNK = 512
"""Samples of a record that are filtered at once: every record is cut into such pieces, so that one
compiled function serves them all."""


@dataclass(frozen=True)
class WheelLoads:
    """What is believed of the tyres' normal forces; corners FL, FR, RL, RR.

    Attributes:
        t: [s] from the first sample, [time].
        load: [N], [time, 4].
        sigma: its standard deviation [N], [time, 4].
        total: sum of the four [N], [time].
        total_sigma: [N], [time].
        covariance: of the four loads [N^2], [time, 4, 4].
        compression_rate: of the struts [m/s], [time, 4].
        roll_moment, pitch_moment: of the tyres' horizontal forces on the body [Nm], [time].
        body_mass: sprung mass [kg], [time].
        body_mass_sigma: of sensor noise and moments alone [kg], [time]; at 100 Hz the unsure rates,
            seen through asymmetric dampers, take another 0.1 to 0.4 % off the mass.
        load_walk: mean intensity believed in [N/s^0.5], [time]: roughness of road and driving.
        nis: normalised innovation squared of the bank, about `freedom` where it fits, [time].
        freedom: entries present, [time].
    """

    t: np.ndarray
    load: np.ndarray
    sigma: np.ndarray
    total: np.ndarray
    total_sigma: np.ndarray
    covariance: np.ndarray
    compression_rate: np.ndarray
    roll_moment: np.ndarray
    pitch_moment: np.ndarray
    body_mass: np.ndarray
    body_mass_sigma: np.ndarray
    load_walk: np.ndarray
    nis: np.ndarray
    freedom: np.ndarray


def wheel_loads(
    sample: VehicleLoadSample,
    dt: float,
    vehicle: FullVehicle,
    tuning: JointLoadTuning | None = None,
    uninitialised: bool = False,
    on_progress: Callable[[int, int], None] | None = None,
) -> WheelLoads:
    """Estimate the four loads of a record.

    Args:
        sample: of the sensors, entries [time], NaN where one is missing; all four `a_u` may be.
        dt: sampling interval [s].
        vehicle: as it is thought to be; its payload is found.
        tuning: noise and priors.
        uninitialised: begin with no load at all and little trust in that, instead of with the
            vehicle at rest.
        on_progress: called with samples done and samples in all, those of every filter of the
            bank counted.

    Raises:
        InputError: for a record that is too short, of unequal lengths, in other units, without the
            deflection of a corner or without any accelerometer, and for tuning out of range.
        DivergenceError: if the filter leaves the finite numbers; says when.
    """
    tuning = JointLoadTuning() if tuning is None else tuning
    sample = checked_sample(sample, dt)
    check_tuning(tuning)
    validate(vehicle)
    vehicle = as_arrays(vehicle)
    samples, kind = len(sample.a_s_FL), jnp.result_type(float)
    ys = VehicleLoadSample(*(entry.astype(kind) for entry in sample))
    members, params = [], None
    # one after the other: lanes for the bank would multiply the time to compile
    for k, walk in enumerate(tuning.load_walks):
        params = joint_load_params(vehicle, dt, tuning, walk)
        pieces = []
        for done, kept in run_in_chunks(
            joint_load_filter(),
            _first_belief(params, uninitialised),
            ys,
            params,
            chunk=CHUNK,
            keep=_keep,
            whole=False,
        ):
            pieces.append(kept)
            if on_progress is not None:
                on_progress(k * samples + done, len(tuning.load_walks) * samples)
        members.append(jax.tree.map(lambda *piece: np.concatenate(piece).astype(float), *pieces))
    assert params is not None
    return _mixed(members, sample, dt, tuning, params)


def bank_weights(log_likelihood: np.ndarray, dt: float) -> np.ndarray:
    """Probabilities of the filters of a bank [filters, time], evidence forgotten exponentially.

    Args:
        log_likelihood: of every sample, [filters, time].
        dt: sampling interval [s].
    """
    kept = np.exp(-dt / FORGETTING)
    evidence = lfilter([1.0], [1.0, -kept], log_likelihood, axis=-1)
    return np.exp(evidence - logsumexp(evidence, axis=0))


def tilted_variance(
    mean: np.ndarray, squared_walk: np.ndarray, params: JointLoadParams
) -> np.ndarray:
    """Variance of the loads [N^2], [time, 4], from the unknown tilt of each wheel's own ground.

    A horizontal force F_h of the tyre on ground that is tilted by e against the plane of the four
    contacts pushes F_h e along the body's axis, where the filter takes it for load. It is as slow
    as the road, so that the filter follows it: it belongs to the estimate, not to a sensor.

    Args:
        mean: states, [time, 15].
        squared_walk: expected square of the intensity believed in [N^2/s], [time].
        params: of the filter; its `load_walk` is not read.
    """
    load, across, ahead = mean[:, LOADS], mean[:, 12], mean[:, 13]
    share = load / np.maximum(load.sum(1), 0.1 * float(np.sum(params.static_load)))[:, None]
    brake, drive = (np.asarray(a, float) for a in (params.brake_share, params.drive_share))
    lengthwise = np.where(ahead[:, None] > 0.0, brake, drive)
    horizontal = np.hypot(across[:, None] * share, ahead[:, None] * lengthwise)
    t = params.tuning
    tilt = float(t.patch_tilt) ** 2 + float(t.tilt_per_walk) ** 2 * squared_walk
    return tilt[:, None] * (horizontal / float(params.lever)) ** 2


def _first_belief(params: JointLoadParams, uninitialised: bool) -> Gaussian:
    prior = joint_load_prior(params)
    if uninitialised:
        unloaded = dict.fromkeys(prior.mean._fields[LOADS], 0.0 * prior.mean.load_FL)
        cov = [list(row) for row in prior.cov]
        for k in range(LOADS.start, LOADS.stop):
            cov[k][k] = cov[k][k] + params.static_load[k - LOADS.start] ** 2
        prior = prior._replace(
            mean=prior.mean._replace(**unloaded), cov=tuple(tuple(row) for row in cov)
        )
    # NumPy's numbers have one type for good: a second chunk compiles nothing
    return jax.tree.map(np.asarray, prior)


def _keep(state: Any, info: Any) -> Any:
    covs = tuple(tuple(state.cov[i][LOADS.start : i + 1]) for i in range(LOADS.start, LOADS.stop))
    return state.mean, covs, state.cov[14][14], info.log_likelihood, info.nis


def _mixed(
    members: list[Any],
    sample: VehicleLoadSample,
    dt: float,
    tuning: JointLoadTuning,
    params: JointLoadParams,
) -> WheelLoads:
    """Mean and covariance of the bank's mixture, and what the tilt of the ground adds to it."""
    means = np.array([np.stack(m[0], -1) for m in members])
    cov = np.zeros((*means.shape[:2], 4, 4))
    for k, member in enumerate(members):
        for i, row in enumerate(member[1]):
            for j, entry in enumerate(row):
                cov[k, :, i, j] = cov[k, :, j, i] = entry
    variance, log_likelihood, nis = (np.array([m[part] for m in members]) for part in (2, 3, 4))
    finite = np.isfinite(means).all((0, 2)) & np.isfinite(log_likelihood).all(0)
    if not finite.all():
        raise DivergenceError(
            f"the filter leaves the finite numbers at {dt * np.argmin(finite):.4g} s; check the "
            "units of the record, the vehicle, and the noise of the tuning"
        )
    weights = bank_weights(log_likelihood, dt)
    mean = np.einsum("kt,ktn->tn", weights, means)
    apart = means[..., LOADS] - mean[:, LOADS]
    cov = np.einsum("kt,ktij->tij", weights, cov + apart[..., :, None] * apart[..., None, :])
    corners = np.arange(4)
    walks = np.asarray(tuning.load_walks, float)
    cov[:, corners, corners] += tilted_variance(mean, weights.T @ walks**2, params)
    spread = np.sum(weights * (variance + (means[..., 14] - mean[:, 14]) ** 2), 0)
    body_mass = float(params.body_mass) * np.exp(mean[:, 14])
    return WheelLoads(
        t=dt * np.arange(len(mean)),
        load=mean[:, LOADS],
        sigma=np.sqrt(np.einsum("tii->ti", cov)),
        total=mean[:, LOADS].sum(1),
        total_sigma=np.sqrt(cov.sum((1, 2))),
        covariance=cov,
        compression_rate=mean[:, 4:8],
        roll_moment=mean[:, 12],
        pitch_moment=mean[:, 13],
        body_mass=body_mass,
        body_mass_sigma=body_mass * np.sqrt(spread),
        load_walk=weights.T @ walks,
        nis=np.sum(weights * nis, 0),
        freedom=np.isfinite(np.stack(sample)).sum(0),
    )
