"""Eq. 16 against its two derivative filters in series, in NumPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.signal import bilinear, lfilter

from tests.oracles import quarter_car_lti as lti
from wheelhop.errors import InputError
from wheelhop.estimators.derivative_load import derivative_filters, derivative_params
from wheelhop.estimators.inverse_load import LoadSensors
from wheelhop.estimators.wheel_load import LoadSample
from wheelhop.estimators.youla_load import unknown_before
from wheelhop.filtering.drive import run
from wheelhop.vehicle.corner_suspension import CornerSuspension

DT, SAMPLES, BANDWIDTH = 1e-3, 400, 45.0
CAR = lti.Car(preload=1000.0)
CORNER = CornerSuspension(*(jnp.asarray(x) for x in CAR))
OBSERVER = derivative_filters()
WEIGHT = (CAR.m_s + CAR.m_u) * lti.GRAVITY


@jax.jit
def observe(y, p):
    state = OBSERVER.filter.init(unknown_before(), p)
    return run(OBSERVER.filter, state, y, p, keep=lambda s, _: OBSERVER.load(s))


def estimate(acceleration, deflection, p):
    """(F, dF) [time, 2] and their covariance at the end."""
    found = observe(LoadSample(jnp.asarray(acceleration), jnp.asarray(deflection)), p)
    cov = found.cov
    last = np.array([[cov[0][0][-1], cov[1][0][-1]], [cov[1][0][-1], cov[1][1][-1]]])
    return np.stack([np.asarray(x) for x in found.mean], 1), last


def params(method="exact", **sensors):
    return derivative_params(CORNER, DT, BANDWIDTH, LoadSensors(**sensors), method)


def two_filters():
    """Two of F_d = s / (1 + s / w) in series, from (q, 1) to (F, dF) of a body at rest."""
    w = 2 * np.pi * BANDWIDTH
    # z_1' = w (q - z_1), d_1 = w (q - z_1), z_2' = w (d_1 - z_2), d_2 = w (d_1 - z_2)
    a = np.array([[-w, 0.0], [-w * w, -w]])
    b = np.array([[w, 0.0], [w * w, 0.0]])
    d_1, d_2 = np.array([-w, 0.0, w, 0.0]), np.array([-w * w, -w, w * w, 0.0])
    strut = CAR.k * np.array([0, 0, 1, 0]) + CAR.b * d_1 + CAR.preload * np.array([0, 0, 0, 1])
    one = np.array([0.0, 0.0, 0.0, 1.0])
    rows = np.stack(
        [
            strut + CAR.m_u * d_2 + CAR.m_u * lti.GRAVITY * one,
            strut - CAR.m_s * lti.GRAVITY * one,
        ]
    )
    return a, b, rows[:, :2], rows[:, 2:]


def test_equals_the_two_filters():
    """From a constant zero before the record; any record will do, acceleration is not used."""
    rng = np.random.default_rng(0)
    q = 0.02 * np.cumsum(rng.normal(size=SAMPLES)) / np.sqrt(SAMPLES)
    u = np.c_[np.append(0.0, q), np.ones(SAMPLES + 1)]
    expected = lti.piecewise_linear(two_filters(), u, DT)[1:]
    found, _ = estimate(rng.normal(size=SAMPLES), q, params())
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-6)
    lost, _ = estimate(np.full(SAMPLES, np.nan), q, params())
    np.testing.assert_allclose(lost, expected, rtol=1e-9, atol=1e-6)


def test_bilinear_equals_scipys():
    rng = np.random.default_rng(1)
    q = 0.02 * rng.normal(size=SAMPLES)
    w = 2 * np.pi * BANDWIDTH
    d_1 = lfilter(*bilinear([1, 0], [1 / w, 1], 1 / DT), q)
    d_2 = lfilter(*bilinear([1, 0], [1 / w, 1], 1 / DT), d_1)
    strut = CAR.preload + CAR.k * q + CAR.b * d_1
    found, _ = estimate(0 * q, q, params("bilinear"))
    np.testing.assert_allclose(found[:, 0], strut + CAR.m_u * (d_2 + lti.GRAVITY), rtol=1e-9)
    np.testing.assert_allclose(found[:, 1], strut - CAR.m_s * lti.GRAVITY, rtol=1e-9, atol=1e-6)


def test_what_a_moving_body_costs():
    """Its error in slow motion is the wheel's share m_u a_s of F, and -m_s a_s of dF."""
    hz, size = 1.0, 600.0

    def loads(t):
        return np.c_[WEIGHT + size * np.sin(2 * np.pi * hz * t), 0 * t]

    _, true, y = lti.driven(lti.corner(CAR), (WEIGHT, 0.0), loads, DT, SAMPLES)
    found, _ = estimate(y[:, 0], y[:, 1], params())
    error = (found - true)[200:]
    missed = np.outer(y[200:, 0], [-CAR.m_u, CAR.m_s])
    late = 2 * np.pi * hz / (2 * np.pi * BANDWIDTH) * CAR.b * 2 * np.pi * hz * abs(y[:, 1]).max()
    assert abs(missed).max(0)[0] > 50
    assert abs(error - missed).max() < 5 + 3 * late


def test_rest_gives_the_weight():
    q = np.full(SAMPLES, (CAR.m_s * lti.GRAVITY - CAR.preload) / CAR.k)
    found, _ = estimate(0 * q, q, params())
    np.testing.assert_allclose(found[-1], [WEIGHT, 0.0], atol=1e-6)


@pytest.mark.parametrize("method", ["exact", "bilinear"])
def test_sigma_is_that_of_the_pulse_response(method):
    """White noise on the deflection: sum of squares of the response to a pulse."""
    pulse = np.zeros(SAMPLES)
    pulse[0] = 1.0
    p = params(method, deflection_noise=4e-4)
    still, _ = estimate(0 * pulse, 0 * pulse, p)
    response, cov = estimate(0 * pulse, pulse, p)
    np.testing.assert_allclose(cov, 4e-4**2 * (response - still).T @ (response - still), rtol=1e-6)


def test_refusals_name_the_field():
    for field, changes in (("dt", {"dt": -1.0}), ("bandwidth", {"bandwidth": 501.0})):
        with pytest.raises(InputError) as refusal:
            derivative_params(**({"corner": CORNER, "dt": DT} | changes))
        assert refusal.value.field == field
