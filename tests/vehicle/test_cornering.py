"""A car through a corner: against SciPy, its mirror image, closed form, and what is refused."""

from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from wheelhop.errors import InputError
from wheelhop.vehicle.cornering import (
    DT,
    double_lane_change,
    simulate_cornering,
    slalom,
    steer_at,
    straight,
    validate,
)
from wheelhop.vehicle.lateral_tire import NOMINAL_TIRE, SOFT_TIRE, ArctangentTire
from wheelhop.vehicle.two_track import SOLMAZ_CAR, TwoTrack, Wheels

SPEED = 120 / 3.6
G = 9.80665
SOUND, SOFT = (1.0, 5650.0, 15.0), (1.0, 4500.0, 12.0)


def lane_change(t, amplitude):
    """The paper's steer: 2.5 s to the left and back, 2 s, and the mirror image, from 5 s on."""
    for begin, sign in ((5.0, 1.0), (9.5, -1.0)):
        if begin < t < begin + 2.5:
            return sign * amplitude * np.sin(2 * np.pi * (t - begin) / 2.5)
    return 0.0


def numpy_motion(x, delta, tires, mu, m):
    """Side slip rate, yaw acceleration, a_y and loads, a_y by bisection; vl, vr, hl, hr."""
    beta, rate = x
    l_v, l_h, track, h, inertia = 1.2, 1.3, 1.5, 0.7, 1200.0
    length = l_v + l_h
    arms = np.array([l_v, l_v, -l_h, -l_h])
    side = np.array([-1.0, 1.0, -1.0, 1.0]) * track / 2
    excess = delta * abs(delta) * track / (2 * length)
    # the inner wheel steers more: in a left turn the left one
    inner_left = delta > 0
    grown, shrunk = delta + excess, delta - excess
    steer = np.array([*((grown, shrunk) if inner_left else (shrunk, grown)), 0.0, 0.0])
    slip = steer - np.arctan((SPEED * beta + arms * rate) / (SPEED + side * rate))

    def loads(a):
        static = m * G / (2 * length) * np.array([l_h, l_h, l_v, l_v])
        moved = m * h / (length * track) * np.array([-l_h, l_h, -l_v, l_v])
        return static + moved * a

    def forces(a):
        k1, k2, k3 = np.array(tires).T
        f = loads(a)
        return np.maximum(f, 0) * np.maximum(k1 - f / k2, 0) * mu * np.arctan(k3 * slip / mu)

    a = brentq(lambda a: forces(a).sum() / m - a, -15, 15, xtol=1e-13)
    s = forces(a)
    yaw = ((s[0] + s[1]) * l_v - (s[2] + s[3]) * l_h) / inertia
    return np.array([a / SPEED - rate, yaw]), a, loads(a), s


def scipy_drive(amplitude, tires, mu, m, until=15.0):
    """States at every DT, piece by piece between the kinks of the steer."""
    kinks = [0.0, 5.0, 7.5, 9.5, 12.0, until]
    x, out = np.zeros(2), []
    for begin, end in pairwise(kinks):
        at = np.arange(round(begin / DT) + 1, round(end / DT) + 1) * DT
        found = solve_ivp(
            lambda t, x: numpy_motion(x, lane_change(t, amplitude), tires, mu, m)[0],
            (begin, end),
            x,
            t_eval=np.minimum(at, end),
            method="DOP853",
            rtol=1e-9,
            atol=1e-11,
        )
        out.append(found.y)
        x = found.y[:, -1]
    return np.concatenate(out, axis=1)


def tire_batch(rows):
    """`Wheels` of stacked coefficients, from [runs, 4] of (k1, k2, k3)."""
    each = np.array(rows)
    return Wheels(*(ArctangentTire(*jnp.asarray(each[:, w].T)) for w in range(4)))


CASES = (
    (0.02, [SOFT, SOUND, SOUND, SOUND], 1.0, 1300.0),
    (-0.02, [SOUND, SOFT, SOUND, SOUND], 1.0, 1300.0),
    (0.0, [SOUND] * 4, 1.0, 1300.0),
    (0.03, [SOFT, SOFT, SOUND, SOFT], 0.5, 1500.0),
)
"""Amplitude, tyres, friction, mass."""


@pytest.fixture(scope="module")
def drives():
    """All cases in one vmap over maneuver, tyres, friction and car."""
    amplitude, tires, mu, mass = (list(column) for column in zip(*CASES, strict=True))

    def one(a, tire, friction, m):
        car = TwoTrack(m, 1200.0, 1.2, 1.3, 1.5, 0.7)
        return simulate_cornering(double_lane_change(a), SPEED, tire, car, friction, duration=15.0)

    batch = jnp.array(amplitude), tire_batch(tires), jnp.array(mu), jnp.array(mass)
    return jax.tree.map(np.asarray, jax.jit(jax.vmap(one))(*batch))


