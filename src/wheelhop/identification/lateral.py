"""Fit the arctangent coefficients of a vehicle's tyres to records of cornering."""

from __future__ import annotations

import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.errors import DivergenceError, InputError, InputWarning, require_in_range
from wheelhop.estimators.lateral import LateralSample
from wheelhop.identification.descent import OnProgress
from wheelhop.identification.lateral_loss import Own, Task, coefficients, tires_of
from wheelhop.identification.lateral_quality import (
    problems_of,
    relative_covariance,
    standard_errors,
    static_stiffness,
)
from wheelhop.identification.lateral_records import Cornering, LateralNoise, cornering
from wheelhop.identification.lateral_step import (
    Descent,
    compiled_advance,
    first,
)
from wheelhop.identification.uncertainty import Uncertainty
from wheelhop.vehicle import lateral_tire, two_track
from wheelhop.vehicle.lateral_tire import NOMINAL_TIRE, ArctangentTire
from wheelhop.vehicle.two_track import TwoTrack, Wheels, wheel_loads

COEFFICIENTS = ("k1", "k2", "k3")
"""What can be fitted of a tyre."""

LAYOUTS: dict[str, tuple[tuple[str, tuple[int, ...]], ...]] = {
    "one": (("", (0, 1, 2, 3)),),
    "axles": (("front.", (0, 1)), ("rear.", (2, 3))),
    "wheels": tuple((f"{name}.", (k,)) for k, name in enumerate(Wheels._fields)),
}
"""Which wheels have a tyre in common."""

SPREAD = 1.0
"""Standard deviation of the parameters before the records are seen: a factor of e."""

# of all tyres together, and of each
_STARTS = (0.3, 0.05)


@dataclass(frozen=True)
class TireFit:
    """Fitted tyres and what is known of them.

    Attributes:
        tires: of the wheels; what was not fitted keeps its start.
        names: of the fitted coefficients, "k2" or "front.k2" or "front_left.k2", whose order all
            arrays keep.
        values: of the fitted coefficients, [n].
        uncertainty: standard errors, correlation, weak directions.
        cornering_stiffness: slope of the tyres' forces at zero slip under static load [N/rad],
            FL, FR, RL, RR: what mild cornering determines best.
        stiffness_errors: their standard errors [N/rad]; NaN where some direction is not seen.
        own: fitted initial states and offsets of the records, of arrays [records].
        rms: left over of lateral acceleration [m/s^2] and yaw rate [rad/s], [records, 2].
        start_rms: the same of the start.
        measured_rms: of the measured signals, [records, 2].
        loss: errors in units of the stated noise, rms; 1 where only noise is left.
        losses: the same of every start, [starts].
        peak: lateral acceleration that the records reached [m/s^2].
        iterations: simulations of every start.
        seconds: the fit took [s].
        problems: what speaks against the result, in plain words; empty where nothing does.
    """

    tires: Wheels
    names: tuple[str, ...]
    values: np.ndarray
    uncertainty: Uncertainty
    cornering_stiffness: np.ndarray
    stiffness_errors: np.ndarray
    own: Own
    rms: np.ndarray
    start_rms: np.ndarray
    measured_rms: np.ndarray
    loss: float
    losses: np.ndarray
    peak: float
    iterations: int
    seconds: float
    problems: tuple[str, ...]

    @property
    def covariance(self) -> np.ndarray:
        """Of ln of the fitted coefficients, for white residuals, [n, n]."""
        return relative_covariance(self.uncertainty, self.values)


