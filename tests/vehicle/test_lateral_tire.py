"""Lateral tyre laws: the arctangent against the paper's equation, the Magic Formula against its
own oracle, and what both owe any tyre: signs, friction, slopes."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.oracles import two_track_numpy as paper
from tests.oracles.magic_formula_numpy import coefficients_of, magic_formula
from wheelhop.errors import InputError
from wheelhop.vehicle.lateral_tire import (
    ARCTANGENT,
    MAGIC_FORMULA,
    NOMINAL_TIRE,
    SOFT_TIRE,
    ArctangentTire,
    InflatedTire,
    arctangent_force,
    validate,
)
from wheelhop.vehicle.magic_formula_parameters import generic_passenger_tire

INFLATED = InflatedTire(generic_passenger_tire(ppy1=-0.6, ppy2=0.4, ppy3=-0.1), 180e3)
LAWS = pytest.mark.parametrize(
    ("law", "tire"), [(ARCTANGENT, SOFT_TIRE), (MAGIC_FORMULA, INFLATED)], ids=["atan", "magic"]
)


def random_slips(n=80, seed=0):
    """Slip angles up to 0.3 rad and loads, lifted and overloaded ones among them."""
    rng = np.random.default_rng(seed)
    return rng.uniform(-0.3, 0.3, n), rng.uniform(-1500.0, 8000.0, n)


@pytest.mark.parametrize(
    ("tire", "k"), [(NOMINAL_TIRE, paper.NOMINAL), (SOFT_TIRE, paper.SOFT)], ids=["sound", "soft"]
)
def test_the_arctangent_is_the_papers(tire, k):
    slip, load = random_slips()
    found = arctangent_force(slip, load, tire)
    np.testing.assert_allclose(found, paper.forces(slip, load, k), rtol=1e-13)
    acts = (load < 0.0) | (load > k[1])
    assert 0 < acts.sum() < len(acts)
    np.testing.assert_array_equal(ARCTANGENT.overloaded(load, tire), acts)


def test_the_guard_refuses_forces_against_the_slip_and_nothing_else():
    """Unguarded, Eq. 3 pushes a lifted and an overloaded wheel the wrong way."""
    slip, load = random_slips(400, seed=1)
    printed = paper.forces(slip, load, paper.SOFT, guard=False)
    wrong = printed * slip < 0.0
    assert wrong.any()
    np.testing.assert_array_equal(ARCTANGENT.overloaded(load, SOFT_TIRE), wrong)
    found = np.asarray(arctangent_force(slip, load, SOFT_TIRE))
    assert (found[wrong] == 0.0).all()
    np.testing.assert_allclose(found[~wrong], printed[~wrong], rtol=1e-13)


def test_the_guard_does_not_act_at_its_very_edges():
    edges = np.array([0.0, 4500.0])
    assert not ARCTANGENT.overloaded(edges, SOFT_TIRE).any()
    assert ARCTANGENT.overloaded(edges + np.array([-1e-6, 1e-6]), SOFT_TIRE).all()
    np.testing.assert_array_equal(arctangent_force(np.full(2, 0.1), edges, SOFT_TIRE), 0.0)


def test_a_soft_tire_of_the_paper_corners_half_as_stiff():
    """At 3.3 kN, about the front wheel's load at rest: (1 - F/k2) F k3 by hand."""
    sound, soft = (float(ARCTANGENT.stiffness(3300.0, t)) for t in (NOMINAL_TIRE, SOFT_TIRE))
    assert sound == pytest.approx((1 - 3300 / 5650) * 3300 * 15, rel=1e-14)
    assert soft == pytest.approx((1 - 3300 / 4500) * 3300 * 12, rel=1e-14)
    assert soft / sound == pytest.approx(0.5, abs=0.02)


def test_the_magic_formula_is_its_oracles():
    """Upright, free rolling; slip here is positive to the left, ISO's tan(alpha) to the right."""
    rng = np.random.default_rng(2)
    slip, load = rng.uniform(-0.4, 0.4, 40), rng.uniform(200.0, 9000.0, 40)
    arbitrary = replace(INFLATED.slip, pey3=0.1, phy1=0.002, pvy1=0.01, pdy3=0.2, pky4=1.9)
    for tire in (INFLATED, InflatedTire(arbitrary, 300e3)):
        keys, relative = coefficients_of(tire.slip), (tire.pressure - 250e3) / 250e3
        expected = [
            magic_formula(0.0, -np.tan(a), f, 0.0, keys, relative, 0.7)[1]
            for a, f in zip(slip, load, strict=True)
        ]
        found = MAGIC_FORMULA.force(slip, load, tire, 0.7)
        np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-8)


def test_magic_formula_lifts_only():
    load = np.array([-1.0, 0.0, 2e4])
    np.testing.assert_array_equal(MAGIC_FORMULA.overloaded(load, INFLATED), [True, False, False])
    found = np.asarray(MAGIC_FORMULA.force(np.full(3, 0.1), load, INFLATED, 1.0))
    assert found[0] == found[1] == 0.0 < found[2]


