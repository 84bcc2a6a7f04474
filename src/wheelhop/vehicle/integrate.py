"""Fixed-step integrators for states that are NamedTuples of named scalars."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax

from wheelhop.errors import InputError
from wheelhop.staging import stage

Derivative = Callable[[Any], Any]
"""x -> x', both the same NamedTuple."""


def euler(derivative: Derivative, x: Any, dt: Any) -> Any:
    """Forward Euler, first order: what Brancati & Tufano 2022, Eq. 15, print."""
    return _advance(x, derivative(x), dt)


def rk4(derivative: Derivative, x: Any, dt: Any, staged: bool = True) -> Any:
    """Classical Runge-Kutta, fourth order.

    Args:
        derivative: x -> x'.
        x: state.
        dt: step [s].
        staged: the derivative is elementwise arithmetic and may be one native function.
    """
    derivative = stage(derivative) if staged else derivative
    k1 = derivative(x)
    k2 = derivative(_advance(x, k1, 0.5 * dt))
    k3 = derivative(_advance(x, k2, 0.5 * dt))
    k4 = derivative(_advance(x, k3, dt))
    slope = jax.tree.map(lambda a, b, c, d: (a + 2.0 * b + 2.0 * c + d) / 6.0, k1, k2, k3, k4)
    return _advance(x, slope, dt)


INTEGRATORS = {"euler": euler, "rk4": rk4}


def integrator(name: str) -> Callable[[Derivative, Any, Any], Any]:
    """Integrator by name.

    Raises:
        InputError: for a name that is not in `INTEGRATORS`.
    """
    if name not in INTEGRATORS:
        raise InputError("integrator", f"{name!r} is unknown", f"Use one of {list(INTEGRATORS)}.")
    return INTEGRATORS[name]


def _advance(x: Any, slope: Any, dt: Any) -> Any:
    return jax.tree.map(lambda a, b: a + dt * b, x, slope)
