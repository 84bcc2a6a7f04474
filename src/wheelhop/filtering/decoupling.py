"""Which part of an unknown input a measurement sees at once, which later, and which never."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.linalg import matrix_balance


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class UnknownInputModel:
    """x_k = F x_{k-1} + G d_{k-1} + f + w, y_k = C x_k + H d_k + h + v.

    Attributes:
        transition: F [n, n].
        input_matrix: G [n, p].
        observation: C [m, n].
        feedthrough: H [m, p]; may be zero or of any rank.
        process_cov: cov(w) [n, n]; may be of any rank.
        observation_cov: cov(v) [m, m], positive definite.
        state_offset: f [n], the effect of known inputs on the state; None is zero.
        observation_offset: h [m], their effect on the measurement; None is zero.
    """

    transition: Any
    input_matrix: Any
    observation: Any
    feedthrough: Any
    process_cov: Any
    observation_cov: Any
    state_offset: Any = None
    observation_offset: Any = None


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class DecoupledModel:
    """Parameters of the filter: a model and the coordinates d = V1 a + V2 b of its input.

    The coordinates are the work of `decoupled`. They stay valid while the entries of the model
    change (by run, in time, under a gradient: `dataclasses.replace(params, model=...)`) as long
    as H keeps its rank; a null space of H that differs from the prepared one must be constant
    in time.

    Attributes:
        model: the matrices.
        direct: V1 [p, q], q = rank H; a is seen at once, through H V1.
        delayed: V2 [p, p - q], H V2 = 0; b is seen one sample later, through C G V2.
        coordinates: [q, p], the map from d to a.
    """

    model: UnknownInputModel
    direct: Any
    delayed: Any
    coordinates: Any


class StrongObservability(NamedTuple):
    """Whether the state can be told whatever the input does.

    Attributes:
        observable: no input can keep the measurement at zero unless the state is zero.
        detectable: every state that an input can hide decays: all zeros lie inside the unit
            circle. The filter's error is bounded if, and only if, this holds.
        zeros: invariant zeros of (F, G, C, H), complex; one per hidden direction.
        hidden: [n, r], orthonormal basis of the states an input can hide for ever.
    """

    observable: bool
    detectable: bool
    zeros: np.ndarray
    hidden: np.ndarray


def decoupled(
    model: UnknownInputModel, input_cov: Any, tolerance: float | None = None
) -> DecoupledModel:
    """Parameters of the filter: splits the input by what H sees, once and outside the step.

    Args:
        model: matrices of one run at one time, concrete (not traced by jit or grad).
        input_cov: [p, p], positive definite: the size of the input. It scales the arithmetic,
            and is the prior N(0, input_cov) where no sample can tell: of the directly seen
            part before the first sample, and of the input of a sample that leaves it
            undetermined because entries are missing. Elsewhere it has no effect.
        tolerance: singular values below it, relative to the largest, count as zero; default
            1000 machine epsilons of the model's type.

    Raises:
        ValueError: if a shape does not fit, an entry is not finite, a covariance is not
            positive definite, or the input is not determined by y_{k-1} and y_k: the rank of
            [C G V2, H V1] must be p (Gillijns & De Moor 2007).
    """
    arrays, dtype, eps = _concrete(model)
    tolerance = 1000 * eps if tolerance is None else tolerance
    g, c, h = (arrays[name] for name in ("input_matrix", "observation", "feedthrough"))
    spread = np.asarray(input_cov, float)
    p = g.shape[1]
    if spread.shape != (p, p):
        raise ValueError(f"input_cov has shape {spread.shape}; {p} inputs need {(p, p)}")
    if not (np.linalg.eigvalsh(spread) > 0).all():
        raise ValueError(
            f"input_cov={spread.tolist()} is not positive definite; give every input the "
            "variance of its expected size"
        )
    root = np.linalg.cholesky(spread)
    noise = np.sqrt(np.diag(arrays["observation_cov"]))[:, None]
    now, later = h @ root / noise, c @ g @ root / noise
    _, sizes, v = np.linalg.svd(now)
    largest = np.linalg.norm(np.hstack([now, later]), 2) if p else 0.0
    rank = int((sizes > tolerance * largest).sum())
    v1, v2 = v[:rank].T, v[rank:].T
    seen = np.hstack([later @ v2, now @ v1])
    _refuse_undetermined(seen, root @ np.hstack([v2, v1]), p - rank, tolerance)
    kept = {name: jnp.asarray(array, dtype) for name, array in arrays.items()}
    basis = (root @ v1, root @ v2, np.linalg.solve(root.T, v1).T)
    return DecoupledModel(UnknownInputModel(**kept), *(jnp.asarray(b, dtype) for b in basis))


def strong_observability(
    model: UnknownInputModel, tolerance: float | None = None
) -> StrongObservability:
    """Tests whether the state can be reconstructed whatever the input, and finds the zeros.

    The hidden states are the largest subspace in which some input keeps x while y stays zero;
    the invariant zeros are the eigenvalues of the motion in it. It is empty exactly where the
    matrix of Filipozzi et al. 2021, Eq. 18, has full column rank.

    Args:
        model: matrices of one run at one time, concrete.
        tolerance: as in `decoupled`.

    Raises:
        ValueError: as `decoupled` for the matrices; or if two inputs give the same record for
            ever, so that no number of samples tells them apart.
    """
    arrays, _, eps = _concrete(model)
    tolerance = 1000 * eps if tolerance is None else tolerance
    f, g, c, h = (
        arrays[name] for name in ("transition", "input_matrix", "observation", "feedthrough")
    )
    n = len(f)
    # units of the states and sensors must not decide what counts as zero
    scale = np.diag(matrix_balance(f, permute=False)[1])
    noise = np.sqrt(np.diag(arrays["observation_cov"]))[:, None]
    f, g = f * scale / scale[:, None], g / scale[:, None]
    c, h = c * scale / noise, h / noise
    c, h = (a / max(np.linalg.norm(np.hstack([c, h]), 2), np.finfo(float).tiny) for a in (c, h))
    sizes = np.linalg.norm(np.vstack([g, h]), axis=0)
    g, h = (a / np.where(sizes > 0, sizes, 1.0) for a in (g, h))

    hidden = np.eye(n)
    while True:
        outside = np.eye(n) - hidden @ hidden.T
        leak = np.vstack([outside @ g, h])
        free = _null_space(np.hstack([np.vstack([outside @ f, c]) @ hidden, leak]), tolerance)
        smaller = _range(hidden @ free[: hidden.shape[1]], tolerance)
        if smaller.shape[1] == hidden.shape[1]:
            break
        hidden = smaller
    silent = _null_space(leak, tolerance)
    if silent.shape[1]:
        direction = silent[:, 0] / np.where(sizes > 0, sizes, 1.0)
        raise ValueError(
            f"input direction {_text(direction)} never shows in the measurement apart from the "
            "other inputs and the state; add a sensor it reaches, or remove it"
        )
    friend = -np.linalg.pinv(leak) @ np.vstack([outside @ f, c]) @ hidden
    zeros = np.linalg.eigvals(hidden.T @ (f @ hidden + g @ friend)).astype(complex)
    inside = bool((np.abs(zeros) < 1 - math.sqrt(eps)).all())
    return StrongObservability(
        hidden.shape[1] == 0, inside, zeros, np.linalg.qr(scale[:, None] * hidden)[0]
    )


def _concrete(model: UnknownInputModel) -> tuple[dict[str, np.ndarray], Any, float]:
    """The matrices in NumPy, checked; the model's floating type and its epsilon."""
    values = {f.name: getattr(model, f.name) for f in fields(model)}
    values = {name: value for name, value in values.items() if value is not None}
    if any(isinstance(value, jax.core.Tracer) for value in values.values()):
        raise ValueError(
            "the model is traced by jit, vmap or grad; prepare it outside, and put traced "
            "matrices in with dataclasses.replace(params, model=...)"
        )
    floats = [a for a in map(jnp.asarray, values.values()) if jnp.issubdtype(a.dtype, jnp.floating)]
    dtype = jnp.result_type(float, *floats)
    arrays = {name: np.asarray(value, float) for name, value in values.items()}
    for name, array in arrays.items():
        axes = 1 if name.endswith("offset") else 2
        if array.ndim != axes:
            raise ValueError(f"{name} has {array.ndim} axes; give {axes}, of one run at one time")
        if not np.isfinite(array).all():
            raise ValueError(f"{name}={array.tolist()} is not finite; give numbers")
    n, p = arrays["input_matrix"].shape
    m = len(arrays["observation"])
    shapes = {
        "transition": (n, n),
        "observation": (m, n),
        "feedthrough": (m, p),
        "process_cov": (n, n),
        "observation_cov": (m, m),
        "state_offset": (n,),
        "observation_offset": (m,),
    }
    for name, shape in shapes.items():
        if name in arrays and arrays[name].shape != shape:
            raise ValueError(
                f"{name} has shape {arrays[name].shape}; {n} states, {p} inputs (input_matrix) "
                f"and {m} measured entries (observation) need {shape}"
            )
    r = arrays["observation_cov"]
    if not (np.linalg.eigvalsh(r) > 0).all():
        raise ValueError(
            f"observation_cov={r.tolist()} is not positive definite; give every entry a variance"
        )
    return arrays, dtype, float(jnp.finfo(dtype).eps)


