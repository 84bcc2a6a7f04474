"""Extended Kalman filter, and its iterated form, with exact derivatives.

Jazwinski 1970; the iterated update is Gauss-Newton on the posterior (Bell & Cathey 1993).
Covariances are sums of squares, as in the unscented filter. On a linear model both are the
Kalman filter.
"""

from __future__ import annotations

from wheelhop.filtering import smallmat
from wheelhop.filtering.gaussian import Gaussian, moment_match
from wheelhop.filtering.interface import Filter, Info, Named, Params, StateSpaceModel, Update
from wheelhop.filtering.lanes import elementwise, same_names
from wheelhop.filtering.linearisation import linearise
from wheelhop.filtering.update import condition


def extended(
    model: StateSpaceModel, iterations: int = 1, measurement_update: Update = condition
) -> Filter:
    """Extended Kalman filter for a state-space model.

    Args:
        model: the state-space model; its functions are called on scalars.
        iterations: linearisations of the observation per update; 1 is the plain filter, more
            is the iterated one. Every iteration starts from the predicted covariance, so the
            measurement counts once however many there are. The steps are full Gauss-Newton ones,
            without a line search: where they do not settle, take fewer, or `unscented`.
        measurement_update: how a measurement is taken in: `condition`, or one of `robust`.

    Returns:
        A `Filter` whose state is the `Gaussian` after each update. Its `Info` describes the
        innovation at the prediction, also where the update is iterated.

    Raises:
        ValueError: if `iterations` is below 1, or above 1 with another measurement update.
    """
    if iterations < 1:
        raise ValueError(f"iterations={iterations}: linearise the observation at least once")
    if iterations > 1 and measurement_update is not condition:
        raise ValueError(
            f"iterations={iterations} with another measurement update: every linearisation would "
            "judge the sample anew; use iterations=1, or `unscented` with that update"
        )

    def init(prior: Gaussian, params: Params) -> Gaussian:
        del params
        return prior

    def step(belief: Gaussian, y: Named, params: Params) -> tuple[Gaussian, Info]:
        factor, guarded = smallmat.cholesky(belief.cov)
        moments = linearise(
            lambda x: model.transition(x, params), belief.mean, factor, what="transition"
        )
        same_names(moments.mean, belief.mean, "the transition's result")
        noise = elementwise(lambda x: model.process_cov(x, params), belief.mean, "process_cov")
        cov = smallmat.add(smallmat.gram(moments.odd), noise)
        predicted = Gaussian(moments.mean, cov)
        return update(model, predicted, y, params, iterations, guarded, measurement_update)

    return Filter(init, step, moment_match)


def update(
    model: StateSpaceModel,
    predicted: Gaussian,
    y: Named,
    params: Params,
    iterations: int = 1,
    guarded: object = False,
    measurement_update: Update = condition,
) -> tuple[Gaussian, Info]:
    """Belief conditioned on a measurement, relinearised `iterations` times."""
    factor, guard_acted = smallmat.cholesky(predicted.cov)
    noise = model.observation_cov(params)

    def once(at: Named) -> tuple[Gaussian, Info]:
        moments = linearise(
            lambda x: model.observation(x, params), at, factor, predicted.mean, "observation"
        )
        return measurement_update(predicted, factor, moments, noise, y, guard_acted | guarded)

    belief, info = once(predicted.mean)
    for _ in range(iterations - 1):
        belief, _ = once(belief.mean)
    return belief, info
