"""Quarter-car dynamics against closed forms, energy and plain NumPy."""

import math
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from wheelhop.errors import InputError
from wheelhop.vehicle.integrate import integrator
from wheelhop.vehicle.parameters import (
    BRANCATI_TABLE_1,
    BRANCATI_TABLE_3,
    brancati_suv,
    corner_sprung_mass,
    validate,
    with_suspension,
)
from wheelhop.vehicle.quarter_car import (
    AbsoluteState,
    RelativeState,
    absolute,
    absolute_derivative,
    accelerations,
    mechanical_energy,
    printed_accelerations,
    printed_step,
    relative,
    relative_derivative,
    relative_step,
    simulate,
)
from wheelhop.vehicle.suspension import Suspension, dissipated_power

CAR = brancati_suv()
K_T = 212.8e3
STATE = RelativeState(0.01, -0.004, 0.15, -0.6)


def linear(car):
    s = car.suspension
    return with_suspension(car, Suspension(s.stiffness, 0.0, s.damping, 0.0))


def test_sprung_masses_of_the_paper():
    assert corner_sprung_mass(BRANCATI_TABLE_1, "front") == pytest.approx(466.7, abs=0.05)
    assert corner_sprung_mass(BRANCATI_TABLE_1, "rear") == pytest.approx(427.3, abs=0.05)
    with pytest.raises(InputError, match="'middle' is not an axle"):
        corner_sprung_mass(BRANCATI_TABLE_1, "middle")


def test_default_suspension_is_physical_and_table_3_is_not():
    """1.35 Hz and 30 % damping; the class-D damper exceeds the wheel hop's critical damping."""
    s = CAR.suspension
    assert math.sqrt(s.stiffness / CAR.sprung_mass) / (2 * math.pi) == pytest.approx(1.35, abs=0.01)
    ratio = s.damping / (2 * math.sqrt(s.stiffness * CAR.sprung_mass))
    assert ratio == pytest.approx(0.30, abs=0.01)
    printed = BRANCATI_TABLE_3["D"]
    critical = 2 * math.sqrt((K_T + printed.stiffness) * CAR.unsprung_mass)
    assert printed.damping > critical


def test_internal_force_obeys_newtons_third_law():
    a = accelerations(STATE, K_T, CAR)
    momentum_rate = CAR.sprung_mass * a.a_s + CAR.unsprung_mass * a.a_u
    assert float(momentum_rate) == pytest.approx(-K_T * STATE.tyre_deflection, rel=1e-12)


def test_printed_equations_break_it_by_twice_the_quadratic_force():
    x = absolute(STATE, 0.02)
    a = printed_accelerations(x, K_T, 0.02, CAR)
    momentum_rate = CAR.sprung_mass * a.a_s + CAR.unsprung_mass * a.a_u
    square = CAR.suspension.quadratic_damping * (STATE.v_s - STATE.v_u) ** 2
    expected = -K_T * STATE.tyre_deflection - 2 * square
    assert float(momentum_rate) == pytest.approx(expected, rel=1e-12)


def test_printed_step_equals_eq_15_by_hand():
    z_s, z_u, v_s, v_u, z_r, dt = 0.03, 0.01, 0.2, -0.3, 0.005, 0.001
    s, m_s, m_u = CAR.suspension, CAR.sprung_mass, CAR.unsprung_mass
    d, w = z_s - z_u, v_s - v_u
    odd = s.stiffness * d + s.cubic_stiffness * d**3 + s.damping * w
    expected = (
        z_s + dt * v_s,
        z_u + dt * v_u,
        v_s + dt * (-odd - s.quadratic_damping * w**2) / m_s,
        v_u + dt * (odd - s.quadratic_damping * w**2 - K_T * (z_u - z_r)) / m_u,
    )
    found = printed_step(AbsoluteState(z_s, z_u, v_s, v_u), K_T, z_r, dt, CAR)
    np.testing.assert_allclose(tuple(found), expected, rtol=1e-13)


