"""First-order moments of a function of a Gaussian, by forward-mode derivatives."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp

from wheelhop.filtering import smallmat
from wheelhop.filtering.interface import Lower, Named
from wheelhop.filtering.lanes import elementwise
from wheelhop.filtering.sigma_points import Moments


def linearise(
    function: Callable[[Named], Named],
    at: Named,
    factor: Lower,
    mean: Named | None = None,
    what: str = "function",
) -> Moments:
    """Moments of `function(x)`, x ~ N(mean, L L^T), with the function linearised at a point.

    E = f(at) + F (mean - at) and cov(f) = (F L)(F L)^T. The columns of F L are directional
    derivatives along the columns of L, so the Jacobian itself is never formed.

    Args:
        function: map of the named components.
        at: point of linearisation.
        factor: lower Cholesky factor L of the covariance.
        mean: mean of x; the point of linearisation where it is not given.
        what: name of the function for an error.

    Raises:
        ValueError: if the function mixes runs.
    """

    def along(direction: Named) -> Named:
        return jax.jvp(function, (at,), (direction,))[1]

    value = elementwise(function, at, what)
    if mean is not None:
        shift = along(type(at)(*(m - a for m, a in zip(mean, at, strict=True))))
        value = type(value)(*(v + s for v, s in zip(value, shift, strict=True)))
    odd = tuple(jax.vmap(along)(type(at)(*smallmat.rows_of(factor))))
    zero = tuple(tuple(jnp.zeros_like(v) for _ in range(i + 1)) for i, v in enumerate(value))
    return Moments(value, odd, zero)
