"""What wrong springs and dampers do to the estimates while braking: Fig. 8 and 9."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from wheelhop.estimators.joint_load import wheel_loads
from wheelhop.studies.filipozzi.drives import (
    BRAKE_DAMPING,
    BRAKE_DIGRESSIVE,
    BRAKE_STIFFNESS,
    Drive,
    cases,
    drives,
)
from wheelhop.studies.filipozzi.maneuvers import JOINT, joint_sample, joint_tuning
from wheelhop.studies.filipozzi.methods import (
    PERFECT,
    UNBIASED,
    YOULA,
    Observed,
    Signals,
    counted_from_free,
    observed,
)
from wheelhop.studies.filipozzi.settings import BRAKE_BEGIN, FACTORS, FilipozziSettings
from wheelhop.studies.filipozzi.vehicles import paper_vehicle
from wheelhop.studies.frame import Advance, Store
from wheelhop.vehicle.corner_suspension import CornerSuspension, corner_suspensions
from wheelhop.vehicle.full_vehicle import FullVehicle

FREE, REST = "from the free spring", "from rest"
"""What deflections are counted from: wrong springs spoil the static load with the first alone."""

METHODS = (YOULA, UNBIASED)

FITTED = f"{JOINT}, springs found"
"""The joint filter that finds how stiff springs and dampers are."""

TRANSIENT = 1.0
"""Duration after the brakes are stepped on that counts as transient [s]."""


class Robustness(NamedTuple):
    """Results; loads [time, 4] N.

    Attributes:
        settings: that made them.
        drives: what truly happened, by name.
        stiffness: by what deflections are counted from, factor and method.
        damping: by factor and method.
        digressive: by method, and `JOINT`, which knows the damper.
        joint: what the joint filter says that believes in springs x 1, deflections counted from
            the design place, by the factor of the plant's springs.
        fitted: the same of `FITTED`.
        fitted_damping: of `FITTED`, by the factor of the plant's dampers.
        linear: what the estimators believe of the corners, leaves [4].
        plant: that has the digressive dampers.
    """

    settings: FilipozziSettings
    drives: dict[str, Drive]
    stiffness: dict[str, dict[float, dict[str, np.ndarray]]]
    damping: dict[float, dict[str, np.ndarray]]
    digressive: dict[str, np.ndarray]
    joint: dict[float, JointBelief]
    fitted: dict[float, JointBelief]
    fitted_damping: dict[float, JointBelief]
    linear: CornerSuspension
    plant: FullVehicle


class JointBelief(NamedTuple):
    """Of the joint filter.

    Attributes:
        load: [time, 4] N.
        sigma: standard deviation that it states, [time, 4] N.
        surprise: normalised innovation squared per its freedom, about one where all fits, [time].
        scale: of springs and of dampers, per those believed in, at the end, [2].
        scale_sigma: its standard deviation, [2]; zeros where they are taken as known.
    """

    load: np.ndarray
    sigma: np.ndarray
    surprise: np.ndarray
    scale: np.ndarray
    scale_sigma: np.ndarray


class Transfer(NamedTuple):
    """Load that the brakes move onto the front left wheel.

    Attributes:
        true, estimated: mean over the last half second less that before braking [N].
        offset: error before braking [N].
        transient: rms error in the `TRANSIENT` after the brakes come on, of the change [N].
        steady: error of the change over the last half second [N].
    """

    true: float
    estimated: float
    offset: float
    transient: float
    steady: float


def robustness(settings: FilipozziSettings, store: Store, advance: Advance) -> Robustness:
    """Estimate the loads of every braking with the springs and dampers of one vehicle.

    Args:
        settings: of the study.
        store: of what is finished.
        advance: told of the cases.
    """
    driven = drives(settings, store, lambda done, of: None)
    names = [*BRAKE_STIFFNESS.values(), *BRAKE_DAMPING.values(), BRAKE_DIGRESSIVE]
    linear = corner_suspensions(paper_vehicle())
    depends = (settings.seed, settings.rate, settings.bandwidth, settings.quick)
    total = 6 * len(FACTORS) + 1
    stiffness: dict[str, dict[float, dict[str, np.ndarray]]] = {FREE: {}, REST: {}}
    done = 0
    for factor in FACTORS:
        for counted, found in stiffness.items():
            advance(done, total)
            believed = counted_from_free(linear, factor) if counted == FREE else linear
            work = partial(_observed, driven[BRAKE_STIFFNESS[factor]], believed, settings)
            kept = f"stiffness_{factor:g}_{counted.split()[-1]}"
            found[factor] = store.arrays(kept, depends, work)
            done += 1
    joint = {}
    for factor in FACTORS:
        advance(done, total)
        work = partial(_joint, driven[BRAKE_STIFFNESS[factor]], settings)
        joint[factor] = JointBelief(**store.arrays(f"joint_{factor:g}", depends, work))
        done += 1
    fitted: dict[str, dict[float, JointBelief]] = {"stiffness": {}, "damping": {}}
    for factor in FACTORS:
        for kind, by_factor in (("stiffness", BRAKE_STIFFNESS), ("damping", BRAKE_DAMPING)):
            advance(done, total)
            work = partial(_joint, driven[by_factor[factor]], settings, told=True)
            told = store.arrays(f"fitted_{kind}_{factor:g}", depends, work)
            fitted[kind][factor] = JointBelief(**told)
            done += 1
    damping = {}
    for factor in FACTORS:
        advance(done, total)
        work = partial(_observed, driven[BRAKE_DAMPING[factor]], linear, settings)
        damping[factor] = store.arrays(f"damping_{factor:g}", depends, work)
        done += 1
    advance(done, total)
    plant = cases(settings)[BRAKE_DIGRESSIVE].vehicle
    work = partial(_with_joint, driven[BRAKE_DIGRESSIVE], linear, plant, settings)
    digressive = store.arrays("digressive", depends, work)
    advance(total, total)
    own = {name: driven[name] for name in names}
    return Robustness(
        settings,
        own,
        stiffness,
        damping,
        digressive,
        joint,
        fitted["stiffness"],
        fitted["damping"],
        linear,
        plant,
    )


def transfer(drive: Drive, load: np.ndarray) -> Transfer:
    """What an estimate [time, 4] N says of the front left wheel."""
    t = drive.t
    before = (t > 0.5 * BRAKE_BEGIN) & (t < BRAKE_BEGIN)
    # an estimator with a delay has no last sample
    end = (t >= t[-1] - 0.5) & np.isfinite(load[:, 0])
    true, found = drive.load[:, 0], load[:, 0]
    true_change, change = true - true[before].mean(), found - found[before].mean()
    after = (t >= BRAKE_BEGIN) & (t < BRAKE_BEGIN + TRANSIENT)
    off = change - true_change
    return Transfer(
        float(true_change[end].mean()),
        float(change[end].mean()),
        float((found - true)[before].mean()),
        float(np.sqrt(np.mean(off[after] ** 2))),
        float(off[end].mean()),
    )


def _observed(
    drive: Drive, believed: CornerSuspension, settings: FilipozziSettings
) -> dict[str, np.ndarray]:
    signals = Signals(drive.body_acceleration, drive.compression)
    dt = 1.0 / settings.rate

    def one(method: str) -> Observed:
        return observed(method, signals, believed, dt, settings.bandwidth)

    return {method: one(method).load for method in METHODS}


def _joint(drive: Drive, settings: FilipozziSettings, told: bool = False) -> dict[str, np.ndarray]:
    sample, tuning = joint_sample(drive, False), joint_tuning(PERFECT)
    horizontal = (drive.a_x, drive.a_y) if told else None
    found = wheel_loads(sample, 1.0 / settings.rate, paper_vehicle(), tuning, horizontal=horizontal)
    scale, sigma = np.ones(2), np.zeros(2)
    if found.scale is not None and found.scale_sigma is not None:
        scale, sigma = found.scale, found.scale_sigma
    surprise = found.nis / found.freedom
    return JointBelief(found.load, found.sigma, surprise, scale, sigma)._asdict()


def _with_joint(
    drive: Drive, believed: CornerSuspension, plant: FullVehicle, settings: FilipozziSettings
) -> dict[str, np.ndarray]:
    found: dict[str, Any] = _observed(drive, believed, settings)
    sample, dt, tuning = joint_sample(drive, False), 1.0 / settings.rate, joint_tuning(PERFECT)
    known = wheel_loads(sample, dt, plant, tuning)
    blind = replace(plant, strut=paper_vehicle().strut)
    linear = wheel_loads(sample, dt, blind, tuning)
    return {**found, JOINT: known.load, f"{JOINT}, linear damper": linear.load}
