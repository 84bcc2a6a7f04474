"""One interface for stiffness filters that are tuned and compared on the same records."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.errors import DivergenceError, InputError
from wheelhop.filtering import Filter, Info, run_batch
from wheelhop.filtering.drive import Bind
from wheelhop.vehicle.quarter_car import Accelerations

Tuning = Mapping[str, Any]
"""Value of every knob of a candidate by name; all are positive."""


class Knob(NamedTuple):
    """A positive figure that may be tuned: where tuning starts, its unit, what it is."""

    start: float
    unit: str
    meaning: str


class Reading(NamedTuple):
    """What a filter says at one time.

    Attributes:
        stiffness: k_t [N/m].
        sigma: its standard deviation [N/m].
        probabilities: of the modes [modes].
        mode_stiffness: k_t of each mode [N/m], [modes].
    """

    stiffness: Any
    sigma: Any
    probabilities: Any
    mode_stiffness: Any


@dataclass(frozen=True)
class Records:
    """Logs of one corner, all of one length and sampling rate.

    Attributes:
        measured: accelerometers [m/s^2], entries [runs, time].
        speed: v [m/s], [runs, time].
        dt: sampling interval [s].
    """

    measured: Accelerations
    speed: Any
    dt: float

    def __len__(self) -> int:
        return int(self.speed.shape[0])

    def part(self, runs: slice | np.ndarray) -> Records:
        """Some of the runs."""
        measured = Accelerations(*(a[runs] for a in self.measured))
        return Records(measured, self.speed[runs], self.dt)


@dataclass(frozen=True)
class Candidate:
    """A filter for tyre stiffness with what may be tuned of it.

    Its functions are pure and of module level, so that candidates which differ in their setting
    only (vehicle, road classes, sampling interval) compile once.

    Attributes:
        name: what it is called in tables.
        modes: names of its modes.
        knobs: what may be tuned, by name.
        filter: any `Filter`.
        setting: pytree of numbers that its functions take and nobody tunes.
        prior: (tuning, setting, normal) -> belief before the first sample, whose mean is off by
            `normal` [states] of its standard deviations.
        params: (tuning, setting) -> parameters.
        inputs: (key, v [time], setting) -> what varies in time, leaves [time, ...].
        bind: puts the inputs of one time into the parameters.
        read: filter state -> `Reading`, elementwise.
        states: number of components of the prior's mean.
    """

    name: str
    modes: tuple[str, ...]
    knobs: Mapping[str, Knob]
    filter: Filter
    setting: Any
    prior: Callable[[Tuning, Any, Any], Any]
    params: Callable[[Tuning, Any], Any]
    inputs: Callable[[Any, Any, Any], Any]
    bind: Bind
    read: Callable[[Any], Reading]
    states: int = 5

    @property
    def default(self) -> dict[str, float]:
        """The tuning to start from."""
        return {name: knob.start for name, knob in self.knobs.items()}


class Track(NamedTuple):
    """Readings over time: entries [runs, time] or [runs, time, modes]."""

    stiffness: Any
    sigma: Any
    probabilities: Any
    mode_stiffness: Any


def checked_tuning(candidate: Candidate, tuning: Tuning | None) -> dict[str, float]:
    """The tuning, or the default for None, as numbers.

    Raises:
        InputError: naming a knob that is unknown, missing or not positive.
    """
    if tuning is None:
        return candidate.default
    for name in tuning:
        if name not in candidate.knobs:
            raise InputError(
                "tuning",
                f"{name!r} is no knob of {candidate.name}",
                f"Use {list(candidate.knobs)}.",
            )
    for name, knob in candidate.knobs.items():
        if name not in tuning:
            raise InputError(
                "tuning",
                f"{name!r} is missing",
                f"Give it, for instance {knob.start:g} {knob.unit}.",
            )
        value = float(tuning[name])
        if not (np.isfinite(value) and value > 0):
            raise InputError(f"tuning.{name}", f"{value:g}", "Give a positive number.")
    return {name: float(tuning[name]) for name in candidate.knobs}


def draw(candidate: Candidate, records: Records, keys: Any) -> tuple[Any, Any]:
    """Offsets of the initial state [runs, states], standard normal, and the filter's own inputs.

    Args:
        candidate: the filter.
        records: logs.
        keys: JAX random keys [runs]; a run's draws depend on its own key alone.
    """
    drawn = _compiled_draw(candidate.inputs, candidate.states)
    return drawn(keys, as_float(records.speed), candidate.setting)


@lru_cache(maxsize=32)
def _compiled_draw(inputs: Callable[..., Any], states: int) -> Any:
    def one(key: Any, speed: Any, setting: Any) -> tuple[Any, Any]:
        first, second = jax.random.split(key)
        return jax.random.normal(first, (states,), speed.dtype), inputs(second, speed, setting)

    return jax.jit(jax.vmap(one, in_axes=(0, 0, None)))


@lru_cache(maxsize=32)
def starter(
    filter: Filter, prior: Callable[..., Any], params: Callable[..., Any]
) -> Callable[[Tuning, Any, Any], tuple[Any, Any]]:
    """(tuning, setting, normals [runs, states]) -> states, leaves [runs, ...], and parameters."""

    def start(tuning: Tuning, setting: Any, normals: Any) -> tuple[Any, Any]:
        found = params(tuning, setting)
        return jax.vmap(lambda n: filter.init(prior(tuning, setting, n), found))(normals), found

    return start


@lru_cache(maxsize=32)
def _compiled_start(filter: Filter, prior: Any, params: Any) -> Any:
    return jax.jit(starter(filter, prior, params))


def track(
    candidate: Candidate,
    records: Records,
    keys: Any,
    tuning: Tuning | None = None,
    *,
    spread: float = 1.0,
    stride: int = 1,
    check: bool = True,
) -> Track:
    """Filter all runs.

    Args:
        candidate: the filter.
        records: logs.
        keys: JAX random keys [runs] of initial states and the filter's own inputs.
        tuning: of the filter; its default for None.
        spread: of the initial states, in standard deviations of the prior; 0 for none.
        stride: keep every so many samples, counted so that the last is kept.
        check: refuse numbers that are not finite; otherwise they are returned.

    Raises:
        InputError: for tuning that does not fit, or a stride below one.
        DivergenceError: if a combined estimate leaves the finite numbers; names the run.
    """
    if stride < 1:
        raise InputError("stride", f"{stride}", "Keep every so many samples, 1 for all.")
    tuning = as_float(checked_tuning(candidate, tuning))
    normals, inputs = draw(candidate, records, keys)
    start = _compiled_start(candidate.filter, candidate.prior, candidate.params)
    states, params = start(tuning, candidate.setting, spread * normals)
    kept = run_batch(
        candidate.filter,
        states,
        as_float(records.measured),
        params,
        inputs=inputs,
        bind=candidate.bind,
        keep=_keep(candidate.read),
        in_axes=(0, 0, None, 0),
    )
    first = (kept.stiffness.shape[1] - 1) % stride
    found = Track(*(np.asarray(leaf[:, first::stride]) for leaf in kept))
    bad = ~(np.isfinite(found.stiffness) & np.isfinite(found.sigma)).all(axis=1)
    if check and bad.any():
        raise DivergenceError(
            f"{candidate.name}: {bad.sum()} of {len(bad)} runs left the finite numbers, the first "
            f"is run {np.flatnonzero(bad)[0]}; raise the process noise in its tuning"
        )
    return found


@lru_cache(maxsize=32)
def _keep(read: Callable[[Any], Reading]) -> Callable[[Any, Info], Track]:
    """`read` as a `Keep`, one for every reader, so that equal ones compile once."""

    def keep(state: Any, info: Info) -> Track:
        del info
        return Track(*read(state))

    return keep


def constant_track(stiffness: float, sigma: float, runs: int, samples: int) -> Track:
    """What a filter that learns nothing says: its prior, at every time."""
    full = partial(np.full, (runs, samples))
    one = np.ones((runs, samples, 1))
    return Track(full(stiffness), full(sigma), one, stiffness * one)


def as_float(tree: Any) -> Any:
    """Leaves as arrays of JAX's default floating type."""
    return jax.tree.map(lambda a: jnp.asarray(a, float), tree)
