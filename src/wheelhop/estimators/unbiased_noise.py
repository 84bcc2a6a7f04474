"""Noise of an unbiased minimum variance filter behind a differentiator, as it truly is.

The filter takes the shaped signals for independent white ones; they are not, since all of them
follow from two sensors through one low-pass. Its gains are constant after a while, and then the
way from the sensors' noise to the load is linear and known.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.linalg import solve_discrete_lyapunov

from wheelhop.filtering.decoupling import DecoupledModel
from wheelhop.filtering.rational import Chain

_STEPS, _SETTLED = 20_000, 1e-10


def steady_load_cov(
    system: DecoupledModel, shaping: Chain, acceleration_noise: float, deflection_noise: float
) -> np.ndarray:
    """Covariance of the two loads that white noise of the sensors makes in the end, [2, 2] N^2.

    Args:
        system: of one corner, states q and q', inputs F and dF, concrete; dF alone is seen at once.
        shaping: chain of the differentiator's low-pass, two states, concrete.
        acceleration_noise: [m/s^2].
        deflection_noise: [m].

    Raises:
        ValueError: if the filter's gains do not settle.
    """
    m = system.model
    f, g, c, h, q, r = (
        np.asarray(x, float)
        for x in (
            m.transition, m.input_matrix, m.observation, m.feedthrough, m.process_cov,
            m.observation_cov,
        )
    )  # fmt: skip
    v1, v2 = np.asarray(system.direct, float), np.asarray(system.delayed, float)
    move, whole, find = _steady_gains(f, g @ v1, g @ v2, c, h @ v1, q, r)
    a, before, now = (
        np.asarray(x, float) for x in (shaping.transition, shaping.before, shaping.now)
    )
    # noise that is in both chains, in their latest samples and in (q, q', a)
    count = 4 + 2 + 3
    both = np.eye(2)
    chains = (np.kron(both, a), np.kron(both, before[:, None]), np.kron(both, now[:, None]))
    reads = np.array([[1.0, 0, 0, 0], [0, 0, 1.0, 0], [0, 0, 0, float(shaping.scale)]])
    new_y = reads @ np.hstack([chains[0], chains[1]])
    by_noise = reads @ chains[2]
    predicted = c @ move[:2]
    step, gain = np.zeros((count, count)), np.zeros((count, 2))
    step[:4, :6] = np.hstack([chains[0], chains[1]])
    gain[:4], gain[4:6] = chains[2], np.eye(2)
    # an innovation e = y - C M z moves the state by M z + W e
    step[6:, :6] = whole @ new_y
    step[6:, 6:] = move - whole @ predicted
    # the new direct input is what is found of it, not the old one moved
    step[8:, :6] = find[1:] @ new_y
    step[8:, 6:] = -find[1:] @ predicted
    gain[6:], gain[8:] = whole @ by_noise, find[1:] @ by_noise
    noise = np.diag([acceleration_noise**2, deflection_noise**2])
    settled = solve_discrete_lyapunov(step, gain @ noise @ gain.T)
    # d_{k-1} = V1 a_{k-1} + V2 b: a_{k-1} as corrected by y_k
    corrected = np.hstack([whole[2:] @ new_y, move[2:] - whole[2:] @ predicted])
    delayed = np.hstack([find[:1] @ new_y, -find[:1] @ predicted])
    out = v1 @ corrected + v2 @ delayed
    through = v1 @ whole[2:] @ by_noise + v2 @ find[:1] @ by_noise
    return np.asarray(out @ settled @ out.T + through @ noise @ through.T)


def shaped_variances(shaping: Chain) -> np.ndarray:
    """Variances of p^0 u / D and p^1 u / D for white u of variance 1, [2].

    Args:
        shaping: chain of the low-pass, concrete.
    """
    a, before, now = (
        np.asarray(x, float) for x in (shaping.transition, shaping.before, shaping.now)
    )
    n = len(a)
    step, gain = np.zeros((n + 1, n + 1)), np.append(now, 1.0)
    step[:n] = np.hstack([a, before[:, None]])
    return np.asarray(np.diag(solve_discrete_lyapunov(step, np.outer(gain, gain)))[:2])


def _steady_gains(
    f: np.ndarray, g1: np.ndarray, g2: np.ndarray, c: np.ndarray, h1: np.ndarray, q: Any, r: Any
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Motion of (x, a) [3, 3], their gain [3, 3], and that of the inputs (b, a) [2, 3].

    The recursion of Gillijns & De Moor 2007 for an input that is seen in part at once.
    """
    move = np.block([[f, g1], [np.zeros((1, 2)), np.ones((1, 1))]])
    process = np.zeros((3, 3))
    process[:2, :2] = q
    seen, reads = np.hstack([c @ g2, h1]), np.hstack([c, np.zeros((3, 1))])
    effect = np.zeros((3, 2))
    effect[:2, :1] = g2
    p, last = np.diag([1e-4, 1.0, 1e6]), np.full((3, 3), np.inf)
    for _ in range(_STEPS):
        p = move @ p @ move.T + process
        weight = np.linalg.inv(reads @ p @ reads.T + r)
        normal = seen.T @ weight
        find = np.linalg.solve(normal @ seen, normal)
        gain = p @ reads.T @ weight
        whole = gain + (effect - gain @ seen) @ find
        errors = np.eye(3) - whole @ reads
        x_cov = errors @ p @ errors.T + whole @ r @ whole.T
        one = find[1:]
        side = whole @ r @ one.T - errors @ p @ reads.T @ one.T
        p = np.zeros((3, 3))
        p[:2, :2], p[:2, 2:], p[2:, :2] = x_cov[:2, :2], side[:2], side[:2].T
        p[2:, 2:] = one @ np.linalg.inv(weight) @ one.T
        if np.abs(whole - last).max() <= _SETTLED * np.abs(whole).max():
            break
        last = whole
    else:
        raise ValueError(f"the filter's gains have not settled after {_STEPS} samples")
    return move, whole, find
