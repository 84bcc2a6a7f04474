"""The arctangent in arithmetic that fills the SIMD lanes.

XLA:CPU calls a scalar function for each element, or with 512-bit vectors, in jaxlib 0.10.2, a wrong
one (`wheelhop.staging.misfits`). A tyre needs six arctangents for each of its forces.
"""

from __future__ import annotations

import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

_BEND = math.tan(math.pi / 8.0)


def _coefficients(count: int) -> tuple[float, ...]:
    """Of (atan(r) / r - 1) / r^2 in r^2, interpolated at Chebyshev points up to tan(pi / 8)."""
    end = _BEND * _BEND
    z = 0.5 * end * (1.0 + np.cos(np.pi * (np.arange(count) + 0.5) / count))
    r = np.sqrt(z)
    small = z < 1e-3
    series = -1.0 / 3.0 + z / 5.0 - z**2 / 7.0 + z**3 / 9.0 - z**4 / 11.0 + z**5 / 13.0
    values = np.where(small, series, (np.arctan(r) / r - 1.0) / z)
    fitted = np.polynomial.Polynomial.fit(z, values, count - 1, domain=(0.0, end))
    return tuple(fitted.convert().coef.tolist())


_TERMS = {"float32": _coefficients(5), "float64": _coefficients(11)}


@jax.custom_jvp
def arctan(x: Any) -> Any:
    """Angle [rad] of a tangent, within 3 units in the last place; any shape, float32 or float64.

    atan(x) = pi/2 - atan(1/x) beyond one, pi/4 + atan((x - 1)/(x + 1)) above tan(pi/8), and a
    polynomial below.
    """
    size = jnp.abs(x)
    far = size > 1.0
    top, bottom = jnp.where(far, 1.0, size), jnp.where(far, size, 1.0)
    bent = top > _BEND * bottom
    r = jnp.where(bent, top - bottom, top) / jnp.where(bent, top + bottom, bottom)
    z = r * r
    terms = _TERMS[str(x.dtype)]
    total = jnp.full_like(z, terms[-1])
    for term in terms[-2::-1]:
        total = total * z + term
    angle = jnp.where(bent, 0.25 * math.pi, 0.0) + (r + r * z * total)
    angle = jnp.where(far, 0.5 * math.pi - angle, angle)
    return jnp.where(x < 0.0, -angle, angle)


@arctan.defjvp
def _jvp(primals: Any, tangents: Any) -> tuple[Any, Any]:
    (x,), (t,) = primals, tangents
    return arctan(x), t / (1.0 + x * x)
