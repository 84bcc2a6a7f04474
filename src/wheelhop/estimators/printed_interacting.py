"""The interacting multiple model as Brancati & Tufano 2022 print it, Eq. 9-14.

For the reproduction of the paper only; `filtering.interacting` is the filter to use.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from wheelhop.filtering import Filter, Gaussian, Info, InteractingParams, InteractingState
from wheelhop.filtering.gaussian import moment_match, trailing
from wheelhop.filtering.interacting import correct, mixture_info, safe_log
from wheelhop.filtering.interface import Named, all_finite
from wheelhop.staging import stage


class PrintedForms(NamedTuple):
    """Which equations are taken as printed; False takes the textbook form.

    Attributes:
        prediction: Eq. 9, mu = Pz mu.
        weights: Eq. 10, 11, weights of the predicted probabilities.
        spread: Eq. 11, no spread of the means.
        determinant: Eq. 12, 1/det(Pyy).
    """

    prediction: bool = True
    weights: bool = True
    spread: bool = True
    determinant: bool = True


def printed_interacting(member: Filter, forms: PrintedForms = PrintedForms()) -> Filter:
    """IMM of Gaussian filters with the printed forms of its equations.

    Args:
        member: a filter whose state is a `Gaussian`.
        forms: what is taken as printed.

    Returns:
        A `Filter` over `InteractingState` and `InteractingParams`, as `interacting`'s. With
        printed weights, which do not sum to one, members grow away from any state that explains
        the samples; a member that leaves the finite numbers is not restarted.
    """

    def init(prior: Any, params: InteractingParams) -> InteractingState:
        states = jax.vmap(member.init, in_axes=(None, 0))(prior, params.members)
        return InteractingState(
            states, safe_log(params.initial), moment_match(params.initial, states)
        )

    def step(
        state: InteractingState, y: Named, params: InteractingParams
    ) -> tuple[InteractingState, Info]:
        before = jnp.exp(state.log_probabilities)
        predicted, weights = printed_mixing(before, params.transition, forms)
        mixed = mixed_states(weights, state.members, spread=not forms.spread)
        states, infos = jax.vmap(member.step, in_axes=(0, None, 0))(mixed, y, params.members)
        likelihoods = infos.log_likelihood
        if forms.determinant:
            likelihoods = without_root(infos)
        log_probabilities, log_likelihood = correct(safe_log(predicted), likelihoods)
        combined = moment_match(jnp.exp(log_probabilities), states)  # Eq. 13, 14
        finite = all_finite((combined, log_likelihood))
        report = mixture_info(predicted, infos, log_likelihood, finite)
        return InteractingState(states, log_probabilities, combined), report

    def mix(weights: Any, stacked: InteractingState) -> InteractingState:
        raise TypeError("the printed filter cannot be a member of another; use `interacting`")

    return Filter(init, step, mix)


@stage
def printed_mixing(mu: Any, transition: Any, forms: PrintedForms) -> tuple[Any, Any]:
    """Predicted probabilities [m], Eq. 9, and weights W[j, i] from j into i [m, m], Eq. 10."""
    lanes = mu.ndim - 1
    p = trailing(transition, lanes + 2)
    predicted = jnp.sum(p * mu[None], 1) if forms.prediction else jnp.sum(p * mu[:, None], 0)
    if forms.weights:
        weights = jnp.swapaxes(p, 0, 1) * predicted[:, None] / predicted[None]
    else:
        weights = p * mu[:, None] / jnp.sum(p * mu[:, None], 0)[None]
    return predicted, weights


@stage
def mixed_states(weights: Any, members: Gaussian, spread: bool) -> Gaussian:
    """Members mixed for the next step, Eq. 10 and 11, on a leading axis [m].

    Args:
        weights: W[j, i] from j into i [m, m].
        members: entries [m].
        spread: add the spread of the means, which Eq. 11 leaves out.
    """

    def average(entries: Any) -> Any:
        return jnp.sum(weights * entries, 0)

    mean = tuple(average(x[:, None]) for x in members.mean)
    off = [x[:, None] - m[None] for x, m in zip(members.mean, mean, strict=True)]
    cov = tuple(
        tuple(
            average(members.cov[i][j][:, None] + (off[i] * off[j] if spread else 0.0))
            for j in range(i + 1)
        )
        for i in range(len(mean))
    )
    return Gaussian(type(members.mean)(*mean), cov)


@stage
def without_root(infos: Info) -> Any:
    """log of exp(-nu^T Pyy^-1 nu / 2) / det(Pyy), Eq. 12, up to a constant."""
    # log L = -(nis + log det + n log 2 pi) / 2, and the constant falls out of the probabilities
    return 2.0 * infos.log_likelihood + 0.5 * infos.nis