def test_relative_and_absolute_coordinates_describe_the_same_motion():
    elevation, rise = 0.37, 0.9
    x = absolute(STATE, elevation)
    np.testing.assert_allclose(tuple(relative(x, elevation)), tuple(STATE), atol=1e-15)
    by_absolute = absolute_derivative(x, K_T, elevation, CAR)
    by_relative = relative_derivative(STATE, K_T, rise, CAR)
    assert float(by_relative.deflection) == pytest.approx(by_absolute.z_s - by_absolute.z_u)
    assert float(by_relative.tyre_deflection) == pytest.approx(by_absolute.z_u - rise)
    assert float(by_relative.v_s) == pytest.approx(float(by_absolute.v_s))
    assert float(by_relative.v_u) == pytest.approx(float(by_absolute.v_u))


def test_energy_changes_by_what_the_damper_takes():
    def energy(t):
        x = relative_step(STATE, K_T, 0.0, t, CAR)
        return mechanical_energy(x, K_T, CAR)

    power = dissipated_power(STATE.v_s - STATE.v_u, CAR.suspension)
    assert float(jax.grad(energy)(0.0)) == pytest.approx(-float(power), rel=1e-10)


def test_energy_balance_over_a_long_ride_closes():
    """Energy in from the road = stored + dissipated, to the integrator's accuracy."""
    dt, steps = 2e-4, 20000
    rng = np.random.default_rng(3)
    velocity = jnp.asarray(np.convolve(rng.normal(size=steps), np.ones(50) / 50, mode="same"))

    def step(carry, v_r):
        x, work, heat = carry
        rates = lambda s: K_T * s.tyre_deflection * -v_r  # noqa: E731
        damp = lambda s: dissipated_power(s.v_s - s.v_u, CAR.suspension)  # noqa: E731
        middle = relative_step(x, K_T, v_r, dt / 2, CAR)
        end = relative_step(x, K_T, v_r, dt, CAR)
        simpson = lambda f: dt / 6 * (f(x) + 4 * f(middle) + f(end))  # noqa: E731
        return (end, work + simpson(rates), heat + simpson(damp)), None

    zero = jnp.zeros(())
    (x, work, heat), _ = jax.lax.scan(
        step, (RelativeState(zero, zero, zero, zero), zero, zero), velocity
    )
    stored = mechanical_energy(x, K_T, CAR)
    assert float(heat) > 1.0
    assert float(work) == pytest.approx(float(stored + heat), rel=1e-6)


def rk4_slope(car, x, rise=0.3, h=0.02 / 1024):
    """Mean slope of one fine Runge-Kutta step in NumPy, apart from the package."""
    s = car.suspension

    def f(y):
        d, e, v_s, v_u = y
        force = s.stiffness * d + s.cubic_stiffness * d**3 + s.damping * (v_s - v_u)
        wheel = (force - K_T * e) / car.unsprung_mass
        return np.array([v_s - v_u, v_u - rise, -force / car.sprung_mass, wheel])

    k1 = f(x)
    k2 = f(x + h / 2 * k1)
    k3 = f(x + h / 2 * k2)
    return (k1 + 2 * k2 + 2 * k3 + f(x + h * k3)) / 6


@pytest.mark.parametrize(("method", "order"), [("euler", 1), ("rk4", 4)])
def test_integrators_have_their_order(method, order):
    smooth = with_suspension(CAR, replace(CAR.suspension, quadratic_damping=0.0))

    def end(steps):
        x = STATE
        for _ in range(steps):
            x = relative_step(x, K_T, 0.3, 0.02 / steps, smooth, method)
        return np.array([float(v) for v in x])

    exact = np.array([float(v) for v in STATE])
    for _ in range(1024):
        exact = exact + 0.02 / 1024 * rk4_slope(smooth, exact)
    coarse, fine = (np.linalg.norm(end(n) - exact) for n in (32, 64))
    assert math.log2(coarse / fine) == pytest.approx(order, abs=0.35)


def test_an_unknown_integrator_is_told():
    with pytest.raises(InputError, match="'heun' is unknown"):
        integrator("heun")


