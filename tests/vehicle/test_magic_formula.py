"""The Magic Formula against plain Python, its own symmetries, and measured tyres."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.oracles.magic_formula_numpy import coefficients_of, magic_formula, pure
from wheelhop.errors import InputError
from wheelhop.vehicle.magic_formula import relaxation_lengths, slip_forces, slip_stiffness
from wheelhop.vehicle.magic_formula_parameters import (
    COEFFICIENTS,
    generic_passenger_tire,
    validate,
)

TIRE = generic_passenger_tire()
P0 = 250e3
forces = jax.jit(slip_forces)


def arbitrary_tire(seed, ellipse=False):
    """A tyre that uses every coefficient, scaling factors included."""
    rng = np.random.default_rng(seed)
    values = {}
    for name in COEFFICIENTS:
        base = getattr(TIRE, name)
        spread = 0.2 * abs(base) if base else 0.05
        values[name] = base + spread * rng.uniform(-1, 1)
    return replace(TIRE, **values, friction_ellipse=ellipse)


def random_slips(n=60, seed=0, load=5000.0):
    rng = np.random.default_rng(seed)
    kappa = rng.uniform(-1.7, 1.7, n) * rng.uniform(0, 1, n) ** 2
    alpha = rng.uniform(-1.2, 1.2, n) * rng.uniform(0, 1, n) ** 2
    return kappa, alpha, load * rng.uniform(0.1, 2.0, n), rng.uniform(-0.15, 0.15, n)


@pytest.mark.parametrize("ellipse", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_every_coefficient_enters_as_in_the_oracle(seed, ellipse):
    tire = arbitrary_tire(seed, ellipse)
    kappa, alpha, load, camber = random_slips(seed=seed)
    pressure, friction = 190e3, 0.7
    found = forces(kappa, alpha, load, camber, pressure, tire, friction)
    c = coefficients_of(tire)
    expected = np.array(
        [
            magic_formula(*point, c, relative_pressure=(190 - 250) / 250, friction=friction)
            for point in zip(kappa, alpha, load, camber, strict=True)
        ]
    )
    size = np.abs(expected).max()
    np.testing.assert_allclose(found.longitudinal, expected[:, 0], rtol=1e-10, atol=1e-12 * size)
    np.testing.assert_allclose(found.lateral, expected[:, 1], rtol=1e-10, atol=1e-12 * size)


def test_the_oracle_feels_every_coefficient():
    """So that agreement above means something: no key is ignored by both."""
    tire = arbitrary_tire(5)
    points = [(0.07, -0.05, 4100.0, 0.06), (-0.2, 0.11, 6200.0, -0.04)]
    relaxation = {"ptx1", "ptx2", "ptx3", "pty1", "pty2", "lsgkp", "lsgal"}
    reference = [magic_formula(*p, coefficients_of(tire), -0.2, 0.9) for p in points]
    for name in set(COEFFICIENTS) - relaxation:
        changed = replace(tire, **{name: getattr(tire, name) + 0.01})
        other = [magic_formula(*p, coefficients_of(changed), -0.2, 0.9) for p in points]
        assert other != reference, name


def test_signs_are_iso():
    kappa = jnp.array([0.05, -0.05, 0.0, 0.0])
    alpha = jnp.array([0.0, 0.0, 0.05, -0.05])
    f = forces(kappa, alpha, jnp.full(4, 5e3), jnp.zeros(4), P0, TIRE)
    assert (np.sign(f.longitudinal) == [1, -1, 0, 0]).all()
    assert (np.sign(f.lateral) == [0, 0, -1, 1]).all()
    # a wheel leaning to the right is pushed to the right
    assert float(forces(0.0, 0.0, 5e3, 0.05, P0, TIRE).lateral) < 0


def test_generic_tire_is_symmetric():
    kappa, alpha, load, camber = random_slips()
    one = forces(kappa, alpha, load, camber, P0, TIRE)
    mirrored = forces(kappa, -alpha, load, -camber, P0, TIRE)
    np.testing.assert_allclose(mirrored.longitudinal, one.longitudinal, rtol=1e-12)
    np.testing.assert_allclose(mirrored.lateral, -one.lateral, rtol=1e-12)
    braked = forces(-kappa, alpha, load, camber, P0, TIRE)
    np.testing.assert_allclose(braked.longitudinal, -one.longitudinal, rtol=1e-12)


def test_a_right_tire_is_the_mirror_image_of_a_left_one():
    tire = arbitrary_tire(1)
    kappa, alpha, load, camber = random_slips()
    left = forces(kappa, alpha, load, camber, P0, tire)
    right = forces(kappa, -alpha, load, -camber, P0, replace(tire, side=-1.0))
    np.testing.assert_allclose(right.longitudinal, left.longitudinal, rtol=1e-12)
    np.testing.assert_allclose(right.lateral, -left.lateral, rtol=1e-12)
    assert float(jnp.abs(forces(0.0, 0.0, 5e3, 0.0, P0, tire).lateral)) > 1.0
    as_measured = forces(
        kappa, alpha, load, camber, P0, replace(tire, side=-1.0, measured_side=-1.0)
    )
    np.testing.assert_array_equal(as_measured.lateral, left.lateral)


def test_slopes_at_zero_slip_are_the_slip_stiffness():
    h = 1e-6
    for load in (1000.0, 5000.0, 9000.0):
        ahead, behind = (forces(s, 0.0, load, 0.0, 200e3, TIRE) for s in (h, -h))
        slope_x = float(ahead.longitudinal - behind.longitudinal) / (2 * h)
        ahead, behind = (forces(0.0, s, load, 0.0, 200e3, TIRE) for s in (h, -h))
        slope_y = float(ahead.lateral - behind.lateral) / (2 * h)
        expected = slip_stiffness(load, 200e3, TIRE)
        np.testing.assert_allclose((slope_x, slope_y), expected, rtol=1e-7)


def test_generic_tire_has_the_figures_of_its_docstring():
    longitudinal, lateral = slip_stiffness(5000.0, P0, TIRE)
    assert float(longitudinal) == pytest.approx(22 * 5000)
    assert float(lateral) == pytest.approx(-16 * 5000)
    slip = jnp.linspace(0.0, 1.0, 400)
    zero, load = jnp.zeros(400), jnp.full(400, 5e3)
    peak_x = float(forces(slip, zero, load, zero, P0, TIRE).longitudinal.max()) / 5e3
    peak_y = float(-forces(zero, slip, load, zero, P0, TIRE).lateral.min()) / 5e3
    assert (peak_x, peak_y) == (pytest.approx(1.1, abs=0.01), pytest.approx(1.0, abs=0.01))
    lengths = relaxation_lengths(5000.0, TIRE)
    np.testing.assert_allclose(lengths, (0.252, 0.4032), rtol=1e-3)


def test_relaxation_lengths_keep_their_floor():
    load = jnp.array([0.0, 100.0, 5000.0])
    kappa, alpha = relaxation_lengths(load, TIRE)
    np.testing.assert_allclose(kappa[:2], 0.1)
    np.testing.assert_allclose(alpha[0], 0.1)
    assert float(alpha[2]) > float(kappa[2]) > 0.1


def test_relaxation_lengths_by_hand():
    tire = replace(TIRE, ptx1=1.9, ptx2=0.3, ptx3=0.4, pty1=1.8, pty2=1.9, lfzo=0.8, lsgal=1.1)
    kappa, alpha = relaxation_lengths(6000.0, tire)
    dfz = 6000 / 4000 - 1
    by_hand = 6000 * (1.9 + 0.3 * dfz) * np.exp(-0.4 * dfz) * 0.36 / 5000
    assert float(kappa) == pytest.approx(by_hand, rel=1e-12)
    by_hand = 1.8 * np.sin(2 * np.arctan(6000 / (1.9 * 4000))) * 0.36 * 0.8 * 1.1
    assert float(alpha) == pytest.approx(by_hand, rel=1e-12)


@pytest.mark.parametrize("ellipse", [False, True])
def test_combined_slip_stays_inside_the_friction_ellipse(ellipse):
    """At most 1 % outside for the weighting functions, never for the ellipse itself."""
    tire = replace(TIRE, friction_ellipse=ellipse)
    slip = jnp.linspace(-1.5, 1.5, 61)
    kappa, alpha = (m.ravel() for m in jnp.meshgrid(slip, slip))
    zero = jnp.zeros_like(kappa)
    for load in (2000.0, 5000.0, 8000.0):
        f = forces(kappa, alpha, zero + load, zero, P0, tire)
        dfz = load / 5000 - 1
        x = np.asarray(f.longitudinal) / (load * (1.1 - 0.1 * dfz))
        y = np.asarray(f.lateral) / (load * (1.0 - 0.15 * dfz))
        assert np.hypot(x, y).max() < (1 + 1e-9 if ellipse else 1.01)
        assert np.hypot(x, y).max() > 0.97


def test_combined_slip_costs_both_forces():
    for ellipse in (False, True):
        tire = replace(TIRE, friction_ellipse=ellipse)
        alone = forces(0.08, 0.0, 5e3, 0.0, P0, tire).longitudinal
        together = forces(0.08, 0.1, 5e3, 0.0, P0, tire)
        assert float(together.longitudinal) < 0.9 * float(alone)
        alone = forces(0.0, 0.1, 5e3, 0.0, P0, tire).lateral
        assert abs(float(together.lateral)) < 0.9 * abs(float(alone))


def test_no_load_no_force_and_no_friction_no_force():
    for tire in (arbitrary_tire(2), arbitrary_tire(2, ellipse=True)):
        for load, friction in ((0.0, 1.0), (-300.0, 1.0), (4000.0, 0.0)):
            f = forces(0.1, 0.05, load, 0.02, P0, tire, friction)
            np.testing.assert_allclose(f, (0.0, 0.0), atol=1e-9)


def test_slip_beyond_its_limit_adds_nothing():
    limit = forces(1.5, 0.1, 5e3, 0.0, P0, TIRE)
    np.testing.assert_array_equal(forces(40.0, 0.1, 5e3, 0.0, P0, TIRE), limit)
    assert np.isfinite(forces(1e9, 1e9, 5e3, 0.0, P0, TIRE)).all()


@pytest.mark.parametrize("ellipse", [False, True])
def test_gradients_are_finite_everywhere(ellipse):
    def total(kappa, alpha, load, camber, pressure, tire, friction):
        f = slip_forces(kappa, alpha, load, camber, pressure, tire, friction)
        stiffness = slip_stiffness(load, pressure, tire)
        lengths = relaxation_lengths(load, tire)
        return sum(f) + sum(stiffness) + sum(lengths)

    slopes = jax.jit(jax.grad(total, argnums=range(7)))
    for tire in (replace(TIRE, friction_ellipse=ellipse), arbitrary_tire(3, ellipse)):
        for kappa in (0.0, 1e-7, 0.3, 1.5, 9.0):
            for alpha in (0.0, -1e-7, 0.4):
                for load, friction in ((0.0, 1.0), (1e-6, 1.0), (5e3, 1.0), (5e3, 0.0)):
                    found = slopes(kappa, alpha, load, 0.0, P0, tire, friction)
                    assert all(np.isfinite(x).all() for x in jax.tree.leaves(found))


def test_slopes_agree_with_finite_differences_at_combined_slip():
    for tire in (arbitrary_tire(4), arbitrary_tire(4, ellipse=True)):
        point = [0.06, -0.04, 4200.0, 0.03, 210e3]
        jacobian = jax.jacobian(slip_forces, argnums=range(5))(*point, tire)
        for i, step in enumerate((1e-6, 1e-6, 1e-2, 1e-6, 1.0)):
            up, down = list(point), list(point)
            up[i] += step
            down[i] -= step
            ahead, behind = forces(*up, tire), forces(*down, tire)
            for name in ("longitudinal", "lateral"):
                difference = float(getattr(ahead, name) - getattr(behind, name)) / (2 * step)
                found = float(getattr(jacobian, name)[i])
                assert found == pytest.approx(difference, rel=1e-5, abs=1e-7)


def test_pressure_moves_cornering_stiffness():
    """ppy1 scales the greatest cornering stiffness, ppy2 the load where it lies."""
    low = 0.8 * P0
    stiffer = generic_passenger_tire(ppy1=-0.5)
    ratio = slip_stiffness(5e3, low, stiffer)[1] / slip_stiffness(5e3, P0, stiffer)[1]
    assert float(ratio) == pytest.approx(1.1, rel=1e-12)
    moved = generic_passenger_tire(ppy2=1.0)
    found = float(slip_stiffness(5e3, low, moved)[1])
    assert found == pytest.approx(-20 * 5e3 * np.sin(2 * np.arctan(1 / (2 * 0.8))), rel=1e-12)
    assert float(slip_stiffness(5e3, low, TIRE)[1]) == float(slip_stiffness(5e3, P0, TIRE)[1])


def test_corners_and_lanes_need_no_vmap():
    side = jnp.array([1.0, -1.0, 1.0, -1.0])[:, None]
    tire = replace(arbitrary_tire(6), side=side)
    rng = np.random.default_rng(0)
    kappa, alpha, camber = (jnp.asarray(rng.uniform(-0.1, 0.1, (4, 3))) for _ in range(3))
    load = jnp.asarray(rng.uniform(1e3, 8e3, (4, 3)))
    together = forces(kappa, alpha, load, camber, jnp.full((4, 3), 2e5), tire)
    alone = forces(
        kappa[1, 2], alpha[1, 2], load[1, 2], camber[1, 2], 2e5, replace(tire, side=-1.0)
    )
    np.testing.assert_allclose(together.lateral[1, 2], alone.lateral, rtol=1e-12)
    np.testing.assert_allclose(together.longitudinal[1, 2], alone.longitudinal, rtol=1e-12)


def test_float32_is_close_to_float64(float32):
    tire = arbitrary_tire(7)
    kappa, alpha, load, camber = random_slips()
    found = slip_forces(
        *(jnp.asarray(x, jnp.float32) for x in (kappa, alpha, load, camber)), P0, tire
    )
    assert found.lateral.dtype == jnp.float32
    c = coefficients_of(tire)
    expected = np.array(
        [magic_formula(*point, c) for point in zip(kappa, alpha, load, camber, strict=True)]
    )
    error = np.abs(np.stack(found, axis=1) - expected) / load[:, None]
    assert error.max() < 5e-6
    slopes = jax.grad(lambda *a: sum(slip_forces(*a, 0.0, P0, tire)), argnums=(0, 1, 2))
    for point in ((0.0, 0.0, 0.0), (1e-9, 0.0, 1e-3), (0.0, 1e-9, 5e3)):
        assert np.isfinite(slopes(*(jnp.float32(x) for x in point))).all()


def test_stiffness_of_an_asymmetric_tire_is_the_slope_at_the_curve_centre():
    tire = arbitrary_tire(8)
    c = coefficients_of(tire)
    s = pure(0.0, 0.0, 6000.0, 0.0, c)
    found = slip_stiffness(6000.0, P0, tire)
    np.testing.assert_allclose(found, (s["k_x"], s["k_y"]), rtol=1e-12)


def test_unphysical_coefficients_are_named():
    assert validate(TIRE) is TIRE
    with pytest.raises(InputError, match=r"magic_formula\.pky1: 12 \(no unit\) is outside"):
        validate(replace(TIRE, pky1=12.0))
    with pytest.raises(InputError, match=r"magic_formula\.side: 0 is no side"):
        validate(replace(TIRE, side=0.0))
