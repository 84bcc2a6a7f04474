"""Rauch-Tung-Striebel smoothers: what the whole record says of every state.

Rauch, Tung & Striebel 1965; the unscented form of Sarkka 2008. The smoothed
covariance is a sum of squares, (L - C G)(L - C G)^T + C (E + Q) C^T + C P_s C^T with the
smoother gain C, where the textbook subtracts.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from wheelhop.filtering import smallmat
from wheelhop.filtering.drive import Bind, constant_params
from wheelhop.filtering.gaussian import Gaussian
from wheelhop.filtering.interface import Lower, Named, Params, StateSpaceModel
from wheelhop.filtering.linearisation import linearise
from wheelhop.filtering.sigma_points import Moments, Rule, cubature, transform
from wheelhop.filtering.update import gain_rows, gain_times, without_gain

Smoother = Callable[..., Gaussian]
"""(beliefs [time], params, inputs=None, bind=...) -> smoothed beliefs [time]."""

TransitionMoments = Callable[[Callable[[Named], Named], Named, Lower], Moments]


def unscented_smoother(model: StateSpaceModel, rule: Rule = cubature) -> Smoother:
    """Smoother of the unscented filter with the same model and rule."""
    return _smoother(model, lambda f, mean, factor: transform(f, mean, factor, rule(len(mean))))


def extended_smoother(model: StateSpaceModel) -> Smoother:
    """Smoother of the extended filter; on a linear model, of the Kalman filter."""
    return _smoother(model, linearise)


def _smoother(model: StateSpaceModel, moments_of: TransitionMoments) -> Smoother:
    def smooth(
        beliefs: Gaussian,
        params: Params,
        *,
        inputs: Any = None,
        bind: Bind = constant_params,
    ) -> Gaussian:
        """Smoothed beliefs of a record.

        Args:
            beliefs: the filter's states after every update, entries [time].
            params: the filter's parameters.
            inputs: what varies in time, as the filter had it, every leaf [time, ...].
            bind: puts the inputs of one time into the parameters.
        """

        def back(later: Gaussian, slices: Any) -> tuple[Gaussian, Gaussian]:
            belief, u = slices
            smoothed = step_back(model, moments_of, belief, later, bind(params, u))
            return smoothed, smoothed

        last = jax.tree.map(lambda a: a[-1], beliefs)
        earlier = jax.tree.map(lambda a: a[:-1], beliefs)
        following = jax.tree.map(lambda a: a[1:], inputs)
        _, smoothed = jax.lax.scan(back, last, (earlier, following), reverse=True)
        return jax.tree.map(lambda a, b: jnp.concatenate([a, b[None]]), smoothed, last)

    return smooth


def step_back(
    model: StateSpaceModel,
    moments_of: TransitionMoments,
    belief: Gaussian,
    later: Gaussian,
    params: Params,
) -> Gaussian:
    """Smoothed belief from the filtered one and the smoothed one a step later."""
    factor, _ = smallmat.cholesky(belief.cov)
    moments = moments_of(lambda x: model.transition(x, params), belief.mean, factor)
    residual = smallmat.add(moments.even, model.process_cov(belief.mean, params))
    predicted_root, _ = smallmat.cholesky(smallmat.add(smallmat.gram(moments.odd), residual))
    rows = smallmat.rows_of(factor)
    gain = gain_rows(rows, moments.odd, predicted_root)
    shift = [s - m for s, m in zip(later.mean, moments.mean, strict=True)]
    mean = [
        m + sum(c * d for c, d in zip(row, shift, strict=True))
        for m, row in zip(belief.mean, gain, strict=True)
    ]
    residual_root, _ = smallmat.cholesky(residual)
    later_root, _ = smallmat.cholesky(later.cov)
    pieces = [
        jnp.concatenate(
            [
                without_gain(row, c, moments.odd),
                gain_times(c, residual_root),
                gain_times(c, later_root),
            ]
        )
        for row, c in zip(rows, gain, strict=True)
    ]
    return Gaussian(type(belief.mean)(*mean), smallmat.gram(pieces))