@pytest.mark.parametrize("case", [0, 3])
def test_the_drive_is_that_of_an_independent_integration(drives, case):
    amplitude, tires, mu, mass = CASES[case]
    exact = scipy_drive(amplitude, tires, mu, mass)
    np.testing.assert_allclose(drives.side_slip[case], exact[0], atol=1e-7)
    np.testing.assert_allclose(drives.yaw_rate[case], exact[1], atol=1e-6)
    assert np.ptp(drives.yaw_rate[case]) > 0.1
    for k in range(0, 1500, 97):
        delta = lane_change((k + 1) * DT, amplitude)
        _, a, loads, forces = numpy_motion(exact[:, k], delta, tires, mu, mass)
        np.testing.assert_allclose(drives.lateral_acceleration[case, k], a, atol=1e-5)
        np.testing.assert_allclose([f[case, k] for f in drives.load], loads, atol=1e-2)
        np.testing.assert_allclose([f[case, k] for f in drives.force], forces, atol=1e-2)
        assert drives.steer[case, k] == pytest.approx(delta, abs=1e-12)


def test_the_mirrored_maneuver_with_mirrored_tyres_is_the_mirror_image(drives):
    for name in ("side_slip", "yaw_rate", "lateral_acceleration", "steer"):
        left, right = getattr(drives, name)[:2]
        np.testing.assert_allclose(left, -right, atol=1e-12)
    front_left, front_right, rear_left, rear_right = drives.load
    np.testing.assert_allclose(front_left[0], front_right[1], rtol=1e-12)
    np.testing.assert_allclose(rear_right[0], rear_left[1], rtol=1e-12)


def test_straight_ahead_nothing_happens(drives):
    assert not np.any(drives.side_slip[2])
    assert not np.any(drives.lateral_acceleration[2])
    np.testing.assert_allclose(sum(load[2] for load in drives.load), 1300 * G)
    assert not np.any(drives.overloaded[:3])


def test_forces_carry_the_car(drives):
    mass = np.array([case[3] for case in CASES])[:, None]
    total = sum(drives.force)
    np.testing.assert_allclose(total, mass * drives.lateral_acceleration, atol=1e-8)


def test_steady_steer_gives_the_yaw_gain_of_the_linear_model():
    delta = 1e-5
    tires = Wheels(SOFT_TIRE, SOFT_TIRE, NOMINAL_TIRE, NOMINAL_TIRE)
    samples = np.full(601, delta)

    def drive(s):
        return simulate_cornering(s, SPEED, tires, SOLMAZ_CAR, duration=6.0)

    found = jax.jit(drive)(samples)
    front, rear = 1300 * G * 1.3 / 5.0, 1300 * G * 1.2 / 5.0
    c_v = 2 * front * (1 - front / 4500) * 12
    c_h = 2 * rear * (1 - rear / 5650) * 15
    determinant = c_v * c_h * 2.5**2 + 1300 * SPEED**2 * (1.3 * c_h - 1.2 * c_v)
    expected = SPEED * c_v * c_h * 2.5 / determinant
    assert found.yaw_rate[-1] / delta == pytest.approx(expected, rel=1e-3)


def test_maneuvers():
    t = np.linspace(0, 20, 1001)
    expected = [lane_change(s, 0.03) for s in t]
    np.testing.assert_allclose(
        steer_at(double_lane_change(0.03), jnp.asarray(t)), expected, atol=1e-12
    )
    found = np.asarray(steer_at(slalom(0.03, begin=2.0, period=2.0, cycles=3), jnp.asarray(t)))
    inside = (t > 2) & (t < 8)
    np.testing.assert_allclose(found, 0.03 * inside * np.sin(np.pi * t), atol=1e-12)
    assert not np.any(steer_at(straight(), jnp.asarray(t)))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"maneuver": slalom(0.7)}, "steer.amplitude: 0.7 rad is outside"),
        ({"maneuver": slalom(0.1, period=0.0)}, "steer.period: 0 s"),
        ({"maneuver": slalom(0.1, cycles=1.5)}, "steer.cycles: 1.5 periods"),
        ({"speed": 0.0}, "speed: 0 m/s"),
        ({"friction": 0.0}, "friction: 0"),
        ({"tires": Wheels(*[ArctangentTire(1.0, 1.0, 15.0)] * 4)}, "front_left.k2: 1 N"),
        ({"car": TwoTrack(1.0, 1200.0, 1.2, 1.3, 1.5, 0.7)}, "two_track.mass: 1 kg"),
    ],
)
def test_what_cannot_be_driven_is_refused(change, message):
    good = {
        "maneuver": double_lane_change(0.02),
        "speed": SPEED,
        "tires": Wheels(*[NOMINAL_TIRE] * 4),
        "car": SOLMAZ_CAR,
    }
    validate(**good)
    with pytest.raises(InputError, match=message.replace("^", r"\^")):
        validate(**(good | change))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"substeps": 0}, "substeps: 0 steps"),
        ({"duration": 0.015}, "duration: 0.015 s is no multiple of 0.01 s"),
        ({"dt": 0.0}, "dt: 0 s"),
        ({"steer": np.zeros(100)}, r"samples of shape \(100,\)"),
    ],
)
def test_times_and_samples_that_do_not_fit_are_refused(change, message):
    options = {"steer": straight(), "duration": 1.0} | change
    steer = options.pop("steer")
    with pytest.raises(InputError, match=message):
        simulate_cornering(steer, SPEED, Wheels(*[NOMINAL_TIRE] * 4), SOLMAZ_CAR, **options)
