"""The half car against an axle in NumPy, and against quarter cars in mean and difference."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.signal import bilinear, lfilter

from tests.oracles import quarter_car_lti as lti
from wheelhop.estimators.axle_load import AxleSample, axle_youla, unknown_axle_before
from wheelhop.estimators.inverse_load import LoadSensors
from wheelhop.estimators.wheel_load import LoadSample
from wheelhop.estimators.youla_load import unknown_before, youla, youla_params
from wheelhop.filtering import run_batch
from wheelhop.filtering.drive import run
from wheelhop.vehicle.corner_suspension import CornerSuspension

DT, SAMPLES, BANDWIDTH = 1e-3, 400, 30.0
BAR = 15e3
LEFT = lti.Car(k_b=BAR)
RIGHT = lti.Car(430.0, 58.0, 31e3, 2500.0, 430.0 * lti.GRAVITY, BAR)
AXLE, CORNER = axle_youla(), youla()
SETTLED = slice(200, None)
HZ = np.array([1.1, 4.0, 11.0])
SIZE = np.array([[500.0, 200.0, 100.0], [-400.0, 250.0, 50.0], [300, 50, 0], [-350, 0, 20]])


def axle_of(left, right):
    return jax.tree.map(lambda *x: jnp.stack(x), corner_of(left), corner_of(right))


def corner_of(car):
    return CornerSuspension(*(jnp.asarray(x) for x in car))


@jax.jit
def observe_axle(y, p):
    state = AXLE.filter.init(unknown_axle_before(), p)
    return run(AXLE.filter, state, y, p, keep=keep_axle)


@jax.jit
def observe_corner(y, p):
    state = CORNER.filter.init(unknown_before(), p)
    return run(CORNER.filter, state, y, p, keep=lambda s, _: CORNER.load(s))


def keep_axle(state, _):
    return AXLE.load(state)


def estimate(y, left=LEFT, right=RIGHT, **sensors):
    """(F_l, F_r, dF_l, dF_r) [time, 4] and the covariance of the last."""
    p = youla_params(axle_of(left, right), DT, BANDWIDTH, sensors=LoadSensors(**sensors))
    found = observe_axle(AxleSample(*jnp.asarray(y).T), p)
    lower = [[float(x[-1]) for x in row] + [0.0] * (3 - i) for i, row in enumerate(found.cov)]
    cov = np.array(lower) + np.tril(lower, -1).T
    return np.stack([np.asarray(x) for x in found.mean], 1), cov


def corner_estimate(y, car):
    """(F, dF) [time, 2] of a quarter-car observer."""
    found = observe_corner(
        LoadSample(*jnp.asarray(y).T), youla_params(corner_of(car), DT, BANDWIDTH)
    )
    return np.stack([np.asarray(x) for x in found.mean], 1)


def rest(left, right):
    return np.array([(c.m_s + c.m_u) * lti.GRAVITY for c in (left, right)] + [0.0, 0.0])


def loads(t):
    return rest(LEFT, RIGHT) + np.sin(2 * np.pi * HZ * t[:, None] + [0.2, 1.0, 2.0]) @ SIZE.T


@pytest.fixture(scope="module")
def drive():
    """(t, loads, outputs) of an axle with unequal sides and a bar."""
    system = lti.axle(LEFT, RIGHT)
    return lti.driven(system, rest(LEFT, RIGHT), loads, DT, SAMPLES)


def low_passed(signal):
    """M_T of signals [time, n] that were 0 before, by SciPy's bilinear transform."""
    w = 2 * np.pi * BANDWIDTH
    whole = np.polymul([1, 2 * np.sqrt(0.5), 1], np.polymul([0.1, 1], [0.1, 1]))
    above, below = bilinear([1.0], whole / w ** np.arange(4, -1, -1), 1 / DT)
    return lfilter(above, below, signal, axis=0)


def test_loads_of_an_axle_with_a_bar_are_found(drive):
    t, true, y = drive
    found, _ = estimate(y[:, :4])
    phasor = lti.low_pass(HZ, BANDWIDTH) * np.exp(1j * np.array([0.2, 1.0, 2.0]))
    passed = (np.exp(2j * np.pi * HZ * t[:, None]) * phasor).imag @ SIZE.T
    np.testing.assert_allclose(found[SETTLED], (rest(LEFT, RIGHT) + passed)[SETTLED], atol=0.5)
    bound = abs(SIZE) @ abs(1 - lti.low_pass(HZ, BANDWIDTH))
    assert np.all(abs(found - true)[SETTLED].max(0) < bound + 0.5)


