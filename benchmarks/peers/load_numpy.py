"""Wheel load as a user of SciPy and NumPy would write it: `lfilter`, and a loop over samples."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy import signal

from wheelhop.estimators.inverse_load import InverseParams
from wheelhop.estimators.unbiased_load import UnbiasedParams
from wheelhop.estimators.youla_load import shaping_denominator


def youla(
    params: InverseParams, bandwidth: float, relative_lag: float
) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Load [runs, time] N from a_s and q [runs, time], by two of SciPy's compiled recursions.

    Discretised by SciPy's bilinear transform, from Eq. 8 and 14 of Filipozzi et al. 2021.
    """
    c = params.corner
    ms_free = float(c.preload) + float(c.unsprung_mass) * 9.80665
    w, dt = 2.0 * np.pi * bandwidth, params.shaping.dt
    p = np.asarray(shaping_denominator(np.sqrt(0.5), relative_lag), float)
    below = (p / w ** np.arange(5))[::-1]
    parts = (
        [float(c.unsprung_mass)],
        [float(x) for x in (c.unsprung_mass, c.damping, c.stiffness)],
    )
    discrete = [signal.cont2discrete((above, below), dt, method="bilinear") for above in parts]
    sections = [(np.ravel(b), a) for b, a, _ in discrete]

    def run(a_s: np.ndarray, q: np.ndarray) -> np.ndarray:
        total = np.full_like(q, ms_free)
        for (b, a), u in zip(sections, (a_s, q), strict=True):
            total += signal.lfilter(b, a, u, axis=-1)
        return total

    return run


def unbiased(params: UnbiasedParams) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Load [time] N from a_s and q [time], one run, a loop of small dense matrices.

    The input is split by what the measurement sees at once; both parts are found by generalised
    least squares, Gillijns & De Moor 2007. The load is of one sample before.
    """
    m = params.system.model
    f, g, c, h = (
        np.asarray(x, float) for x in (m.transition, m.input_matrix, m.observation, m.feedthrough)
    )
    q_cov, r = np.asarray(m.process_cov, float), np.asarray(m.observation_cov, float)
    x_known, y_known = np.asarray(m.state_offset, float), np.asarray(m.observation_offset, float)
    v1, v2 = np.asarray(params.system.direct, float), np.asarray(params.system.delayed, float)
    to_a = np.asarray(params.system.coordinates, float)
    s = params.shaping
    a_x, before, now = (np.asarray(x, float) for x in (s.transition, s.before, s.now))
    scale = float(s.scale)
    g1, g2 = g @ v1, g @ v2
    move = np.block([[f, g1], [np.zeros((1, 2)), np.ones((1, 1))]])
    wide_q = np.zeros((3, 3))
    wide_q[:2, :2] = q_cov
    seen = np.hstack([c @ g2, h @ v1])
    reads = np.hstack([c, np.zeros((3, 1))])

    def run(a_s: np.ndarray, deflection: np.ndarray) -> np.ndarray:
        chains, last, z = np.zeros((2, 2)), np.zeros(2), np.zeros(3)
        spread = float(0.03**2)
        direct = float((to_a @ (v1 @ v1.T) @ to_a.T)[0, 0])
        p = np.diag([spread, spread * scale**2, direct])
        loads = np.empty(len(a_s))
        for k in range(len(a_s)):
            u = np.array([a_s[k], deflection[k]])
            chains = chains @ a_x.T + last[:, None] * before + u[:, None] * now
            last = u
            y = np.array([chains[0, 0], chains[1, 0], scale * chains[1, 1]])
            z, p, loads[k] = _step(z, p, y)
        return loads

    def _step(z: np.ndarray, p: np.ndarray, y: np.ndarray) -> tuple[Any, Any, float]:
        z = move @ z + np.append(x_known, 0.0)
        p = move @ p @ move.T + wide_q
        e = y - reads @ z - y_known
        total = reads @ p @ reads.T + r
        weight = np.linalg.inv(total)
        normal = seen.T @ weight
        inverse = np.linalg.solve(normal @ seen, normal)
        b, a = inverse @ e
        gain = p @ reads.T @ weight
        # what the inputs add to (x, a_{k-1}) and to the new a_k
        effect = np.vstack([np.hstack([g2, np.zeros((2, 1))]), np.zeros((1, 2))])
        whole = gain + (effect - gain @ seen) @ inverse
        z = z + whole @ e
        load = float((v2 @ [b] + v1[:, 0] * z[2])[0])
        errors = np.eye(3) - whole @ reads
        x_cov = errors @ p @ errors.T + whole @ r @ whole.T
        to_new = inverse[1:2]
        new = np.zeros((3, 3))
        new[:2, :2] = x_cov[:2, :2]
        new[2:, 2:] = to_new @ total @ to_new.T
        side = -(errors @ p @ reads.T @ to_new.T - whole @ r @ to_new.T)
        new[:2, 2:] = side[:2]
        new[2:, :2] = side[:2].T
        return np.array([z[0], z[1], a]), new, load

    return run
