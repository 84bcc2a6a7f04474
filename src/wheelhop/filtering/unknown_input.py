"""Unbiased minimum variance filter: state and unknown input of a linear system together.

    x_k = F x_{k-1} + G d_{k-1} + w,    y_k = C x_k + H d_k + v,

with nothing assumed of d. Gillijns & De Moor 2007 solve H = 0 and H of full column rank;
Filipozzi et al. 2021, Eq. 17-30, use a rank-deficient H, where the inverse printed in Eq. 24
does not exist. Here one regression serves the three cases. The input is split into what H sees
and what it does not, d = V1 a + V2 b with H V2 = 0, and each sample estimates b_{k-1} and a_k
by generalised least squares. That is the optimum over the whole record, because the estimate
of a_k and its covariance with the state are carried on, not discarded as in Eq. 19-26.
"""

from __future__ import annotations

import math
from collections import namedtuple
from collections.abc import Iterable
from dataclasses import fields
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from wheelhop.filtering import columns, smallmat
from wheelhop.filtering.decoupling import DecoupledModel, UnknownInputModel
from wheelhop.filtering.gaussian import Gaussian, moment_match
from wheelhop.filtering.interface import Filter, Flags, Info, Lower, Named, all_finite
from wheelhop.filtering.sigma_points import Moments
from wheelhop.filtering.update import mask_missing
from wheelhop.staging import stage


class UnknownInputState(NamedTuple):
    """State of the filter after the update with y_k.

    Attributes:
        belief: `Gaussian` of x_k.
        input: `Gaussian` of the latest input that y_1..y_k determine in full: d_k where H has
            full column rank, otherwise d_{k-1}.
        direct: `Gaussian` of V1 a_k, the part of d_k that y_k sees; 0 where H = 0.
        cross: cov(x_k, V1 a_k), n rows of p entries.
    """

    belief: Gaussian
    input: Gaussian
    direct: Gaussian
    cross: tuple[tuple[Any, ...], ...]


