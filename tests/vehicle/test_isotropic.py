"""Random roads under four wheels: spectra, coherence between tracks, roughness."""

import math
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.signal import csd, welch
from scipy.special import k1
from scipy.stats import chi2

from wheelhop.errors import InputError
from wheelhop.vehicle.road import class_level, displacement_psd_cycles, iri, synthesise
from wheelhop.vehicle.road.isotropic import (
    draw_tracks,
    isotropic_tracks,
    prepare_isotropic,
    two_track_coherence,
    wheel_lines,
)
from wheelhop.vehicle.road.profile import Profile

LINES = wheel_lines(1.606, 1.6364)
LEVEL = class_level("C")


@partial(jax.jit, static_argnums=2)
def draw_many(road, level, count):
    keys = jax.random.split(jax.random.key(11), count)
    return jax.vmap(lambda key: draw_tracks(key, road, level))(keys)


def spectra(tracks):
    """Cross periodograms of whole periods, exact for a periodic road: [tracks, tracks, n]."""
    z = np.fft.rfft(tracks, axis=-1)
    return np.einsum("mif,mjf->ijf", z, z.conj()) / len(tracks)


def test_wheel_lines_lie_half_a_track_width_to_each_side():
    assert LINES == (0.803, -0.803, 0.8182, -0.8182)


@pytest.mark.parametrize("waviness", [1.6, 2.0, 2.7])
@pytest.mark.parametrize(("n", "distance"), [(0.02, 1.6), (0.3, 1.6), (0.1, 3.0), (2.0, 0.03)])
def test_coherence_law_is_the_fourier_integral_of_an_isotropic_spectrum(waviness, n, distance):
    """Quadrature over the lateral wavenumber m of (n^2 + m^2)^-((w + 1) / 2)."""
    density = lambda m: (n * n + m * m) ** (-0.5 * (waviness + 1.0))  # noqa: E731
    line = 2 * quad(density, 0.0, np.inf, epsabs=0, epsrel=1e-11)[0]
    cross = 2 * quad(density, 0.0, np.inf, weight="cos", wvar=2 * math.pi * distance)[0]
    found = two_track_coherence(np.array(n), distance, waviness)
    assert float(found) == pytest.approx(cross / line, abs=1e-6)


def test_coherence_law_has_its_limits():
    n = np.array([0.0, 1e-9, 1e3])
    np.testing.assert_allclose(two_track_coherence(n, 1.6), [1.0, 1.0, 0.0], atol=1e-12)
    assert np.all(two_track_coherence(n, 0.0) == 1.0)
    falling = two_track_coherence(np.geomspace(1e-3, 10, 200), 1.6)
    assert np.all(np.diff(falling) <= 0)
    with pytest.raises(InputError, match="waviness: 5 is not that of a road"):
        two_track_coherence(n, 1.6, 5.0)


@pytest.mark.parametrize("waviness", [2.0, 2.5])
def test_every_track_lies_on_the_iso_line_within_its_statistical_band(waviness):
    """Welch PSD of one long road, averaged in third octaves, in its 99.9 % band."""
    spacing, length, segment = 0.05, 4000.0, 2000
    road = prepare_isotropic(length, spacing, waviness, LINES)
    tracks = np.asarray(draw_many(road, LEVEL, 1))[0]
    n, density = welch(tracks, fs=1 / spacing, nperseg=segment, axis=-1, detrend="linear")
    for low in np.geomspace(0.05, 3.0, 14):
        inside = (n >= low) & (n < low * 2 ** (1 / 3))
        lines = inside.sum()
        ratio = (density[:, inside] / displacement_psd_cycles(n[inside], LEVEL, waviness)).mean(1)
        # Hann window at half overlap: 18/19 of the segments count, and 1 in 1.94 lines
        degrees = 2 * (2 * length / (segment * spacing)) * 18 / 19 * max(1.0, lines / 1.94)
        band = chi2.ppf([0.0005, 0.9995], degrees) / degrees
        # the Hann window's spread, a third of a squared line, raises a curved spectrum
        leak = 1 + waviness * (waviness + 1) / 6 * (1 / (segment * spacing) / low) ** 2
        assert np.all(ratio > band[0]), low
        assert np.all(ratio < band[1] * leak), low


@pytest.mark.parametrize("waviness", [2.0, 1.7])
def test_tracks_of_many_roads_have_the_cross_spectra_of_the_bessel_law(waviness):
    """Left/right 1.6 m apart, front/rear 15 mm apart, and diagonal ones."""
    count, spacing = 1500, 0.1
    road = prepare_isotropic(64.0, spacing, waviness, LINES)
    cross = spectra(np.asarray(draw_many(road, LEVEL, count)))
    n = np.fft.rfftfreq(road.points, spacing)
    used = (n > 0.012) & (n < 4.5)
    power = np.einsum("iif->if", cross).real[:, used]
    for i in range(4):
        for j in range(i):
            found = cross[i, j, used] / np.sqrt(power[i] * power[j])
            law = two_track_coherence(n[used], abs(LINES[i] - LINES[j]), waviness)
            # standard deviations of a sample coherence: (1 - law^2) along, sqrt(1 - law^2) across
            real = (found.real - law) / ((1 - law**2) / math.sqrt(2 * count))
            imaginary = found.imag / np.sqrt((1 - law**2) / (2 * count))
            if abs(LINES[i] - LINES[j]) > 1.0:
                assert np.abs(real).max() < 5.0
                assert np.abs(imaginary).max() < 5.0
                assert np.sqrt(np.mean(imaginary**2)) == pytest.approx(1.0, abs=0.15)
            else:
                # nearly one: the difference of the lines is what carries the law
                assert np.mean((1 - found.real) / (1 - law)) == pytest.approx(1.0, abs=0.02)


