"""Eq. 6-14 by sympy, and the transfer matrices by the state space of Eq. 2-4."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
import sympy as sp
from scipy.signal import bilinear, freqs, freqz, ss2tf

from tests.oracles import quarter_car_lti as lti
from wheelhop.errors import InputError
from wheelhop.estimators.youla_design import (
    discrete_youla,
    discretisation_error,
    loop_transfers,
    passed_bandwidth,
    singular_values,
)
from wheelhop.estimators.youla_load import default_lag, youla_params
from wheelhop.vehicle.corner_suspension import CornerSuspension

CAR = lti.Car()
CORNER = CornerSuspension(*(jnp.asarray(x) for x in CAR))
HZ = np.geomspace(0.01, 400, 25)
S, M_S, M_U, K, B, W0, ZETA, TAU = sp.symbols("s m_s m_u k b w0 zeta tau", positive=True)
STRUT = B * S + K
CHARACTERISTIC = M_S * M_U * S**2 + (M_S + M_U) * STRUT
PRINTED = sp.Matrix([[STRUT, -(M_U * S**2 + STRUT)], [M_S, M_U]]) / CHARACTERISTIC
INVERSE = sp.Matrix([[M_U, M_U * S**2 + STRUT], [-M_S, STRUT]])
U_L = sp.Matrix([[0, 1], [M_U, M_U * S**2 + STRUT]])
U_R = sp.Matrix([[0, 1 / (M_S * M_U)], [1 / M_U, -1 / M_U**2]])
M_P = sp.diag(1 / CHARACTERISTIC, 1 / (M_S * M_U))
LOW_PASS = W0**2 / ((S**2 + 2 * ZETA * W0 * S + W0**2) * (TAU * S + 1) ** 2)


def equal(a, b):
    return (sp.Matrix(a) - sp.Matrix(b)).applyfunc(sp.cancel) == sp.zeros(2)


def test_plant_is_that_of_the_equations_of_motion():
    """Eq. 6 as printed has the acceleration p_s' / m_s in its first row, not p_s' as its label."""
    p_s, p_u, q, f, df = sp.symbols("p_s p_u q F dF")
    rate = p_u / M_U - p_s / M_S
    force = K * q + B * rate
    motion = [S * p_s - (force - df), S * p_u - (f - force), S * q - rate]
    found = sp.solve(motion, [p_s, p_u, q], dict=True)[0]

    def row(signal):
        signal = sp.expand(sp.simplify(signal.subs(found)))
        return [signal.coeff(f), signal.coeff(df)]

    assert equal(sp.Matrix([row(S * p_s / M_S), row(q)]), PRINTED)
    assert not equal(sp.Matrix([row(S * p_s), row(q)]), PRINTED)


def test_smith_mcmillan_form_is_as_printed():
    """Eq. 7 holds literally: unimodular factors, a diagonal, each zero polynomial dividing the
    next and each pole polynomial divided by the next, up to constants."""
    assert equal(U_L * PRINTED * U_R, M_P)
    for factor in (U_L, U_R):
        determinant = sp.simplify(factor.det())
        assert determinant != 0
        assert not determinant.has(S)
        assert all(entry.is_polynomial(S) for entry in factor)
    (first, second) = (sp.fraction(sp.together(M_P[i, i])) for i in (0, 1))
    assert sp.rem(second[0], first[0], S) == 0
    assert sp.rem(first[1], second[1], S) == 0
    # the poles are those of the minors, McMillan degree 2, and there is no transmission zero
    assert sp.simplify(PRINTED.det() * CHARACTERISTIC) == 1
    assert equal(PRINTED * INVERSE, sp.eye(2))


def test_closed_loop_controller_and_youla_are_as_printed():
    """Eq. 9-14 from Eq. 7 and 8; M_Y is M_T M_p^-1."""
    closed = U_R * (LOW_PASS * sp.eye(2)) * U_R.inv()
    assert equal(closed, LOW_PASS * sp.eye(2))
    youla = U_R * (LOW_PASS * M_P.inv()) * U_L
    assert equal(youla, LOW_PASS * INVERSE)
    assert equal(youla * PRINTED, closed)
    denominator = (S**2 + 2 * ZETA * W0 * S + W0**2) * (TAU * S + 1) ** 2 - W0**2
    controller = W0**2 / denominator * INVERSE
    assert equal((sp.eye(2) - closed) * controller, youla)
    assert denominator.subs(S, 0) == 0  # an integrator
    assert equal((sp.eye(2) + controller * PRINTED) * youla, controller)


def test_a_plant_that_differs_is_seen_through_the_closed_loop():
    """For G_p = G (I + D) the estimate is T_u (I + D) u; the printed T_u + Y D is for an error of
    the plant that adds to it, G_p = G + D."""
    delta = sp.Matrix(2, 2, sp.symbols("d_11 d_12 d_21 d_22"))
    youla = LOW_PASS * INVERSE
    assert equal(youla * PRINTED * (sp.eye(2) + delta), LOW_PASS * (sp.eye(2) + delta))
    assert equal(youla * (PRINTED + delta), LOW_PASS * sp.eye(2) + youla * delta)
    assert not equal(youla * PRINTED * (sp.eye(2) + delta), LOW_PASS * sp.eye(2) + youla * delta)


def test_estimate_is_eq_15():
    """With p_s' = s p_s: the printed m_u s (p_s / m_s + s q) + b s q + k q."""
    p_s, q = sp.symbols("p_s q")
    printed = (M_U * S * (p_s / M_S + S * q) + B * S * q + K * q) * LOW_PASS
    found = (LOW_PASS * INVERSE * sp.Matrix([S * p_s / M_S, q]))[0]
    assert sp.simplify(printed - found) == 0