def fit_tires(
    records: Sequence[LateralSample] | LateralSample,
    car: TwoTrack,
    dt: float,
    *,
    start: ArctangentTire | Wheels = NOMINAL_TIRE,
    free: Sequence[str] = ("k2", "k3"),
    layout: str = "one",
    noise: LateralNoise = LateralNoise(),
    own: Own = Own(),
    loads: str = "model",
    starts: int = 4,
    seed: int = 0,
    iterations: int = 60,
    on_progress: OnProgress | None = None,
) -> TireFit:
    """Fit coefficients of Solmaz, Eq. 3, by the errors of a simulation driven by steer and speed.

    What records can tell, by how hard they corner:
     - mild: the cornering stiffness (k1 - F_z / k2) k3 F_z of the tyres under static load;
     - with load transfer, or one tyre under axles of unequal load: k1 k2 and k1 k3;
     - with slip beyond the linear: k1 too, as c k1, k2 / c, k3 / c have equal stiffness under every
       load for every c, but bend at another slip. By default k1 is held, as all tyres of the paper
       have k1 = 1; k2 and k3 are as right as that. Friction is such a c: the coefficients hold
       for the road of the records.
    Standard errors are linear in ln of the coefficients: beyond some per cent only their size
    counts.

    Args:
        records: of entries [time] each, or one of [time] or [records, time]; NaN where a sample
            is missing. Steer and speed are taken as exact but for the offset in `own`.
        car: the vehicle.
        dt: sampling interval [s].
        start: tyre to begin from, of all wheels or `Wheels` of them.
        free: coefficients to fit; the others keep their start.
        layout: "one" tyre for all wheels, "axles" or "wheels".
        noise: of the sensors, which weighs them against each other.
        own: what every record has of its own: initial state and, if wanted, offsets.
        loads: "model", of the simulated lateral acceleration, or "measured", whose noise is then
            part of the model and biases k2 where the load transfer is small.
        starts: starting points, the given one and random ones around it.
        seed: of the random ones.
        iterations: most simulations of a start.
        on_progress: told after every iteration, with the best `loss`.

    Returns:
        The best fit. What speaks against it is in `problems`, and told as an `InputWarning`.

    Raises:
        InputError: for records or settings that cannot be used.
        DivergenceError: if no start gave a finite simulation.
    """
    if loads not in ("measured", "model"):
        raise InputError("loads", f"{loads!r} is unknown", "Use 'measured' or 'model'.")
    for name, value in (("starts", starts), ("iterations", iterations)):
        if value < 1:
            raise InputError(name, f"{value}", "Give at least 1.")
    for name, high, unit in zip(Own._fields, (1.0, 5.0, 10.0, 1.0, 0.5), _OWN_UNITS, strict=True):
        require_in_range(f"own.{name}", getattr(own, name), 0.0, high, unit)
    two_track.validate(car)
    names, assigned = _parameters(free, layout)
    begin = start if isinstance(start, Wheels) else Wheels(start, start, start, start)
    for name, tire in zip(Wheels._fields, begin, strict=True):
        lateral_tire.validate(f"start.{name}", tire)
    prepared = cornering(records, dt, noise, loads)
    task = _task(prepared, begin, assigned, noise, own, car)
    theta = _starting_points(starts, len(free), len(names), seed)
    clock = time.perf_counter()
    found, start_sums, done = _descend(theta, prepared, task, loads, iterations, on_progress)
    seconds = time.perf_counter() - clock
    if not np.isfinite(found.loss).any():
        raise DivergenceError(
            f"none of {starts} starts gave a finite simulation; start from tyres under which the "
            "vehicle is stable, or check the records' units"
        )
    fit = _result(found, start_sums, prepared, task, names, noise, done, seconds)
    for problem in fit.problems:
        warnings.warn(f"tyre fit: {problem}", InputWarning, stacklevel=2)
    return fit


_OWN_UNITS = ("rad", "rad/s", "m/s^2", "rad/s", "rad")


def _parameters(free: Sequence[str], layout: str) -> tuple[tuple[str, ...], np.ndarray]:
    """Names of the fitted numbers, and the coefficients that each moves, [4, 3, n]."""
    if layout not in LAYOUTS:
        raise InputError("layout", f"{layout!r} is unknown", f"Use one of {', '.join(LAYOUTS)}.")
    if not free or len(set(free)) != len(free) or not set(free) <= set(COEFFICIENTS):
        raise InputError("free", f"{list(free)}", "Name each of k1, k2, k3 that is wanted once.")
    names: list[str] = []
    columns = []
    for group, wheels in LAYOUTS[layout]:
        for coefficient in free:
            column = np.zeros((4, 3))
            column[list(wheels), COEFFICIENTS.index(coefficient)] = 1.0
            names.append(group + coefficient)
            columns.append(column)
    return tuple(names), np.stack(columns, axis=-1)


def _task(
    prepared: Cornering,
    begin: Wheels,
    assigned: np.ndarray,
    noise: LateralNoise,
    own: Own,
    car: TwoTrack,
) -> Task:
    k = np.array([[float(tire.k1), float(tire.k2), float(tire.k3)] for tire in begin])
    static = np.array(wheel_loads(0.0, car))
    shared = (np.einsum("wcn,vcn->wv", assigned, assigned) > 0.0).astype(float)
    load = shared @ static / shared.sum(1)
    light = assigned.sum(-1)[:, 1] * (k[:, 0] * k[:, 1] <= 1.01 * load) > 0
    if light.any():
        wheel = int(np.argmax(light))
        raise InputError(
            f"start.{Wheels._fields[wheel]}",
            f"k1 k2 = {k[wheel, 0] * k[wheel, 1]:.4g} N is no more than the static load, "
            f"{load[wheel]:.4g} N, so that the tyre has no force",
            "Start from a larger k2.",
        )
    weight = prepared.counted / np.array([noise.lateral_acceleration, noise.yaw_rate])
    own_scale = np.array(own, float)
    drive, interval = prepared.drive, prepared.interval
    task = Task(k, assigned, load, drive, weight, interval, own_scale, SPREAD, car)
    return jax.tree.map(lambda a: jnp.asarray(a, jnp.result_type(float)), task)


