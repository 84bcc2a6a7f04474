"""Several models of one system, each with its own filter, and the probability of each.

Magill 1965: filters that do not mix, weighed by their likelihoods. What an IMM gives up beside it
is the mixing of m^2 states, so that hundreds of hypotheses stay cheap; it suits hypotheses that
change rarely and states that every filter finds by itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.filtering.gaussian import trailing
from wheelhop.filtering.interacting import correct, log_sum_exp, mixture_info, safe_log
from wheelhop.filtering.interface import Filter, Info, Named, all_finite
from wheelhop.staging import stage


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class MultipleModelParams:
    """Parameters of m hypotheses.

    Attributes:
        members: the member filter's parameters, every leaf with a leading axis [m].
        prior: probabilities before the first sample, and of the hypothesis that follows a
            change [m].
        change: probability that the hypothesis changes from one sample to the next.
        temper: exponent of the likelihoods, from 0 to 1: below one where errors of the model are
            correlated in time, so that a sample tells less than its likelihood says.
    """

    members: Any
    prior: Any
    change: Any = 0.0
    temper: Any = 1.0


class MultipleModelState(NamedTuple):
    """State of m hypotheses.

    Attributes:
        members: the members' states, every leaf with a leading axis [m].
        log_probabilities: of the hypotheses [m].
        combined: the members' mixture as one state of the member filter (moment-matched).
    """

    members: Any
    log_probabilities: Any
    combined: Any


def multiple_model(member: Filter) -> Filter:
    """Filters of several hypotheses beside each other, and the hypotheses' probabilities.

    One step: a change may lead to any hypothesis, p <- (1 - c) p + c prior; every member steps by
    itself; its likelihood corrects its probability. A member whose step is not finite has
    probability zero, until a change leads back to it, and is restarted from the mixture.

    Args:
        member: any `Filter`; its step is vmapped over stacked states and parameters.

    Returns:
        A `Filter` over `MultipleModelState` and `MultipleModelParams`; its `Info` describes the
        mixture, as that of `interacting`, and its log-likelihood is that of the untempered members.

    Raises:
        ValueError: by `init`, if the prior, the change or the temper are concrete and no
            probabilities.
    """

    def init(prior: Any, params: MultipleModelParams) -> MultipleModelState:
        _refuse_improbable(params)
        states = jax.vmap(member.init, in_axes=(None, 0))(prior, params.members)
        return MultipleModelState(states, safe_log(params.prior), member.mix(params.prior, states))

    def step(
        state: MultipleModelState, y: Named, params: MultipleModelParams
    ) -> tuple[MultipleModelState, Info]:
        predicted = changed(state.log_probabilities, params.prior, params.change)
        states, infos = jax.vmap(member.step, in_axes=(0, None, 0))(
            state.members, y, params.members
        )
        sound = jax.vmap(all_finite)(states)
        temper = jnp.asarray(params.temper, infos.log_likelihood.dtype)[None]
        temper = trailing(temper, infos.log_likelihood.ndim)
        told = jnp.where(sound, temper * infos.log_likelihood, jnp.nan)
        log_probabilities, _ = correct(predicted, told)
        _, log_likelihood = correct(predicted, jnp.where(sound, infos.log_likelihood, jnp.nan))
        combined = member.mix(jnp.exp(log_probabilities), states)
        states = jax.tree.map(lambda own, one: _either(sound, own, one), states, combined)
        finite = all_finite((combined, log_likelihood))
        report = mixture_info(jnp.exp(predicted), infos, log_likelihood, finite)
        return MultipleModelState(states, log_probabilities, combined), report

    def mix(weights: Any, stacked: MultipleModelState) -> MultipleModelState:
        members = jax.vmap(member.mix, in_axes=(None, 1))(weights, stacked.members)
        lanes = max(weights.ndim - 1, stacked.log_probabilities.ndim - 2)
        outer = trailing(weights, lanes + 1)[:, None]
        probabilities = jnp.sum(outer * jnp.exp(trailing(stacked.log_probabilities, lanes + 2)), 0)
        combined = member.mix(weights, stacked.combined)
        return MultipleModelState(members, safe_log(probabilities), combined)

    return Filter(init, step, mix)


@stage
def changed(log_probabilities: Any, prior: Any, change: Any) -> Any:
    """log((1 - c) p + c prior): hypotheses after one interval in which one may have changed."""
    lanes = log_probabilities.ndim
    change = trailing(jnp.asarray(change, log_probabilities.dtype)[None], lanes)
    stays = safe_log(1.0 - change) + log_probabilities
    comes = safe_log(change) + trailing(safe_log(prior), lanes)
    return log_sum_exp(jnp.stack([stays, comes + jnp.zeros_like(stays)]))


def _either(sound: Any, own: Any, mixture: Any) -> Any:
    """A member's leaf [m, ...], or the mixture's [...] where the member is not sound."""
    axes = own.ndim - sound.ndim
    shaped = sound.reshape(sound.shape[:1] + (1,) * axes + sound.shape[1:])
    return jnp.where(shaped, own, mixture[None])


def _refuse_improbable(params: MultipleModelParams) -> None:
    for name in ("prior", "change", "temper"):
        value = getattr(params, name)
        if isinstance(value, jax.core.Tracer):
            continue
        p = np.asarray(value, float)
        tolerance = 1e3 * float(jnp.finfo(jnp.result_type(float, value)).eps)
        whole = name != "prior" or np.allclose(p.sum(0), 1.0, rtol=0, atol=tolerance)
        if not (p >= 0).all() or not (p <= 1 + tolerance).all() or not whole:
            raise ValueError(
                f"{name}={p.tolist()} does not hold probabilities; give numbers from 0 to 1"
                + (" that sum to 1" if name == "prior" else "")
            )
