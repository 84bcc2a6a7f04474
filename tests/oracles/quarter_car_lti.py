"""A corner and an axle in momentum form, in NumPy and SciPy alone, written apart from wheelhop.

p_s' = S - m_s g - dF, p_u' = -S - m_u g + F, q' = p_u / m_u - p_s / m_s (Filipozzi et al. 2021,
Eq. 2-4), S = preload + k q + b q', on an axle with k_b (q - q_other) more. A system is (A, B, C, D)
with the inputs (F, dF, 1), on an axle (F_l, F_r, dF_l, dF_r, 1): gravity and preload come with the
last one. Outputs are p_s' / m_s, q and q' of each side, signal by signal.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

GRAVITY = 9.80665


class Car(NamedTuple):
    m_s: float = 460.0
    m_u: float = 61.0
    k: float = 33.6e3
    b: float = 2800.0
    preload: float = 460.0 * GRAVITY
    k_b: float = 0.0


def corner(car):
    ease = np.array([-car.b / car.m_s, car.b / car.m_u, car.k])  # S over p_s, p_u and q
    rate = np.array([-1.0 / car.m_s, 1.0 / car.m_u, 0.0])
    a = np.array([ease, -ease, rate])
    b = np.array(
        [
            [0.0, -1.0, car.preload - car.m_s * GRAVITY],
            [1.0, 0.0, -car.preload - car.m_u * GRAVITY],
            [0.0, 0.0, 0.0],
        ]
    )
    c = np.array([a[0] / car.m_s, [0.0, 0.0, 1.0], rate])
    d = np.array([b[0] / car.m_s, np.zeros(3), np.zeros(3)])
    return a, b, c, d


def axle(left, right):
    """States p_s, p_u, q of the left side, then of the right; the bar's stiffness is the left's."""
    sides = [corner(left), corner(right)]
    a, b = np.zeros((6, 6)), np.zeros((6, 5))
    for i, (a_i, b_i, _, _) in enumerate(sides):
        rows, other = slice(3 * i, 3 * i + 3), 5 - 3 * i
        a[rows, rows] = a_i
        b[rows, [i, 2 + i, 4]] = b_i
        for row, sign in ((3 * i, 1.0), (3 * i + 1, -1.0)):
            a[row, 3 * i + 2] += sign * left.k_b
            a[row, other] -= sign * left.k_b
    mass = np.array([[left.m_s], [right.m_s]])
    q = np.eye(6)[[2, 5]]
    c = np.concatenate([a[[0, 3]] / mass, q, a[[2, 5]]])
    d = np.concatenate([b[[0, 3]] / mass, np.zeros((4, 5))])
    return a, b, c, d


def transfer(system, hz):
    """C (s I - A)^-1 B + D, [frequencies, outputs, inputs]."""
    a, b, c, d = system
    s = 2j * np.pi * np.atleast_1d(hz)
    inside = s[:, None, None] * np.eye(len(a)) - a
    return c @ np.linalg.solve(inside, np.broadcast_to(b, (len(s), *b.shape))) + d


def at_rest(system, weights):
    """State without momentum in which loads that carry the weights leave a system at rest."""
    a, b, _, _ = system
    u = np.append(weights, 1.0)
    x, *_ = np.linalg.lstsq(a, -b @ u, rcond=None)
    assert np.abs(a @ x + b @ u).max() < 1e-6, "these loads do not balance the weight"
    return x


def piecewise_linear(system, u, dt, x=None):
    """Outputs [time, outputs] at the samples under inputs that are linear between them."""
    a, b, c, d = system
    n, m = b.shape
    whole = np.zeros((n + 2 * m, n + 2 * m))
    whole[:n, :n], whole[:n, n : n + m] = a * dt, b * dt
    whole[n : n + m, n + m :] = np.eye(m)
    moved = expm(whole)
    f, g0, g1 = moved[:n, :n], moved[:n, n : n + m], moved[:n, n + m :]
    u = np.asarray(u, float)
    x = np.zeros(n) if x is None else x
    ys = [c @ x + d @ u[0]]
    for before, now in pairwise(u):
        x = f @ x + g0 @ before + g1 @ (now - before)
        ys.append(c @ x + d @ now)
    return np.array(ys)


def held(system, u, dt, x=None):
    """As `piecewise_linear`, with inputs that stay constant from one sample to the next."""
    a, b, c, d = system
    n, m = b.shape
    moved = expm(np.block([[a * dt, b * dt], [np.zeros((m, n + m))]]))
    x = np.zeros(n) if x is None else x
    ys = []
    for now in np.asarray(u, float):
        ys.append(c @ x + d @ now)
        x = moved[:n, :n] @ x + moved[:n, n:] @ now
    return np.array(ys)


def driven(system, weights, loads, dt, samples, fine=10, lead=1.0):
    """(t, loads, outputs) under loads(t) [time, inputs - 1] that are smooth.

    The motion begins at rest `lead` seconds before the record, so that only what the loads make
    is left of it.
    """
    before = round(lead / dt)
    t = np.arange(-before * fine, (samples - 1) * fine + 1) * dt / fine
    u = np.c_[loads(t), np.ones(len(t))]
    y = piecewise_linear(system, u, dt / fine, at_rest(system, weights))
    kept = slice(before * fine, None, fine)
    return t[kept], u[kept, :-1], y[kept]


def low_pass(hz, bandwidth, damping=np.sqrt(0.5), lag=None):
    """M_T of Eq. 8 at some frequencies."""
    w = 2 * np.pi * bandwidth
    tau = 0.1 / w if lag is None else lag
    s = 2j * np.pi * np.asarray(hz)
    return w**2 / (s**2 + 2 * damping * w * s + w**2) / (tau * s + 1) ** 2