def test_pressure_acts_on_the_magic_formula():
    """ppy1 = -0.5 alone: 20 % less pressure, 10 % more cornering stiffness."""
    tire = InflatedTire(generic_passenger_tire(ppy1=-0.5), np.array([250e3, 200e3]))
    sound, low = np.asarray(MAGIC_FORMULA.stiffness(np.full(2, 4e3), tire))
    assert low / sound == pytest.approx(1.1, rel=1e-12)


@LAWS
def test_the_force_follows_the_slip_and_is_odd(law, tire):
    slip, load = random_slips()
    force = np.asarray(law.force(slip, load, tire, 1.0))
    carried = ~np.asarray(law.overloaded(load, tire))
    np.testing.assert_array_equal(np.sign(force[carried]), np.sign(slip[carried]))
    np.testing.assert_array_equal(law.force(-slip, load, tire, 1.0), -force)


@LAWS
@pytest.mark.parametrize("mu", [0.3, 0.8])
def test_friction_is_similarity(law, tire, mu):
    """mu S(alpha / mu), in the slip the law is written in: the angle or its tangent."""
    slip, load = random_slips(seed=3)
    same = np.arctan(np.tan(slip) / mu) if law is MAGIC_FORMULA else slip / mu
    found = law.force(slip, load, tire, mu)
    np.testing.assert_allclose(found, mu * law.force(same, load, tire, 1.0), rtol=1e-11, atol=1e-9)


@LAWS
def test_stiffness_is_the_slope_at_zero_slip_whatever_the_friction(law, tire):
    h, load = 1e-6, np.array([-200.0, 500.0, 3000.0, 4400.0])
    expected = np.asarray(law.stiffness(load, tire))
    assert expected[0] == 0.0
    assert (expected[1:] > 0.0).all()
    for mu in (0.25, 1.0):
        ends = (np.asarray(law.force(np.full(4, s), load, tire, mu)) for s in (h, -h))
        slope = np.subtract(*ends) / (2 * h)
        np.testing.assert_allclose(slope, expected, rtol=1e-7)


@LAWS
def test_a_slippery_road_saturates_sooner(law, tire):
    slip = np.array([1e-4, 0.4])
    rough, icy = (np.asarray(law.force(slip, np.full(2, 3e3), tire, mu)) for mu in (1.0, 0.3))
    assert icy[0] == pytest.approx(rough[0], rel=1e-4)
    assert icy[1] < 0.5 * rough[1]


@LAWS
def test_gradients_are_finite_everywhere(law, tire):
    """Zero slip, zero load, the guard's edges and beyond; in every argument."""
    slopes = jax.grad(
        lambda a, f, t, mu: law.force(a, f, t, mu) + law.stiffness(f, t), argnums=(0, 1, 2, 3)
    )
    slip, load = (
        m.ravel()
        for m in np.meshgrid([0.0, 1e-12, -0.05, 0.5], [-500.0, 0.0, 1e-9, 3e3, 4.5e3, 9e3])
    )
    every = jax.jit(jax.vmap(slopes, (0, 0, None, None)))
    for mu in (1.0, 0.3):
        found = every(slip, load, tire, mu)
        assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(found))
        before_the_peak = (load == 3e3) & (abs(slip) < 0.01)
        assert (np.asarray(found[0])[before_the_peak] > 0.0).all()


def test_slopes_of_the_arctangent_by_hand():
    """At F = 2 kN, alpha = 0.05: in slip, load, k1, k2, k3 and friction 0.8."""
    a, f, mu, (k1, k2, k3) = 0.05, 2000.0, 0.8, paper.SOFT
    slopes = jax.grad(arctangent_force, argnums=(0, 1, 2, 3))(a, f, SOFT_TIRE, mu)
    grip, angle = (k1 - f / k2) * f, np.arctan(k3 * a / mu)
    bend = 1 / (1 + (k3 * a / mu) ** 2)
    by_hand = (
        grip * k3 * bend,
        (k1 - 2 * f / k2) * mu * angle,
        f * mu * angle,
        f * f / k2**2 * mu * angle,
        grip * a * bend,
        grip * (angle - k3 * a / mu * bend),
    )
    np.testing.assert_allclose(jax.tree.leaves(slopes), by_hand, rtol=1e-12)


@LAWS
def test_float32_is_close_to_float64(float32, law, tire):
    slip, load = random_slips(seed=4)
    found = law.force(jnp.asarray(slip, jnp.float32), jnp.asarray(load, jnp.float32), tire, 0.9)
    assert found.dtype == jnp.float32
    with jax.enable_x64(True):
        exact = np.asarray(law.force(slip, load, tire, 0.9))
    assert np.abs(found - exact).max() < 5e-6 * 8000.0


@pytest.mark.parametrize(
    ("name", "value"),
    [("k1", 0.0), ("k1", np.nan), ("k2", -5650.0), ("k2", 5.65), ("k3", 0.0), ("k3", np.inf)],
)
def test_a_bad_coefficient_is_named(name, value):
    assert validate("front", NOMINAL_TIRE) == ArctangentTire(1.0, 5650.0, 15.0)
    with pytest.raises(InputError, match=rf"front\.{name}"):
        validate("front", replace(NOMINAL_TIRE, **{name: value}))
