"""Vertical tyre law against its closed forms and a published contact length."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from wheelhop.errors import InputError
from wheelhop.vehicle.vertical_tire import (
    VerticalTire,
    contact_half_length,
    deflection_at_load,
    effective_radius,
    linear_coefficient,
    linear_vertical_tire,
    nominal_stiffness,
    validate,
    vertical_load,
    vertical_stiffness,
)

R0 = 0.5 * (16 * 0.0254 + 2 * 0.6 * 0.245)
SAMPLE = VerticalTire(
    unloaded_radius=R0,
    rated_load=5000.0,
    q_fz1=linear_coefficient(239.45e3, 15.416, R0, 5000.0),
    q_fz2=15.416,
    pressure_coefficient=0.7097,
    nominal_pressure=240e3,
    speed_coefficient=0.0466,
    reference_speed=16.7,
    damping=50.0,
)
"""245/60R16: 239.45 kN/m at 240 kPa and the rated load."""


def test_load_follows_the_published_law():
    rho, rate, spin, pressure = 0.023, -0.4, 60.0, 190e3
    t = SAMPLE
    strain = rho / R0
    stiffening = (1 + 0.0466 * 60.0 * R0 / 16.7) * (1 + 0.7097 * (190 - 240) / 240)
    expected = stiffening * (t.q_fz1 * strain + 15.416 * strain**2) * 5000 - 50 * 0.4
    assert float(vertical_load(rho, rate, spin, pressure, t)) == pytest.approx(expected, rel=1e-13)


def test_stiffness_at_the_rated_load_is_the_given_one():
    assert float(nominal_stiffness(SAMPLE)) == pytest.approx(239.45e3, rel=1e-12)
    rho = deflection_at_load(5000.0, 0.0, 240e3, SAMPLE)
    assert float(vertical_stiffness(rho, 0.0, 240e3, SAMPLE)) == pytest.approx(239.45e3, rel=1e-12)


def test_deflection_inverts_the_load():
    load = jnp.linspace(0.0, 12e3, 25)
    spin = jnp.full(25, -70.0)
    for tire in (SAMPLE, linear_vertical_tire(264.7e3, 250e3, 0.7, 0.36, 5000.0)):
        rho = deflection_at_load(load, spin, 180e3, tire)
        back = vertical_load(rho, jnp.zeros(25), spin, 180e3, tire)
        np.testing.assert_allclose(back, load, rtol=1e-12, atol=1e-9)


def test_stiffness_is_the_slope_of_the_load():
    for rho in (0.004, 0.02, 0.05):
        slope = jax.grad(lambda x: vertical_load(x, 0.0, 50.0, 200e3, SAMPLE))(rho)
        found = vertical_stiffness(rho, 50.0, 200e3, SAMPLE)
        assert float(slope) == pytest.approx(float(found), rel=1e-12)


def test_linear_tire_is_hooke_and_its_pressure_law_that_of_the_quarter_car():
    tire = linear_vertical_tire(264.7e3, 250e3, 0.7, 0.36, 5000.0)
    load = vertical_load(jnp.array([0.01, 0.02]), jnp.zeros(2), jnp.zeros(2), 250e3, tire)
    np.testing.assert_allclose(load, [2647.0, 5294.0], rtol=1e-13)
    for kpa, expected in ((130, 175.8e3), (180, 212.8e3), (230, 249.9e3)):
        k = float(vertical_stiffness(0.02, 0.0, kpa * 1e3, tire))
        assert k == pytest.approx(expected, rel=1e-3)


def test_the_road_never_pulls_and_lost_contact_carries_nothing():
    tire = replace(SAMPLE, damping=2000.0)
    rho = jnp.array([-0.05, 0.0, 0.001, 0.02])
    rate = jnp.array([3.0, 3.0, -3.0, 0.5])
    load = np.asarray(vertical_load(rho, rate, jnp.zeros(4), 240e3, tire))
    assert (load[:3] == 0).all()
    assert load[3] > 1000


def test_effective_radius_lies_between_loaded_and_unloaded_at_service_loads():
    rho = jnp.linspace(0.0, 0.04, 41)
    radius = np.asarray(effective_radius(rho, SAMPLE))
    assert radius[0] == R0
    assert (np.diff(radius) < 0).all()
    service = np.asarray(rho) > 0.012
    assert (radius > R0 - np.asarray(rho))[service].all()
    assert float(effective_radius(-0.1, SAMPLE)) == R0
    # dR_e/drho = -(D B + F) where the tyre just touches
    slope = float(jax.grad(lambda x: effective_radius(x, SAMPLE))(1e-12))
    assert slope == pytest.approx(-(0.25 * 8.0 + 0.01), rel=1e-6)


@pytest.mark.parametrize(("share", "millimetres"), [(1.0, 152.0), (0.8, 166.0), (0.6, 184.0)])
def test_contact_grows_as_the_pressure_falls(share, millimetres):
    """Contact length of the sample tyre at 5 kN, to 2.5 %."""
    rho = deflection_at_load(5000.0, 0.0, share * 240e3, SAMPLE)
    found = 2e3 * float(contact_half_length(rho, SAMPLE))
    assert found == pytest.approx(millimetres, rel=0.025)


def test_gradients_stay_finite_through_loss_of_contact():
    def everything(rho, rate, spin, tire):
        return (
            vertical_load(rho, rate, spin, 200e3, tire)
            + vertical_stiffness(rho, spin, 200e3, tire)
            + effective_radius(rho, tire)
            + contact_half_length(rho, tire)
            + deflection_at_load(rho * 1e5, spin, 200e3, tire)
        )

    slopes = jax.jit(jax.grad(everything, argnums=(0, 1, 2, 3)))
    for rho in (-0.01, 0.0, 1e-9, 0.02):
        for rate in (0.0, -5.0):
            for leaf in jax.tree.leaves(slopes(rho, rate, 0.0, SAMPLE)):
                assert np.isfinite(leaf).all()


def test_corners_and_lanes_need_no_vmap():
    tire = replace(SAMPLE, damping=jnp.array([50.0, 60.0, 70.0, 80.0])[:, None])
    rho = jnp.linspace(-0.01, 0.03, 12).reshape(4, 3)
    found = vertical_load(rho, jnp.ones((4, 3)), jnp.ones((4, 3)), jnp.full((4, 3), 2e5), tire)
    one = replace(SAMPLE, damping=80.0)
    assert float(found[3, 2]) == pytest.approx(float(vertical_load(rho[3, 2], 1.0, 1.0, 2e5, one)))


def test_float32_is_close_to_float64(float32):
    rho = jnp.linspace(0.0, 0.04, 9)
    assert rho.dtype == jnp.float32
    load = vertical_load(rho, jnp.zeros(9), jnp.full(9, 50.0), 200e3, SAMPLE)
    assert load.dtype == jnp.float32
    strain = np.linspace(0.0, 0.04, 9) / R0
    stiffening = (1 + 0.0466 * 50 * R0 / 16.7) * (1 - 0.7097 * 40 / 240)
    expected = 5000 * stiffening * (SAMPLE.q_fz1 * strain + 15.416 * strain**2)
    np.testing.assert_allclose(load, expected, rtol=1e-6)


def test_unphysical_parameters_are_named():
    assert validate(SAMPLE) is SAMPLE
    with pytest.raises(InputError, match=r"vertical_tire\.damping: -1 Ns/m is outside"):
        validate(replace(SAMPLE, damping=-1.0))
    with pytest.raises(InputError, match=r"vertical_tire\.rated_load: nan N"):
        validate(replace(SAMPLE, rated_load=float("nan")))
    with pytest.raises(InputError, match="yield below three times its rated load"):
        validate(replace(SAMPLE, q_fz2=-50.0))
    with pytest.raises(InputError, match="leaves no stiffness at small loads"):
        linear_coefficient(200e3, 100.0, 0.35, 5000.0)
