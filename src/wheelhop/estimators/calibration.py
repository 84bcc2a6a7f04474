"""Calibration at a known pressure: what the driver's reset button starts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from wheelhop.errors import InputError, require_in_range
from wheelhop.estimators.pressure import StiffnessBelief
from wheelhop.vehicle.tire import Tire, stiffness_from_pressure

SHORTEST = 20.0
"""Least time with beliefs that a calibration needs [s]."""


@dataclass(frozen=True)
class Calibration:
    """Offsets of ln k_t found at a known pressure.

    Attributes:
        offset: estimated ln k_t less the law's at the known pressure, [wheels].
        cov: covariance of the offset, [wheels, wheels].
        shared: part of it that every later belief repeats and that cancels therefore,
            [wheels, wheels].
        pressure: the known pressures [Pa], [wheels].
        duration: time with beliefs [s].
    """

    offset: np.ndarray
    cov: np.ndarray
    shared: np.ndarray
    pressure: np.ndarray
    duration: float


def calibrate(
    t: Float[np.ndarray, " time"],
    mean: Float[np.ndarray, "time wheels"],
    cov: Float[np.ndarray, "time wheels wheels"],
    tire: Tire,
    pressure: Any,
    *,
    belief_walk: float,
    shared: Any = None,
    shortest: float = SHORTEST,
) -> Calibration:
    """Offset of the estimated ln k_t from the law's while the pressure is known.

    A recursive estimator that assumes a random walk w of ln k_t forgets, so that its last belief
    is not all that the window holds. In its steady state it takes in
    J = inv(Sigma + Sigma^2 / (w^2 dt)) per step; c = (sum J)^-1 sum J (m - ln k_t(p)), with
    covariance (sum J)^-1. The last belief is used instead where it knows more of every wheel,
    as while the estimator still converges. Instants at which a wheel has no belief are left out.

    Args:
        t: time [s], evenly spaced.
        mean: of ln k_t, corrected to the reference load and speed.
        cov: its covariance.
        tire: law, entries [] or [wheels].
        pressure: known pressure [Pa], [] or [wheels].
        belief_walk: w [1/sqrt(s)] of the estimator.
        shared: covariance of errors that are the same before and after the reset (a wrong damper
            on the same road), [wheels, wheels]; none if left out.
        shortest: least time with beliefs [s].

    Raises:
        InputError: if the pressure is unknown, the window too short or without beliefs, a
            covariance not positive definite, or `shared` no covariance or more than the
            calibration's own.
    """
    wheels = mean.shape[1]
    known = _known_pressure(pressure, wheels)
    require_in_range("belief_walk", belief_walk, 1e-5, 1.0, "1/sqrt(s)")
    good = np.isfinite(mean).all(1) & np.isfinite(cov).all((1, 2))
    if not good.any():
        raise InputError(
            "calibration",
            f"none of the {len(t)} beliefs is a number",
            "Drive above walking pace with all sensors connected, and reset again.",
        )
    dt = float(np.median(np.diff(t))) if len(t) > 1 else 0.0
    duration = dt * int(good.sum())
    if duration < shortest * (1.0 - 1e-9):
        raise InputError(
            "calibration",
            f"{duration:.3g} s of beliefs are fewer than {shortest:g} s",
            "Drive longer at the known pressure before the calibration is closed.",
        )
    mean, cov = mean[good].astype(float), cov[good].astype(float)
    _require_positive("cov", cov)
    offsets = mean - np.log(np.asarray(stiffness_from_pressure(known, tire), float))
    taken_in = np.linalg.inv(cov + cov @ cov / (belief_walk**2 * dt))
    window_cov = np.linalg.inv(taken_in.sum(0))
    offset = window_cov @ np.einsum("tij,tj->i", taken_in, offsets)
    found_cov = 0.5 * (window_cov + window_cov.T)
    if (np.diagonal(cov[-1]) < np.diagonal(found_cov)).all():
        offset, found_cov = offsets[-1], cov[-1]
    return Calibration(offset, found_cov, _shared(shared, found_cov), known, duration)


def calibrated(stiffness: StiffnessBelief, calibration: Calibration) -> StiffnessBelief:
    """Later beliefs less the offset, with the calibration's uncertainty.

    Sigma + C - 2 C_shared: errors before and after are independent but for the shared ones,
    which cancel. The calibration's own error C is the same at all later times.

    Args:
        stiffness: belief over ln k_t, corrected to the same load and speed.
        calibration: offsets.
    """
    wide = _like(calibration.cov - 2.0 * calibration.shared, stiffness.cov)
    mean = stiffness.mean - _like(calibration.offset, stiffness.mean)
    return StiffnessBelief(mean, stiffness.cov + wide)


def bias_cov(calibration: Calibration, common_sd: float = 0.0, single_sd: float = 0.0) -> Any:
    """Covariance of the errors that stay for a whole drive, [wheels, wheels].

    What `alarms` needs beside beliefs from which only the offset was subtracted:
    C - 2 C_shared + common_sd^2 1 1' + single_sd^2 I.

    Args:
        calibration: offsets.
        common_sd: drift of ln k_t since the reset that all wheels share [-].
        single_sd: drift of each wheel on its own [-].
    """
    ones = np.ones_like(calibration.cov)
    extra = common_sd**2 * ones + single_sd**2 * np.eye(len(ones))
    return calibration.cov - 2.0 * calibration.shared + extra


def to_dict(calibration: Calibration) -> dict[str, Any]:
    """Plain numbers and lists, for a JSON or TOML file."""
    return {
        "offset": calibration.offset.tolist(),
        "cov": calibration.cov.tolist(),
        "shared": calibration.shared.tolist(),
        "pressure_pa": calibration.pressure.tolist(),
        "duration_s": float(calibration.duration),
    }


def from_dict(entries: dict[str, Any]) -> Calibration:
    """The calibration that `to_dict` wrote.

    Raises:
        InputError: if an entry is missing, no finite number, of the wrong shape or no covariance.
    """
    names = ("offset", "cov", "shared", "pressure_pa", "duration_s")
    arrays = {}
    for name in names:
        try:
            arrays[name] = np.asarray(entries[name], float)
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(
                f"calibration.{name}", "is missing or no number", "Calibrate again."
            ) from error
        if not np.isfinite(arrays[name]).all():
            raise InputError(f"calibration.{name}", "is not finite", "Calibrate again.")
    wheels = arrays["offset"].size
    shapes = ((wheels,), (wheels, wheels), (wheels, wheels), (wheels,), ())
    for name, shape in zip(names, shapes, strict=True):
        if arrays[name].shape != shape:
            raise InputError(
                f"calibration.{name}",
                f"has shape {arrays[name].shape} for {wheels} wheels",
                "Calibrate again.",
            )
    _require_positive("calibration.cov", arrays["cov"][None])
    shared = _shared(arrays["shared"], arrays["cov"])
    pressure = _known_pressure(arrays["pressure_pa"], wheels)
    return Calibration(
        arrays["offset"], arrays["cov"], shared, pressure, float(arrays["duration_s"])
    )


def _known_pressure(pressure: Any, wheels: int) -> np.ndarray:
    if pressure is None or not np.isfinite(np.asarray(pressure, float)).all():
        raise InputError(
            "pressure",
            f"{pressure} is not known",
            "Inflate to the placard, and give that pressure.",
        )
    known = np.asarray(pressure, float)
    if known.shape not in ((), (wheels,)):
        raise InputError(
            "pressure", f"has shape {known.shape} for {wheels} wheels", "Give one, or one a wheel."
        )
    for value in np.atleast_1d(known):
        require_in_range("pressure", value, 5e4, 1.5e6, "Pa")
    return np.broadcast_to(known, (wheels,)).copy()


def _shared(shared: Any, cov: np.ndarray) -> np.ndarray:
    """`shared` as a checked matrix: a covariance no larger than the calibration's."""
    if shared is None:
        return np.zeros_like(cov)
    matrix = np.asarray(shared, float)
    if matrix.shape != cov.shape:
        raise InputError("shared", f"has shape {matrix.shape}, not {cov.shape}", "Give a matrix.")
    lowest = -1e-9 * float(np.trace(cov))
    for part, problem in ((matrix, "is no covariance"), (cov - matrix, "exceeds that of the data")):
        if not np.allclose(part, part.T) or not float(np.linalg.eigvalsh(part).min()) >= lowest:
            raise InputError("shared", problem, "State a smaller, positive semidefinite one.")
    return matrix


def _require_positive(field: str, cov: np.ndarray) -> None:
    symmetric = np.allclose(cov, np.swapaxes(cov, -1, -2), rtol=1e-4, atol=1e-12)
    if not symmetric or not (np.linalg.eigvalsh(cov) > 0).all():
        raise InputError(
            field, "is not positive definite throughout", "Give the estimator's own covariance."
        )


def _like(array: np.ndarray, target: Any) -> Any:
    return jnp.broadcast_to(jnp.asarray(array, target.dtype), target.shape)
