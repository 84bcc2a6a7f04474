"""First-order shape filter of a road: exact sampling, in both conventions of its level."""

from __future__ import annotations

import math
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from wheelhop.errors import InputError

CUTOFF = 0.127
"""alpha [rad/m], Brancati & Tufano 2022, section 2.1."""

CONVENTIONS = ("iso8608", "brancati2022")


def stationary_variance(level: Any, convention: str = "iso8608", cutoff: float = CUTOFF) -> Any:
    """Variance sigma^2 [m^2] of the elevation at a level Gd(W0) [m^3/rad].

    "iso8608": pi (1 + alpha^2) / (2 alpha) Gd(W0), so that the spectrum passes through the
    level at W0 = 1 rad/m. "brancati2022": 4 Gd(W0) as printed, a factor pi (5 dB) smoother
    than its label; for reproduction only.

    Raises:
        InputError: for an unknown convention.
    """
    if convention == "iso8608":
        return math.pi * (1.0 + cutoff**2) / (2.0 * cutoff) * level
    if convention == "brancati2022":
        return 4.0 * level
    raise InputError("convention", f"{convention!r} is unknown", f"Use one of {CONVENTIONS}.")


def shape_filter_psd(wavenumber: Any, variance: Any, cutoff: float = CUTOFF) -> Any:
    """One-sided PSD [m^3/rad] of the filter's output, 2 alpha s^2 / (pi (alpha^2 + W^2)).

    Brancati & Tufano 2022, Eq. 5, in space instead of time.
    """
    return 2.0 * cutoff * variance / (math.pi * (cutoff**2 + wavenumber**2))


def elevations(
    key: Array,
    variance: Any,
    travel: Float[Array, " steps"],
    cutoff: float = CUTOFF,
    dtype: Any = None,
) -> Float[Array, " steps+1"]:
    """A realisation of z_r' = -alpha v z_r + eta, sampled exactly.

    z[k + 1] = a z[k] + sqrt(sigma^2 (1 - a^2)) n[k], a = exp(-alpha v dt): Brancati & Tufano
    2022, Eq. 6, without a discretisation error; it starts from the stationary distribution.

    Args:
        key: JAX random key.
        variance: sigma^2 [m^2], [] or [steps] where the road changes along the way.
        travel: distance v dt [m] of every step.
        cutoff: alpha [rad/m].
        dtype: floating type of the result; default that of `travel`.

    Returns:
        Elevation [m] before the first and after every step.
    """
    travel = jnp.asarray(travel, dtype)
    variance = jnp.broadcast_to(jnp.asarray(variance, travel.dtype), travel.shape)
    decay = jnp.exp(-cutoff * travel)
    drive = jnp.sqrt(variance * -jnp.expm1(-2.0 * cutoff * travel))
    normal = jax.random.normal(key, (travel.shape[0] + 1,), travel.dtype)
    start = jnp.sqrt(variance[0]) * normal[0]

    def step(z: Any, inputs: Any) -> tuple[Any, Any]:
        a, kick = inputs
        z = a * z + kick
        return z, z

    _, rest = jax.lax.scan(step, start, (decay, drive * normal[1:]))
    return jnp.concatenate([start[None], rest])
