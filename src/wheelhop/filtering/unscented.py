"""Unscented Kalman filter with additive noise, for any symmetric sigma-point rule.

Julier & Uhlmann 1997; Wan & van der Merwe 2000. The points are redrawn after the prediction;
covariances are sums of squares throughout.
"""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp

from wheelhop.filtering import smallmat
from wheelhop.filtering.gaussian import Gaussian, moment_match
from wheelhop.filtering.interface import Filter, Info, Named, Params, StateSpaceModel, Update
from wheelhop.filtering.lanes import elementwise, same_names
from wheelhop.filtering.sigma_points import Rule, cubature, transform
from wheelhop.filtering.update import condition

_SMALLEST_SPREAD_SQUARED_F32 = 0.01


def unscented(
    model: StateSpaceModel, rule: Rule = cubature, measurement_update: Update = condition
) -> Filter:
    """Unscented (or cubature) Kalman filter for a state-space model.

    Args:
        model: the state-space model; its functions take all sigma points at once.
        rule: a sigma-point rule, `cubature`, `scaled(alpha, beta, kappa)` or
            `gauss_hermite(order)`.
        measurement_update: how a measurement is taken in: `condition`, or one of `robust`.

    Returns:
        A `Filter` whose state is the `Gaussian` after each update.

    Raises:
        ValueError: at the first step, if the rule is not usable for the state's size or
            type (a spread this small loses all digits in float32).
    """

    def init(prior: Gaussian, params: Params) -> Gaussian:
        del params
        return prior

    def step(belief: Gaussian, y: Named, params: Params) -> tuple[Gaussian, Info]:
        predicted, guarded = predict(model, rule, belief, params)
        return update(model, rule, predicted, y, params, guarded, measurement_update)

    return Filter(init, step, moment_match)


def predict(
    model: StateSpaceModel, rule: Rule, belief: Gaussian, params: Params
) -> tuple[Gaussian, Any]:
    """Belief one sampling interval later, and whether the pivot guard acted."""
    n = len(belief.mean)
    sigma_rule = rule(n)
    refuse_cancellation(sigma_rule.spread**2 / n, belief.cov[0][0].dtype)
    factor, guarded = smallmat.cholesky(belief.cov)
    moments = transform(
        lambda x: model.transition(x, params), belief.mean, factor, sigma_rule, "transition"
    )
    same_names(moments.mean, belief.mean, "the transition's result")
    cov = smallmat.add(smallmat.gram(moments.odd), moments.even)
    noise = elementwise(lambda x: model.process_cov(x, params), belief.mean, "process_cov")
    return Gaussian(moments.mean, smallmat.add(cov, noise)), guarded


def update(
    model: StateSpaceModel,
    rule: Rule,
    predicted: Gaussian,
    y: Named,
    params: Params,
    guarded: Any = False,
    measurement_update: Update = condition,
) -> tuple[Gaussian, Info]:
    """Belief conditioned on a measurement, with points redrawn from `predicted`."""
    factor, guard_acted = smallmat.cholesky(predicted.cov)
    moments = transform(
        lambda x: model.observation(x, params),
        predicted.mean,
        factor,
        rule(len(predicted.mean)),
        "observation",
    )
    noise = model.observation_cov(params)
    return measurement_update(predicted, factor, moments, noise, y, guard_acted | guarded)


def refuse_cancellation(relative_spread_squared: float, dtype: Any) -> None:
    """Raise ValueError where float32 cannot tell the sigma points apart."""
    if dtype == jnp.float32 and relative_spread_squared < _SMALLEST_SPREAD_SQUARED_F32:
        raise ValueError(
            f"sigma points {relative_spread_squared**0.5:g} standard deviations apart cancel in "
            "float32; use alpha >= 0.1 or run in float64"
        )
