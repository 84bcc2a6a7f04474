"""A quarter car in plain NumPy, written apart from wheelhop: state [d, e, v_s, v_u, ln k_t]."""

import numpy as np

M_S, M_U = 466.7, 61.14
K_S, K_NL, C_S, C_NL = 33.6e3, 1.0e5, 2400.0, 500.0
SPEED, DT = 60.0 / 3.6, 0.002
NOISE = 0.5
STIFFNESS_WALK, VELOCITY_WALK = 0.02, 0.01


def suspension(d, w):
    return K_S * d + K_NL * d**3 + C_S * w + C_NL * w * abs(w)


def derivative(x):
    d, e, v_s, v_u, ln_k = x
    force = suspension(d, v_s - v_u)
    return np.array([v_s - v_u, v_u, -force / M_S, (force - np.exp(ln_k) * e) / M_U, 0.0])


def transition(x, dt=DT):
    k1 = derivative(x)
    k2 = derivative(x + dt / 2 * k1)
    k3 = derivative(x + dt / 2 * k2)
    k4 = derivative(x + dt * k3)
    return x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def observation(x):
    d, e, v_s, v_u, ln_k = x
    force = suspension(d, v_s - v_u)
    return np.array([-force / M_S, (force - np.exp(ln_k) * e) / M_U])


def process_cov(x, level, dt=DT):
    """Response to a step of the road, fourth-order series, integrated by 3-point Gauss-Legendre."""
    k_t = np.exp(x[4])
    a = np.zeros((5, 5))
    a[0, 2], a[0, 3], a[1, 3] = 1.0, -1.0, 1.0
    a[2, :4] = -np.array([K_S, 0.0, C_S, -C_S]) / M_S
    a[3, :4] = np.array([K_S, -k_t, C_S, -C_S]) / M_U
    step = np.array([0.0, 1.0, 0.0, 0.0, 0.0])
    cov = np.zeros((5, 5))
    for node, weight in zip(*np.polynomial.legendre.leggauss(3), strict=True):
        t = dt / 2 * (1 + node)
        terms = [step]
        for k in range(1, 5):
            terms.append(a @ terms[-1] * t / k)
        h = np.sum(terms, axis=0)
        cov += np.pi * level * SPEED * dt / 2 * weight * np.outer(h, h)
    return cov + np.diag([0, 0, VELOCITY_WALK**2, VELOCITY_WALK**2, STIFFNESS_WALK**2]) * dt


def simulate(rng, level, samples, ln_k, substeps=10):
    x = np.array([0.0, 0.0, 0.0, 0.0, ln_k])
    rows = []
    for _ in range(samples):
        for _ in range(substeps):
            x = transition(x, DT / substeps)
            x[1] -= rng.normal() * np.sqrt(np.pi * level * SPEED * DT / substeps)
        rows.append(observation(x) + NOISE * rng.normal(size=2))
    return np.array(rows)
