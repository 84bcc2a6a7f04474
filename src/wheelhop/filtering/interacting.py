"""Interacting multiple model filter over stacked members of any filter.

Blom & Bar-Shalom 1988; the form printed in Brancati & Tufano 2022, Eq. 9-14, with the
row-stochastic convention, the spread of the means and a log-space correction.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.filtering.gaussian import Gaussian, moment_match, normalised_square, trailing
from wheelhop.filtering.interface import Filter, Info, Named, all_finite
from wheelhop.staging import stage


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class InteractingParams:
    """Parameters of an IMM of m members.

    Attributes:
        members: the member filter's parameters, every leaf with a leading axis [m].
        transition: Pz [m, m], row-stochastic: Pz[i, j] = P(mode j now | mode i before).
        initial: mode probabilities before the first sample [m].
    """

    members: Any
    transition: Any
    initial: Any


class InteractingState(NamedTuple):
    """State of an IMM of m members.

    Attributes:
        members: the members' states, every leaf with a leading axis [m].
        log_probabilities: log of the mode probabilities [m].
        combined: the members' mixture as one state of the member filter (moment-matched).
    """

    members: Any
    log_probabilities: Any
    combined: Any


def interacting(member: Filter) -> Filter:
    """IMM whose modes are copies of one filter with different parameters.

    One step: predict the mode probabilities, mix the members' states, run every member,
    correct the mode probabilities with the members' likelihoods. A member whose likelihood
    is not finite gets probability zero and is restarted from the others at the next mixing.

    Args:
        member: any `Filter`; its step is vmapped over stacked states and parameters.

    Returns:
        A `Filter` over `InteractingState` and `InteractingParams`. Its `Info` describes the
        mixture: log p(y | past) of the mixture, innovation and covariance moment-matched.
        A mixture's NIS is not chi-square: improbable modes widen its covariance, so its mean
        lies below the number of entries even where a member's model is exact.

    Raises:
        ValueError: by `init`, if Pz or the initial probabilities are concrete and no
            probabilities; a negative or NaN one met later makes the step nonfinite.
    """

    def init(prior: Any, params: InteractingParams) -> InteractingState:
        _refuse_improbable(params)
        states = jax.vmap(member.init, in_axes=(None, 0))(prior, params.members)
        return InteractingState(
            states, safe_log(params.initial), member.mix(params.initial, states)
        )

    def step(
        state: InteractingState, y: Named, params: InteractingParams
    ) -> tuple[InteractingState, Info]:
        predicted, weights = mixing(state.log_probabilities, params.transition)
        mixed = jax.vmap(member.mix, in_axes=(1, None))(weights, state.members)
        states, infos = jax.vmap(member.step, in_axes=(0, None, 0))(mixed, y, params.members)
        log_probabilities, log_likelihood = correct(predicted, infos.log_likelihood)
        combined = member.mix(jnp.exp(log_probabilities), states)
        finite = all_finite((combined, log_likelihood))
        report = mixture_info(jnp.exp(predicted), infos, log_likelihood, finite)
        return InteractingState(states, log_probabilities, combined), report

    def mix(weights: Any, stacked: InteractingState) -> InteractingState:
        members = jax.vmap(member.mix, in_axes=(None, 1))(weights, stacked.members)
        lanes = max(weights.ndim - 1, stacked.log_probabilities.ndim - 2)
        outer = trailing(weights, lanes + 1)[:, None]
        probabilities = jnp.sum(outer * jnp.exp(trailing(stacked.log_probabilities, lanes + 2)), 0)
        combined = member.mix(weights, stacked.combined)
        return InteractingState(members, safe_log(probabilities), combined)

    return Filter(init, step, mix)


def _refuse_improbable(params: InteractingParams) -> None:
    for name, value, axis in (("transition", params.transition, 1), ("initial", params.initial, 0)):
        if isinstance(value, jax.core.Tracer):
            continue
        p = np.asarray(value, float)
        tolerance = 1e3 * float(jnp.finfo(jnp.result_type(float, value)).eps)
        if not (p >= 0).all() or not np.allclose(p.sum(axis=axis), 1.0, rtol=0, atol=tolerance):
            raise ValueError(
                f"{name}={p.tolist()} does not hold probabilities; give numbers from 0 to 1, "
                + ("every row Pz[i, :] summing to 1" if axis else "summing to 1")
            )


@stage
def mixing(log_probabilities: Any, transition: Any) -> tuple[Any, Any]:
    """Predicted log mode probabilities [m] and mixing weights W[i, j] from i into j [m, m].

    W[i, j] = Pz[i, j] mu_i / sum_k Pz[k, j] mu_k (Brancati & Tufano 2022, Eq. 9-11 with the
    index and time corrected). A mode nothing leads to keeps its own state.
    """
    lanes = log_probabilities.ndim - 1
    modes = log_probabilities.shape[0]
    joint = trailing(safe_log(transition), lanes + 2) + log_probabilities[:, None]
    predicted = log_sum_exp(joint)
    reachable = ~jnp.isneginf(predicted)
    weights = jnp.where(
        reachable[None],
        jnp.exp(joint - jnp.where(reachable, predicted, 0.0)[None]),
        trailing(jnp.eye(modes, dtype=joint.dtype), lanes + 2),
    )
    return predicted, weights


@stage
def correct(predicted: Any, log_likelihoods: Any) -> tuple[Any, Any]:
    """Posterior log mode probabilities [m] and the mixture's log-likelihood.

    Where no member explains the sample (no finite likelihood) the prediction stands, and
    the mixture's log-likelihood is NaN.
    """
    usable = jnp.isfinite(log_likelihoods)
    joint = jnp.where(usable, predicted + jnp.where(usable, log_likelihoods, 0.0), -jnp.inf)
    joint = jnp.where(jnp.isnan(predicted), jnp.nan, joint)
    total = log_sum_exp(joint)
    explained = jnp.isfinite(total)
    posterior = jnp.where(
        explained[None], joint - jnp.where(explained, total, 0.0)[None], predicted
    )
    return posterior, jnp.where(explained, total, jnp.nan)


@stage
def mixture_info(probabilities: Any, infos: Info, log_likelihood: Any, finite: Any) -> Info:
    """Info of the mixture; the innovation is moment-matched over the members' predictions."""
    matched = moment_match(probabilities, Gaussian(infos.innovation, infos.innovation_cov))
    flags = infos.flags._replace(
        missing=infos.flags.missing[0],
        guarded=jnp.any(infos.flags.guarded, 0),
        nonfinite=~finite,
        lost_members=jnp.sum(infos.flags.nonfinite.astype(jnp.int32), 0)
        + jnp.sum(infos.flags.lost_members, 0),
        rejected=jnp.max(infos.flags.rejected, 0),
    )
    nis = normalised_square(matched.mean, matched.cov)
    return Info(matched.mean, matched.cov, log_likelihood, nis, flags)


def safe_log(p: Any) -> Any:
    """log p with -inf, and gradient 0, at p = 0; NaN where p is negative or NaN."""
    zero = p == 0
    return jnp.where(zero, -jnp.inf, jnp.log(jnp.where(zero, 1.0, p)))


def log_sum_exp(a: Any) -> Any:
    """log sum exp over the leading axis, with finite gradients where all terms are -inf."""
    top = jax.lax.stop_gradient(jnp.max(a, axis=0))
    finite = jnp.isfinite(top)
    shift = jnp.where(finite, top, 0.0)
    total = jnp.sum(jnp.exp(a - shift[None]), 0)
    found = jnp.where(finite, jnp.log(jnp.where(finite, total, 1.0)) + shift, -jnp.inf)
    return jnp.where(jnp.isnan(top), jnp.nan, found)
