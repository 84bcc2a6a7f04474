"""A textbook IMM of unscented filters in dense NumPy, written apart from wheelhop.

Blom & Bar-Shalom 1988, with the unscented filter of Wan & van der Merwe 2000: covariances are
weighted sums over all points, the update subtracts K S K^T, and rows of `measurements` that
hold NaN are left out by deleting them from y, S and the cross covariance.
"""

import numpy as np
from scipy.special import logsumexp
from scipy.stats import multivariate_normal


def points(mean, cov, alpha, beta, kappa):
    n = len(mean)
    total = alpha**2 * (n + kappa)
    root = np.linalg.cholesky(total * cov)
    spread = np.vstack([np.zeros(n), root.T, -root.T])
    weights = np.full(2 * n + 1, 0.5 / total)
    weights_cov = weights.copy()
    weights[0] = 1 - n / total
    weights_cov[0] = weights[0] + 1 - alpha**2 + beta
    return mean + spread, weights, weights_cov


def predict(mean, cov, transition, process_cov, rule):
    noise = process_cov(mean)
    x, w, wc = points(mean, cov, *rule)
    x = np.array([transition(p) for p in x])
    mean = w @ x
    return mean, (x - mean).T @ np.diag(wc) @ (x - mean) + noise


def update(mean, cov, y, observation, noise, rule):
    here = np.isfinite(y)
    if not here.any():
        return mean, cov, 0.0
    x, w, wc = points(mean, cov, *rule)
    z = np.array([observation(p) for p in x])
    expected = w @ z
    s = ((z - expected).T @ np.diag(wc) @ (z - expected) + noise)[np.ix_(here, here)]
    cross = ((x - mean).T @ np.diag(wc) @ (z - expected))[:, here]
    gain = np.linalg.solve(s, cross.T).T
    log_likelihood = multivariate_normal(expected[here], s).logpdf(y[here])
    return (
        mean + gain @ (y - expected)[here],
        cov - gain @ s @ gain.T,
        log_likelihood,
    )


def mixture(weights, means, covs):
    mean = sum(w * m for w, m in zip(weights, means, strict=True))
    cov = sum(
        w * (p + np.outer(m - mean, m - mean)) for w, m, p in zip(weights, means, covs, strict=True)
    )
    return mean, cov


def imm(measurements, mean, cov, markov, initial, members, observation, noise, rule):
    """Combined means and covariances, mode probabilities and log-likelihoods of a record.

    Args:
        markov: P(mode j now | mode i before) at [i, j].
        members: per mode, (transition(x), process_cov(x)).
        rule: (alpha, beta, kappa).
    """
    modes = range(len(members))
    beliefs = [(mean, cov)] * len(members)
    mu, history = np.asarray(initial), []
    for y in measurements:
        predicted = markov.T @ mu
        stepped, log_likelihoods = [], []
        for j in modes:
            mixing = markov[:, j] * mu / predicted[j]
            m, p = mixture(mixing, *zip(*beliefs, strict=True))
            m, p = predict(m, p, *members[j], rule)
            m, p, log_likelihood = update(m, p, y, observation, noise, rule)
            stepped.append((m, p))
            log_likelihoods.append(log_likelihood)
        beliefs = stepped
        joint = np.log(predicted) + log_likelihoods
        total = logsumexp(joint)
        mu = np.exp(joint - total)
        m, p = mixture(mu, *zip(*beliefs, strict=True))
        history.append((m, p, mu, total))
    return [np.array(h) for h in zip(*history, strict=True)]