def test_a_quarter_car_misses_the_bar_by_its_force(drive):
    """k_b (q_l - q_r) behind the low-pass, on F and on dF, with opposite signs on the sides."""
    y = drive[2]
    whole, _ = estimate(y[:, :4])
    across = BAR * low_passed(y[:, 2:3] - y[:, 3:4])
    for side, car, sign in ((0, LEFT, 1.0), (1, RIGHT, -1.0)):
        alone = corner_estimate(y[:, [side, 2 + side]], car)
        missed = whole[:, [side, 2 + side]] - alone
        np.testing.assert_allclose(missed, sign * across * [1, 1], atol=1e-6)
    assert abs(across[SETTLED]).max() > 200


def test_mean_and_difference_are_quarter_cars(drive):
    """Of equal sides: stiffness k in the mean, k + 2 k_b in the difference, which has no weight."""
    y = drive[2][:, :4]
    found, _ = estimate(y, LEFT, LEFT)
    left, right = y[:, [0, 2]], y[:, [1, 3]]
    both = corner_estimate(0.5 * (left + right), LEFT)
    apart = corner_estimate(left - right, LEFT._replace(k=LEFT.k + 2 * BAR))
    apart = apart - [LEFT.m_u * lti.GRAVITY + LEFT.preload, LEFT.preload - LEFT.m_s * lti.GRAVITY]
    np.testing.assert_allclose(0.5 * (found[:, ::2] + found[:, 1::2]), both, rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(found[:, ::2] - found[:, 1::2], apart, rtol=1e-9, atol=1e-6)


def test_without_a_bar_it_is_two_observers(drive):
    y = drive[2]
    cars = [car._replace(k_b=0.0) for car in (LEFT, RIGHT)]
    found, cov = estimate(y[:, :4], *cars)
    for side, car in enumerate(cars):
        alone = corner_estimate(y[:, [side, 2 + side]], car)
        np.testing.assert_allclose(found[:, [side, 2 + side]], alone, rtol=1e-10, atol=1e-7)
    np.testing.assert_allclose(cov[np.ix_([0, 2], [1, 3])], 0.0, atol=1e-9)


def test_covariance_is_that_of_the_pulse_responses():
    """Of white noise on the four sensors, left and right together."""
    noise = {"acceleration_noise": 0.07, "deflection_noise": 4e-4}
    still, _ = estimate(np.zeros((SAMPLES, 4)), **noise)
    expected = np.zeros((4, 4))
    for channel, sigma in enumerate([0.07, 0.07, 4e-4, 4e-4]):
        pulse = np.zeros((SAMPLES, 4))
        pulse[0, channel] = sigma
        response = estimate(pulse, **noise)[0] - still
        expected += response.T @ response
    _, cov = estimate(np.zeros((SAMPLES, 4)), **noise)
    np.testing.assert_allclose(cov, expected, rtol=1e-6, atol=1e-6 * expected.max())
    assert abs(cov[0, 1]) > 0.001 * cov[0, 0]  # the bar ties the sides


def test_bars_that_differ_by_run(drive):
    """A batch of axles equals single runs."""
    bars = np.array([0.0, 8e3, 30e3])
    ys = AxleSample(*(jnp.asarray(np.stack([x] * 3)) for x in drive[2][:, :4].T))
    p = youla_params(axle_of(LEFT, RIGHT), DT, BANDWIDTH)
    stacked = replace(p.corner, anti_roll=jnp.asarray(np.stack([bars, bars], 1)))
    none = jax.tree.map(lambda _: None, p)
    by_run = replace(none, corner=replace(none.corner, anti_roll=0))
    state = AXLE.filter.init(unknown_axle_before(), p)
    found = run_batch(
        AXLE.filter, state, ys, replace(p, corner=stacked), keep=keep_axle,
        in_axes=(None, 0, by_run, None),
    )  # fmt: skip
    for r, bar in enumerate(bars):
        single, cov = estimate(drive[2][:, :4], LEFT._replace(k_b=bar), RIGHT._replace(k_b=bar))
        mean = np.stack([np.asarray(x[r]) for x in found.mean], 1)
        np.testing.assert_allclose(mean, single, rtol=1e-9, atol=1e-6)
        np.testing.assert_allclose(found.cov[1][0][r, -1], cov[1, 0], rtol=1e-9, atol=1e-6)