@pytest.fixture(scope="module")
def oracle():
    """T_u, S_u, Y, G_c and L_u by inverting the plant's response in NumPy."""
    plant = lti.transfer(lti.corner(CAR), HZ)[:, :2, :2]
    passed = lti.low_pass(HZ, 30.0)[:, None, None] * np.eye(2)
    youla = passed @ np.linalg.inv(plant)
    sensitivity = np.eye(2) - passed
    controller = np.linalg.solve(sensitivity, youla)
    return plant, passed, sensitivity, youla, controller, controller @ plant


def test_transfer_matrices_equal_those_of_the_state_space(oracle):
    found = loop_transfers(CORNER, HZ)
    for ours, theirs in zip(found, oracle, strict=True):
        size = abs(theirs).max((1, 2), keepdims=True)
        np.testing.assert_allclose(ours / size, theirs / size, atol=1e-8)
    np.testing.assert_allclose(found.closed, found.youla @ found.plant, atol=1e-9)
    inside = np.linalg.inv(np.eye(2) + found.loop)
    np.testing.assert_allclose(inside, found.sensitivity, atol=1e-9)


def test_plant_equals_scipys_frequency_response():
    """Entry by entry, of the two observable states."""
    ease = 1 / CAR.m_s + 1 / CAR.m_u
    a = np.array([[0.0, 1.0], [-CAR.k * ease, -CAR.b * ease]])
    into = np.array([[0.0, 0.0], [1 / CAR.m_u, 1 / CAR.m_s]])
    out = np.array([[CAR.k / CAR.m_s, CAR.b / CAR.m_s], [1.0, 0.0]])
    through = np.array([[0.0, -1 / CAR.m_s], [0.0, 0.0]])
    found = loop_transfers(CORNER, HZ).plant
    for i in range(2):
        for j in range(2):
            fraction = ss2tf(a, into, out[[i]], through[[i]], input=j)
            expected = freqs(fraction[0][0], fraction[1], 2 * np.pi * HZ)[1]
            np.testing.assert_allclose(found[:, i, j], expected, rtol=1e-7)


def test_singular_values_have_the_limits_of_figure_4(oracle):
    found = loop_transfers(CORNER, [1e-3, 3.0, 30.0, 3e3])
    closed, sensitivity, loop = (
        singular_values(m) for m in (found.closed, found.sensitivity, found.loop)
    )
    np.testing.assert_allclose(closed[0], 1.0, rtol=1e-6)
    np.testing.assert_allclose(closed[1], 1.0, rtol=1e-3)
    np.testing.assert_allclose(20 * np.log10(closed[2]), -3.0103 - 0.0864, atol=1e-3)
    assert np.all(closed[3] < 1e-5)
    assert np.all(sensitivity[0] < 1e-4)
    np.testing.assert_allclose(sensitivity[3], 1.0, rtol=1e-3)
    assert np.all(loop[0] > 1e4)
    assert np.all(loop[3] < 1e-5)
    # at rest Y is the inverse of the plant's gain: [[m_u, k], [-m_s, k]]
    still = np.linalg.svd([[CAR.m_u, CAR.k], [-CAR.m_s, CAR.k]], compute_uv=False)
    np.testing.assert_allclose(singular_values(found.youla)[0], still, rtol=1e-5)
    ours = loop_transfers(CORNER, HZ)
    for name, theirs in zip(ours._fields, oracle, strict=True):
        expected = np.sqrt(np.linalg.eigvalsh(theirs.conj().transpose(0, 2, 1) @ theirs)[:, ::-1])
        largest = singular_values(getattr(ours, name))
        np.testing.assert_allclose(largest[:, 0], expected[:, 0], rtol=1e-7)


