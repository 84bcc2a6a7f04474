"""Measurement updates that outliers cannot pull away: a gate, Student's t, Huber.

Each function returns an `Update` for the `measurement_update` of `unscented` or `extended`.
Every one of them reports the innovation, its nominal covariance and the NIS that were seen,
whatever it made of them, and the log-likelihood of a density that integrates to one. So
leaving samples out is never rewarded when noise is learned by maximum likelihood, as it would
be if a rejected sample counted zero.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
from scipy.special import poch
from scipy.stats import chi2

from wheelhop.filtering import smallmat
from wheelhop.filtering.gaussian import Gaussian
from wheelhop.filtering.interface import Info, Lower, Named, Update, all_finite
from wheelhop.filtering.sigma_points import Moments
from wheelhop.filtering.update import condition, mask_missing


def gated(
    probability: float = 0.999, *, threshold: float | None = None, entrywise: bool = False
) -> Update:
    """Innovation gate: a measurement whose NIS is too large becomes missing.

    NIS = r^T S^-1 r is compared with the chi-square quantile of as many degrees of freedom as
    entries are present, or, entry by entry, r_i^2 / S_ii with that of one degree (Bar-Shalom,
    Li & Kirubarajan 2001). `Info.flags.rejected` counts the entries left out.

    The log-likelihood is that of the Gaussian inside the gate and of a power-law tail outside,
    which holds exactly the mass q that the Gaussian has there; with g^2 the threshold, k
    degrees of freedom and A_k = 2 pi^(k/2) / Gamma(k/2),
    log p = log(q g / A_k) - (k + 1)/2 log NIS - 1/2 log det S.
    It has no units to choose, and it integrates to one for every S (entrywise: if the
    innovations are uncorrelated), so that shrinking S to reject more lowers it.

    Args:
        probability: share of good measurements that pass, in (0, 1).
        threshold: largest accepted NIS, instead of `probability`.
        entrywise: judge and reject every entry alone, not the whole sample.

    Raises:
        ValueError: if `probability` is not inside (0, 1) or `threshold` is not positive.
    """
    if threshold is None and not 0 < probability < 1:
        raise ValueError(f"probability={probability}: give a share between 0 and 1, as 0.999")
    if threshold is not None and not 0 < threshold < math.inf:
        raise ValueError(f"threshold={threshold}: give a positive, finite NIS, as 10.8")

    def border(k: int) -> float:
        return float(chi2.isf(1.0 - probability, k)) if threshold is None else threshold

    def tail(k: int) -> float:
        mass = 1.0 - probability if threshold is None else float(chi2.sf(threshold, k))
        area = math.log(2) + 0.5 * k * math.log(math.pi) - math.lgamma(0.5 * k)
        return math.log(max(mass, sys.float_info.min)) + 0.5 * math.log(border(k)) - area

    def update(
        predicted: Gaussian, factor: Lower, moments: Moments, noise: Lower, y: Named, guarded: Any
    ) -> tuple[Gaussian, Info]:
        _, seen = condition(predicted, factor, moments, noise, y, guarded)
        m = len(y)
        kept, rejected = list(y), jnp.zeros_like(seen.flags.missing)
        outside = jnp.zeros_like(seen.log_likelihood)
        for group in [[i] for i in range(m)] if entrywise else [list(range(m))]:
            dofs = range(1, len(group) + 1)
            cov = tuple(tuple(seen.innovation_cov[i][j] for j in group if j <= i) for i in group)
            root, _ = smallmat.cholesky(cov)
            log_nis = _log_nis([seen.innovation[i] for i in group], root)
            count = _count([jnp.isfinite(y[i]) for i in group])
            far = log_nis > _of_count(count, [math.inf, *(math.log(border(k)) for k in dofs)])
            power = 0.5 * (count.astype(log_nis.dtype) + 1.0)
            density = (
                _of_count(count, [0.0, *map(tail, dofs)])
                - power * jnp.where(far, log_nis, 0.0)
                - 0.5 * smallmat.log_det(root)
            )
            outside = outside + jnp.where(far, density, 0.0)
            rejected = rejected + jnp.where(far, count, 0)
            for i in group:
                kept[i] = jnp.where(far, jnp.nan, y[i])
        belief, info = condition(predicted, factor, moments, noise, type(y)(*kept), guarded)
        log_likelihood = info.log_likelihood + outside
        return belief, _report(seen, info, belief, log_likelihood, rejected)

    return update


def student_t(dof: float = 4.0, iterations: int = 5) -> Update:
    """Update for measurement noise with a Student's t distribution of scale matrix R.

    Given lambda ~ Gamma(dof/2, dof/2) the noise is N(0, R / lambda); the variational posterior
    keeps the state Gaussian and iterates, with e = E[(y - h(x))^T R^-1 (y - h(x)) | y, lambda],
    lambda = (dof + m) / (dof + e)
    (Agamennoni, Nieto & Nebot 2012; Piche, Sarkka & Hartikainen 2012). All entries of a sample
    share one lambda. The noise has covariance R dof / (dof - 2) for dof > 2.

    The log-likelihood is that of Student's t with scale matrix S, the form of the filter of
    Roth, Ozkan & Gustafsson 2013: exact where R outweighs the predicted uncertainty, and always
    a normalised density. A sample so far off that its NIS has no square in the floating type
    is left out and counted in `Info.flags.rejected`.

    Args:
        dof: degrees of freedom, positive; small is heavy-tailed, infinity is Gaussian.
        iterations: fixed-point iterations for lambda.

    Raises:
        ValueError: if `dof` is not positive and finite or `iterations` is below 1.
    """
    if not 0 < dof < math.inf:
        raise ValueError(f"dof={dof}: give positive, finite degrees of freedom, as 4")
    _at_least_one(iterations)

    def constant(k: int) -> float:
        return math.log(poch(0.5 * dof, 0.5 * k)) - 0.5 * k * math.log(dof * math.pi)

    def update(
        predicted: Gaussian, factor: Lower, moments: Moments, noise: Lower, y: Named, guarded: Any
    ) -> tuple[Gaussian, Info]:
        _, seen = condition(predicted, factor, moments, noise, y, guarded)
        root, _ = smallmat.cholesky(seen.innovation_cov)
        log_nis = _log_nis(seen.innovation, root)
        far = log_nis > 0.5 * math.log(jnp.finfo(log_nis.dtype).max)
        rejected = _count([jnp.isfinite(v) & far for v in y])
        kept = type(y)(*(jnp.where(far, jnp.nan, v) for v in y))

        innovation, signal, scale, present = _split(kept, moments, noise)
        count = _count(present).astype(log_nis.dtype)
        nis = jnp.exp(jnp.where(far, 0.0, log_nis))
        spread = jnp.where(far, 1.0, (dof + nis) / (dof + count))

        def again(spread: Any, _: None) -> tuple[Any, None]:
            scaled = smallmat.add(signal, tuple(tuple(spread * r for r in row) for row in scale))
            root, _ = smallmat.cholesky(scaled)
            residual = [spread * w for w in _solve(root, innovation)]
            columns = [_solve(root, _column(signal, j)) for j in range(len(present))]
            trace = sum(column[j] for j, column in enumerate(columns))
            return (dof + _quadratic(scale, residual) + spread * trace) / (dof + count), None

        spread, _ = jax.lax.scan(again, spread, None, iterations)
        wider = tuple(tuple(spread * r for r in row) for row in noise)
        belief, info = condition(predicted, factor, moments, wider, kept, guarded)
        count = _count([jnp.isfinite(v) for v in y])
        log_likelihood = (
            _of_count(count, [0.0, *map(constant, range(1, len(present) + 1))])
            - 0.5 * smallmat.log_det(root)
            - 0.5
            * (dof + count.astype(log_nis.dtype))
            * jnp.logaddexp(0.0, log_nis - math.log(dof))
        )
        return belief, _report(seen, info, belief, log_likelihood, rejected)

    return update


def huber(threshold: float = 1.345, iterations: int = 10) -> Update:
    """Huber's M-estimate: residuals beyond a threshold pull with a constant force.

    Minimises (x - m)^T P^-1 (x - m) / 2 + sum_i rho(z_i) over x, with z the residuals
    y - h(x) whitened by the Cholesky factor of R and rho quadratic up to the threshold and
    linear beyond, by iteratively reweighted updates (Huber 1964; Karlgaard & Schaub 2007, here
    with the prediction trusted). The problem is convex: one optimum, whatever the outlier.

    The log-likelihood is Huber's density exp(-rho(u)) / Z of the whitened innovation u:
    Gaussian with exponential tails, normalised.

    Args:
        threshold: in standard deviations of R; 1.345 keeps 95 % of the efficiency for a
            location under Gaussian noise. Infinity is the plain update.
        iterations: reweighted solutions.

    Raises:
        ValueError: if `threshold` is not positive or `iterations` is below 1.
    """
    if not threshold > 0:
        raise ValueError(f"threshold={threshold}: give a positive number of standard deviations")
    _at_least_one(iterations)
    inside = math.sqrt(2 * math.pi) * math.erf(threshold / math.sqrt(2))
    log_z = math.log(inside + 2 * math.exp(-0.5 * threshold**2) / threshold)

    def update(
        predicted: Gaussian, factor: Lower, moments: Moments, noise: Lower, y: Named, guarded: Any
    ) -> tuple[Gaussian, Info]:
        _, seen = condition(predicted, factor, moments, noise, y, guarded)
        innovation, signal, scale, present = _split(y, moments, noise)
        noise_root, noise_guarded = smallmat.cholesky(scale)
        m = len(present)

        def again(spread: Any, _: None) -> tuple[Any, None]:
            root, _ = smallmat.cholesky(smallmat.add(signal, _weighted(noise_root, spread)))
            weight = _solve(root, innovation)
            residual = [
                spread[k] * sum(noise_root[i][k] * weight[i] for i in range(k, m)) for k in range(m)
            ]
            return tuple(jnp.maximum(jnp.abs(z) / threshold, 1.0) for z in residual), None

        first = tuple(jnp.ones_like(r) for r in innovation)
        spread, _ = jax.lax.scan(again, first, None, iterations)
        wider = _weighted(noise_root, spread)
        belief, info = condition(predicted, factor, moments, wider, y, guarded | noise_guarded)
        seen_root, _ = smallmat.cholesky(seen.innovation_cov)
        white = smallmat.solve_lower(seen_root, tuple(seen.innovation))
        cost = sum(_huber_loss(u, threshold) for u in white)
        count = _count(present)
        log_likelihood = (
            -cost - log_z * count.astype(cost.dtype) - 0.5 * smallmat.log_det(seen_root)
        )
        return belief, _report(seen, info, belief, log_likelihood, jnp.zeros_like(count))

    return update


def _report(seen: Info, info: Info, belief: Gaussian, log_likelihood: Any, rejected: Any) -> Info:
    """What was seen, with the log-likelihood and flags of what was done."""
    flags = info.flags._replace(
        missing=seen.flags.missing,
        rejected=rejected,
        nonfinite=~all_finite((belief, log_likelihood)),
    )
    return seen._replace(log_likelihood=log_likelihood, flags=flags)


def _split(y: Named, moments: Moments, noise: Lower) -> tuple[tuple, Lower, Lower, list]:
    """Innovation, G G^T + even (0 where missing), R (1 where missing), presence."""
    none = jax.tree.map(jnp.zeros_like, moments.even)
    innovation, odd, scale, present = mask_missing(y, moments._replace(even=none), noise)
    even = tuple(
        tuple(jnp.where(present[i] & present[j], e, 0.0) for j, e in enumerate(row))
        for i, row in enumerate(moments.even)
    )
    return innovation, smallmat.add(smallmat.gram(odd), even), scale, present


def _log_nis(innovation: Sequence[Any], root: Lower) -> Any:
    """log r^T S^-1 r; scaled first, so that no square overflows, and -inf at r = 0."""
    top = jnp.abs(innovation[0])
    for r in innovation[1:]:
        top = jnp.maximum(top, jnp.abs(r))
    top = jax.lax.stop_gradient(top)
    positive = top > 0
    divisor = jnp.where(positive, top, 1.0)
    white = smallmat.solve_lower(root, [r / divisor for r in innovation])
    square = sum((w * w for w in white[1:]), white[0] * white[0])
    logarithm = 2.0 * jnp.log(divisor) + jnp.log(jnp.where(positive, square, 1.0))
    return jnp.where(positive, logarithm, -jnp.inf)


def _solve(root: Lower, b: Sequence[Any]) -> tuple[Any, ...]:
    return smallmat.solve_lower_transposed(root, smallmat.solve_lower(root, b))


def _column(a: Lower, j: int) -> list[Any]:
    return [a[max(i, j)][min(i, j)] for i in range(len(a))]


def _quadratic(a: Lower, x: Sequence[Any]) -> Any:
    n = len(a)
    return sum(x[i] * sum(a[max(i, j)][min(i, j)] * x[j] for j in range(n)) for i in range(n))


def _weighted(root: Lower, spread: Sequence[Any]) -> Lower:
    """L diag(spread) L^T."""
    n = len(root)
    return tuple(
        tuple(sum(root[i][k] * spread[k] * root[j][k] for k in range(j + 1)) for j in range(i + 1))
        for i in range(n)
    )


def _huber_loss(u: Any, threshold: float) -> Any:
    inner = jnp.clip(u, -threshold, threshold)
    return inner * (u - 0.5 * inner)


def _count(present: Sequence[Any]) -> Any:
    return sum((p.astype(jnp.int32) for p in present[1:]), present[0].astype(jnp.int32))


def _of_count(count: Any, table: Sequence[float]) -> Any:
    """table[count], elementwise."""
    value: Any = table[0]
    for k, entry in enumerate(table[1:], start=1):
        value = jnp.where(count == k, entry, value)
    return value


def _at_least_one(iterations: int) -> None:
    if iterations < 1:
        raise ValueError(f"iterations={iterations}: weights need at least 1 solution")
