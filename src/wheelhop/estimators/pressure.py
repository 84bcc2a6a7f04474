"""Tyre pressure from an estimate of ln k_t, with its uncertainty and its known corrections."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp

from wheelhop.vehicle.tire import Tire, pressure_from_stiffness, stiffness_from_pressure
from wheelhop.vehicle.vertical_tire import (
    VerticalTire,
    deflection_at_load,
    effective_radius,
    vertical_load,
)

LOWEST_TRUSTED, HIGHEST_TRUSTED = 0.4, 1.6
"""Pressures between which the linear law is trusted, relative to the nominal pressure [-]."""

WIDEST_TRUSTED = 0.15
"""Standard deviation of ln k_t up to which the delta method is trusted [-]: at 0.15 the mean of
k_t lies 1.1 % above the exponential of the mean of ln k_t."""

_RADIUS_ITERATIONS = 4
_Law = TypeVar("_Law", Tire, VerticalTire)


class StiffnessBelief(NamedTuple):
    """What an estimator knows of the stiffness of one to four tyres.

    Attributes:
        mean: of ln k_t, k_t in N/m, [..., wheels].
        cov: its covariance, [..., wheels, wheels]; NaN where a wheel has no belief.
    """

    mean: Any
    cov: Any


class PressureBelief(NamedTuple):
    """Pressure of one to four tyres.

    Attributes:
        mean: p [Pa], [..., wheels].
        cov: its covariance [Pa^2], [..., wheels, wheels].
        trusted: whether law and delta method hold there, [..., wheels].
    """

    mean: Any
    cov: Any
    trusted: Any


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Operation:
    """What a tyre works under, each [..., wheels] or [].

    Attributes:
        load: static load F_z [N].
        speed: v [m/s].
        pressure: p [Pa]; the relative effect of load depends weakly on it.
    """

    load: Any
    speed: Any
    pressure: Any


def ln_stiffness(pressure: Any, tire: Tire) -> Any:
    """ln k_t of the tyre's law at a pressure [Pa], any shape that the tyre broadcasts to."""
    pressure = jnp.asarray(pressure, jnp.result_type(float, pressure))
    return jnp.log(stiffness_from_pressure(pressure, _like(tire, pressure)))


def pressure_belief(stiffness: StiffnessBelief, tire: Tire) -> PressureBelief:
    """Pressure and its covariance by the delta method.

    p = p(exp(m)), cov_ij = p'_i k_i p'_j k_j Sigma_ij. It is not trusted where p leaves
    `LOWEST_TRUSTED` to `HIGHEST_TRUSTED` times the nominal pressure, or where ln k_t is more
    uncertain than `WIDEST_TRUSTED`; the numbers are given all the same.

    Args:
        stiffness: belief over ln k_t.
        tire: law, entries [] or [wheels].
    """
    law = _like(tire, stiffness.mean)

    def law_of_log(ln_k_t: Any) -> Any:
        return pressure_from_stiffness(jnp.exp(ln_k_t), law)

    # the law acts wheel by wheel, so one tangent holds all slopes
    mean, slope = jax.jvp(law_of_log, (stiffness.mean,), (jnp.ones_like(stiffness.mean),))
    variance = jnp.diagonal(stiffness.cov, axis1=-2, axis2=-1)
    relative = mean / law.nominal_pressure
    trusted = (relative >= LOWEST_TRUSTED) & (relative <= HIGHEST_TRUSTED)
    trusted = trusted & (variance <= WIDEST_TRUSTED**2)
    return PressureBelief(mean, slope[..., :, None] * stiffness.cov * slope[..., None, :], trusted)


def operating_ln_stiffness(operation: Operation, law: VerticalTire) -> Any:
    """ln dF_z/drho of the vertical law at the deflection that carries the load, [..., wheels].

    The derivative is taken of `vertical_load` itself. The wheel rolls freely: its spin is the
    speed over the effective radius, found by a fixed-point iteration.

    Args:
        operation: load, speed and pressure.
        law: vertical law, entries [] or [wheels].
    """
    load, speed, pressure = _broadcast(operation)
    law = _like(law, load)
    spin = speed / law.unloaded_radius
    for _ in range(_RADIUS_ITERATIONS):
        deflection = deflection_at_load(load, spin, pressure, law)
        spin = speed / effective_radius(deflection, law)
    deflection = deflection_at_load(load, spin, pressure, law)

    def elastic(rho: Any) -> Any:
        return vertical_load(rho, jnp.zeros_like(rho), spin, pressure, law)

    return jnp.log(jax.jvp(elastic, (deflection,), (jnp.ones_like(deflection),))[1])


def correction(operation: Operation, reference: Operation, law: VerticalTire) -> Any:
    """ln of the stiffness at a load and speed relative to the reference, [..., wheels].

    Both are taken at the pressure of `reference`, so that no loss of pressure is corrected away.

    Args:
        operation: load and speed now; its pressure is not read.
        reference: those of the calibration, or of the pressure law.
        law: vertical law.
    """
    now = Operation(operation.load, operation.speed, reference.pressure)
    here, there = operating_ln_stiffness(now, law), operating_ln_stiffness(reference, law)
    return here - jnp.broadcast_to(there, here.shape)


def corrected(
    stiffness: StiffnessBelief,
    operation: Operation,
    reference: Operation,
    law: VerticalTire,
    load_sd: Any = 0.0,
) -> StiffnessBelief:
    """The belief as it would be at the reference load and speed.

    The error of each wheel's load adds (d ln k_t / d F_z)^2 load_sd^2, independent among wheels.

    Args:
        stiffness: belief over ln k_t.
        operation: load and speed now, [..., wheels] or [].
        reference: those to correct to.
        law: vertical law.
        load_sd: standard deviation of the known load [N], [..., wheels] or [].
    """
    shape, dtype = stiffness.mean.shape, stiffness.mean.dtype
    load, speed, sd = (
        jnp.broadcast_to(jnp.asarray(a, dtype), shape)
        for a in (operation.load, operation.speed, load_sd)
    )

    def of_load(newtons: Any) -> Any:
        return correction(Operation(newtons, speed, operation.pressure), reference, law)

    shift, slope = jax.jvp(of_load, (load,), (jnp.ones_like(load),))
    extra = (slope * sd) ** 2
    diagonal = extra[..., :, None] * jnp.broadcast_to(
        jnp.eye(shape[-1], dtype=dtype), (*shape, shape[-1])
    )
    return StiffnessBelief(stiffness.mean - shift, stiffness.cov + diagonal)


def _like(law: _Law, array: Any) -> _Law:
    """The law with entries of the array's type and shape, [..., wheels]."""
    return jax.tree.map(lambda a: jnp.broadcast_to(jnp.asarray(a, array.dtype), array.shape), law)


def _broadcast(operation: Operation) -> tuple[Any, Any, Any]:
    fields = (operation.load, operation.speed, operation.pressure)
    dtype = jnp.result_type(float, *fields)
    shape = jnp.broadcast_shapes(*(jnp.shape(a) for a in fields))
    load, speed, pressure = (jnp.broadcast_to(jnp.asarray(a, dtype), shape) for a in fields)
    return load, speed, pressure