def _refuse_undetermined(
    seen: np.ndarray, directions: np.ndarray, delayed: int, tolerance: float
) -> None:
    """Raises unless the columns of seen = [C G V2, H V1] are independent."""
    sizes = np.linalg.norm(seen, axis=0)
    missing = _null_space(seen / np.where(sizes > 0, sizes, 1.0), tolerance)
    if not missing.shape[1]:
        return
    m, p = seen.shape
    mixture = missing[:, 0] / np.where(sizes > 0, sizes, 1.0)
    before = _text(directions[:, :delayed] @ mixture[:delayed])
    now = _text(directions[:, delayed:] @ mixture[delayed:])
    raise ValueError(
        f"{m} measured entries do not determine {p} inputs: [C G V2, H V1] has rank "
        f"{p - missing.shape[1]}, and input {before} before the sample together with {now} at it "
        "leaves no trace; add a sensor that sees it, or describe it as a state"
    )


def _null_space(a: np.ndarray, tolerance: float) -> np.ndarray:
    """Orthonormal columns [k, r] that a [i, k] maps to zero."""
    _, sizes, v = np.linalg.svd(a)
    largest = max(sizes, default=0.0)
    return v[int((sizes > tolerance * largest).sum()) :].T


def _range(a: np.ndarray, tolerance: float) -> np.ndarray:
    u, sizes, _ = np.linalg.svd(a, full_matrices=False)
    return u[:, sizes > tolerance]


def _text(direction: np.ndarray) -> str:
    largest = np.abs(direction).max(initial=0.0)
    return "[" + ", ".join(f"{d:.3g}" for d in direction / (largest or 1.0)) + "]"
