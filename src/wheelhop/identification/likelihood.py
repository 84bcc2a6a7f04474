"""Log-likelihood of records on unknown roads, with score and information, in one pass."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from wheelhop.estimators.road_model import RoadModelParams, corner_on_road, prior
from wheelhop.filtering import Filter, extended, unscented
from wheelhop.filtering.sensitivity import information_columns
from wheelhop.identification.parameters import SearchSpace
from wheelhop.staging import staged_jit
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.quarter_car import Accelerations

FILTERS: dict[str, Callable[..., Filter]] = {"extended": extended, "unscented": unscented}
"""Filters that the likelihood can be that of."""

LEVEL = 16e-6
"""Road level Gd(W0) [m^3/rad] of free number 0: class C."""


@dataclass(frozen=True)
class Fitted:
    """What is fitted beside the car, and how: everything a compilation depends on.

    Attributes:
        space: the car's parameters.
        waviness: whether the road's waviness is fitted.
        noise: whether the accelerometers' noise is fitted.
        coloured: whether the road has shaping states.
        filter: key of `FILTERS`.
        substeps: integration steps per sampling interval.
    """

    space: SearchSpace
    waviness: bool
    noise: bool
    coloured: bool
    filter: str
    substeps: int

    @property
    def shared(self) -> int:
        """Number of free numbers that all records share; each has its level as one more."""
        return len(self.space.names) + self.waviness + 2 * self.noise


class Given(NamedTuple):
    """What is not fitted: arrays only.

    Attributes:
        base: car whose other parameters hold.
        waviness: of the road, where it is not fitted.
        noise: of a_s and a_u [m/s^2], where it is not fitted, [2].
    """

    base: QuarterCar
    waviness: Any
    noise: Any


class Course(NamedTuple):
    """Records in blocks, leaves [blocks, samples, records], dt [records].

    Attributes:
        a_s, a_u: measured accelerations [m/s^2], NaN where missing.
        speed: [m/s].
        pressure: [Pa].
        count: 1 where a sample's likelihood counts, else 0.
        dt: sampling interval [s].
    """

    a_s: Any
    a_u: Any
    speed: Any
    pressure: Any
    count: Any
    dt: Any


class LikelihoodSums(NamedTuple):
    """Sums over the samples that count, by block, record and start.

    Attributes:
        log_likelihood: [blocks, records, starts].
        nis: sum of the normalised innovations squared, likewise.
        entries: number of measured entries, likewise.
        score: by the p free numbers of that record, [blocks, p, records, starts].
        information: their expected information, [blocks, p, p, records, starts].
    """

    log_likelihood: Any
    nis: Any
    entries: Any
    score: Any
    information: Any


def filter_of(fitted: Fitted) -> Filter:
    """The filter whose likelihood is meant."""
    return FILTERS[fitted.filter](corner_on_road(fitted.coloured, fitted.substeps))


def model_params(
    free: Any, fitted: Fitted, given: Given, speed: Any, pressure: Any, dt: Any
) -> RoadModelParams:
    """Parameters of the model from the free numbers of one record.

    Args:
        free: the car's, then [ln(w - 1) - ln(3 - w)], then [ln noise_a_s, ln noise_a_u], then
            ln Gd(W0) / LEVEL; entries of any one shape.
        fitted: what is fitted.
        given: the rest.
        speed, pressure, dt: at the sample.
    """
    n = len(fitted.space.names)
    waviness = waviness_of(free[n]) if fitted.waviness else given.waviness
    noise = [jnp.exp(f) for f in free[-3:-1]] if fitted.noise else given.noise
    return RoadModelParams(
        car=fitted.space.car(free, given.base),
        level=LEVEL * jnp.exp(free[-1]),
        waviness=waviness,
        noise_a_s=noise[0],
        noise_a_u=noise[1],
        speed=speed,
        pressure=pressure,
        dt=dt,
    )


def waviness_of(free: Any) -> Any:
    """Waviness, between 1 and 3, of its free number."""
    return 1.0 + 2.0 * jax.nn.sigmoid(free)


@lru_cache(maxsize=16)
def compiled_sums(fitted: Fitted) -> Callable[[Any, Course, Given], LikelihoodSums]:
    """`likelihood_sums` as a compiled function of (free, course, given)."""
    return staged_jit(lambda free, course, given: likelihood_sums(free, course, given, fitted))


def likelihood_sums(free: Any, course: Course, given: Given, fitted: Fitted) -> LikelihoodSums:
    """Sums of log-likelihood, score and expected information, derivatives carried forward.

    With innovation r, its covariance S and their derivatives r_i, S_i by the free numbers,
    info_ij = r_i' S^-1 r_j + 1/2 tr(S^-1 S_i S^-1 S_j).

    Args:
        free: free numbers of every record and start, [p, records, starts].
        course: the records.
        given: what is not fitted.
        fitted: what is.
    """
    p, records, starts = free.shape
    lanes = records * starts
    theta = free.reshape(p, lanes)
    units = jnp.broadcast_to(jnp.eye(p, dtype=free.dtype)[:, :, None], (p, p, lanes))
    filter = filter_of(fitted)

    def spread(leaf: Any) -> Any:
        return jnp.repeat(leaf, starts, axis=-1)

    course = jax.tree.map(spread, course)
    zero = jnp.zeros((lanes,), free.dtype)

    def still(theta: Any) -> RoadModelParams:
        found = model_params(tuple(theta), fitted, given, zero, zero, course.dt)
        return jax.tree.map(lambda a: jnp.asarray(a, free.dtype) + zero, found)

    def begin(params: RoadModelParams) -> Any:
        return filter.init(prior(params, fitted.coloured), params)

    params, along = jax.linearize(still, theta)
    slopes = jax.vmap(along)(units)
    state, along = jax.linearize(begin, params)
    tangents = jax.vmap(along)(slopes)

    def advance(state: Any, tangents: Any, params: Any, slopes: Any, now: Any) -> Any:
        a_s, a_u, speed, pressure = now

        def step(state: Any, params: Any) -> Any:
            bound = replace(params, speed=speed, pressure=pressure)
            new, info = filter.step(state, Accelerations(a_s, a_u), bound)
            kept = (info.innovation, info.innovation_cov, info.log_likelihood)
            return (new, kept), (info.nis, info.flags.missing)

        def push(tangent: Any, slope: Any) -> Any:
            return jax.jvp(step, (state, params), (tangent, slope), has_aux=True)

        (state, kept), (tangents, by), (nis, missing) = jax.vmap(push, out_axes=(None, 0, None))(
            tangents, slopes
        )
        columns = information_columns(kept[1], by[0], by[1])
        return state, tangents, (kept[2], nis, 2 - missing, by[2], columns)

    def add(total: Any, found: Any, count: Any) -> Any:
        value, nis, entries, score, columns = found
        information = total[4]
        for c in columns:
            c = count[None] * c
            information = information + c[:, None] * c[None, :]
        return (
            total[0] + count * value,
            total[1] + count * nis,
            total[2] + count * entries.astype(count.dtype),
            total[3] + count[None] * score,
            information,
        )

    def sample(carry: Any, now: Any) -> tuple[Any, None]:
        state, tangents, total = carry
        *measured, count = now
        state, tangents, found = advance(state, tangents, params, slopes, tuple(measured))
        return (state, tangents, add(total, found, count)), None

    def block(carry: Any, piece: Any) -> tuple[Any, Any]:
        empty = (
            zero,
            zero,
            zero,
            jnp.zeros((p, lanes), free.dtype),
            jnp.zeros((p, p, lanes), free.dtype),
        )
        (state, tangents, total), _ = jax.lax.scan(sample, (*carry, empty), piece)
        return (state, tangents), total

    sums = jax.lax.scan(block, (state, tangents), tuple(course)[:-1])[1]
    return LikelihoodSums(*(s.reshape(*s.shape[:-1], records, starts) for s in sums))