def transfer_functions(car, k_t, omega):
    """Accelerations per road velocity of the linear quarter car, by complex 2x2 algebra."""
    s = 1j * omega
    k, c = car.suspension.stiffness, car.suspension.damping
    link = k + c * s
    mass = np.array(
        [
            [car.sprung_mass * s**2 + link, -link],
            [-link, car.unsprung_mass * s**2 + link + k_t],
        ]
    )
    z = np.linalg.solve(mass, np.array([0.0, k_t]))
    return z * s**2 / s


@pytest.mark.parametrize("hertz", [0.5, 1.35, 4.0, 10.5, 25.0])
def test_steady_oscillation_follows_the_closed_form_transfer_functions(hertz):
    car, omega, dt, substeps = linear(CAR), 2 * math.pi * hertz, 1e-3, 4
    cycles = 12 if hertz > 2 else 8
    settle = 6.0
    samples = int((settle + cycles / hertz) / dt)
    t_fine = dt / substeps * np.arange(samples * substeps + 1)
    amplitude = 1e-3
    elevation = amplitude * np.sin(omega * t_fine)
    rise = jnp.asarray(np.diff(elevation).reshape(samples, substeps))
    zero = jnp.zeros(())
    record = simulate(RelativeState(zero, zero, zero, zero), K_T, rise, dt, car)
    t = dt * np.arange(1, samples + 1)
    late = t > settle
    basis = np.stack([np.cos(omega * t[late]), np.sin(omega * t[late])], axis=1)
    expected = transfer_functions(car, K_T, omega)
    for values, h in zip(record.accelerations, expected, strict=True):
        cosine, sine = np.linalg.lstsq(basis, np.asarray(values)[late], rcond=None)[0]
        found = (cosine - 1j * sine) / (amplitude * omega)
        assert abs(found - h) < 2e-3 * abs(h)


def test_wheel_hop_moves_by_0_8_hz_per_50_kpa():
    from wheelhop.vehicle.tire import stiffness_from_pressure

    def hop(pressure):
        k_t = float(stiffness_from_pressure(pressure, CAR.tire))
        f = np.linspace(5, 20, 6001)
        gain = [abs(transfer_functions(linear(CAR), k_t, 2 * np.pi * x)[1]) for x in f]
        return f[int(np.argmax(gain))]

    assert (hop(230e3) - hop(130e3)) / 2 == pytest.approx(0.8, abs=0.15)


def test_step_response_settles_on_the_road():
    rise = np.zeros((8000, 4))
    rise[0, 0] = 0.05
    zero = jnp.zeros(())
    record = simulate(RelativeState(zero, zero, zero, zero), K_T, jnp.asarray(rise), 1e-3, CAR)
    assert float(jnp.abs(record.state.tyre_deflection).max()) > 0.01
    assert float(jnp.abs(record.accelerations.a_u[-1])) < 1e-3
    assert float(jnp.abs(record.state.deflection[-1])) < 1e-4


def test_stiffness_gradient_of_a_simulation_equals_finite_differences():
    rise = jnp.asarray(1e-4 * np.random.default_rng(0).normal(size=(200, 4)))
    zero = jnp.zeros(())

    def energy(k_t):
        record = simulate(RelativeState(zero, zero, zero, zero), k_t, rise, 2e-3, CAR)
        return jnp.sum(record.accelerations.a_u**2)

    h = 10.0
    difference = (energy(K_T + h) - energy(K_T - h)) / (2 * h)
    assert float(jax.grad(energy)(K_T)) == pytest.approx(float(difference), rel=1e-6)


def test_unphysical_parameters_are_named():
    with pytest.raises(InputError, match=r"suspension\.damping: -5 Ns/m is outside"):
        validate(with_suspension(CAR, replace(CAR.suspension, damping=-5.0)))
    with pytest.raises(InputError, match=r"quarter_car\.sprung_mass: nan kg"):
        validate(replace(CAR, sprung_mass=float("nan")))
