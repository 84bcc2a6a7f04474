"""Solmaz's two-track model and switched bank in plain NumPy, from the paper's equations alone.

Written apart from wheelhop. Wheels are the last axis: v l, v r, h l, h r; a tyre is (k1, k2, k3).
`printed` keeps Eq. 2, 8 and 9 as they stand; otherwise a right turn is, by construction, the
mirror image of a left turn: all signs turned, Eq. 8, the wheels exchanged.
"""

import numpy as np
from scipy.integrate import cumulative_trapezoid, solve_ivp

G = 9.80665
CAR = {"m": 1300.0, "J": 1200.0, "lv": 1.2, "lh": 1.3, "T": 1.5, "h": 0.7}
NOMINAL, SOFT = (1.0, 5650.0, 15.0), (1.0, 4500.0, 12.0)
LEFT_IS_RIGHT = [1, 0, 3, 2]


def wheels(*columns):
    return np.stack(np.broadcast_arrays(*columns), axis=-1)


def loads(a_y, car=CAR):
    """Eq. 7."""
    m, lv, lh, track, h = (car[name] for name in ("m", "lv", "lh", "T", "h"))
    length = lv + lh
    return wheels(
        m * lh / (2 * length) * G - m * lh * h / (length * track) * a_y,
        m * lh / (2 * length) * G + m * lh * h / (length * track) * a_y,
        m * lv / (2 * length) * G - m * lv * h / (length * track) * a_y,
        m * lv / (2 * length) * G + m * lv * h / (length * track) * a_y,
    )


def steer_angles(delta, car=CAR):
    """Eq. 2: inner, outer."""
    length = car["lv"] + car["lh"]
    return (
        delta + delta**2 * car["T"] / (2 * length),
        delta - delta**2 * car["T"] / (2 * length),
    )


def _slip_angles_left(beta, rate, delta, v, car):
    """Eq. 8."""
    inner, outer = steer_angles(delta, car)
    slow, fast = v - 0.5 * rate * car["T"], v + 0.5 * rate * car["T"]
    front, rear = v * beta + rate * car["lv"], v * beta - rate * car["lh"]
    return wheels(
        inner - np.arctan(front / slow),
        outer - np.arctan(front / fast),
        -np.arctan(rear / slow),
        -np.arctan(rear / fast),
    )


def _slip_angles_right(beta, rate, delta, v, car):
    """Eq. 9."""
    inner, outer = steer_angles(delta, car)
    one, other = v + 0.5 * rate * car["T"], v - 0.5 * rate * car["T"]
    front, rear = v * beta + rate * car["lv"], v * beta - rate * car["lh"]
    return wheels(
        outer - np.arctan(front / one),
        inner - np.arctan(front / other),
        -np.arctan(rear / one),
        -np.arctan(rear / other),
    )


def slip_angles(beta, rate, delta, v, printed, car=CAR):
    left = _slip_angles_left(beta, rate, delta, v, car)
    if printed:
        right = _slip_angles_right(beta, rate, delta, v, car)
    else:
        right = -_slip_angles_left(-beta, -rate, -delta, v, car)[..., LEFT_IS_RIGHT]
    return np.where(np.expand_dims(np.asarray(delta) > 0, -1), left, right)


def forces(alpha, load, k, guard=True):
    """Eq. 3; guarded: no force of a lifted wheel or of a negative bracket."""
    k1, k2, k3 = (np.asarray(k)[..., i] for i in range(3))
    force = (k1 - load / k2) * load * np.arctan(k3 * alpha)
    holds = (load >= 0) & (load <= k1 * k2)
    return np.where(holds, force, 0.0) if guard else force


def yaw_acceleration(force, car=CAR):
    """Eq. 1."""
    front, rear = force[..., 0] + force[..., 1], force[..., 2] + force[..., 3]
    return (front * car["lv"] - rear * car["lh"]) / car["J"]


def lateral_acceleration(force, car=CAR):
    """Eq. 11."""
    return force.sum(-1) / car["m"]


