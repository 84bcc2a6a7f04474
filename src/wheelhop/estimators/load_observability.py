"""Which sensors determine the load of a corner, whatever the load does.

Filipozzi et al. 2021, Eq. 18, ask whether a matrix has full column rank. That tells yes or no; the
hidden states and zeros of `filtering.strong_observability` tell why not, and trying the sensors
that are left tells what is missing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from wheelhop.errors import InputError, require_in_range
from wheelhop.estimators.unbiased_load import ThreeSignals, corner_system
from wheelhop.filtering.decoupling import UnknownInputModel, decoupled, strong_observability
from wheelhop.vehicle.corner_suspension import CornerSuspension, validate

SIGNALS = ("body_acceleration", "deflection", "deflection_rate", "wheel_acceleration")
"""Signals of a corner that can be measured."""

_NAMES = {
    "body_acceleration": "the body's acceleration",
    "deflection": "the deflection",
    "deflection_rate": "the deflection's rate",
    "wheel_acceleration": "the wheel carrier's acceleration",
}
_NOISE = {
    "body_acceleration": 0.1,
    "deflection": 1e-3,
    "deflection_rate": 1e-2,
    "wheel_acceleration": 0.1,
}


class LoadObservability(NamedTuple):
    """What a set of sensors says of a corner with unknown load and load transfer.

    Attributes:
        strongly_observable: the state can be told whatever the loads do.
        usable: an unbiased minimum variance filter exists for it: strongly detectable, and every
            load told with a delay of one sample at most.
        rank, columns: of the matrix of Eq. 18.
        zeros: invariant zeros, complex: modes that some load can hide.
        missing: what there is to know, in a sentence.
    """

    strongly_observable: bool
    usable: bool
    rank: int
    columns: int
    zeros: np.ndarray
    missing: str


def load_observability(
    corner: CornerSuspension, dt: float, signals: Sequence[str]
) -> LoadObservability:
    """Test a set of sensors, and name what is missing.

    Args:
        corner: the corner, entries [], concrete.
        dt: sampling interval [s].
        signals: some of `SIGNALS`.

    Raises:
        InputError: for a signal that is not one of `SIGNALS`, none at all, or a corner or sampling
            interval out of range.
    """
    for name in signals:
        if name not in SIGNALS:
            raise InputError("signals", f"{name!r} is unknown", f"Use {', '.join(SIGNALS)}.")
    require_in_range("dt", dt, 1e-6, 10.0, "s")
    validate(corner)
    if not signals:
        raise InputError("signals", "there are none", f"Give some of {', '.join(SIGNALS)}.")
    system = measured_system(corner, dt, signals)
    matrix = observability_matrix(system)
    observable, detectable, zeros, why = _judged(system)
    usable = detectable and _determined(system)
    names, one = _joined(signals), len(signals) == 1
    said = f"{names} determine{'s' if one else ''} the load"
    if not usable:
        said = f"{names} {'does' if one else 'do'} not determine the load: {why}"
    elif not observable:
        said += f", but not strongly: {why}"
    if not (usable and observable):
        enough = _strongly if usable else _usable
        others = [s for s in SIGNALS if s not in signals]
        cures = [s for s in others if enough(measured_system(corner, dt, [*signals, s]))]
        cure = " or ".join(_NAMES[s] for s in cures) or "at least two more signals"
        said += f"; measure {cure} as well"
    said += "."
    sizes = np.linalg.norm(matrix, axis=0)
    rank = int(np.linalg.matrix_rank(matrix / np.where(sizes > 0, sizes, 1.0), tol=1e-9))
    return LoadObservability(observable, usable, rank, matrix.shape[1], zeros, said)


def measured_system(
    corner: CornerSuspension, dt: float, signals: Sequence[str]
) -> UnknownInputModel:
    """The corner's discrete system with the rows of some signals.

    Args:
        corner: entries [].
        dt: sampling interval [s].
        signals: some of `SIGNALS`, in the order of the rows.
    """
    c = corner
    full = corner_system(c, dt, jnp.asarray(1e-3), ThreeSignals(*(_NOISE[s] for s in SIGNALS[:3])))
    zero = 0.0 * jnp.asarray(c.stiffness)
    on_wheel = jnp.stack([zero - c.stiffness, zero - c.damping]) / c.unsprung_mass
    rows = jnp.concatenate([full.observation, on_wheel[None]])
    by_load = jnp.stack([zero + 1.0 / c.unsprung_mass, zero])
    through = jnp.concatenate([full.feedthrough, by_load[None]])
    chosen = np.asarray([SIGNALS.index(s) for s in signals])
    noise = jnp.asarray([_NOISE[s] ** 2 for s in signals], zero.dtype)
    return replace(
        full,
        observation=rows[chosen],
        feedthrough=through[chosen],
        observation_cov=jnp.diag(noise),
        observation_offset=None,
    )


def observability_matrix(system: UnknownInputModel) -> np.ndarray:
    """The matrix of Eq. 18: states, then inputs sample by sample, over as many samples as states.

    Of the last sample's inputs only those that are seen at once have columns.

    Args:
        system: concrete.
    """
    a, h, c, g = (
        np.asarray(m, float)
        for m in (system.transition, system.input_matrix, system.observation, system.feedthrough)
    )
    n, m, p = len(a), len(c), h.shape[1]
    matrix = np.zeros((n * m, n + n * p))
    power = np.eye(n)
    for i in range(n):
        matrix[i * m : (i + 1) * m, :n] = c @ power
        power = a @ power
    for j in range(n):
        matrix[j * m : (j + 1) * m, n + j * p : n + (j + 1) * p] = g
        effect = h
        for i in range(j + 1, n):
            matrix[i * m : (i + 1) * m, n + j * p : n + (j + 1) * p] = c @ effect
            effect = a @ effect
    last = np.flatnonzero(np.abs(g).max(0) > 0)
    kept = np.concatenate([np.arange(n + (n - 1) * p), n + (n - 1) * p + last])
    return matrix[:, kept]


def _judged(system: UnknownInputModel) -> tuple[bool, bool, np.ndarray, str]:
    try:
        found = strong_observability(system)
    except ValueError:
        why = "there are loads and transfers that leave no trace there"
        return False, False, np.zeros(0, complex), why
    if found.observable:
        why = "the state shows, but a load shows later than one sample"
    else:
        sizes = ", ".join(f"{abs(z):.3g}" for z in found.zeros)
        what = "decays" if found.detectable else "does not decay"
        why = f"loads can hide a motion that {what} (zeros of modulus {sizes})"
    return found.observable, found.detectable, found.zeros, why


def _determined(system: UnknownInputModel) -> bool:
    try:
        decoupled(system, np.eye(system.input_matrix.shape[1]))
    except ValueError:
        return False
    return True


def _usable(system: UnknownInputModel) -> bool:
    return _judged(system)[1] and _determined(system)


def _strongly(system: UnknownInputModel) -> bool:
    return _usable(system) and _judged(system)[0]


def _joined(signals: Sequence[Any]) -> str:
    *before, last = (_NAMES[s] for s in signals)
    words = f"{', '.join(before)} and {last}" if before else last
    return words[:1].upper() + words[1:]