def unknown_input(measurement: type, inputs: type) -> Filter:
    """Unbiased minimum variance filter of the state and of the unknown input.

    With e = y - C x' the innovation at the prediction without b_{k-1} and a_k, S its covariance
    for known inputs and A = [C G V2, H V1], the inputs are (A^T S^-1 A)^-1 A^T S^-1 e and the
    rest of e corrects the state (Gillijns & De Moor 2007). The covariance is a sum of squares.

    A sample of m present entries spends p of them on the input. `Info` describes what is left,
    the innovation e - A (inputs): its covariance has rank m - p, its `nis` is chi-square with
    m - p degrees of freedom, and its `log_likelihood` is the density of B^T e, where the columns
    of B are orthonormal and B^T A = 0. With m = p there is none: all three are 0.

    Entries of y that are not finite are left out. If the others still determine the input,
    nothing else changes. If they do not, the inputs of this sample have the prior
    N(0, input_cov) of `decoupled` instead of none, so that the covariance grows as the size of
    the input demands; then `flags.guarded` is True, `nis` has as many degrees of freedom as
    entries are present, and `log_likelihood` is their density.

    Args:
        measurement: NamedTuple type of the measurement, fields in the order of C's rows.
        inputs: NamedTuple type of the unknown input, fields in the order of G's columns.

    Returns:
        A `Filter` over `UnknownInputState` and `DecoupledModel` parameters; its `init` raises
        ValueError where the named components do not fit the matrices. States that are mixed
        must belong to models whose H has one null space.
    """

    def init(prior: Gaussian, params: DecoupledModel) -> UnknownInputState:
        _check_names(prior.mean, measurement, inputs, params.model)
        lanes = _lanes(prior.mean, params.model)
        belief = jax.tree.map(lambda entry: jnp.broadcast_to(entry, lanes), prior)
        v1, v2 = _input_basis(params, lanes)
        cov, known = (
            columns.lower_triangle(columns.gram(v)) for v in (jnp.concatenate([v1, v2], 1), v1)
        )
        zero = jnp.zeros_like(belief.mean[0])
        nothing = inputs(*(zero for _ in v1))
        cross = tuple(tuple(zero for _ in v1) for _ in belief.mean)
        return UnknownInputState(belief, Gaussian(nothing, cov), Gaussian(nothing, known), cross)

    def step(
        state: UnknownInputState, y: Named, params: DecoupledModel
    ) -> tuple[UnknownInputState, Info]:
        model, n, p = params.model, len(state.belief.mean), len(state.direct.mean)
        lanes = _lanes((*state.belief.mean, *y), model)
        f, g, c, h, to_a = (
            columns.broadcast(a, 2, lanes)
            for a in (model.transition, model.input_matrix, model.observation, model.feedthrough,
                      params.coordinates)
        )  # fmt: skip
        v1, v2 = _input_basis(params, lanes)
        q, rest = v1.shape[1], v2.shape[1]
        g1, g2 = columns.times(g, v1), columns.times(g, v2)
        seen = jnp.concatenate([columns.times(c, g2), columns.times(h, v1)], 1)

        # predict x_k without b_{k-1}; a_{k-1} stays beside it if y_k can still correct d_{k-1}
        kept = q if rest else 0
        mean, cov = _state_and_direct(state, to_a, lanes)
        move = columns.blocks([[f, g1], [columns.zeros(kept, n, f), columns.identity(q, f)[:kept]]])
        factor, guarded = smallmat.cholesky(cov)
        mean = columns.times(move, mean)
        known = _offset(model.state_offset, n, lanes, f)
        mean = jnp.concatenate([mean[:n] + known, mean[n:]])
        moved = columns.lower_triangle(columns.gram(columns.times(move, columns.of_factor(factor))))
        cov = (
            smallmat.add(
                moved[:n], columns.lower_triangle(columns.broadcast(model.process_cov, 2, lanes))
            )
            + moved[n:]
        )
        factor, predicted_guarded = smallmat.cholesky(cov)
        rows = columns.of_factor(factor)

        expected = columns.times(c, mean[:n]) + _offset(model.observation_offset, len(c), lanes, f)
        noise = columns.lower_triangle(columns.broadcast(model.observation_cov, 2, lanes))
        moments = Moments(
            measurement(*expected[:, 0]),
            tuple(columns.times(c, rows[:n])),
            smallmat.diagonal([jnp.zeros_like(e) for e in expected[:, 0]]),
        )
        innovation, odd, residual, present = mask_missing(y, moments, noise)
        seen = jnp.where(jnp.stack(present)[:, None], seen, 0.0)
        fit = _regress(jnp.stack(innovation)[:, None], odd, residual, seen)

        # x_k, V1 a_k and d_{k-1}, each a part of the prediction plus an effect of (b, a)
        def estimated(z: Any) -> Any:
            nothing = columns.zeros(p, z.shape[1], z)
            return jnp.concatenate([z[:n], nothing, columns.times(v1[:, :kept], z[n:])])

        no_a, no_b = columns.zeros(n + p, q, f), columns.zeros(p, rest, f)
        effect = columns.blocks([[g2, no_a[:n]], [no_b, v1], [v2, no_a[:p]]])
        updated, errors = _estimate(estimated(mean), estimated(rows), effect, fit)

        joint = columns.gram(errors[: n + p])
        belief = Gaussian(
            type(state.belief.mean)(*updated[:n]), columns.lower_triangle(joint[:n, :n])
        )
        direct = Gaussian(inputs(*updated[n : n + p]), columns.lower_triangle(joint[n:, n:]))
        cross = tuple(tuple(row) for row in joint[:n, n:])
        before = Gaussian(
            inputs(*updated[n + p :]), columns.lower_triangle(columns.gram(errors[n + p :]))
        )
        new = UnknownInputState(belief, before if rest else direct, direct, cross)
        return new, _report(new, type(y), fit, present, guarded | predicted_guarded)

    return Filter(init, step, _mix)


class _Fit(NamedTuple):
    """Regression of a sample on its inputs; "white" is in units of S's factor.

    Attributes:
        inputs: (b, a) [p, 1].
        inverse: effect on them of the m whitened entries and of the p rows of their prior.
        left: what they leave of those rows [m + p, 1].
        seen: A, white [m, p].
        odd: effect of the prediction's error, white [m, k].
        noise: effect of the measurement noise, white [m, m].
        root: factor of S.
        undetermined: where the inputs needed their prior.
        guarded: that, or a pivot of S or R that was raised.
        log_volume: log-determinant of the projected innovation's covariance.
    """

    inputs: Any
    inverse: Any
    left: Any
    seen: Any
    odd: Any
    noise: Any
    root: Lower
    undetermined: Any
    guarded: Any
    log_volume: Any


