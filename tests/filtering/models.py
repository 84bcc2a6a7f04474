"""State-space models for tests, and a NumPy Kalman filter that shares no code with wheelhop."""

from typing import Any, NamedTuple

import numpy as np

from wheelhop.filtering import AugmentedModel, Gaussian, StateSpaceModel


class Track(NamedTuple):
    position: Any
    velocity: Any
    bias: Any


class Sensors(NamedTuple):
    a: Any
    b: Any


F = np.array([[1.0, 0.1, 0.0], [-0.2, 0.97, 0.05], [0.0, 0.0, 0.99]])
H = np.array([[1.0, 0.0, 0.3], [0.0, 1.0, -1.0]])
Q = np.outer([0.1, 0.3, 0.0], [0.1, 0.3, 0.0])  # rank one: a road drives one direction
R = np.array([[0.5, 0.1], [0.1, 0.4]])
MEAN = np.array([0.3, -0.2, 0.1])
COV = np.array([[1.0, 0.2, 0.0], [0.2, 0.5, 0.1], [0.0, 0.1, 0.3]])


def _product(matrix, x):
    return [sum(m * v for m, v in zip(row, x, strict=True)) for row in matrix.tolist()]


def _scaled_triangle(scale, matrix):
    rows = matrix.tolist()
    return tuple(tuple(scale * rows[i][j] for j in range(i + 1)) for i in range(len(rows)))


def linear_model():
    """Linear Gaussian model; `params` scales both noises."""
    return StateSpaceModel(
        transition=lambda x, p: Track(*_product(F, x)),
        observation=lambda x, p: Sensors(*_product(H, x)),
        process_cov=lambda x, p: _scaled_triangle(p, Q),
        observation_cov=lambda p: _scaled_triangle(p, R),
    )


class One(NamedTuple):
    value: Any


def augmented_linear_model():
    """The same model with its rank-one noise as an argument."""
    linear = linear_model()

    def transition(x, w, p):
        nxt = linear.transition(x, p)
        return Track(nxt.position + 0.1 * w.value, nxt.velocity + 0.3 * w.value, nxt.bias)

    def observation(x, v, p):
        return Sensors(*(h + n for h, n in zip(linear.observation(x, p), v, strict=True)))

    def observation_noise(p):
        return Gaussian(Sensors(0.0, 0.0), _scaled_triangle(p, R))

    return AugmentedModel(
        transition, observation, lambda x, p: Gaussian(One(0.0), ((1.0 * p,),)), observation_noise
    )


def kalman(ys, scale=1.0):
    """Textbook Kalman filter, predict first, over rows of ys; NaN rows or entries are missing."""
    mean, cov = MEAN.copy(), COV.copy()
    means, covs, log_likelihood = [], [], []
    for y in ys:
        mean, cov = F @ mean, F @ cov @ F.T + scale * Q
        here = np.isfinite(y)
        if here.any():
            h, r = H[here], scale * R[np.ix_(here, here)]
            s = h @ cov @ h.T + r
            innovation = y[here] - h @ mean
            gain = cov @ h.T @ np.linalg.inv(s)
            mean = mean + gain @ innovation
            joseph = np.eye(3) - gain @ h
            cov = joseph @ cov @ joseph.T + gain @ r @ gain.T
            nis = innovation @ np.linalg.solve(s, innovation)
            log_likelihood.append(-0.5 * (nis + np.linalg.slogdet(2 * np.pi * s)[1]))
        else:
            log_likelihood.append(0.0)
        means.append(mean)
        covs.append(cov)
    return np.array(means), np.array(covs), np.array(log_likelihood)


def sample(seed, steps):
    rng = np.random.default_rng(seed)
    x = rng.multivariate_normal(MEAN, COV)
    xs, ys = [], []
    for _ in range(steps):
        x = F @ x + rng.normal() * np.array([0.1, 0.3, 0.0])
        xs.append(x)
        ys.append(H @ x + rng.multivariate_normal(np.zeros(2), R))
    return np.array(xs), np.array(ys)


def joint(steps):
    """Mean and covariance of all states and measurements, with no recursion over filters."""
    powers = [np.linalg.matrix_power(F, k) for k in range(steps + 1)]
    mean = np.concatenate([powers[k] @ MEAN for k in range(1, steps + 1)])
    cov = np.zeros((3 * steps, 3 * steps))
    for a in range(1, steps + 1):
        for b in range(1, steps + 1):
            block = powers[a] @ COV @ powers[b].T
            for k in range(1, min(a, b) + 1):
                block = block + powers[a - k] @ Q @ powers[b - k].T
            cov[3 * a - 3 : 3 * a, 3 * b - 3 : 3 * b] = block
    big_h = np.kron(np.eye(steps), H)
    return mean, cov, big_h, big_h @ cov @ big_h.T + np.kron(np.eye(steps), R)


def dense_posterior(ys):
    """Mean and covariance of all states given the record, and its evidence: one dense solve."""
    mean, cov, big_h, s = joint(len(ys))
    residual = ys.ravel() - big_h @ mean
    weight = np.linalg.solve(s, residual)
    posterior = mean + cov @ big_h.T @ weight
    spread = cov - cov @ big_h.T @ np.linalg.solve(s, big_h @ cov)
    evidence = -0.5 * (residual @ weight + np.linalg.slogdet(2 * np.pi * s)[1])
    return posterior, spread, evidence
