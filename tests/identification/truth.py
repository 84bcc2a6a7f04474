"""Records of a quarter car on a road of random waves, in plain NumPy, apart from wheelhop."""

import numpy as np

from wheelhop.vehicle.record import CornerRecord

TRUE = {
    "sprung_mass": 466.7,
    "unsprung_mass": 61.14,
    "suspension.stiffness": 33.6e3,
    "suspension.cubic_stiffness": 8.0e5,
    "suspension.damping": 2400.0,
    "suspension.quadratic_damping": 500.0,
    "tire.stiffness": 264.7e3,
    "tire.pressure_coefficient": 0.7,
    "tire.damping": 0.0,
}
NOMINAL_PRESSURE = 250e3
FINE = 4
"""Steps per sample: four times finer than what is fitted."""


def waves(rng, level, speed, count=80):
    """Amplitudes [m], angular frequencies [rad/s], phases of a road of ISO 8608 level [m^3/rad]."""
    wave_number = np.geomspace(0.15, 8.0, count + 1)
    middle, width = np.sqrt(wave_number[1:] * wave_number[:-1]), np.diff(wave_number)
    amplitude = np.sqrt(2.0 * level * middle**-2.0 * width)
    return amplitude, middle * speed, rng.uniform(0, 2 * np.pi, count)


def simulate(road, pressure, seconds, rate, parameters=TRUE):
    """Sprung and unsprung acceleration and elevation at the ends of the sampling intervals."""
    p = parameters
    amplitude, omega, phase = road
    k_t = p["tire.stiffness"] * (
        1 + p["tire.pressure_coefficient"] * (pressure / NOMINAL_PRESSURE - 1)
    )

    def z_and_slope(t):
        angle = np.outer(np.atleast_1d(t), omega) + phase
        return np.sin(angle) @ amplitude, np.cos(angle) @ (amplitude * omega)

    def forces(x, z, slope):
        d, w = x[0] - x[1], x[2] - x[3]
        strut = (
            p["suspension.stiffness"] * d
            + p["suspension.cubic_stiffness"] * d**3
            + p["suspension.damping"] * w
            + p["suspension.quadratic_damping"] * w * abs(w)
        )
        tyre = k_t * (x[1] - z) + p["tire.damping"] * (x[3] - slope)
        return -strut / p["sprung_mass"], (strut - tyre) / p["unsprung_mass"]

    steps = round(seconds * rate) * FINE
    h = 1.0 / (rate * FINE)
    z, slope = z_and_slope(0.5 * h * np.arange(2 * steps + 1))
    x = np.array([z[0], z[0], 0.0, 0.0])
    rows = []
    for k in range(steps):

        def rate_of(state, j, k=k):
            return np.array([state[2], state[3], *forces(state, z[2 * k + j], slope[2 * k + j])])

        k1 = rate_of(x, 0)
        k2 = rate_of(x + 0.5 * h * k1, 1)
        k3 = rate_of(x + 0.5 * h * k2, 1)
        k4 = rate_of(x + h * k3, 2)
        x = x + h / 6.0 * (k1 + 2 * k2 + 2 * k3 + k4)
        if (k + 1) % FINE == 0:
            rows.append(forces(x, z[2 * k + 2], slope[2 * k + 2]))
    a_s, a_u = np.array(rows).T
    return a_s, a_u, z[2 * FINE :: 2 * FINE]


def record(seed, speed, pressure, seconds=4.0, rate=500.0, noise=0.0, level=64e-6, **changes):
    """A record at a speed [m/s] and pressure [Pa]; `changes` replace true parameters."""
    rng = np.random.default_rng(seed)
    true = TRUE | {name.replace("__", "."): value for name, value in changes.items()}
    a_s, a_u, z = simulate(waves(rng, level, speed), pressure, seconds, rate, true)
    t = np.arange(1, len(z) + 1) / rate
    full = np.full(len(z), 1.0)
    return CornerRecord(
        t,
        a_s + noise * rng.normal(size=len(z)),
        a_u + noise * rng.normal(size=len(z)),
        speed * full,
        pressure * full,
        z,
    )