@stage
def _regress(innovation: Any, odd: tuple, residual: Lower, seen: Any) -> _Fit:
    """Generalised least squares of the innovation on A, with a unit prior where A is deficient."""
    root, guarded = smallmat.cholesky(smallmat.add(smallmat.gram(odd), residual))
    noise_root, noise_guarded = smallmat.cholesky(residual)
    wide_root = jax.tree.map(lambda entry: entry[None], root)
    e, a, z, v = (
        jnp.stack(smallmat.solve_lower(wide_root, tuple(b)))
        for b in (innovation, seen, odd, columns.of_factor(noise_root))
    )
    p = a.shape[1]
    undetermined = jnp.any(columns.orthonormal(a)[2], 0)
    prior = columns.identity(p, a) * undetermined.astype(a.dtype)[None, None]
    basis, upper, _ = columns.orthonormal(jnp.concatenate([a, prior]))
    left, found = columns.project(jnp.concatenate([e, columns.zeros(p, 1, e)]), basis)
    # without a prior the density is that of B^T e, whose volume does not depend on units of d
    outside = jnp.where(undetermined[None], 1.0, columns.pivots(columns.orthonormal(seen)[1]))
    volume = smallmat.log_det(root) + 2.0 * jnp.sum(jnp.log(columns.pivots(upper) / outside), 0)
    return _Fit(
        columns.back_substitute(upper, found),
        columns.back_substitute(upper, columns.transposed(basis)),
        left, a, z, v, root, undetermined, guarded | noise_guarded | undetermined, volume,
    )  # fmt: skip


@stage
def _estimate(mean: Any, rows: Any, effect: Any, fit: _Fit) -> tuple[Any, Any]:
    """Estimates of `prediction + effect (b, a)`, and a square root of their error covariance.

    With gain = rows L^T the weight of the whole innovation is K = gain + (effect - gain A) A^+,
    so that K A = effect. The errors are (rows - K L) of the prediction's, -K V of the noise's.
    """
    m = len(fit.seen)
    gain = columns.times(rows, columns.transposed(fit.odd))
    through = columns.times(effect - columns.times(gain, fit.seen), fit.inverse)
    weight = gain + through[:, :m]
    updated = mean + columns.times(effect, fit.inputs) + columns.times(gain, fit.left[:m])
    kept = [rows - columns.times(weight, fit.odd), columns.times(weight, fit.noise), through[:, m:]]
    return updated[:, 0], jnp.concatenate(kept, 1)


def _report(state: UnknownInputState, kind: type, fit: _Fit, present: list, guarded: Any) -> Info:
    """Info of the part of the innovation that the inputs leave."""
    m, p = fit.seen.shape[:2]
    nis = jnp.sum(fit.left * fit.left, (0, 1))
    count = sum(a.astype(jnp.int32) for a in present)
    freedom = count - jnp.where(fit.undetermined, 0, p)
    log_likelihood = -0.5 * (
        nis + fit.log_volume + math.log(2 * math.pi) * freedom.astype(nis.dtype)
    )
    lower = columns.of_factor(fit.root)
    free = columns.identity(m + p, fit.seen)[:m] - columns.times(fit.seen, fit.inverse)
    none = jnp.zeros_like(count)
    flags = Flags(
        missing=m - count,
        guarded=guarded | fit.guarded,
        nonfinite=~all_finite((state, log_likelihood)),
        lost_members=none,
        rejected=none,
    )
    innovation = kind(*columns.times(lower, fit.left[:m])[:, 0])
    return Info(
        innovation,
        columns.lower_triangle(columns.gram(columns.times(lower, free))),
        log_likelihood,
        nis,
        flags,
    )


