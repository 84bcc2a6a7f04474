"""Kalman filter and smoother of one long record in parallel over time, by a blocked scan.

Sarkka & Garcia-Fernandez 2021: a stretch of the record is an element of five matrices, two
neighbouring stretches combine into one, and the combination is associative. The record is cut
into about sqrt(T) blocks. All blocks are summed up side by side, a scan over the sums gives the
belief at every block's edge, and from there all blocks are filtered side by side: 3 sqrt(T)
dependent rounds instead of T steps, at more work in total. It is meant for long single
records, above all on accelerators; many records at once are better served by `run_batch`.

Values are sums of squares. Derivatives are those of the textbook formulas, which are
smooth where a covariance is singular, so a gradient is right in every direction there too.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from wheelhop.filtering import smallmat
from wheelhop.filtering.drive import Trajectory
from wheelhop.filtering.gaussian import Gaussian
from wheelhop.filtering.interface import Flags, Info, Lower, Named, all_finite
from wheelhop.filtering.kalman import LinearGaussian
from wheelhop.filtering.sigma_points import Moments
from wheelhop.filtering.update import mask_missing


class Stretch(NamedTuple):
    """What a stretch of the record says of the states x before it and z at its end.

    p(z | x, its samples) = N(A x + b, C) and p(its samples | x) ~ exp(e'x - x'J x / 2).
    Matrices are arrays [rows, columns, lanes]; b and e are columns.
    """

    transition: Any
    shift: Any
    cov: Any
    information_mean: Any
    information: Any


class Sample(NamedTuple):
    """Measurement and model of one time, as arrays [rows, columns, lanes].

    The missing entries are taken out: no value, no row of H, variance 1.
    """

    y: Any
    present: Any
    model: LinearGaussian


def parallel_filter(
    prior: Gaussian, ys: Named, params: LinearGaussian, *, blocks: int | None = None
) -> Trajectory:
    """Kalman filter of one record, parallel in time; the result is that of `drive.run`.

    Args:
        prior: belief one sampling interval before the first sample; any rank.
        ys: measurements, every entry [time]; non-finite entries are missing.
        params: matrices of the model, each constant or with a leading time axis: entry k
            holds for the step into sample k. The process noise may be of any rank, or zero;
            the measurement noise must be positive definite (else the steps are flagged
            `nonfinite`). Of both, the lower triangle is read.
        blocks: number of blocks filtered side by side; by default about the square root of
            the number of samples.

    Returns:
        States after every update and the steps' reports, entries [time].

    Raises:
        ValueError: if there is no sample, `blocks` is not positive, or a matrix does not have
            the record's shape.
    """
    record, steps = _cut(params, ys, len(prior.mean), blocks)
    totals = _totals(record, len(prior.mean))
    start = _believed(jnp.stack(tuple(prior.mean))[:, None], _symmetric(prior.cov))

    def over_block(before: Stretch, total: Stretch) -> tuple[Stretch, Stretch]:
        after = _combine(before, total)
        return _believed(after.shift, after.cov), before

    @jax.checkpoint
    def step(before: Stretch, slices: Any) -> tuple[Stretch, Any]:
        sample = _sample(*slices)
        after = _combine(before, _stretch(sample))
        named = type(prior.mean)(*after.shift[:, 0])
        belief = Gaussian(named, _lower(after.cov))
        report = _report(before, belief, slices[0], sample)
        return _believed(after.shift, after.cov), Trajectory(belief, report)

    _, edges = jax.lax.scan(over_block, start, jax.tree.map(_lanes_first, totals))
    _, found = jax.lax.scan(step, jax.tree.map(_lanes_last, edges), record)
    return _joined(found, steps)


def parallel_log_likelihood(
    prior: Gaussian, ys: Named, params: LinearGaussian, *, blocks: int | None = None
) -> Any:
    """log p(y_1..y_T | params), parallel in time, differentiable; arguments of the filter."""
    found = parallel_filter(prior, ys, params, blocks=blocks)
    return jnp.sum(found.info.log_likelihood, 0)


def parallel_smoother(
    beliefs: Gaussian, ys: Named, params: LinearGaussian, *, blocks: int | None = None
) -> Gaussian:
    """Smoothed beliefs of one record, parallel in time.

    Each filtered belief is conditioned on all later samples, gathered by a scan from the end
    (a two-filter smoother, Fraser & Potter 1969): the predicted covariance, singular where the
    process noise is, is never inverted.

    Args:
        beliefs: states of `parallel_filter` or of `drive.run`, entries [time].
        ys: the measurements the filter had.
        params: the matrices the filter had.
        blocks: as in `parallel_filter`.

    Raises:
        ValueError: if there is no sample, `blocks` is not positive, or a matrix does not have
            the record's shape.
    """
    n = len(beliefs.mean)
    record, steps = _cut(params, ys, n, blocks)
    totals = _totals(record, n)
    rounds, lanes = record[0][0].shape

    def over_block(after: Stretch, total: Stretch) -> tuple[Stretch, Stretch]:
        before = _combine(total, after)
        return _informed(before.information_mean, before.information), after

    @jax.checkpoint
    def step(after: Stretch, slices: Any) -> tuple[Stretch, Gaussian]:
        belief, sample = slices
        mean = jnp.stack(tuple(belief.mean))[:, None]
        kept, cov, _ = _gains(_symmetric(belief.cov), after.information)
        mean = _times(kept, mean) + _times(cov, after.information_mean)
        before = _combine(_stretch(_sample(*sample)), after)
        smoothed = Gaussian(type(belief.mean)(*mean[:, 0]), _lower(cov))
        return _informed(before.information_mean, before.information), smoothed

    none = jnp.zeros_like(totals.cov[..., 0])
    last = _informed(none[:, :1], none)
    _, edges = jax.lax.scan(over_block, last, jax.tree.map(_lanes_first, totals), reverse=True)
    padded = jax.tree.map(lambda a: _side_by_side(a, rounds, lanes), beliefs)
    edges = jax.tree.map(_lanes_last, edges)
    _, found = jax.lax.scan(step, edges, (padded, record), reverse=True)
    return _joined(found, steps)


def _cut(params: LinearGaussian, ys: Named, n: int, blocks: int | None) -> tuple[Any, int]:
    """Measurements [round, block] and matrices [round, rows, columns, block or 1].

    Sample `round` of every block is filtered at once. The end is padded with missing samples.
    """
    steps, m = ys[0].shape[0], len(ys)
    if steps < 1:
        raise ValueError("ys has 0 samples; give a record of at least 1")
    if blocks is not None and blocks < 1:
        raise ValueError(f"blocks={blocks}: give at least 1, or None to have them chosen")
    rounds = math.isqrt(steps - 1) + 1 if blocks is None else -(-steps // blocks)
    lanes = -(-steps // rounds)

    def matrix(name: str, rows: int, columns: int) -> Any:
        value = jnp.asarray(getattr(params, name))
        if value.shape not in ((rows, columns), (steps, rows, columns)):
            raise ValueError(
                f"{name} has shape {value.shape}; give ({rows}, {columns}), or "
                f"({steps}, {rows}, {columns}) where it varies over the {steps} samples"
            )
        if value.ndim == 2:
            return jnp.broadcast_to(value[None, :, :, None], (rounds, rows, columns, 1))
        return jnp.moveaxis(_side_by_side(value, rounds, lanes), 1, 3)

    model = LinearGaussian(
        matrix("transition", n, n),
        matrix("observation", m, n),
        matrix("process_cov", n, n),
        matrix("observation_cov", m, m),
    )
    return (jax.tree.map(lambda y: _side_by_side(y, rounds, lanes, jnp.nan), ys), model), steps


def _side_by_side(a: Any, rounds: int, lanes: int, fill: float | None = None) -> Any:
    """[time, ...] as [round, block, ...], padded with a value (None: the last entry)."""
    pad = rounds * lanes - a.shape[0]
    value = a[-1:] if fill is None else jnp.full_like(a[-1:], fill)
    a = jnp.concatenate([a, jnp.broadcast_to(value, (pad, *a.shape[1:]))])
    return jnp.swapaxes(a.reshape((lanes, rounds, *a.shape[1:])), 0, 1)


def _joined(tree: Any, steps: int) -> Any:
    """[round, block] as [time], without the padding."""
    return jax.tree.map(lambda a: jnp.swapaxes(a, 0, 1).reshape(-1)[:steps], tree)


def _lanes_first(a: Any) -> Any:
    return jnp.moveaxis(a, -1, 0)


def _lanes_last(a: Any) -> Any:
    return jnp.moveaxis(a, 0, -1)


def _totals(record: Any, n: int) -> Stretch:
    """Every block as one stretch, blocks in the lanes."""

    @jax.checkpoint
    def extend(total: Stretch, slices: Any) -> tuple[Stretch, None]:
        return _combine(total, _stretch(_sample(*slices))), None

    y = record[0][0][0]
    none = jnp.zeros((n, n, *y.shape), y.dtype)
    empty = Stretch(_identity_like(none), none[:, :1], none, none[:, :1], none)
    return jax.lax.scan(extend, empty, record)[0]


def _sample(y: Named, model: LinearGaussian) -> Sample:
    model = jax.tree.map(lambda a: jnp.broadcast_to(a, (*a.shape[:2], *y[0].shape)), model)
    zero = jnp.zeros_like(y[0])
    noise = _lower(model.observation_cov)
    moments = Moments(
        type(y)(*(zero for _ in y)), tuple(model.observation), jax.tree.map(lambda a: zero, noise)
    )
    values, observation, noise, present = mask_missing(y, moments, noise)
    process_cov = _symmetric(_lower(model.process_cov))
    masked = LinearGaussian(
        model.transition, jnp.stack(observation), process_cov, _symmetric(noise)
    )
    return Sample(jnp.stack(values)[:, None], present, masked)


def _believed(mean: Any, cov: Any) -> Stretch:
    """A belief as a stretch that forgets what was before it."""
    none, column = jnp.zeros_like(cov), jnp.zeros_like(mean)
    return Stretch(none, mean, cov, column, none)


def _informed(information_mean: Any, information: Any) -> Stretch:
    """Likelihood of all later samples as a stretch whose end does not matter."""
    none, column = jnp.zeros_like(information), jnp.zeros_like(information_mean)
    return Stretch(none, column, none, information_mean, information)


def _stretch(sample: Sample) -> Stretch:
    """One sampling interval: a prediction combined with a measurement."""
    model = sample.model
    n = model.transition.shape[0]
    white = _whiten(model.observation_cov, jnp.concatenate([model.observation, sample.y], axis=1))
    back, y = _transpose(white[:, :n]), white[:, n:]
    none = jnp.zeros_like(model.process_cov)
    column = none[:, :1]
    predict = Stretch(model.transition, column, model.process_cov, column, none)
    update = Stretch(_identity_like(none), column, none, _times(back, y), _gram(back))
    return _combine(predict, update)


def _report(before: Stretch, belief: Gaussian, y: Named, sample: Sample) -> Info:
    """Report of a step from the belief before it."""
    f, h, noise = sample.model.transition, sample.model.observation, sample.model.observation_cov
    predicted = _congruence(f, before.cov) + sample.model.process_cov
    innovation_cov = _lower(_congruence(h, predicted) + noise)
    innovation = (sample.y - _times(h, _times(f, before.shift)))[:, 0]
    root, guarded = smallmat.cholesky(innovation_cov)
    white = smallmat.solve_lower(root, tuple(innovation))
    nis = sum((w * w for w in white[1:]), white[0] * white[0])
    count = sum(p.astype(nis.dtype) for p in sample.present)
    log_likelihood = -0.5 * (nis + smallmat.log_det(root) + math.log(2 * math.pi) * count)
    for cov in (before.cov, predicted, noise):
        guarded = guarded | smallmat.cholesky(_lower(cov))[1]
    nothing = jnp.zeros_like(sample.present[0], jnp.int32)
    flags = Flags(
        missing=len(y) - sum(p.astype(jnp.int32) for p in sample.present),
        guarded=guarded,
        nonfinite=~all_finite((belief, log_likelihood)),
        lost_members=nothing,
        rejected=nothing,
    )
    return Info(type(y)(*innovation), innovation_cov, log_likelihood, nis, flags)


def _with_tangent_of(smooth: Callable) -> Callable[[Callable], Callable]:
    """Decorator: the value of the decorated function with the derivative of `smooth`."""

    def decorate(stable: Callable) -> Callable:
        function = jax.custom_jvp(stable)
        function.defjvp(lambda x, dx: (function(*x), jax.jvp(smooth, x, dx)[1]))
        return function

    return decorate


@jax.custom_jvp
def _gains(cov: Any, information: Any) -> tuple[Any, Any, Any]:
    """(I + C J)^-1, (C^-1 + J)^-1 and (J^-1 + C)^-1, for C and J of any rank."""
    kept, p, q = _gain_roots(cov, information)
    return kept, _gram(p), _gram(q)


@_gains.defjvp
def _gains_tangent(primals: Any, tangents: Any) -> tuple[Any, Any]:
    e, m, n = _gains(*primals)
    dc, dj = tangents
    left, right = _times(e, dc), _times(m, dj)
    de = -(_times(left, n) + _times(right, e))
    dm = _times(left, _transpose(e)) - _times(right, m)
    dn = _times(_transpose(e), _times(dj, e)) - _times(n, _times(dc, n))
    return (e, m, n), (de, dm, dn)


def _gain_roots(cov: Any, information: Any) -> tuple[Any, Any, Any]:
    """`_gains` with square roots of its last two: with C = L L', J = Z Z' and W = Z'L they are
    L (I + W'W)^-1/2 and Z (I + W W')^-1/2, whose matrices to invert have no eigenvalue below 1.
    """
    roots = _cholesky(jnp.stack([cov, information], axis=2))
    w = _times(_transpose(roots[:, :, 1]), roots[:, :, 0])
    inner = jnp.stack([_gram(_transpose(w)), _gram(w)], axis=2)
    white = _whiten(_identity_like(inner) + inner, _transpose(roots))
    p, q = _transpose(white[:, :, 0]), _transpose(white[:, :, 1])
    z = roots[:, :, 1]
    kept = _identity_like(cov) - _times(p, _times(_times(_transpose(p), z), _transpose(z)))
    return kept, p, q


def _textbook_combine(i: Stretch, j: Stretch) -> Stretch:
    """Sarkka & Garcia-Fernandez 2021, filtering operator, of stretch i followed by j."""
    kept, cov, information = _gains(i.cov, j.information)
    onward, back = j.transition, _transpose(i.transition)
    return Stretch(
        _times(onward, _times(kept, i.transition)),
        _times(onward, _times(kept, i.shift) + _times(cov, j.information_mean)) + j.shift,
        _times(onward, _times(cov, _transpose(onward))) + j.cov,
        _times(back, _times(_transpose(kept), j.information_mean) - _times(information, i.shift))
        + i.information_mean,
        _times(back, _times(information, i.transition)) + i.information,
    )


@_with_tangent_of(_textbook_combine)
def _combine(i: Stretch, j: Stretch) -> Stretch:
    """Stretch i followed by stretch j, its covariance and information as sums of squares."""
    kept, p, q = _gain_roots(i.cov, j.information)
    onward, back = j.transition, _transpose(i.transition)
    onward_kept, onward_p, back_q = _times(onward, kept), _times(onward, p), _times(back, q)
    return Stretch(
        _times(onward_kept, i.transition),
        _times(onward_kept, i.shift)
        + _times(onward_p, _times(_transpose(p), j.information_mean))
        + j.shift,
        _gram(onward_p) + j.cov,
        _times(back, _times(_transpose(kept), j.information_mean))
        - _times(back_q, _times(_transpose(q), i.shift))
        + i.information_mean,
        _gram(back_q) + i.information,
    )


@_with_tangent_of(lambda a, c: _times(a, _times(c, _transpose(a))))
def _congruence(a: Any, c: Any) -> Any:
    """A C A^T as a sum of squares."""
    return _gram(_times(a, _cholesky(c)))


def _times(a: Any, b: Any) -> Any:
    return jnp.sum(a[:, :, None] * b[None], 1)


def _transpose(a: Any) -> Any:
    return jnp.swapaxes(a, 0, 1)


def _gram(a: Any) -> Any:
    return _times(a, _transpose(a))


def _identity_like(a: Any) -> Any:
    n = a.shape[0]
    eye = jnp.eye(n, dtype=a.dtype).reshape((n, n) + (1,) * (a.ndim - 2))
    return jnp.broadcast_to(eye, a.shape)


def _lower(matrix: Any) -> Lower:
    return tuple(tuple(matrix[i, j] for j in range(i + 1)) for i in range(matrix.shape[0]))


def _symmetric(lower: Lower) -> Any:
    n = len(lower)
    return jnp.stack([jnp.stack([lower[max(i, j)][min(i, j)] for j in range(n)]) for i in range(n)])


def _cholesky(a: Any) -> Any:
    """Lower Cholesky factor of positive semidefinite arrays [n, n, ...], zero pivots left out.

    Stretches are singular as a rule, so the relative pivot guard is below rounding: the one of
    `smallmat.cholesky` would add information in every null direction of every stretch.
    """
    n = a.shape[0]
    guard = 0.125 * float(jnp.finfo(a.dtype).eps)
    rest, columns = a, []
    for j in range(n):
        pivot = jnp.maximum(rest[0, 0], guard * a[j, j])
        positive = pivot > 0
        inverse = jnp.where(positive, jax.lax.rsqrt(jnp.where(positive, pivot, 1.0)), 0.0)
        below = rest[1:, 0] * inverse[None]
        columns.append(jnp.concatenate([jnp.zeros_like(a[:j, 0]), (pivot * inverse)[None], below]))
        rest = rest[1:, 1:] - below[:, None] * below[None]
    return jnp.stack(columns, axis=1)


def _whiten(cov: Any, columns: Any) -> Any:
    """V^-1 times the columns, with cov = V V^T positive definite."""
    rest, rows = jnp.concatenate([cov, columns], axis=1), []
    for _ in range(cov.shape[0]):
        row = rest[0] * jax.lax.rsqrt(rest[0, 0])[None]
        rows.append(row[-columns.shape[1] :])
        rest = rest[1:, 1:] - row[1 : rest.shape[0], None] * row[None, 1:]
    return jnp.stack(rows)