def _descend(
    theta: np.ndarray,
    prepared: Cornering,
    task: Task,
    loads: str,
    iterations: int,
    on_progress: OnProgress | None,
) -> tuple[Descent, Any, int]:
    """Steps of all starts [starts, n] until all have converged; also the start's sums."""
    state = jax.vmap(lambda t: first(t, task, prepared.blocks))(
        jnp.asarray(theta, task.weight.dtype)
    )
    advance = compiled_advance(loads)
    start_sums: Any = None
    done = 0
    while done < iterations:
        state = advance(state, task)
        done += 1
        if start_sums is None:
            start_sums = jax.tree.map(lambda a: np.asarray(a[0]), state.sums)
        if on_progress is not None:
            on_progress(done, iterations, float(_errors(state, prepared).min()))
        if _agreed(state):
            break
    return jax.tree.map(np.asarray, state), start_sums, done


def _agreed(state: Descent) -> bool:
    """Whether the best start and another have converged to the same loss, or no start can go on."""
    loss = np.where(np.isfinite(state.loss), state.loss, np.inf)
    converged = np.asarray(state.converged)
    there = converged & (loss <= loss.min() + 1e-4 * (1.0 + loss.min()))
    stuck = np.asarray(state.damping) > 1e9
    return bool(there.sum() > 1 or (converged | stuck).all())


def _starting_points(starts: int, coefficients: int, n: int, seed: int) -> np.ndarray:
    """The given start and random ones around it, [starts, n], with tyres nearly alike."""
    random = np.random.default_rng(seed)
    alike = np.tile(random.normal(size=(starts, coefficients)), n // coefficients)
    theta = _STARTS[0] * alike + _STARTS[1] * random.normal(size=(starts, n))
    theta[0] = 0.0
    return theta


def _errors(state: Descent, prepared: Cornering) -> np.ndarray:
    """Errors of every start in units of noise, rms, [starts]."""
    mean = np.asarray(state.sums.squares).sum((1, 2)) / prepared.counted.sum()
    return np.where(np.isfinite(state.loss), np.sqrt(mean), np.inf)


def _result(
    found: Descent,
    start_sums: Any,
    prepared: Cornering,
    task: Task,
    names: tuple[str, ...],
    noise: LateralNoise,
    done: int,
    seconds: float,
) -> TireFit:
    best = int(np.argmin(np.where(np.isfinite(found.loss), found.loss, np.inf)))
    theta = jnp.asarray(found.theta[best])
    tires = jax.tree.map(float, tires_of(theta, task))
    k = np.asarray(coefficients(theta, task))
    at = [tuple(np.argwhere(np.asarray(task.assigned)[..., n])[0]) for n in range(len(names))]
    wheel, which = np.array(at).T
    values = k[wheel, which]
    sums = jax.tree.map(lambda a: a[best], found.sums)
    slopes = np.asarray(jax.jacfwd(lambda t: jnp.log(coefficients(t, task)))(theta))
    known = standard_errors(sums, prepared, values, slopes[wheel, which], names)
    stiffness, errors = static_stiffness(tires, task, known, values)
    scale = np.array([noise.lateral_acceleration, noise.yaw_rate])
    counts = np.maximum(prepared.counted.sum(1), 1)
    own = np.asarray(found.own[best]) * np.asarray(task.own)
    rms = scale * np.sqrt(sums.squares / counts)
    losses = _errors(found, prepared)
    loss = float(losses[best])
    return TireFit(
        tires=tires,
        names=names,
        values=values,
        uncertainty=known,
        cornering_stiffness=stiffness,
        stiffness_errors=errors,
        own=Own(*own.T),
        rms=rms,
        start_rms=scale * np.sqrt(start_sums.squares / counts),
        measured_rms=prepared.measured_rms,
        loss=loss,
        losses=losses,
        peak=prepared.peak,
        iterations=done,
        seconds=seconds,
        problems=problems_of(found, best, sums, prepared, names, known, loss),
    )
