"""Coordinates in which every loss looks alike: whitening, steps in them, what a step promises."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.identification.objective import Evaluation

ON_BOUND = 800.0
"""Free number, or its negative, of a parameter that lies on its bound to the last digit."""

JUST_INSIDE = 12.0
"""The same a little inside it, 6e-6 of the interval: where the slope tells which way is down."""

REACH = 4.0
"""Farthest that a round moves a free number."""

_FLATTEST = 1e-10
_FLAT = 1e-12


@jax.jit
def whitening_of(normal: Any, gradient: Any, free: Any) -> Any:
    """W of the whitened coordinates, [starts, n, n].

    Near a bound the Gauss-Newton matrix vanishes with the square of the distance, and what bends
    the loss is the logistic map p(theta) itself: J_p p'' = J_theta p'' / p', with
    p'' / p' = 1 - 2 sigmoid(theta).
    """
    bent = 0.5 * jnp.maximum(gradient * (1.0 - 2.0 * jax.nn.sigmoid(free)), 0.0)
    whole = normal + jax.vmap(jnp.diag)(bent)
    values, vectors = jnp.linalg.eigh(whole)
    floor = jnp.maximum(_FLATTEST * values[:, -1:], jnp.finfo(normal.dtype).tiny)
    return vectors / jnp.sqrt(jnp.maximum(values, floor))[:, None, :]


def moved(center: Any, whitening: Any, z: Any, reach: Any) -> Any:
    """theta = theta_0 + r tanh(W z / r): no free number moves by more than r, [starts].

    What lies on a bound stays there to the last digit.
    """
    r = reach[:, None]
    there = center + r * jnp.tanh(jnp.einsum("sij,sj->si", whitening, z) / r)
    return jnp.where(jnp.abs(center) >= ON_BOUND, center, there)


def promised_decrease(gradient: Any, whitening: Any) -> Any:
    """Decrease that the quadratic model J + g d + |W^-1 d|^2 promises, [starts].

    Its step is shortened where it is longer than a round may go: near a bound the loss hardly
    depends on the free number, and the model promises what no step can keep.
    """
    newton = -0.5 * jnp.einsum("sij,skj,sk->si", whitening, whitening, gradient)
    longest = jnp.max(jnp.abs(newton), axis=1)
    share = REACH / jnp.maximum(longest, REACH)
    return -0.5 * share * jnp.sum(gradient * newton, axis=1)


def promises_nothing(promised: Any, loss: Any, tolerance: float) -> np.ndarray:
    """Where the promised decrease is next to none.

    A loss at the rounding of its own sums is as good as zero.
    """
    loss = np.asarray(loss)
    rounding = 10 * float(np.finfo(loss.dtype).eps) ** 2
    return (np.asarray(promised) <= tolerance * loss) | (loss <= rounding)


@jax.jit
def put_on_bounds(free: Any, found: Evaluation) -> Any:
    """Free numbers with those put on their bound that would need many steps to get there.

    Those whose loss is bent by the logistic map more than by the data, and falls outwards.
    """
    outward = found.gradient * (1.0 - 2.0 * jax.nn.sigmoid(free))
    close = 0.5 * outward > jnp.diagonal(found.normal, axis1=1, axis2=2)
    falls = outward > _FLAT * found.loss[:, None]
    return jnp.where(close & falls, jnp.sign(free) * ON_BOUND, free)


@jax.jit
def just_inside(free: Any) -> Any:
    """Free numbers with those on a bound put a little inside it."""
    return jnp.where(jnp.abs(free) >= ON_BOUND, jnp.sign(free) * JUST_INSIDE, free)


@jax.jit
def released(free: Any, inside: Any, found: Evaluation) -> Any:
    """Free numbers with those put inside whose loss falls inwards.

    Args:
        free: free numbers, some on a bound.
        inside: `just_inside` of them.
        found: what is known there.
    """
    inward = found.gradient * jnp.sign(free) > _FLAT * found.loss[:, None]
    return jnp.where((inside != free) & inward, inside, free)
