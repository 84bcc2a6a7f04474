"""Estimated wheel loads as the known load correction of the pressure estimate.

A tyre's stiffness rises with its load. What a payload adds would read as pressure; the load that
an estimator finds takes it out, and its standard deviation goes into that of the pressure.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax.numpy as jnp

from wheelhop.errors import InputError
from wheelhop.estimators.pressure import Operation, StiffnessBelief, corrected
from wheelhop.vehicle.vertical_tire import VerticalTire


class OperatingLoad(NamedTuple):
    """Load under which the tyres worked over a window.

    Attributes:
        mean: [N], [..., wheels].
        sd: standard deviation of that mean [N], [..., wheels].
    """

    mean: Any
    sd: Any


def operating_load(load: Any, sigma: Any, window: slice = slice(None)) -> OperatingLoad:
    """Mean load of a window and its standard deviation; pure.

    The errors of one wheel's load are taken as one and the same error all along the window, as
    those of a wrong mass, spring or offset are: the standard deviation of the mean is the mean
    standard deviation, not less by the root of the number of samples. Samples that are not
    finite are left out; a wheel without any is NaN. The mean stands for the window as the
    stiffness's law is nearly straight over the loads that a drive passes through.

    Args:
        load: estimated loads [N], [time, wheels].
        sigma: their standard deviations [N], [time, wheels].
        window: samples that the stiffness was estimated over.

    Raises:
        InputError: where the shapes differ, or the window has no sample.
    """
    load, sigma = jnp.asarray(load), jnp.asarray(sigma)
    if load.ndim != 2 or load.shape != sigma.shape:
        raise InputError(
            "load", f"load {load.shape}, sigma {sigma.shape}", "Give both [time, wheels]."
        )
    load, sigma = load[window], sigma[window]
    if not load.shape[0]:
        raise InputError("window", f"{window} has no sample", "Choose samples within the log.")
    known = jnp.isfinite(load) & jnp.isfinite(sigma)
    count = jnp.sum(known, 0).astype(load.dtype)

    def mean(values: Any) -> Any:
        return jnp.sum(jnp.where(known, values, 0.0), 0) / count

    return OperatingLoad(mean(load), mean(sigma))


def corrected_by_load(
    stiffness: StiffnessBelief,
    load: OperatingLoad,
    speed: Any,
    reference: Operation,
    law: VerticalTire,
) -> StiffnessBelief:
    """The belief over ln k_t as it would be at the reference load and speed.

    The load's error adds (d ln k_t / d F_z)^2 sd^2, independent among wheels. An error that all
    wheels share, as that of the mass, makes their pressures err alike, which the covariance does
    not say.

    Args:
        stiffness: belief over ln k_t, [..., wheels].
        load: what the tyres carried, from `operating_load`.
        speed: v [m/s], [..., wheels] or [].
        reference: load, speed and pressure of the calibration or of the pressure law.
        law: vertical law, entries [] or [wheels].
    """
    now = Operation(load.mean, speed, reference.pressure)
    return corrected(stiffness, now, reference, law, load.sd)
