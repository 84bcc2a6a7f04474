"""Stages: how a filter is cut into native functions where the compiler would not do it well.

XLA on CPUs fuses by duplicating shared intermediates, so that an unrolled filter recomputes the
same Cholesky factor in every consumer, and it runs a loop body of many small kernels one by one.
A stage is a call that XLA may not inline, compiled into one native function: its results are
computed once. Stages act only in functions compiled by `staged_jit`; everywhere else, and on
other platforms, `stage(f)` is `f`. The numbers are the same up to the order of rounding.

The attributes used are undocumented details of XLA. They live in this file alone; `available`
probes them once, and `staged_jit` is `jax.jit` where the probe fails.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import contextmanager
from contextvars import ContextVar
from functools import lru_cache, wraps
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

try:
    from jax.experimental.xla_metadata import set_xla_metadata
except ImportError:  # a JAX release without it: plain compilation
    set_xla_metadata = None  # type: ignore[assignment]

_ACTIVE: ContextVar[bool] = ContextVar("wheelhop_staging", default=False)

_CALL = {"inlineable": "false", "xla_cpu_small_call": "true"}
_OPTIONS: dict[str, Any] = {
    "xla_cpu_prefer_vector_width": 512,
    "xla_disable_hlo_passes": "cpu-parallel-task-assigner,dot-library-rewriter",
}


def stage(function: Callable[..., Any]) -> Callable[..., Any]:
    """The same function, compiled as one native function inside `staged_jit`.

    The function must be elementwise arithmetic without library calls (no linear algebra, sort,
    FFT or random numbers). Arguments are pytrees; leaves that are not arrays are constants.
    """

    @wraps(function)
    def staged(*args: Any, **options: Any) -> Any:
        if not _ACTIVE.get():
            return function(*args, **options)
        leaves, structure = jax.tree.flatten((args, options))
        dynamic = [isinstance(leaf, jax.Array) for leaf in leaves]

        def call(arrays: list[Any]) -> Any:
            remaining = iter(arrays)
            both = [next(remaining) if d else leaf for d, leaf in zip(dynamic, leaves, strict=True)]
            arguments, keywords = jax.tree.unflatten(structure, both)
            with set_xla_metadata(**dict.fromkeys(_CALL)):
                return function(*arguments, **keywords)

        with set_xla_metadata(**_CALL):
            return jax.jit(call)([leaf for d, leaf in zip(dynamic, leaves, strict=True) if d])

    return staged


def staged_jit(function: Callable[..., Any]) -> Callable[..., Any]:
    """`jax.jit` with stages, where this platform has them; call it at top level only.

    JAX refuses the result inside another `jax.jit` or `grad`: transform first, as in
    `staged_jit(jax.grad(f))`. Pass arrays as arguments: with arrays that the function closes over
    XLA:CPU can abort the process.
    """
    if not available():
        return jax.jit(function)

    @wraps(function)
    def traced(*args: Any, **options: Any) -> Any:
        with staging():
            return function(*args, **options)

    return jax.jit(traced, compiler_options=_OPTIONS)


def native_jit(function: Callable[..., Any]) -> Callable[..., Any]:
    """`staged_jit` with the whole function as one native function around its stages.

    Faster where arrays are small, as for one record, and slower to compile where they are large.
    A function with library calls (linear algebra, sort) cannot be one native function; then, and
    where there are no stages, this is `staged_jit`. Call it at top level only.
    """
    parts = staged_jit(function)
    if not available():
        return parts
    whole = staged_jit(stage(function))
    refused = False

    @wraps(function)
    def call(*args: Any) -> Any:
        nonlocal refused
        if not refused:
            try:
                return whole(*args)
            except jax.errors.JaxRuntimeError:
                refused = True
        return parts(*args)

    return call


@contextmanager
def staging(active: bool = True) -> Any:
    """Whether stages act in what is traced inside."""
    token = _ACTIVE.set(active)
    try:
        yield
    finally:
        _ACTIVE.reset(token)


@lru_cache(maxsize=1)
def available() -> bool:
    """Whether stages compile here and give the plain numbers; decided once by trying."""
    if set_xla_metadata is None or jax.default_backend() != "cpu":
        return False
    x = np.linspace(0.5, 2.0, 32, dtype=np.float32)

    def probe(x: Any) -> Any:
        half = stage(lambda a: 0.5 * jnp.sqrt(a) + a)
        return jax.lax.scan(lambda c, _: (half(c), None), x, length=3)[0]

    def traced(x: Any) -> Any:
        with staging():
            return probe(x)

    try:
        compiled = jax.jit(traced, compiler_options=_OPTIONS).lower(x).compile()
        native = 'xla_cpu_small_call="true"' in (compiled.as_text() or "")
        return native and bool(np.allclose(compiled(x), jax.jit(probe)(x), rtol=1e-6))
    except Exception:  # any refusal of the compiler means the plain path
        return False
