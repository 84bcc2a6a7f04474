"""Pressure from stiffness: the law's inverse, its uncertainty, load and speed."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from wheelhop.estimators.pressure import (
    Operation,
    StiffnessBelief,
    corrected,
    correction,
    ln_stiffness,
    pressure_belief,
)
from wheelhop.vehicle.tire import Tire
from wheelhop.vehicle.vertical_tire import VerticalTire, linear_vertical_tire

TIRE = Tire(264.7e3, 250e3, 0.7)
LAW = VerticalTire(
    0.35,
    5000.0,
    q_fz1=13.0,
    q_fz2=15.0,
    pressure_coefficient=0.7,
    speed_coefficient=0.046,
)
COV = np.array([[4.0, 1.0, 1.0], [1.0, 3.0, 1.0], [1.0, 1.0, 2.0]]) * 1e-4


def law(pressure):
    return 264.7e3 * (1.0 + 0.7 * (pressure - 250e3) / 250e3)


def test_pressure_inverts_the_law():
    pressures = np.array([130e3, 180e3, 230e3])
    belief = StiffnessBelief(jnp.log(law(pressures)), jnp.asarray(COV))
    found = pressure_belief(belief, TIRE)
    np.testing.assert_allclose(found.mean, pressures, rtol=1e-13)
    np.testing.assert_allclose(ln_stiffness(pressures, TIRE), np.log(law(pressures)), rtol=1e-14)


def test_the_delta_method_agrees_with_sampling():
    pressures = np.array([150e3, 190e3, 240e3])
    belief = StiffnessBelief(jnp.log(law(pressures)), jnp.asarray(COV))
    found = pressure_belief(belief, TIRE)
    draws = np.random.default_rng(0).multivariate_normal(np.log(law(pressures)), COV, 200_000)
    samples = ((np.exp(draws) / 264.7e3 - 1.0) / 0.7 + 1.0) * 250e3
    np.testing.assert_allclose(found.cov, np.cov(samples.T), rtol=0.02)
    assert np.asarray(found.trusted).all()


def test_leaving_the_linear_law_or_the_delta_method_is_said():
    mean = jnp.log(law(np.array([230e3, 80e3, 450e3, 230e3])))
    cov = jnp.diag(jnp.array([1e-4, 1e-4, 1e-4, 0.04]))
    trusted = pressure_belief(StiffnessBelief(mean, cov), TIRE).trusted
    assert np.asarray(trusted).tolist() == [True, False, False, False]
    nothing = StiffnessBelief(mean * jnp.nan, cov * jnp.nan)
    assert not np.asarray(pressure_belief(nothing, TIRE).trusted).any()


def stiffness_by_differences(load, speed, pressure):
    """Central difference of load over deflection, the law written out, spin of free rolling."""
    p = LAW

    def force(rho, spin):
        stiffening = 1 + p.speed_coefficient * spin * p.unloaded_radius / p.reference_speed
        inflation = 1 + p.pressure_coefficient * (pressure / p.nominal_pressure - 1)
        x = rho / p.unloaded_radius
        return stiffening * inflation * (p.q_fz1 * x + p.q_fz2 * x * x) * p.rated_load

    def radius(rho):
        rho0 = p.unloaded_radius / np.sqrt(p.q_fz1**2 + 4 * p.q_fz2)
        x = rho / rho0
        return p.unloaded_radius - rho0 * (p.d_reff * np.arctan(p.b_reff * x) + p.f_reff * x)

    low, high = 0.0, 0.1
    for _ in range(80):
        rho = 0.5 * (low + high)
        low, high = (rho, high) if force(rho, speed / radius(rho)) < load else (low, rho)
    spin = speed / radius(rho)
    return (force(rho + 1e-6, spin) - force(rho - 1e-6, spin)) / 2e-6


@pytest.mark.parametrize(("load", "speed"), [(3200.0, 8.0), (5000.0, 20.0), (6500.0, 40.0)])
def test_the_correction_is_that_of_the_vertical_law(load, speed):
    reference = Operation(4500.0, 15.0, 230e3)
    found = correction(Operation(load, speed, 999e3), reference, LAW)
    expected = np.log(
        stiffness_by_differences(load, speed, 230e3) / stiffness_by_differences(4500.0, 15.0, 230e3)
    )
    assert abs(expected) > 0.005
    np.testing.assert_allclose(found, expected, atol=2e-7)


def test_a_tire_of_constant_stiffness_needs_no_correction():
    flat = linear_vertical_tire(264.7e3, 250e3, 0.7, 0.35, 5000.0)
    loads = jnp.array([3000.0, 5000.0, 7000.0])
    found = correction(Operation(loads, 30.0, 230e3), Operation(4000.0, 10.0, 230e3), flat)
    np.testing.assert_allclose(found, 0.0, atol=1e-14)


def test_correcting_recovers_the_reference_and_adds_the_loads_uncertainty():
    reference = Operation(4500.0, 15.0, 230e3)
    now = Operation(jnp.array([4000.0, 4500.0, 6000.0]), 30.0, 230e3)
    shift = correction(now, reference, LAW)
    belief = StiffnessBelief(12.0 + shift, jnp.asarray(COV))
    found = corrected(belief, now, reference, LAW, load_sd=300.0)
    np.testing.assert_allclose(found.mean, 12.0, rtol=1e-14)
    steps = [correction(Operation(now.load + s, 30.0, 230e3), reference, LAW) for s in (1.0, -1.0)]
    slope = np.asarray(steps[0] - steps[1]) / 2.0
    np.testing.assert_allclose(found.cov, COV + np.diag((300.0 * slope) ** 2), rtol=1e-6)


def test_a_batch_in_single_precision_equals_a_loop_in_double(float32):
    rng = np.random.default_rng(1)
    means = np.log(law(rng.uniform(150e3, 250e3, (5, 3)))).astype("float32")
    cov = jnp.broadcast_to(jnp.asarray(COV, jnp.float32), (5, 3, 3))
    batch = jax.jit(jax.vmap(lambda m, c: pressure_belief(StiffnessBelief(m, c), TIRE)))
    found = batch(jnp.asarray(means), cov)
    assert found.mean.dtype == found.cov.dtype == jnp.float32
    direct = pressure_belief(StiffnessBelief(jnp.asarray(means), cov), TIRE)
    np.testing.assert_allclose(found.mean, direct.mean, rtol=1e-6)
    for mean, got in zip(means, found.mean, strict=True):
        expected = ((np.exp(mean.astype(float)) / 264.7e3 - 1.0) / 0.7 + 1.0) * 250e3
        np.testing.assert_allclose(got, expected, rtol=1e-5)
