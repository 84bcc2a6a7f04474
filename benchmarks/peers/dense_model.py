"""The quarter car as a JAX user writes it for a filter library: state vectors, dense matrices.

x = (d, e, v_s, v_u, ln k_t), y = (a_s, a_u); the same equations as tests/oracles.
"""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from tests.oracles import quarter_car_numpy as car

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(3)


def accelerations(x):
    """Of body and wheel [m/s^2], for one state [5]."""
    d, e, v_s, v_u, ln_k = x
    w = v_s - v_u
    force = car.K_S * d + car.K_NL * d**3 + car.C_S * w + car.C_NL * w * jnp.abs(w)
    return jnp.stack([-force / car.M_S, (force - jnp.exp(ln_k) * e) / car.M_U])


def derivative(x):
    """dx/dt of one state [5]."""
    a_s, a_u = accelerations(x)
    return jnp.stack([x[2] - x[3], x[3], a_s, a_u, jnp.zeros_like(a_s)])


def transition(x):
    """One state [5] a sampling interval later, by RK4."""
    dt = car.DT
    k1 = derivative(x)
    k2 = derivative(x + dt / 2 * k1)
    k3 = derivative(x + dt / 2 * k2)
    k4 = derivative(x + dt * k3)
    return x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def process_cov(x, level):
    """Covariance [5, 5] of a sampling interval on a road of level Gd(W0) [m^3/rad]."""
    k_t = jnp.exp(x[4])
    zero = jnp.zeros_like(k_t)
    spring, damper = car.K_S + zero, car.C_S + zero
    a = jnp.stack(
        [
            jnp.stack([zero, zero, zero + 1, zero - 1]),
            jnp.stack([zero, zero, zero, zero + 1]),
            jnp.stack([-spring, zero, -damper, damper]) / car.M_S,
            jnp.stack([spring, -k_t, damper, -damper]) / car.M_U,
        ]
    )
    times = jnp.asarray(car.DT / 2 * (1 + _NODES), x.dtype)
    weights = jnp.asarray(np.pi * car.SPEED * car.DT / 2 * _WEIGHTS, x.dtype) * level
    term = jnp.broadcast_to(jnp.stack([zero, zero + 1, zero, zero]), (3, 4))
    response = term
    for k in range(1, 5):
        term = times[:, None] / k * (term @ a.T)
        response = response + term
    road = jnp.einsum("q,qi,qj->ij", weights, response, response)
    walks = [0, 0, car.VELOCITY_WALK**2, car.VELOCITY_WALK**2, car.STIFFNESS_WALK**2]
    return jnp.pad(road, (0, 1)) + jnp.diag(jnp.asarray(walks, x.dtype)) * car.DT
