"""Momentum, energy and small-angle matrices of a car on four wheels, in NumPy and SciPy."""

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation

GRAVITY = 9.80665


def plain(tree):
    """A NamedTuple or dataclass of arrays with its entries as float64 NumPy arrays."""
    names = getattr(tree, "_fields", None) or tree.__dataclass_fields__
    values = {name: getattr(tree, name) for name in names}
    return {k: np.asarray(v, float) for k, v in values.items() if hasattr(v, "shape")}


def places(compression, chassis):
    """Wheel centres in the body's frame, [4, 3]."""
    c = plain(chassis)
    x = np.array([c["front_arm"], c["front_arm"], -c["rear_arm"], -c["rear_arm"]])
    y = 0.5 * np.array([c["front_track"], -c["front_track"], c["rear_track"], -c["rear_track"]])
    return np.stack([x, y, np.asarray(compression) - c["hub_drop"]], axis=1)


def attitude(x):
    """Rotation matrix, body to world."""
    return Rotation.from_euler("ZYX", [x["yaw"], x["pitch"], x["roll"]]).as_matrix()


def gravity(grade, bank, g=GRAVITY):
    """Gravity in the frame of a plane that is graded, then banked about its own x axis."""
    down = Rotation.from_euler("y", -grade).as_matrix().T @ np.array([0.0, 0.0, -g])
    return Rotation.from_euler("x", bank).as_matrix().T @ down


def bodies(state, chassis):
    """Masses [5], positions and velocities in the world [5, 3]: body, then wheels."""
    x, c = plain(state), plain(chassis)
    turn, r = attitude(x), places(x["compression"], chassis)
    v, w = np.array([x["v_x"], x["v_y"], x["v_z"]]), np.array([x["p"], x["q"], x["r"]])
    slide = np.zeros((4, 3))
    slide[:, 2] = x["compression_rate"]
    position = np.array([x["x"], x["y"], x["z"]]) + np.vstack([np.zeros(3), r @ turn.T])
    velocity = np.vstack([v, v + np.cross(w, r) + slide]) @ turn.T
    return np.r_[c["body_mass"], c["wheel_mass"]], position, velocity


def momentum(state, chassis):
    """Linear and angular momentum (about the world's origin), [3] each."""
    x, c = plain(state), plain(chassis)
    mass, position, velocity = bodies(state, chassis)
    p, q, r = x["p"], x["q"], x["r"]
    wheel = [
        np.sum(c["diametral_inertia"]) * p,
        np.sum(c["spin_inertia"] * (q + x["spin"])),
        np.sum(c["diametral_inertia"]) * r,
    ]
    own = attitude(x) @ (inertia(c) @ np.array([p, q, r]) + np.array(wheel))
    linear = mass[:, None] * velocity
    return linear.sum(0), np.cross(position, linear).sum(0) + own


def inertia(c):
    product = -c["roll_yaw_product"]
    return np.array(
        [
            [c["roll_inertia"], 0.0, product],
            [0.0, c["pitch_inertia"], 0.0],
            [product, 0.0, c["yaw_inertia"]],
        ]
    )


def stop_energy(penetration, stop):
    """Energy in a stop, force [N] over penetration [m] as a cubic Hermite curve."""
    spline = CubicHermiteSpline(*(np.asarray(part) for part in (stop.x, stop.y, stop.slope)))
    assert np.all(penetration < spline.x[-1])
    return spline.antiderivative()(np.maximum(penetration, 0.0))


