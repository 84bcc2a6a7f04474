"""Stiffness of one corner whose road and tyre may change abruptly: an IMM of RML filters.

Two assumptions on the road. `continuous`: its level may be anything, and the modes are what
changes - nothing, the road, or the tyre. `classes`: its level is that of an ISO 8608 class
exactly, and the modes are the classes, each with a tyre that holds or changes. See `changing_modes`
for why these and not others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.errors import InputError, require_in_range
from wheelhop.estimators.stiffness import (
    StiffnessTuning,
    stiffness_filter,
    stiffness_params,
    stiffness_prior,
    validate_tuning,
)
from wheelhop.filtering import Filter, InteractingParams, SensitivityPrior, interacting
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.road import class_level


@dataclass(frozen=True)
class ChangeTuning:
    """How roads and tyres change.

    Attributes:
        road_every: mean time [s] from one abrupt change of the road to the next.
        road_lasts: mean time [s] that the filter looks for the new level.
        road_walk: random walk of ln G meanwhile [1/sqrt(s)].
        tyre_every: mean time [s] from one change of the tyre to the next.
        tyre_lasts: mean time [s] that a change takes.
        tyre_walk: random walk of ln k_t meanwhile [1/sqrt(s)].
        class_sigma: of ln G about its class, for exact classes.
    """

    road_every: float = 20.0
    road_lasts: float = 0.1
    road_walk: float = 10.0
    tyre_every: float = 500.0
    tyre_lasts: float = 1.0
    tyre_walk: float = 0.15
    class_sigma: float = 0.02


EXACT_CLASSES = ChangeTuning(tyre_every=20.0, tyre_walk=0.1)
"""For a road of exact classes, which no change of the tyre can be mistaken for."""

_RANGES = {
    "road_every": (0.1, 1e9, "s"),
    "road_lasts": (0.01, 100.0, "s"),
    "road_walk": (0.0, 1e3, "1/sqrt(s)"),
    "tyre_every": (0.1, 1e9, "s"),
    "tyre_lasts": (0.01, 1e3, "s"),
    "tyre_walk": (0.0, 10.0, "1/sqrt(s)"),
    "class_sigma": (0.0, 5.0, "(no unit)"),
}


def validate_changes(changes: ChangeTuning) -> ChangeTuning:
    """The same tuning, checked.

    Raises:
        InputError: naming the figure that is out of range.
    """
    for field in fields(changes):
        low, high, unit = _RANGES[field.name]
        require_in_range(f"changes.{field.name}", getattr(changes, field.name), low, high, unit)
    return changes


class Modes(NamedTuple):
    """Modes of an IMM of RML filters.

    Attributes:
        names: of the modes.
        levels: Gd(W0) [m^3/rad] from which ln G deviates, [modes].
        stiffness_walks: of ln k_t [1/sqrt(s)], [modes].
        level_walks: of ln G [1/sqrt(s)], [modes].
        transition: Pz, [modes, modes].
        initial: probabilities before the first sample, [modes].
    """

    names: tuple[str, ...]
    levels: np.ndarray
    stiffness_walks: np.ndarray
    level_walks: np.ndarray
    transition: np.ndarray
    initial: np.ndarray


def changing_modes(
    dt: float,
    tuning: StiffnessTuning = StiffnessTuning(),
    changes: ChangeTuning = ChangeTuning(),
    classes: Sequence[str] = (),
) -> Modes:
    """The modes for a road of any level, or of exact classes.

    Measured on one corner (48 runs, 130-230 kPa, 40-80 km/h, 0.5 m/s^2), rms error in kPa: at 20 s
    on roads of any level; largest after a step of 3 dB of the road, and after 50 kPa lost in 1.5 s:

        modes                                          any level (NEES)   3 dB    leak
        classes exactly, tyre holds / changes          56 (57)            -       -
        classes, sd of ln G 0.7, tyre holds / changes  10.6 (0.8)         -       -
        changes: road every 1000 s, tyre every 20 s    10.3 (0.5)         80      35, 11 after 3.5 s
        changes: road every 100 s, tyre every 100 s     9.8 (0.6)         45      45, 27 after 3.5 s
        changes: road every 20 s, tyre every 500 s      9.9 (0.8)         18      47, 33 after 3.5 s

    Classes are wrong between them, and with a wide prior five modes more for nothing; a change of
    road from A to D or back costs none of them more than a second. The last three differ in what
    a lone corner believes of a change that it cannot tell apart, since k_t^2 G changes alike. Roads
    change more often than tyres burst: the last is the default. The 18 kPa are what the error was
    before the step. On exact classes nothing can be mistaken: there the tyre's modes are cheap and
    a leak is followed within a second (`EXACT_CLASSES`). The level of every mode is free about its
    class, ln k_t is mixed, and no run of 2,400 stayed on a wrong ridge of k_t^2 G: the prior on the
    pressure and the limit on a step of theta suffice.

    Args:
        dt: sampling interval [s].
        tuning: of the members.
        changes: how roads and tyres change.
        classes: ISO 8608 classes, of which the road has one exactly; none: a road of any level.

    Raises:
        InputError: if a figure is out of range, or a change shorter than the sampling interval.
    """
    validate_changes(changes)
    for name in ("tyre_lasts",) if classes else ("road_lasts", "tyre_lasts"):
        require_in_range(f"changes.{name}", getattr(changes, name), dt, _RANGES[name][1], "s")
    if classes:
        return _class_modes(dt, tuning, changes, tuple(classes))
    road, tyre = dt / changes.road_every, dt / changes.tyre_every
    road_ends, tyre_ends = dt / changes.road_lasts, dt / changes.tyre_lasts
    transition = np.array(
        [
            [1.0 - road - tyre, road, tyre],
            [road_ends, 1.0 - road_ends, 0.0],
            [tyre_ends, 0.0, 1.0 - tyre_ends],
        ]
    )
    steady, still = tuning.stiffness_walk, tuning.level_walk
    return Modes(
        ("steady", "road changes", "tyre changes"),
        np.full(3, tuning.prior_level),
        np.array([steady, steady, changes.tyre_walk]),
        np.array([still, changes.road_walk, still]),
        transition,
        transition[0],
    )


def _class_modes(
    dt: float, tuning: StiffnessTuning, changes: ChangeTuning, classes: tuple[str, ...]
) -> Modes:
    n = len(classes)
    leave, tyre, ends = dt / changes.road_every, dt / changes.tyre_every, dt / changes.tyre_lasts
    roads = np.full((n, n), leave / max(n - 1, 1))
    np.fill_diagonal(roads, 1.0 - leave if n > 1 else 1.0)
    tyres = np.array([[1.0 - tyre, tyre], [ends, 1.0 - ends]])
    return Modes(
        tuple(f"{c}{state}" for c in classes for state in ("", ", tyre changes")),
        np.repeat([class_level(c) for c in classes], 2),
        np.tile([tuning.stiffness_walk, changes.tyre_walk], n),
        np.zeros(2 * n),
        np.kron(roads, tyres),
        np.kron(np.full(n, 1.0 / n), tyres[0]),
    )


def changing_filter(dt: float, free: Sequence[str] = (), inner: str = "extended") -> Filter:
    """IMM of recursive maximum likelihood filters; arguments as `stiffness_filter`."""
    return _interacting(stiffness_filter(dt, tuple(free), inner))


@lru_cache(maxsize=16)
def _interacting(member: Filter) -> Filter:
    return interacting(member)


def changing_params(
    car: QuarterCar,
    speed: float,
    dt: float,
    tuning: StiffnessTuning = StiffnessTuning(),
    changes: ChangeTuning = ChangeTuning(),
    classes: Sequence[str] = (),
    free: Sequence[str] = (),
    waviness: float = 2.0,
) -> InteractingParams:
    """Parameters of `changing_filter`.

    Args:
        car, speed, dt, tuning, free, waviness: as in `stiffness_params`.
        changes: how roads and tyres change.
        classes: as in `changing_modes`.
    """
    modes = changing_modes(dt, validate_tuning(tuning), changes, classes)
    members = [
        stiffness_params(
            car,
            speed,
            dt,
            replace(tuning, prior_level=level, stiffness_walk=stiff, level_walk=rough),
            free,
            waviness,
        )
        for level, stiff, rough in zip(
            modes.levels, modes.stiffness_walks, modes.level_walks, strict=True
        )
    ]
    stacked = jax.tree.map(lambda *a: jnp.stack(a), *members)
    return InteractingParams(
        stacked, jnp.asarray(modes.transition, float), jnp.asarray(modes.initial, float)
    )


def changing_prior(
    params: InteractingParams,
    tuning: StiffnessTuning = StiffnessTuning(),
    changes: ChangeTuning = ChangeTuning(),
    classes: Sequence[str] = (),
    free: Sequence[str] = (),
) -> SensitivityPrior:
    """Belief before the first sample; see `stiffness_prior`."""
    first = jax.tree.map(lambda a: a[0], params.members)
    if classes:
        tuning = replace(tuning, prior_level_sigma=changes.class_sigma)
    return stiffness_prior(first, tuning, free)


def bind_speed(params: InteractingParams, speed: Any) -> InteractingParams:
    """The parameters at a time of speed [m/s]."""
    inner = params.members.inner
    speed = jnp.asarray(speed, inner.speed.dtype)
    every = jnp.broadcast_to(speed[None], (inner.speed.shape[0], *speed.shape))
    return replace(params, members=replace(params.members, inner=replace(inner, speed=every)))


def check_classes(classes: Sequence[str]) -> tuple[str, ...]:
    """The classes, checked.

    Raises:
        InputError: if one is unknown or given twice.
    """
    found = tuple(classes)
    if len(set(found)) != len(found):
        raise InputError("classes", f"{found}", "Give each class once.")
    for name in found:
        class_level(name)
    return found