def _mix(weights: Any, stacked: UnknownInputState) -> UnknownInputState:
    """Mixture's moments; x and V1 a are matched together for the sake of their covariance."""
    n, p = len(stacked.belief.mean), len(stacked.direct.mean)
    cross = tuple(zip(*stacked.cross, strict=True))
    below = tuple((*cross[j], *stacked.direct.cov[j]) for j in range(p))
    together = _joint(n + p)(*stacked.belief.mean, *stacked.direct.mean)
    joint = moment_match(weights, Gaussian(together, stacked.belief.cov + below))
    direct = tuple(row[n:] for row in joint.cov[n:])
    return UnknownInputState(
        Gaussian(type(stacked.belief.mean)(*joint.mean[:n]), joint.cov[:n]),
        moment_match(weights, stacked.input) if p else stacked.input,
        Gaussian(type(stacked.direct.mean)(*joint.mean[n:]), direct),
        tuple(tuple(row[i] for row in joint.cov[n:]) for i in range(n)),
    )


@lru_cache(maxsize=64)
def _joint(size: int) -> Any:
    return namedtuple("Joint", [f"entry{i}" for i in range(size)])


def _state_and_direct(state: UnknownInputState, to_a: Any, lanes: tuple) -> tuple[Any, Lower]:
    """Mean [n + q, 1] and covariance of (x, a): in coordinates, the covariance has full rank."""
    x, d = ([jnp.broadcast_to(e, lanes) for e in b.mean] for b in (state.belief, state.direct))
    n, p = len(x), len(d)
    wide = jax.tree.map(lambda e: jnp.broadcast_to(e, lanes), state)
    if not len(to_a):
        return jnp.stack(x)[:, None], wide.belief.cov
    cov = wide.direct.cov
    full = jnp.stack([jnp.stack([cov[max(i, j)][min(i, j)] for j in range(p)]) for i in range(p)])
    corner = columns.lower_triangle(
        columns.times(columns.times(to_a, full), columns.transposed(to_a))
    )
    side = columns.times(
        to_a, jnp.stack([jnp.stack([row[j] for row in wide.cross]) for j in range(p)])
    )
    mean = jnp.concatenate([jnp.stack(x), columns.times(to_a, jnp.stack(d)[:, None])[:, 0]])[
        :, None
    ]
    below = tuple((*side[i, :n], *row) for i, row in enumerate(corner))
    return mean, wide.belief.cov + below


def _input_basis(params: DecoupledModel, lanes: tuple) -> tuple[Any, Any]:
    """V1 and V2, turned together so that V2 is the null space of this H, not the prepared one."""
    v1, v2 = columns.broadcast(params.direct, 2, lanes), columns.broadcast(params.delayed, 2, lanes)
    if v1.shape[1] and v2.shape[1]:
        h = columns.broadcast(params.model.feedthrough, 2, lanes)
        basis, upper, _ = columns.orthonormal(columns.times(h, v1))
        turn = columns.back_substitute(upper, columns.project(columns.times(h, v2), basis)[1])
        return v1 + columns.times(v2, columns.transposed(turn)), v2 - columns.times(v1, turn)
    return v1, v2


def _offset(vector: Any, size: int, lanes: tuple, like: Any) -> Any:
    return (
        columns.zeros(size, 1, like)
        if vector is None
        else columns.broadcast(vector, 1, lanes)[:, None]
    )


def _lanes(entries: Iterable[Any], model: UnknownInputModel) -> tuple:
    """Shape [runs] or () of the entries of a step."""
    shapes = [jnp.shape(entry) for entry in entries]
    for field in fields(model):
        value = getattr(model, field.name)
        if value is not None:
            shapes.append(jnp.shape(value)[1 if field.name.endswith("offset") else 2 :])
    return jnp.broadcast_shapes(*shapes)


def _check_names(x: Named, measurement: type, inputs: type, model: UnknownInputModel) -> None:
    sizes = {
        "state": (x._fields, model.transition.shape[0]),
        "measurement": (measurement._fields, model.observation.shape[0]),  # type: ignore[attr-defined]
        "inputs": (inputs._fields, model.input_matrix.shape[1]),  # type: ignore[attr-defined]
    }
    for name, (names, size) in sizes.items():
        if len(names) != size:
            raise ValueError(
                f"{name} has the {len(names)} components {names} and the matrices have {size}; "
                "name every row (state, measurement) or column (inputs), in that order"
            )
