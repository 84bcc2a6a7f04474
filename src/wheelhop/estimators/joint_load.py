"""The four wheel loads of a vehicle from a record, with their covariance.

A bank of joint filters, which differ in how fast they let the loads change, weighed by how well
each has foretold the record lately: smooth and rough stretches of road need different ones.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.estimators.joint_load_checks import (
    check_tuning,
    checked_horizontal,
    checked_sample,
)
from wheelhop.estimators.joint_load_mixture import SLOW, WheelLoads, mixed
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
from wheelhop.estimators.joint_load_scales import (
    scaled_load_filter,
    scaled_load_prior,
    scales_of,
    tell_doubts,
)
from wheelhop.filtering import Filter, Gaussian
from wheelhop.filtering.drive import Bind, constant_params, run_in_chunks
from wheelhop.vehicle.full_vehicle_parameters import as_arrays, validate
from wheelhop.vehicle.full_vehicle_state import FullVehicle
from wheelhop.vehicle.load_record import VehicleLoadSample

CHUNK = 512
"""Samples of a record that are filtered at once: every record is cut into such pieces, so that one
compiled function serves them all."""


def wheel_loads(
    sample: VehicleLoadSample,
    dt: float,
    vehicle: FullVehicle,
    tuning: JointLoadTuning | None = None,
    uninitialised: bool = False,
    on_progress: Callable[[int, int], None] | None = None,
    horizontal: tuple[np.ndarray, np.ndarray] | None = None,
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
        horizontal: a_x forward and a_y to the left, as accelerometers at the body's centre of mass
            show them (0 at rest on level ground) [m/s^2], [time], NaN in gaps of 0.1 s at most.
            Then the springs' rate about the design place and the dampers' strength need not be
            what `vehicle` says: their scales are found first, by filtering the record with the
            moments that these tell. The preload and the anti-roll bars are taken as known: springs
            that have sagged look like a payload. A record without braking or cornering tells
            little, and says so by `scale_sigma`. Scales that explain nothing are warned of.

    Raises:
        InputError: for a record that is too short, of unequal lengths, in other units, without the
            deflection of a corner or without any accelerometer, for a_x or a_y with long gaps, and
            for tuning out of range.
        DivergenceError: if the filter leaves the finite numbers; says when.
    """
    tuning = JointLoadTuning() if tuning is None else tuning
    sample = checked_sample(sample, dt)
    check_tuning(tuning)
    validate(vehicle)
    vehicle = as_arrays(vehicle)
    samples, kind = len(sample.a_s_FL), jnp.result_type(float)
    ys = VehicleLoadSample(*(entry.astype(kind) for entry in sample))
    walks = tuning.load_walks
    inputs: tuple[np.ndarray, np.ndarray] | None = None
    if horizontal is not None:
        a_x, a_y = horizontal
        inputs = (
            checked_horizontal("a_x", a_x, samples, dt).astype(kind),
            checked_horizontal("a_y", a_y, samples, dt).astype(kind),
        )
    total = (1 if inputs is None else 2) * len(walks) * samples

    def advance(before: int, done: int) -> None:
        if on_progress is not None:
            on_progress(before * samples + done, total)

    params = [joint_load_params(vehicle, dt, tuning, walk) for walk in walks]
    scales, before = None, 0
    if inputs is not None:
        find = _Finder(scaled_load_filter(), scaled_load_prior, _told)
        told = [
            _filtered(find, ys, p, inputs, uninitialised, partial(advance, k))
            for k, p in enumerate(params)
        ]
        scales = scales_of(
            np.array([[float(entry[-1]) for entry in m[0][SLOW + 1 :]] for m in told]),
            np.array([[float(entry[-1]) for entry in m[2][1:]] for m in told]),
            np.array([m[3].sum() for m in told]),
            (float(tuning.spring_doubt), float(tuning.damper_doubt)),
        )
        freedom = float(np.isfinite(np.stack(sample)).sum(0).mean())
        tell_doubts(scales, float(np.nanmin([m[4].mean() for m in told])) / freedom)
        params = [replace(p, scale=jnp.asarray(scales.value, kind)) for p in params]
        before = len(walks)
    find = _Finder(joint_load_filter(), joint_load_prior, constant_params)
    # one after the other: lanes for the bank would multiply the time to compile
    members = [
        _filtered(find, ys, p, None, uninitialised, partial(advance, before + k))
        for k, p in enumerate(params)
    ]
    return mixed(members, sample, dt, params[0], scales)


class _Finder(NamedTuple):
    """A filter, its belief before the first sample, and how it takes inputs in."""

    filter: Filter
    prior: Callable[[JointLoadParams], Gaussian]
    bind: Bind


def _filtered(
    find: _Finder,
    ys: VehicleLoadSample,
    params: JointLoadParams,
    inputs: Any,
    uninitialised: bool,
    advance: Callable[[int], None],
) -> Any:
    """What `_keep` keeps of a record, entries [time]."""
    pieces = []
    start = _first_belief(find.prior(params), params, uninitialised)
    options: dict[str, Any] = {"chunk": CHUNK, "keep": _keep, "whole": False}
    for done, kept in run_in_chunks(
        find.filter, start, ys, params, inputs=inputs, bind=find.bind, **options
    ):
        pieces.append(kept)
        advance(done)
    return jax.tree.map(lambda *piece: np.concatenate(piece).astype(float), *pieces)


def _told(params: JointLoadParams, now: Any) -> JointLoadParams:
    return replace(params, told=jnp.ones_like(params.told), a_x=now[0], a_y=now[1])


def _first_belief(prior: Gaussian, params: JointLoadParams, uninitialised: bool) -> Gaussian:
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
    slow = tuple(state.cov[k][k] for k in range(SLOW, len(state.mean)))
    return state.mean, covs, slow, info.log_likelihood, info.nis
