"""Unscented filter for noise that is not additive: the noise joins the sigma points.

Wan & van der Merwe 2000, the augmented form; prediction and update each draw the points of the
state and of the noise that acts there.
"""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import jax.numpy as jnp

from wheelhop.filtering import smallmat
from wheelhop.filtering.gaussian import Gaussian, moment_match
from wheelhop.filtering.interface import Filter, Info, Lower, Named, Params, Update
from wheelhop.filtering.sigma_points import Rule, cubature, transform
from wheelhop.filtering.update import condition


class AugmentedModel(NamedTuple):
    """x' = transition(x, w), y = observation(x, v), with noises w and v that may enter anyhow.

    Attributes:
        transition: (x, w, params) -> x, elementwise as in `StateSpaceModel`.
        observation: (x, v, params) -> y, elementwise too.
        process_noise: (x, params) -> `Gaussian` of w, evaluated at the mean of x.
        observation_noise: (params) -> `Gaussian` of v.
    """

    transition: Callable[[Named, Named, Params], Named]
    observation: Callable[[Named, Named, Params], Named]
    process_noise: Callable[[Named, Params], Gaussian]
    observation_noise: Callable[[Params], Gaussian]


def augmented(
    model: AugmentedModel, rule: Rule = cubature, measurement_update: Update = condition
) -> Filter:
    """Unscented filter with the noise among the sigma points.

    For additive noise use `unscented`: it is cheaper, and where the model is linear they agree.

    Args:
        model: the model with its noises as arguments.
        rule: a sigma-point rule for state and noise together.
        measurement_update: `condition`, or a gate of `robust`. The updates there that reweigh the
            measurement noise have nothing to act on here, as v is inside the observation.

    Returns:
        A `Filter` whose state is the `Gaussian` of x after each update.
    """

    def init(prior: Gaussian, params: Params) -> Gaussian:
        del params
        return prior

    def step(belief: Gaussian, y: Named, params: Params) -> tuple[Gaussian, Info]:
        noise = model.process_noise(belief.mean, params)
        joint, factor, guarded = _joined(belief, noise)

        def transition(z: Named) -> Named:
            return model.transition(*_parted(z, belief, noise), params)

        moments = transform(transition, joint.mean, factor, rule(len(joint.mean)))
        predicted = Gaussian(moments.mean, smallmat.add(smallmat.gram(moments.odd), moments.even))
        return update(predicted, y, params, guarded)

    def update(
        predicted: Gaussian, y: Named, params: Params, guarded: Any
    ) -> tuple[Gaussian, Info]:
        noise = model.observation_noise(params)
        joint, factor, guard_acted = _joined(predicted, noise)

        def observation(z: Named) -> Named:
            return model.observation(*_parted(z, predicted, noise), params)

        moments = transform(observation, joint.mean, factor, rule(len(joint.mean)))
        no_noise = tuple(tuple(jnp.zeros_like(entry) for entry in row) for row in moments.even)
        posterior, info = measurement_update(joint, factor, moments, no_noise, y, guarded)
        # the even part alone is singular, which is no reason to call a guard to attention
        _, innovation_guarded = smallmat.cholesky(info.innovation_cov)
        flags = info.flags._replace(guarded=guarded | guard_acted | innovation_guarded)
        n = len(predicted.mean)
        marginal = Gaussian(type(predicted.mean)(*posterior.mean[:n]), posterior.cov[:n])
        return marginal, info._replace(flags=flags)

    return Filter(init, step, moment_match)


def _joined(belief: Gaussian, noise: Gaussian) -> tuple[Gaussian, Lower, Any]:
    """State and independent noise as one Gaussian, its factor, and whether the guard acted."""
    factor, guarded = smallmat.cholesky(belief.cov)
    noise_factor, noise_guarded = smallmat.cholesky(noise.cov)
    zero = jnp.zeros_like(factor[0][0])
    n = len(belief.mean)

    def block(a: Lower, b: Lower) -> Lower:
        return (*a, *((*((zero,) * n), *(entry + zero for entry in row)) for row in b))

    kind = _joint_type(belief.mean._fields, noise.mean._fields)
    mean = kind(*belief.mean, *(m + zero for m in noise.mean))
    return (
        Gaussian(mean, block(belief.cov, noise.cov)),
        block(factor, noise_factor),
        guarded | noise_guarded,
    )


def _parted(z: Named, belief: Gaussian, noise: Gaussian) -> tuple[Named, Named]:
    """State and noise of a joint vector."""
    n = len(belief.mean)
    return type(belief.mean)(*z[:n]), type(noise.mean)(*z[n:])


@lru_cache(maxsize=64)
def _joint_type(state: tuple[str, ...], noise: tuple[str, ...]) -> Any:
    names = [f"state_{name}" for name in state] + [f"noise_{name}" for name in noise]
    return namedtuple("Joint", names)
