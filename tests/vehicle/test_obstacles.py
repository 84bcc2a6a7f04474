"""Obstacles: their shape, smoothness, sides and what they excite."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from wheelhop.errors import InputError
from wheelhop.vehicle.road.obstacles import (
    Bump,
    SineSweep,
    Slope,
    Step,
    elevation_of,
    obstacle_tracks,
    smoothstep,
    validate,
)

BUMP = Bump(5.0, 0.5, 0.06)
STEP = Step(5.0, 0.2, -0.08)
SWEEP = SineSweep(5.0, 120.0, 0.05)
SLOPE = Slope(5.0, 0.2, 8.0, 40.0)


def derivatives(obstacle, x):
    f = lambda s: obstacle.elevation(s)  # noqa: E731
    slope = jax.grad(f)
    return (jax.jit(jax.vmap(g))(jnp.asarray(x)) for g in (f, slope, jax.grad(slope)))


def test_a_bump_is_one_cosine_wave():
    x = np.linspace(4.5, 6.0, 31)
    inside = (x > 5.0) & (x < 5.5)
    expected = np.where(inside, 0.06 * np.sin(math.pi * (x - 5.0) / 0.5) ** 2, 0.0)
    np.testing.assert_allclose(BUMP.elevation(jnp.asarray(x)), expected, atol=1e-15)


def test_a_step_goes_from_level_to_level_half_way_in_its_middle():
    x = jnp.array([0.0, 5.0, 5.1, 5.2, 100.0])
    np.testing.assert_allclose(STEP.elevation(x), [0, 0, -0.04, -0.08, -0.08], atol=1e-15)


@pytest.mark.parametrize(
    ("obstacle", "joints", "order"),
    [
        (BUMP, [5.0, 5.5], 1),
        (STEP, [5.0, 5.2], 2),
        (SWEEP, [5.0, 17.5, 121.8, 125.0], 2),
        (SLOPE, [5.0, 13.0, 40.0, 48.0], 2),
    ],
)
def test_obstacles_join_the_road_smoothly(obstacle, joints, order):
    gap = 1e-7
    before, after = (list(derivatives(obstacle, np.array(joints) + s)) for s in (-gap, gap))
    scale = [np.abs(np.asarray(v)).max() for v in derivatives(obstacle, np.linspace(5, 130, 4001))]
    for k in range(order + 1):
        np.testing.assert_allclose(before[k], after[k], atol=1e-4 * scale[k])
    at = list(derivatives(obstacle, np.array(joints)))
    assert all(np.all(np.isfinite(v)) for v in at)


def test_the_bump_is_no_smoother_than_its_slope():
    """The jump of curvature at its foot: the smoothness test can fail."""
    _, _, curvature = derivatives(BUMP, np.array([5.0 - 1e-7, 5.0 + 1e-7]))
    assert float(curvature[1] - curvature[0]) == pytest.approx(
        0.5 * 0.06 * (2 * math.pi / 0.5) ** 2, rel=1e-6
    )


def test_spectrum_of_a_bump_is_its_closed_form():
    """|Z(n)| = h L |sinc(nL)| / (2 |1 - (nL)^2|), zero at nL = 2, 3, ..."""
    spacing = 1e-3
    x = spacing * np.arange(20000)
    z = np.asarray(BUMP.elevation(jnp.asarray(x)))
    n = np.fft.rfftfreq(len(x), spacing)
    found = np.abs(np.fft.rfft(z)) * spacing
    cycles = n * 0.5
    regular = np.abs(cycles - 1) > 1e-6
    expected = 0.06 * 0.5 / 2 * np.abs(np.sinc(cycles)[regular] / (1 - cycles[regular] ** 2))
    np.testing.assert_allclose(found[regular][:400], expected[:400], atol=1e-6)


def test_sweep_excites_up_to_3_5_hz_at_20_km_h():
    speed = 20 / 3.6
    assert float(SWEEP.wavelength(jnp.asarray(125.0))) == pytest.approx(1.6)
    assert speed / 1.6 == pytest.approx(3.5, abs=0.03)
    x = np.linspace(5.0, 125.0, 60001)
    z = np.asarray(SWEEP.elevation(jnp.asarray(x)))
    crossings = x[1:][np.diff(np.sign(z)) != 0]
    waves = 2 * np.diff(crossings[1:-1])
    assert np.all(np.diff(waves) < 1e-3)
    middle = 0.5 * (crossings[1:-2] + crossings[2:-1])
    frequency = 1 / 25.0 + (1 / 1.6 - 1 / 25.0) * (middle - 5.0) / 120.0
    np.testing.assert_allclose(1 / waves, frequency, rtol=0.02)


def test_sweep_spectrum_ends_at_its_shortest_wave():
    x = 0.02 * np.arange(8192)
    power = np.abs(np.fft.rfft(np.asarray(SWEEP.elevation(jnp.asarray(x))))) ** 2
    n = np.fft.rfftfreq(8192, 0.02)
    inside = (n > 0.5 / 25.0) & (n < 1.15 / 1.6)
    assert power[~inside].sum() < 1e-2 * power.sum()
    assert power[n > 1.5 / 1.6].sum() < 1e-5 * power.sum()


def test_sweep_amplitude_falls_with_the_wavelength():
    x = np.linspace(20.0, 120.0, 200001)
    z = np.asarray(SWEEP.elevation(jnp.asarray(x)))
    peak = (
        np.flatnonzero((np.abs(z[1:-1]) > np.abs(z[:-2])) & (np.abs(z[1:-1]) > np.abs(z[2:]))) + 1
    )
    height = np.abs(z[peak])
    assert np.all(np.diff(height) < 0)
    wave = 1 / (1 / 25.0 + (1 / 1.6 - 1 / 25.0) * (x[peak] - 5.0) / 120.0)
    np.testing.assert_allclose(height[2:], 0.05 * wave[2:] / 25.0, rtol=0.02)


def test_slope_has_its_gradient_between_the_transitions():
    x = np.array([0.0, 5.0, 13.0, 20.0, 40.0, 48.0, 60.0])
    z, slope, _ = derivatives(SLOPE, x)
    np.testing.assert_allclose(slope, [0, 0, 0.2, 0.2, 0.2, 0, 0], atol=1e-12)
    assert float(z[-1]) == pytest.approx(0.2 * 35.0)
    endless = Slope(5.0, 0.2)
    far, gradient, _ = derivatives(endless, np.array([1e4]))
    assert float(gradient[0]) == pytest.approx(0.2)
    assert float(far[0]) == pytest.approx(0.2 * (1e4 - 10.0))


def test_obstacles_add_up_on_their_sides():
    left, both = Bump(1.0, 2.0, 0.05, "left"), Step(0.0, 1.0, 0.1)
    x = jnp.linspace(0.0, 5.0, 51)
    tracks = np.asarray(obstacle_tracks([left, both], x))
    np.testing.assert_array_equal(tracks[0], tracks[2])
    np.testing.assert_array_equal(tracks[1], tracks[3])
    np.testing.assert_allclose(tracks[1], both.elevation(x))
    np.testing.assert_allclose(tracks[0] - tracks[1], left.elevation(x), atol=1e-15)
    assert not np.any(elevation_of([], x, "left"))
    with pytest.raises(InputError, match="'both' is no side"):
        elevation_of([left], x, "both")


def test_smoothstep_is_a_monotone_step():
    s = np.linspace(-0.5, 1.5, 401)
    value = np.asarray(smoothstep(jnp.asarray(s)))
    assert value[0] == 0.0
    assert value[-1] == 1.0
    assert np.all(np.diff(value) >= 0)
    np.testing.assert_allclose(value + value[::-1], 1.0, atol=1e-14)


@pytest.mark.usefixtures("float32")
def test_obstacles_keep_single_precision_and_differentiate_by_their_height():
    x = jnp.linspace(0.0, 10.0, 101)
    assert elevation_of([BUMP, STEP, SWEEP, SLOPE], x, "left").dtype == jnp.float32
    gradient = jax.grad(lambda h: jnp.sum(Bump(5.0, 2.0, h).elevation(x)))(0.1)
    assert float(gradient) == pytest.approx(10.0, rel=1e-4)


def test_unusable_obstacles_are_named():
    assert validate(BUMP) is BUMP
    with pytest.raises(InputError, match=r"Bump\.length: 0 m is not positive"):
        validate(Bump(0.0, 0.0, 0.1))
    with pytest.raises(InputError, match=r"Slope\.side: 'middle' is unknown"):
        validate(Slope(0.0, 0.1, side="middle"))