def balanced_forces(alpha, k, car=CAR):
    """Forces under the loads of their own lateral acceleration: where no guard acts, Eq. 3 and 7
    in Eq. 11 are one quadratic equation for it, with one root that vanishes with the slip."""
    k = np.asarray(k)
    rest = loads(0.0, car)
    transfer = loads(1.0, car) - rest
    k1, k2, angle = k[..., 0], k[..., 1], np.arctan(k[..., 2] * alpha) / car["m"]
    a = -(transfer**2 / k2 * angle).sum(-1)
    b = (transfer * (k1 - 2 * rest / k2) * angle).sum(-1) - 1
    c = (rest * (k1 - rest / k2) * angle).sum(-1)
    load = loads(2 * c / (-b + np.sqrt(b * b - 4 * a * c)), car)
    if (load < 0).any() or (load > k1 * k2).any():
        raise ValueError("a guard acts: the balance is not this quadratic")
    return forces(alpha, load, k)


def double_lane_change(t, amplitude=0.02, begin=5.0, period=2.5, gap=2.0):
    """To the left and back, then to the right and back: delta [rad]."""
    u = (t - begin) / period
    w = (t - begin - period - gap) / period
    there = np.where((u > 0) & (u < 1), np.sin(2 * np.pi * u), 0.0)
    return amplitude * (there - np.where((w > 0) & (w < 1), np.sin(2 * np.pi * w), 0.0))


def simulate(t, steer, v, k, printed=False, car=CAR):
    """Vehicles of tyres k [n, 4, 3] from rest at time 0: beta, yaw rate, a_y, each [n, time]."""
    k = np.asarray(k)

    def forces_of(time, beta, rate, k):
        return balanced_forces(slip_angles(beta, rate, steer(time), v, printed, car), k, car)

    def slope(time, x):
        beta, rate = x.reshape(2, -1)
        force = forces_of(time, beta, rate, k)
        beta_dot = lateral_acceleration(force, car) / v - rate
        return np.concatenate([beta_dot, yaw_acceleration(force, car)])

    start, span = np.zeros(2 * len(k)), (0.0, t[-1])
    x = solve_ivp(slope, span, start, "DOP853", t, rtol=1e-8, atol=1e-11, max_step=0.25).y
    beta, rate = x.reshape(2, len(k), -1)
    return beta, rate, lateral_acceleration(forces_of(t, beta, rate, k[:, None]), car)


def integrated_bank(t, delta, v, a_y, rate, k, printed, car=CAR):
    """Eq. 10, then Eq. 5, 6 and 11 of models k [m, 4, 3]: beta [time], psi_dot_i, a_yi [time, m].

    All signals start at time t[0] with the car straight.
    """
    beta = cumulative_trapezoid(a_y / v - rate, t, initial=0.0)
    alpha = slip_angles(beta, rate, delta, v, printed, car)
    force = forces(alpha[:, None], loads(a_y, car)[:, None], k)
    rates = cumulative_trapezoid(yaw_acceleration(force, car), t, axis=0, initial=0.0)
    return beta, rates, lateral_acceleration(force, car)


def observer_slope(beta, rate, measured, k, gains, car=CAR):
    """Eq. 1 of one vehicle led by sensors: gains are the share of the measured acceleration in
    the side slip's rate and the pull on the yaw rate [1/s]; measured are delta, v, a_y, rate."""
    delta, v, a_y, yaw_rate = measured
    force = forces(slip_angles(beta, rate, delta, v, False, car), loads(a_y, car), k)
    mixed = (1 - gains[0]) * lateral_acceleration(force, car) + gains[0] * a_y
    return mixed / v - rate, yaw_acceleration(force, car) + gains[1] * (yaw_rate - rate)


def cost(t, size, instantaneous, cumulative, forgetting):
    """Eq. 13 at the last of the times t, its integral by the trapezoidal rule; size [time, ...]."""
    weight = np.exp(-forgetting * (t[-1] - t))
    integral = np.trapezoid(weight * size.T, t, axis=-1)
    return instantaneous * size[-1] + cumulative * integral


def combinations():
    """Tyres of the 16 models [16, 4, 3]: the paper says that the 8th is front left alone; counting
    down in binary, the front left tyre's digit highest and one for a soft tyre, makes it so."""
    soft = [[(15 - i) >> bit & 1 for bit in (3, 2, 1, 0)] for i in range(16)]
    return np.array([[SOFT if s else NOMINAL for s in row] for row in soft])