def energy(state, vehicle, pressure, down):
    """Mechanical energy [J]: motion, weight, springs, stops, bars, linear tyres on a flat road."""
    x, c, t = plain(state), plain(vehicle.chassis), plain(vehicle.tire.vertical)
    k = plain(vehicle.strut)
    mass, position, velocity = bodies(state, vehicle.chassis)
    w = np.array([x["p"], x["q"], x["r"]])
    turning = w @ inertia(c) @ w + np.sum(c["diametral_inertia"] * (w[0] ** 2 + w[2] ** 2))
    turning += np.sum(c["spin_inertia"] * (w[1] + x["spin"]) ** 2)
    kinetic = 0.5 * (mass @ np.sum(velocity**2, 1) + turning)
    height = -mass @ (position @ down)
    s = x["compression"]
    spring = k["preload"] * s + k["stiffness"] * s**2 / 2 + k["cubic_stiffness"] * s**4 / 4
    stops = stop_energy(s - k["bump_clearance"], vehicle.strut.stop)
    stops = stops + stop_energy(-s - k["rebound_clearance"], vehicle.strut.stop)
    bars = [
        vehicle.anti_roll.front * (s[0] - s[1]) ** 2,
        vehicle.anti_roll.rear * (s[2] - s[3]) ** 2,
    ]
    tire = (
        0.5
        * tire_stiffness(t, pressure)
        * np.maximum(t["unloaded_radius"] - position[1:, 2], 0) ** 2
    )
    return float(kinetic + height + np.sum(spring + stops + tire) + 0.5 * sum(map(float, bars)))


def tire_stiffness(t, pressure):
    """Stiffness of linear tyres [N/m]."""
    excess = (np.asarray(pressure) - t["nominal_pressure"]) / t["nominal_pressure"]
    k = t["rated_load"] * t["q_fz1"] / t["unloaded_radius"]
    return k * (1.0 + t["pressure_coefficient"] * excess)


def seven(vehicle, pressure):
    """Mass, damping and stiffness matrices [7, 7] of heave, roll, pitch (body) and four wheels.

    Wheels by their own height above the road: coordinates z, roll, pitch, w_FL .. w_RR. The body
    rolls and pitches about the level of the whole car's centre of mass, and yaws as it likes,
    since nothing holds it horizontally.
    """
    c, k = plain(vehicle.chassis), plain(vehicle.strut)
    r = places(np.zeros(4), vehicle.chassis)
    m = c["wheel_mass"]
    total = c["body_mass"] + m.sum()
    spread = lambda a, b: m @ (r[:, a] * r[:, b]) - (m @ r[:, a]) * (m @ r[:, b]) / total  # noqa: E731
    disc = c["diametral_inertia"].sum()
    # the yaw that a roll acceleration brings along
    yawing = (c["roll_yaw_product"] + spread(0, 2)) ** 2
    yawing /= c["yaw_inertia"] + disc + spread(0, 0) + spread(1, 1)
    roll = c["roll_inertia"] + disc + spread(2, 2) - yawing
    mass = np.diag([c["body_mass"], roll, c["pitch_inertia"] + spread(2, 2), *m])
    # compression = wheel's height - body's height above the wheel
    body = np.stack([np.ones(4), r[:, 1], -r[:, 0]], axis=1)
    squeeze = np.hstack([-body, np.eye(4)])
    bars = np.zeros((4, 4))
    for at, stiffness in ((0, float(vehicle.anti_roll.front)), (2, float(vehicle.anti_roll.rear))):
        bars[at : at + 2, at : at + 2] = stiffness * np.array([[1.0, -1.0], [-1.0, 1.0]])
    t = plain(vehicle.tire.vertical)
    below = np.zeros((7, 7)), np.zeros((7, 7))
    below[0][3:, 3:] = np.diag(tire_stiffness(t, pressure))
    below[1][3:, 3:] = np.diag(t["damping"])
    damper = plain(vehicle.strut.damper)
    slope = damper["damping"] / (1 + 1e-3 * damper["digression"])
    # the struts' preload tilts with the body, whose weight topples it like a pendulum's
    topple = -k["preload"] @ c["hub_drop"]
    spring = squeeze.T @ (np.diag(k["stiffness"]) + bars) @ squeeze
    spring += np.diag([0.0, topple, topple, 0.0, 0.0, 0.0, 0.0])
    damping = squeeze.T @ np.diag(slope) @ squeeze
    return mass, damping + below[1], spring + below[0], squeeze