def test_front_and_rear_lines_differ_by_the_difference_spectrum():
    """Var(z_f - z_r) = 2 sum of G (1 - gamma) dn, 15 mm apart: millimetres on a class C road."""
    road = prepare_isotropic(100.0, 0.05, 2.0, LINES)
    tracks = np.asarray(draw_many(road, LEVEL, 200))
    found = np.mean((tracks[:, 0] - tracks[:, 2]) ** 2)
    n = np.arange(1, 1000) / 100.0
    distance = LINES[2] - LINES[0]
    x = 2 * math.pi * n * distance
    expected = np.sum(2 * displacement_psd_cycles(n, LEVEL) * (1 - x * k1(x))) / 100.0
    assert found == pytest.approx(expected, rel=0.03)
    assert 5e-4 < math.sqrt(expected) < 5e-3


def test_one_line_is_a_road_of_the_same_law_as_the_single_track_synthesis():
    road = prepare_isotropic(50.0, 0.1, 2.2, [0.0])
    keys = jax.random.split(jax.random.key(3), 800)
    single = jax.jit(jax.vmap(lambda k: synthesise(k, 50.0, 0.1, LEVEL, 2.2)))(keys)
    a = spectra(np.asarray(draw_many(road, LEVEL, 800)))[0, 0].real
    b = spectra(np.asarray(single)[:, None])[0, 0].real
    used = slice(1, 240)
    assert np.mean(a[used] / b[used]) == pytest.approx(1.0, abs=0.02)
    assert np.all(a[used] / b[used] < 1.4)


def test_roughness_index_of_class_b_tracks():
    """IRI of the exact ISO line is 4.35 m/km; the mean of 8 km lies within 5 % of it."""
    road = prepare_isotropic(1000.0, 0.1, 2.0, LINES)
    tracks = np.asarray(draw_many(road, class_level("B"), 8))
    index = np.array([[iri(Profile(0.1, z), moving_average=False) for z in t] for t in tracks])
    assert np.all(np.abs(index / 4.35 - 1) < 0.15)
    assert np.all(np.abs(index.mean(axis=0) / 4.35 - 1) < 0.05)


def test_a_road_is_a_pure_function_of_key_and_level():
    build = jax.jit(lambda key, level: isotropic_tracks(key, 20.0, 0.1, level, 2.0, LINES))
    one, again = build(jax.random.key(0), LEVEL), build(jax.random.key(0), LEVEL)
    np.testing.assert_array_equal(one, again)
    np.testing.assert_allclose(build(jax.random.key(0), 4 * LEVEL), 2 * one, rtol=1e-12)
    assert not np.allclose(one, build(jax.random.key(1), LEVEL))
    slope = jax.grad(lambda level: jnp.sum(build(jax.random.key(0), level) ** 2))(LEVEL)
    assert float(slope) == pytest.approx(float(jnp.sum(one**2)) / LEVEL, rel=1e-9)


@pytest.mark.usefixtures("float32")
def test_single_precision_roads_have_the_variance_of_the_band():
    tracks = isotropic_tracks(jax.random.key(2), 200.0, 0.05, LEVEL, 2.0, LINES, (0.05, 5.0))
    assert tracks.dtype == jnp.float32
    n = np.arange(10, 1001) / 200.0
    expected = np.sum(displacement_psd_cycles(n, LEVEL)) / 200.0
    assert np.var(np.asarray(tracks), axis=1) == pytest.approx(expected, rel=0.6)


def test_a_road_without_a_wave_is_refused():
    with pytest.raises(InputError, match=r"length: 0\.05 m at a spacing of 0\.1 m"):
        isotropic_tracks(jax.random.key(0), 0.05, 0.1, LEVEL, 2.0, LINES)


def test_welch_coherence_of_one_long_road_follows_the_squared_law():
    """As an engineer would measure it: magnitude-squared coherence of a 6 km recording."""
    spacing, segment = 0.1, 1000
    road = prepare_isotropic(6000.0, spacing, 2.0, LINES)
    left, right = np.asarray(draw_many(road, LEVEL, 1))[0, :2]
    options = {"fs": 1 / spacing, "nperseg": segment}
    n, cross = csd(left, right, **options)
    measured = np.abs(cross) ** 2 / (welch(left, **options)[1] * welch(right, **options)[1])
    used = (n > 0.03) & (n < 1.0)
    law = two_track_coherence(n[used], LINES[0] - LINES[1]) ** 2
    averages = 2 * 60 * 18 / 19
    spread = np.sqrt(2 * law / averages) * (1 - law) + 1 / averages
    assert np.all(np.abs(measured[used] - law) < 5 * spread)
