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
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from wheelhop.filtering import smallmat
from wheelhop.filtering.columns import gram, lower_triangle, times, transposed
from wheelhop.filtering.drive import Trajectory
from wheelhop.filtering.gaussian import Gaussian
from wheelhop.filtering.interface import Info, Named
from wheelhop.filtering.kalman import LinearGaussian
from wheelhop.filtering.sigma_points import Moments
from wheelhop.filtering.stretches import (
    Stretch,
    believed,
    combine,
    congruence,
    gains,
    identity_like,
    informed,
    symmetric,
    whiten,
)
from wheelhop.filtering.update import mask_missing, report


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

    In float64 to rounding. In float32 with sensors far more precise than the prediction (variance
    1e-8 of it) the mean may stray by tenths of its standard deviation; use float64 there.

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
    start = believed(jnp.stack(tuple(prior.mean))[:, None], symmetric(prior.cov))

    def over_block(before: Stretch, total: Stretch) -> tuple[Stretch, Stretch]:
        after = combine(before, total)
        return believed(after.shift, after.cov), before

    @jax.checkpoint
    def step(before: Stretch, slices: Any) -> tuple[Stretch, Any]:
        sample = _sample(*slices)
        after = combine(before, _stretch(sample))
        named = type(prior.mean)(*after.shift[:, 0])
        belief = Gaussian(named, lower_triangle(after.cov))
        report = _report(before, belief, slices[0], sample)
        return believed(after.shift, after.cov), Trajectory(belief, report)

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
        before = combine(total, after)
        return informed(before.information_mean, before.information), after

    @jax.checkpoint
    def step(after: Stretch, slices: Any) -> tuple[Stretch, Gaussian]:
        belief, sample = slices
        mean = jnp.stack(tuple(belief.mean))[:, None]
        kept, cov, _ = gains(symmetric(belief.cov), after.information)
        mean = times(kept, mean) + times(cov, after.information_mean)
        before = combine(_stretch(_sample(*sample)), after)
        smoothed = Gaussian(type(belief.mean)(*mean[:, 0]), lower_triangle(cov))
        return informed(before.information_mean, before.information), smoothed

    none = jnp.zeros_like(totals.cov[..., 0])
    last = informed(none[:, :1], none)
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
    lengths = {entry.shape[0] for entry in ys}
    if len(lengths) > 1:
        raise ValueError(
            f"the entries {type(ys)._fields} of ys have {sorted(lengths)} samples; give one length"
        )
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
        return combine(total, _stretch(_sample(*slices))), None

    y = record[0][0][0]
    none = jnp.zeros((n, n, *y.shape), y.dtype)
    empty = Stretch(identity_like(none), none[:, :1], none, none[:, :1], none)
    return jax.lax.scan(extend, empty, record)[0]


def _sample(y: Named, model: LinearGaussian) -> Sample:
    model = jax.tree.map(lambda a: jnp.broadcast_to(a, (*a.shape[:2], *y[0].shape)), model)
    zero = jnp.zeros_like(y[0])
    noise = lower_triangle(model.observation_cov)
    moments = Moments(
        type(y)(*(zero for _ in y)), tuple(model.observation), jax.tree.map(lambda a: zero, noise)
    )
    values, observation, noise, present = mask_missing(y, moments, noise)
    process_cov = symmetric(lower_triangle(model.process_cov))
    masked = LinearGaussian(model.transition, jnp.stack(observation), process_cov, symmetric(noise))
    return Sample(jnp.stack(values)[:, None], present, masked)


def _stretch(sample: Sample) -> Stretch:
    """One sampling interval: a prediction combined with a measurement."""
    model = sample.model
    n = model.transition.shape[0]
    white = whiten(model.observation_cov, jnp.concatenate([model.observation, sample.y], axis=1))
    back, y = transposed(white[:, :n]), white[:, n:]
    none = jnp.zeros_like(model.process_cov)
    column = none[:, :1]
    predict = Stretch(model.transition, column, model.process_cov, column, none)
    update = Stretch(identity_like(none), column, none, times(back, y), gram(back))
    return combine(predict, update)


def _report(before: Stretch, belief: Gaussian, y: Named, sample: Sample) -> Info:
    """Report of a step from the belief before it."""
    f, h, noise = sample.model.transition, sample.model.observation, sample.model.observation_cov
    predicted = congruence(f, before.cov) + sample.model.process_cov
    innovation_cov = lower_triangle(congruence(h, predicted) + noise)
    innovation = (sample.y - times(h, times(f, before.shift)))[:, 0]
    root, guarded = smallmat.cholesky(innovation_cov)
    white = smallmat.solve_lower(root, tuple(innovation))
    for cov in (before.cov, predicted, noise):
        guarded = guarded | smallmat.cholesky(lower_triangle(cov))[1]
    return report(
        type(y)(*innovation), innovation_cov, white, root, sample.present, belief, guarded
    )
