"""Modes of a quarter car against its characteristic polynomial, a limit and free decays."""

import math
from dataclasses import replace
from itertools import pairwise

import jax.numpy as jnp
import numpy as np
import pytest

from wheelhop.errors import InputError
from wheelhop.vehicle.corner_modes import (
    corner_modes,
    critical_damping_ratio,
    equivalent_damping,
)
from wheelhop.vehicle.parameters import BRANCATI_TABLE_3, brancati_suv, with_suspension
from wheelhop.vehicle.quarter_car import RelativeState, simulate

CAR = brancati_suv()
P = 180e3
K_T = 264.7e3 * (1 + 0.7 * (P - 250e3) / 250e3)


def on(damping, quadratic=0.0, stiffness=33.6e3, tire_damping=0.0):
    suspension = replace(
        CAR.suspension, damping=damping, quadratic_damping=quadratic, stiffness=stiffness
    )
    tire = replace(CAR.tire, damping=tire_damping)
    return replace(CAR, suspension=suspension, tire=tire)


def polynomial(car, damping):
    """Characteristic polynomial of the two equations of motion, highest power first."""
    m_s, m_u, k = car.sprung_mass, car.unsprung_mass, car.suspension.stiffness
    c, c_t = damping, car.tire.damping
    return [
        m_s * m_u,
        c * (m_s + m_u) + c_t * m_s,
        k * (m_s + m_u) + K_T * m_s + c * c_t,
        c * K_T + k * c_t,
        k * K_T,
    ]


@pytest.mark.parametrize("tire_damping", [0.0, 300.0])
@pytest.mark.parametrize("damping", [0.0, 500.0, 2400.0, 4500.0])
def test_complex_pairs_are_the_roots_of_the_characteristic_polynomial(damping, tire_damping):
    car = on(damping, tire_damping=tire_damping)
    roots = np.roots(polynomial(car, damping))
    up = sorted((r for r in roots if r.imag > 0), key=abs)
    assert len(up) == 2
    found = corner_modes(car, P)
    np.testing.assert_allclose(found[::2], np.abs(up) / (2 * np.pi), rtol=1e-9)
    expected = [-r.real / abs(r) for r in up]
    np.testing.assert_allclose(found[1::2], expected, rtol=1e-9, atol=1e-12)


def test_an_overdamped_pair_has_a_ratio_above_one():
    car = with_suspension(CAR, BRANCATI_TABLE_3["D"])
    roots = np.roots(polynomial(car, car.suspension.damping))
    slow, fast = (r.real for r in roots if r.imag == 0)
    (pair,) = (r for r in roots if r.imag > 0)
    found = corner_modes(car, P)
    assert found.ride_frequency == pytest.approx(abs(pair) / (2 * np.pi), rel=1e-9)
    assert found.hop_frequency == pytest.approx(math.sqrt(slow * fast) / (2 * np.pi), rel=1e-9)
    assert found.hop_damping == pytest.approx(-(slow + fast) / 2 / math.sqrt(slow * fast))
    assert found.hop_damping > 1


def test_the_class_d_damper_of_the_paper_locks_body_and_wheel_together():
    """All that is left to oscillate is the whole corner on its tyre, near 3 Hz."""
    car = with_suspension(CAR, BRANCATI_TABLE_3["D"])
    assert corner_modes(car, P).ride_frequency == pytest.approx(3.0, abs=0.25)
    assert critical_damping_ratio(car, P).wheel > 1
    locked = math.sqrt(K_T / (CAR.sprung_mass + CAR.unsprung_mass)) / (2 * math.pi)
    assert corner_modes(on(1e6), P).ride_frequency == pytest.approx(locked, rel=1e-3)
    assert corner_modes(CAR, P).hop_frequency > 3 * corner_modes(car, P).ride_frequency


@pytest.mark.parametrize("damping", [2400.0, 12e3])
def test_a_body_too_heavy_to_move_leaves_the_wheel_by_itself(damping):
    car = replace(on(damping, tire_damping=200.0), sprung_mass=1e9)
    found = corner_modes(car, P)
    stiffness = 33.6e3 + K_T
    omega = math.sqrt(stiffness / CAR.unsprung_mass)
    ratio = (damping + 200.0) / (2 * math.sqrt(stiffness * CAR.unsprung_mass))
    assert found.hop_frequency == pytest.approx(omega / (2 * math.pi), rel=1e-5)
    assert found.hop_damping == pytest.approx(ratio, rel=1e-5)
    assert critical_damping_ratio(car, P).wheel == pytest.approx(ratio, rel=1e-12)


def test_the_body_alone_has_its_textbook_damping_ratio():
    expected = 2400.0 / (2 * math.sqrt(33.6e3 * CAR.sprung_mass))
    assert critical_damping_ratio(on(2400.0), P).body == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("hop", [False, True])
def test_free_decay_has_the_frequency_and_the_decrement(hop):
    """Released in the shape of one mode, the corner rings in it alone."""
    car = replace(on(1500.0), suspension=replace(on(1500.0).suspension, cubic_stiffness=0.0))
    roots = sorted((r for r in np.roots(polynomial(car, 1500.0)) if r.imag > 0), key=abs)
    root = roots[1] if hop else roots[0]
    m_s, k, c = car.sprung_mass, car.suspension.stiffness, car.suspension.damping
    wheel = 1e-3 * (-1.0 if hop else 1.0)
    body = wheel * (c * root + k) / (m_s * root**2 + c * root + k)
    start = [body - wheel, wheel, body * root, wheel * root]
    state = RelativeState(*(jnp.asarray(complex(value).real) for value in start))
    dt, samples = 1e-4, 40000
    ride = simulate(state, K_T, jnp.zeros((samples, 1)), dt, car)
    e = np.asarray(ride.state.tyre_deflection)
    rising = np.flatnonzero((e[:-1] < 0) & (e[1:] >= 0))[:3]
    period = (rising[2] - rising[0]) / 2 * dt
    peaks = [np.abs(e[a:b]).max() for a, b in pairwise(rising)]
    decrement = math.log(peaks[0] / peaks[1])
    damping = decrement / math.sqrt(4 * math.pi**2 + decrement**2)
    frequency = 1 / period / math.sqrt(1 - damping**2)
    found = corner_modes(car, P)
    assert frequency == pytest.approx(
        found.hop_frequency if hop else found.ride_frequency, rel=5e-3
    )
    assert damping == pytest.approx(found.hop_damping if hop else found.ride_damping, rel=5e-3)


def test_quadratic_damping_counts_as_its_best_linear_fit_to_gaussian_motion():
    w = 0.3 * np.random.default_rng(0).normal(size=400_000)
    force = 2400.0 * w + 900.0 * w * np.abs(w)
    best = float(w @ force / (w @ w))
    assert equivalent_damping(on(2400.0, 900.0), 0.3) == pytest.approx(best, rel=3e-3)
    found = corner_modes(on(2400.0, 900.0), P, 0.3)
    np.testing.assert_allclose(found, corner_modes(on(best), P), rtol=3e-3)


def test_a_velocity_that_is_none_is_refused():
    with pytest.raises(InputError, match="velocity_rms: -1 m/s is outside"):
        corner_modes(CAR, P, -1.0)
