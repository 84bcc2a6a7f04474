"""Stages: how a filter is cut into native functions where the compiler would not do it well.

XLA on CPUs fuses by duplicating shared intermediates, so that an unrolled filter recomputes the
same Cholesky factor in every consumer, and it runs a loop body of many small kernels one by one.
A stage is a call that XLA may not inline, compiled into one native function: its results are
computed once. Stages act only in functions compiled by `staged_jit`; everywhere else, and on
other platforms, `stage(f)` is `f`. The numbers are the same up to the order of rounding.

The attributes used are undocumented details of XLA. They live in this file alone; `available`
probes them once, and `staged_jit` is `jax.jit` where the probe fails.

Wide vectors need a second probe, `misfits`. XLA:CPU of jaxlib 0.10.2 hands its arctangent 512-bit
vectors by value where that reads them from memory, so that the result is what the stack held
(jax issue 39352). A function that uses such an operation is compiled for `jax.jit`'s width.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import lru_cache, wraps
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import jaxpr_as_fun

try:
    from jax.experimental.xla_metadata import set_xla_metadata
except ImportError:  # a JAX release without it: plain compilation
    set_xla_metadata = None  # type: ignore[assignment]

_ACTIVE: ContextVar[bool] = ContextVar("wheelhop_staging", default=False)

_CALL = {"inlineable": "false", "xla_cpu_small_call": "true"}
_OPTIONS: dict[str, Any] = {
    "xla_disable_hlo_passes": "cpu-parallel-task-assigner,dot-library-rewriter",
}
_WIDE = {"xla_cpu_prefer_vector_width": 512}

# operations that XLA has vector code for, each with NumPy's for the same
_PROBED: dict[str, tuple[Callable[[Any], Any], Callable[[Any], Any]]] = {
    "atan": (jax.lax.atan, np.arctan),
    # with a second argument of one XLA makes it an arctangent
    "atan2": (lambda x: jax.lax.atan2(x, jnp.ones_like(x)), np.arctan),
    "cos": (jax.lax.cos, np.cos),
    "erf": (jax.lax.erf, np.vectorize(math.erf)),
    "exp": (jax.lax.exp, np.exp),
    "expm1": (jax.lax.expm1, np.expm1),
    "log": (jax.lax.log, np.log),
    "log1p": (jax.lax.log1p, np.log1p),
    "logistic": (jax.lax.logistic, lambda x: 1.0 / (1.0 + np.exp(-x))),
    "pow": (lambda x: jax.lax.pow(x, 1.0 + x), lambda x: x ** (1.0 + x)),
    "rsqrt": (jax.lax.rsqrt, lambda x: 1.0 / np.sqrt(x)),
    "sin": (jax.lax.sin, np.sin),
    "sqrt": (jax.lax.sqrt, np.sqrt),
    "tan": (jax.lax.tan, np.tan),
    "tanh": (jax.lax.tanh, np.tanh),
}


class _Narrow(Exception):
    """What is being traced uses an operation that wide vectors get wrong."""


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

    wide = jax.jit(traced, compiler_options=_OPTIONS | _WIDE)
    return _narrowed(traced, misfits()) if misfits() else wide


def _narrowed(traced: Callable[..., Any], refused: frozenset[str]) -> Callable[..., Any]:
    """`traced` for wide vectors unless it uses a refused operation, then for JAX's width."""

    @wraps(traced)
    def checked(*args: Any, **options: Any) -> Any:
        found, shape = jax.make_jaxpr(traced, return_shape=True)(*args, **options)
        if refused & set(_operations(found.jaxpr)):
            raise _Narrow
        results = jaxpr_as_fun(found)(*jax.tree.leaves((args, options)))
        return jax.tree.unflatten(jax.tree.structure(shape), results)

    wide = jax.jit(checked, compiler_options=_OPTIONS | _WIDE)
    narrow = jax.jit(traced, compiler_options=_OPTIONS)
    use = wide

    def widest(way: Callable[[Any], Any]) -> Any:
        nonlocal use
        try:
            return way(use)
        except _Narrow:
            use = narrow
        return way(use)

    @wraps(traced)
    def call(*args: Any, **options: Any) -> Any:
        return widest(lambda compiled: compiled(*args, **options))

    def lower(*args: Any, **options: Any) -> Any:
        return widest(lambda compiled: compiled.lower(*args, **options))

    call.lower = lower  # type: ignore[attr-defined]
    call._cache_size = lambda: use._cache_size()  # type: ignore[attr-defined]
    return call


def _operations(jaxpr: Any) -> Iterator[str]:
    """Names of the operations of a traced function and of those it calls."""
    for equation in jaxpr.eqns:
        yield equation.primitive.name
        for parameter in jax.tree.leaves(equation.params):
            inner = getattr(parameter, "jaxpr", parameter)
            if hasattr(inner, "eqns"):
                yield from _operations(inner)


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
        compiled = jax.jit(traced, compiler_options=_OPTIONS | _WIDE).lower(x).compile()
        native = 'xla_cpu_small_call="true"' in (compiled.as_text() or "")
        return native and bool(np.allclose(compiled(x), jax.jit(probe)(x), rtol=1e-6))
    except Exception:  # any refusal of the compiler means the plain path
        return False


@lru_cache(maxsize=1)
def misfits() -> frozenset[str]:
    """Operations that wide vectors get wrong here, by name; decided once by trying."""

    def every(*xs: Any) -> Any:
        return {name: [ours(x) for x in xs] for name, (ours, _) in _PROBED.items()}

    with jax.enable_x64(True):
        xs = [np.linspace(0.05, 0.95, 256).astype(precision) for precision in ("f4", "f8")]
        found = jax.jit(every, compiler_options=_OPTIONS | _WIDE)(*xs)
    return frozenset(
        name
        for name, (_, expected) in _PROBED.items()
        if not all(
            np.allclose(y, expected(x), rtol=1e-5) for x, y in zip(xs, found[name], strict=True)
        )
    )
