"""CommonRoad's multi-body vehicle, driven by wheel angle and acceleration over time.

The model is that of the package `commonroad-vehicle-models` (Althoff & Würsching 2020): 29 states
in SAE axes (y to the right, z down), two rigid axles that are joined to the body by compliant
pins, tyres without relaxation. Nothing of wheelhop is imported.
"""

import copy

import numpy as np
from scipy.integrate import solve_ivp
from vehiclemodels.init_mb import init_mb
from vehiclemodels.parameters_vehicle2 import parameters_vehicle2
from vehiclemodels.vehicle_dynamics_mb import vehicle_dynamics_mb

SPEED, YAW_RATE, ROLL, PITCH, LATERAL, SINKING = 3, 5, 6, 8, 10, 11
AXLES = ((13, 16), (18, 21))
"""Roll angle and sinking of the front and of the rear axle."""


def parameters():
    """Vehicle 2, a BMW 320i."""
    return parameters_vehicle2()


def plain(stiffer=30.0):
    """Vehicle 2 without what a body on four sliding wheels lacks.

    No tyre forces by camber, side slip by longitudinal slip or ply steer; no camber by
    compression, no lateral compliance of the tyres, pins `stiffer` than the vehicle's own.
    """
    p = copy.deepcopy(parameters())
    p.D_f = p.D_r = p.K_lt = 0.0
    p.K_ras, p.K_rad = p.K_ras * stiffer, p.K_rad * stiffer
    for name in ("hx1", "vx1", "hy1", "hy3", "vy1", "vy3", "dx3", "dy3"):
        setattr(p.tire, f"p_{name}", 0.0)
    for name in ("hx1", "hy1", "vy1", "vy3", "by3"):
        setattr(p.tire, f"r_{name}", 0.0)
    return p


def simulate(p, speed, steer_rate, acceleration, times):
    """Signals over `times` [s] from straight running at `speed` [m/s].

    Args:
        p: parameters.
        speed: at the start [m/s].
        steer_rate: t -> rate of the front wheels' angle [rad/s], positive to the right.
        acceleration: t -> wanted acceleration [m/s^2], which sets drive and brake torque.
        times: increasing, from 0.

    Returns:
        Speed, yaw rate, roll, pitch [time], lateral acceleration [time] and tyre loads
        [time, 4], in SAE axes; corners FL, FR, RL, RR.
    """

    def slope(t, x):
        return vehicle_dynamics_mb(list(x), [steer_rate(t), acceleration(t)], p)

    start = init_mb([0.0, 0.0, 0.0, speed, 0.0, 0.0, 0.0], p)
    # `init_mb` leaves the body above its sunken axles
    front, rear = start[AXLES[0][1]], start[AXLES[1][1]]
    start[PITCH] = (rear - front) / (p.a + p.b)
    start[SINKING] = front + p.a * start[PITCH]
    done = solve_ivp(
        slope,
        (times[0], times[-1]),
        start,
        method="LSODA",
        t_eval=times,
        rtol=1e-7,
        atol=1e-8,
        max_step=0.02,
    )
    if not done.success:
        raise RuntimeError(done.message)
    x = done.y
    sideways = np.gradient(x[LATERAL], times) + x[SPEED] * x[YAW_RATE]
    loads = []
    for (roll, sinking), track in zip(AXLES, (p.T_f, p.T_r), strict=True):
        middle = x[sinking] + p.R_w * (np.cos(x[roll]) - 1)
        tilt = 0.5 * track * np.sin(x[roll])
        loads += [(middle - tilt) * p.K_zt, (middle + tilt) * p.K_zt]
    return {
        "speed": x[SPEED],
        "yaw_rate": x[YAW_RATE],
        "roll": x[ROLL],
        "pitch": x[PITCH],
        "lateral_acceleration": sideways,
        "load": np.stack(loads, 1),
    }