def test_design_parameters_reach_every_matrix():
    design = {"bandwidth": 12.0, "damping": 0.5, "lag": 2e-3}
    found = loop_transfers(CORNER, HZ, **design)
    passed = lti.low_pass(HZ, *design.values())
    np.testing.assert_allclose(found.closed, passed[:, None, None] * np.eye(2), rtol=1e-9)
    np.testing.assert_allclose(found.sensitivity[:, 0, 0], 1 - passed, rtol=1e-9)
    p = youla_params(CORNER, 1e-4, **design)
    assert discretisation_error(p, [1.0, 5.0], **design).max() < 1e-4
    assert discretisation_error(p, [5.0]).min() > 0.05  # another design than that of the params


@pytest.mark.parametrize("method", ["exact", "bilinear"])
def test_discrete_youla_is_the_continuous_one_within_the_stated_accuracy(method):
    """1 kHz up to the bandwidth: 0.3 % at f dt = 0.03 of the signal or of its frequency, whose
    square the wheel's inertia sees."""
    hz, dt = np.array([0.3, 3.0, 10.0, 30.0]), 1e-3
    p = youla_params(CORNER, dt, method=method)
    plant = lti.transfer(lti.corner(CAR), hz)[:, :2, :2]
    exact = lti.low_pass(hz, 30.0)[:, None, None] * np.linalg.inv(plant)
    error = abs(discrete_youla(p, hz) / exact - 1).max((1, 2))
    np.testing.assert_allclose(discretisation_error(p, hz), error, rtol=1e-6, atol=1e-12)
    stated = (np.pi * hz * dt) ** 2 / 3
    assert np.all(error < (2.0 * stated + 1e-4 if method == "bilinear" else 1.2 * stated + 2e-4))
    assert error[-1] > 0.5 * stated[-1]


def test_with_a_slow_interval_the_images_decide():
    """At 125 Hz the low-pass does not keep the sampling rate out, and the wheel's inertia weighs
    there: linear interpolation is off by far more than sinc^2, Tustin's rule is not."""
    hz, dt = np.array([1.0, 3.0]), 8e-3
    stated = (np.pi * hz * dt) ** 2 / 3
    lag = default_lag(30.0)
    linear, tustin = (
        discretisation_error(youla_params(CORNER, dt, lag=lag, method=m), hz)
        for m in ("exact", "bilinear")
    )
    assert np.all(linear > 15 * stated)
    assert np.all(tustin < 1.5 * stated)


def test_the_bandwidth_that_comes_out_is_told():
    """-3 dB of Eq. 8 by SciPy; half a sampling interval of lag takes some of it at a low rate."""
    for dt in (1e-3, 4e-3):
        p = youla_params(CORNER, dt)
        scale, lag = 2.0 * np.pi * 30.0, max(0.1 / (2.0 * np.pi * 30.0), 0.5 * dt)
        below = np.polymul([lag, 1.0], [lag, 1.0])
        below = np.polymul(below, [1 / scale**2, np.sqrt(2.0) / scale, 1.0])
        digital = bilinear([1.0], below, 1 / dt)
        hertz, gain = freqz(*digital, worN=20_000, fs=1 / dt)
        expected = hertz[np.argmax(np.abs(gain) < np.sqrt(0.5))]
        assert passed_bandwidth(p) == pytest.approx(expected, rel=5e-3)


def test_a_corner_out_of_range_is_refused():
    for field, value in (("stiffness", float("nan")), ("stiffness", 30.0), ("sprung_mass", -5.0)):
        wrong = replace(CORNER, **{field: jnp.asarray(value)})
        with pytest.raises(InputError, match=f"corner.{field}"):
            youla_params(wrong, 1e-3)
    with pytest.raises(InputError, match="bandwidth"):
        youla_params(CORNER, 4e-3, bandwidth=70.0)
    with pytest.raises(InputError, match="frequency"):
        loop_transfers(CORNER, [0.0])
