"""Checks, while a filter is traced, that a user's functions keep runs and names apart.

In lanes a model function meets arrays [runs] where it meets scalars elsewhere. A norm or a sum
over stacked components without an axis would then mix the runs, silently; here it is refused.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax.extend.core import Literal

from wheelhop.filtering.interface import Named

_WIDTH = 257
"""A number of lanes that no other axis has."""

_ALONG_AXIS = {"argmax", "argmin", "cumsum", "cumprod", "cummax", "cummin", "cumlogsumexp", "rev"}


def elementwise(function: Callable[[Named], Any], x: Named, what: str) -> Any:
    """`function(x)`, after making sure that it does not mix the lanes of x.

    Raises:
        ValueError: naming the function and the operation.
    """
    if all(jnp.ndim(entry) for entry in x):
        lanes = x[0].shape[-1]
        closed = jax.make_jaxpr(function)(x)
        culprit = _mixing(closed.jaxpr, [True] * len(closed.jaxpr.invars), lanes)[0]
        if culprit and lanes > 1:
            raise ValueError(
                f"the model's {what} mixes runs by `{culprit}` over the lanes; write it "
                "elementwise in the named components, or reduce stacked components over axis 0, "
                "as in jnp.sum(jnp.stack([x.a, x.b]) ** 2, axis=0)"
            )
    return function(x)


def keeps_lanes(keep: Callable[[Any, Any], Any], state: Any, info: Any) -> Any:
    """`keep(state, info)`, after making sure that its results have their lanes last.

    Raises:
        ValueError: if one has not.
    """

    def widened(leaf: Any) -> Any:
        return jax.ShapeDtypeStruct((*leaf.shape[:-1], _WIDTH), leaf.dtype)

    shapes = jax.eval_shape(keep, *jax.tree.map(widened, (state, info)))
    for leaf in jax.tree.leaves(shapes):
        if not leaf.shape or leaf.shape[-1] != _WIDTH:
            raise ValueError(
                f"a kept result of shape {leaf.shape} for {_WIDTH} runs does not have the runs "
                "last; keep what follows from the state or the info by elementwise arithmetic"
            )
    return keep(state, info)


def same_names(found: Any, expected: Any, what: str) -> None:
    """Raise ValueError unless two NamedTuples have the same fields in the same order."""
    if getattr(found, "_fields", None) != getattr(expected, "_fields", None):
        raise ValueError(
            f"{what} has the components {getattr(found, '_fields', type(found).__name__)} where "
            f"{getattr(expected, '_fields', type(expected).__name__)} are expected; use one "
            "NamedTuple type, its fields in one order"
        )


def _mixing(jaxpr: Any, dependent: list[bool], lanes: int) -> tuple[str, list[bool]]:
    """First operation over the last axis of what depends on x, and which results depend on x."""
    known = {v for v, d in zip(jaxpr.invars, dependent, strict=True) if d}

    def depends(v: Any) -> bool:
        return not isinstance(v, Literal) and v in known

    for eqn in jaxpr.eqns:
        inputs = [depends(v) for v in eqn.invars]
        if not any(inputs):
            continue
        name = eqn.primitive.name
        outputs = [True] * len(eqn.outvars)
        inner = eqn.params.get("jaxpr") or eqn.params.get("call_jaxpr")
        inner = getattr(inner, "jaxpr", inner)
        if inner is not None and len(inner.invars) == len(inputs):
            culprit, outputs = _mixing(inner, inputs, lanes)
            if culprit:
                return culprit, outputs
        else:
            for operand, (v, d) in enumerate(zip(eqn.invars, inputs, strict=True)):
                in_lanes = d and v.aval.ndim and v.aval.shape[-1] == lanes
                if in_lanes and v.aval.ndim - 1 in _reduced_axes(eqn, name, operand):
                    return name, outputs
        known |= {v for v, d in zip(eqn.outvars, outputs, strict=True) if d}
    return "", [depends(v) for v in jaxpr.outvars]


def _reduced_axes(eqn: Any, name: str, operand: int) -> tuple[int, ...]:
    if name == "dot_general":
        return tuple(eqn.params["dimension_numbers"][0][operand])
    if name == "sort":
        return (eqn.params["dimension"],)
    if name in _ALONG_AXIS:
        axis = eqn.params.get("axes", eqn.params.get("axis", eqn.params.get("dimensions", ())))
        return (axis,) if isinstance(axis, int) else tuple(axis)
    if name.startswith("reduce_") and "axes" in eqn.params:
        return tuple(eqn.params["axes"])
    return ()
