"""Curves against SciPy, struts against their printed laws."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from wheelhop.errors import InputError
from wheelhop.vehicle.curve import curve, value
from wheelhop.vehicle.full_vehicle_parameters import suv
from wheelhop.vehicle.strut import (
    AntiRollBars,
    Damper,
    Strut,
    anti_roll_force,
    damper_force,
    default_stop,
    spring_force,
    validate,
)

POINTS = ([-0.3, -0.1, 0.0, 0.05, 0.4, 0.5], [-900.0, -500.0, 0.0, 20.0, 20.0, 700.0])


def strut(damper=None, **others):
    settings = {"preload": 4e3, "stiffness": 33e3, "cubic_stiffness": 0.0} | others
    stops = {"bump_clearance": 0.06, "rebound_clearance": 0.07, "stop": default_stop()}
    return Strut(damper=damper or Damper(2000.0), **(settings | stops))


def test_curve_is_scipys_pchip_and_straight_beyond():
    x = np.linspace(-0.3, 0.5, 401)
    c, oracle = curve(*POINTS), PchipInterpolator(*POINTS)
    np.testing.assert_allclose(value(c, jnp.asarray(x)), oracle(x), atol=1e-10)
    outside = np.array([-1.0, 0.9])
    slope = oracle(np.array([-0.3, 0.5]), 1)
    straight = np.array([-900.0, 700.0]) + slope * (outside - np.array([-0.3, 0.5]))
    np.testing.assert_allclose(value(c, jnp.asarray(outside)), straight)
    assert float(value(curve([0.0, 2.0], [3.0, -1.0]), 5.0)) == pytest.approx(-7.0)


def test_curve_slope_is_continuous_and_monotone():
    c = curve(*POINTS)
    slope = jax.vmap(jax.grad(lambda x: value(c, x)))(jnp.linspace(-0.6, 0.8, 2001))
    assert float(slope.min()) >= -1e-9
    for x in POINTS[0]:
        left, right = (float(jax.grad(lambda x: value(c, x))(x + h)) for h in (-1e-9, 1e-9))
        assert left == pytest.approx(right, rel=1e-5, abs=1e-3)


@pytest.mark.parametrize(
    ("x", "y", "message"),
    [
        ([0.0], [1.0], "pairs"),
        ([0.0, np.nan], [1.0, 2.0], "number"),
        ([1.0, 1.0], [0.0, 1.0], "repeat"),
    ],
)
def test_impossible_curve_is_told(x, y, message):
    with pytest.raises(InputError, match=message):
        curve(x, y)


def test_linear_and_signed_quadratic_options():
    s, w = np.linspace(-0.05, 0.05, 11), np.linspace(-2, 2, 21)
    spring = strut(cubic_stiffness=1e6)
    np.testing.assert_allclose(spring_force(jnp.asarray(s), spring), 4e3 + 33e3 * s + 1e6 * s**3)
    damper = strut(Damper(2000.0, quadratic=500.0))
    np.testing.assert_allclose(
        damper_force(jnp.asarray(w), damper), 2000.0 * w + 500.0 * np.sign(w) * w**2, atol=1e-9
    )


def test_extension_is_stiffer_by_the_asymmetry_and_fades_by_the_digression():
    pull = lambda w, **d: float(damper_force(w, strut(Damper(2000.0, **d))))  # noqa: E731
    ratio = -pull(-2.0, asymmetry=0.4) / pull(2.0, asymmetry=0.4)
    assert ratio == pytest.approx(1.4 / 0.6, rel=1e-12)
    assert pull(1.5, digression=2.0) == pytest.approx(2000.0 * 1.5 / 4.0, rel=1e-5)
    slope = jax.grad(lambda w: damper_force(w, strut(Damper(2000.0, 0.4, 0.1, 1.0))))(0.0)
    assert float(slope) == pytest.approx(2000.0, rel=2e-3)


def test_a_damper_never_gives_energy():
    w = jnp.linspace(-5, 5, 4001)
    for d in (Damper(2800.0, 0.9, 0.05, 3.0, 100.0), suv().strut.damper):
        one = jax.tree.map(lambda leaf: jnp.ravel(jnp.asarray(leaf))[0], d)
        assert float(jnp.min(w * damper_force(w, strut(one)))) >= 0.0


def test_stops_act_beyond_their_clearance_only():
    s = jnp.asarray([-0.08, -0.07, -0.03, 0.03, 0.06, 0.07])
    extra = spring_force(s, strut()) - (4e3 + 33e3 * s)
    np.testing.assert_array_equal(np.asarray(extra[1:5]), 0.0)
    # 10 mm into the rubber: 1 kN
    np.testing.assert_allclose(extra[jnp.asarray([0, 5])], [-1e3, 1e3], rtol=1e-9)


@pytest.mark.parametrize("s", [-0.07, 0.06, 0.062, 0.1])
def test_force_and_its_derivative_are_continuous(s):
    slope = jax.grad(lambda s: spring_force(s, strut()))
    assert float(slope(s - 1e-9)) == pytest.approx(float(slope(s + 1e-9)), rel=1e-3)


def test_maps_add_to_the_laws():
    spring, damper = (
        curve([-0.1, 0.1], [-500.0, 500.0]),
        curve([-1.0, 0.0, 1.0], [-900.0, 0.0, 300.0]),
    )
    both = strut(spring_map=spring, damper_map=damper)
    assert float(spring_force(0.02, both) - spring_force(0.02, strut())) == pytest.approx(100.0)
    assert float(damper_force(-1.0, both) - damper_force(-1.0, strut())) == pytest.approx(-900.0)


def test_anti_roll_bars_are_internal_and_idle_in_heave():
    s = jnp.asarray([0.03, 0.01, -0.02, 0.02])
    force = np.asarray(anti_roll_force(s, AntiRollBars(15e3, 8e3)))
    np.testing.assert_allclose(force, [300.0, -300.0, -320.0, 320.0])
    np.testing.assert_array_equal(anti_roll_force(jnp.full(4, 0.05), AntiRollBars(1e4, 1e4)), 0.0)


def test_unphysical_strut_is_named():
    with pytest.raises(InputError, match=r"damper\.asymmetry: 1\.2"):
        validate(strut(Damper(2000.0, asymmetry=1.2)), AntiRollBars())
    with pytest.raises(InputError, match="pulls before contact"):
        validate(replace(strut(), stop=curve([0.0, 0.01], [0.0, 1e3])), AntiRollBars())


def test_the_most_lopsided_damper_still_rises_with_speed():
    lopsided = strut(Damper(2800.0, asymmetry=0.8, knee=0.1))
    speed = jnp.linspace(-2.0, 2.0, 4001)
    assert np.all(np.diff(np.asarray(damper_force(speed, lopsided))) > 0)
    with pytest.raises(InputError, match=r"damper\.asymmetry"):
        validate(strut(Damper(2800.0, asymmetry=0.9)), AntiRollBars())
