"""What a bank of joint load filters says together: one Gaussian belief of the four loads."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
from scipy.signal import lfilter
from scipy.special import logsumexp

from wheelhop.errors import DivergenceError
from wheelhop.estimators.joint_load_model import LOADS, JointLoadBelief
from wheelhop.estimators.joint_load_params import JointLoadParams, map_springs
from wheelhop.estimators.joint_load_scales import Scales
from wheelhop.vehicle.full_vehicle_state import STANDARD_GRAVITY
from wheelhop.vehicle.load_record import VehicleLoadSample
from wheelhop.vehicle.strut import damper_force, spring_force

FORGETTING = 0.1
"""Time [s] over which the evidence for a filter of the bank is forgotten."""

SLOW = JointLoadBelief._fields.index("ln_mass")
"""Place in the state from which on nothing is quick."""


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
        scale: what the springs' rate and the dampers' force seem to be per those of the vehicle,
            [2], where a_x and a_y were given, or None.
        scale_sigma: its standard deviation, doubts of the tuning included, [2], or None.
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
    scale: np.ndarray | None = None
    scale_sigma: np.ndarray | None = None


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


def mixed(
    members: list[Any],
    sample: VehicleLoadSample,
    dt: float,
    params: JointLoadParams,
    scales: Scales | None = None,
) -> WheelLoads:
    """Mean and covariance of the bank's mixture; what the ground's tilt and the scales' doubt add.

    Args:
        members: of every filter the states, covariances of the loads, variances from `SLOW` on,
            log-likelihoods and normalised innovations squared, [time].
        sample: that was filtered.
        dt: sampling interval [s].
        params: of any of the filters.
        scales: of the springs and dampers that the parameters have, or None where they are given.

    Raises:
        DivergenceError: if a filter has left the finite numbers; says when.
    """
    means = np.array([np.stack(m[0], -1) for m in members])
    cov = np.zeros((*means.shape[:2], 4, 4))
    for k, member in enumerate(members):
        for i, row in enumerate(member[1]):
            for j, entry in enumerate(row):
                cov[k, :, i, j] = cov[k, :, j, i] = entry
    variance = np.array([np.stack(m[2], -1) for m in members])
    log_likelihood, nis = (np.array([m[part] for m in members]) for part in (3, 4))
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
    walks = np.asarray(params.tuning.load_walks, float)
    cov[:, corners, corners] += tilted_variance(mean, weights.T @ walks**2, params)
    off = means[..., SLOW:] - mean[:, SLOW:]
    spread = np.sqrt(np.einsum("kt,ktn->tn", weights, variance + off**2))
    body_mass = float(params.body_mass) * np.exp(mean[:, SLOW])
    mass_sigma = body_mass * spread[:, 0]
    if scales is not None:
        added, weight = _of_scales(mean, scales, params)
        cov += added
        mass_sigma = np.hypot(mass_sigma, weight)
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
        body_mass_sigma=mass_sigma,
        load_walk=weights.T @ walks,
        nis=np.sum(weights * nis, 0),
        freedom=np.isfinite(np.stack(sample)).sum(0),
        scale=None if scales is None else scales.value,
        scale_sigma=None if scales is None else scales.value * scales.ln_sigma,
    )


def _of_scales(mean: np.ndarray, scales: Scales, params: JointLoadParams) -> tuple[np.ndarray, Any]:
    """Covariance of loads [N^2] and deviation of the mass [kg] from scales that are in doubt.

    Struts that are stronger than believed carry more of what has moved them.
    """
    law = map_springs(lambda leaf: leaf[:, None], params.strut)
    s, w = (jnp.asarray(mean[:, k : k + 4].T, law.preload.dtype) for k in (0, 4))
    forces = spring_force(s, law) - law.preload, damper_force(w, law)
    moved = scales.value[:, None, None] * np.array([np.asarray(f, float).T for f in forces])
    sigma = scales.ln_sigma[:, None, None] * moved
    weight = abs(sigma[0].sum(1).mean()) / STANDARD_GRAVITY
    return np.einsum("kti,ktj->tij", sigma, sigma), weight
