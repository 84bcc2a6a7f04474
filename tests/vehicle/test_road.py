"""Roads against ISO 8608 lines, closed-form variances and the golden car's own solution."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov
from scipy.stats import chi2, kstest

from wheelhop.errors import InputError, InputWarning
from wheelhop.vehicle.road import (
    CLASSES,
    Profile,
    class_level,
    class_of_level,
    displacement_psd,
    displacement_psd_cycles,
    elevation_at,
    elevations,
    fit_iso8608,
    iri,
    iri_segments,
    profile_from_samples,
    profile_psd,
    resample,
    road_velocity_intensity,
    shape_filter_psd,
    stationary_variance,
    synthesise,
)
from wheelhop.vehicle.road.roughness_index import SPEED, golden_car
from wheelhop.vehicle.road.shape_filter import CUTOFF

REALISATIONS = 64


def test_class_centres_and_bounds():
    assert [class_level(c) for c in "ABCD"] == pytest.approx([1e-6, 4e-6, 16e-6, 64e-6])
    for c in CLASSES:
        assert class_of_level(class_level(c)) == c
        assert class_of_level(1.99 * class_level(c)) == c
        assert class_of_level(0.51 * class_level(c)) == c
    assert class_of_level(1e-9) == "A"
    assert class_of_level(1.0) == "H"


def test_centres_agree_with_the_standard_in_cycles():
    """ISO 8608 quotes 16e-6 m^3 at 0.1 cycles/m for class A; rounded, within 1 %."""
    for k, c in enumerate("ABCD"):
        density = displacement_psd_cycles(0.1, class_level(c))
        assert density == pytest.approx(16e-6 * 4**k, rel=0.01)


@pytest.mark.parametrize("bad", ["Z", "AB", "", "1"])
def test_unknown_class_is_told(bad):
    with pytest.raises(InputError, match="Use one of A to H"):
        class_level(bad)


@pytest.mark.parametrize("waviness", [1.6, 2.0, 2.6])
def test_synthesised_psd_is_the_class_line_within_its_statistical_error(waviness):
    """Periodogram over line is chi-square(2) / 2 at every frequency of every realisation."""
    length, spacing, level = 200.0, 0.05, class_level("B")
    keys = jax.random.split(jax.random.key(8), REALISATIONS)
    z = np.asarray(jax.vmap(lambda k: synthesise(k, length, spacing, level, waviness))(keys))
    n = np.fft.rfftfreq(z.shape[1], spacing)[2:-1]
    density = 2 * spacing / z.shape[1] * np.abs(np.fft.rfft(z, axis=1)[:, 2:-1]) ** 2
    # written out apart from the package: Gd(n) = Gd(W0) (2 pi n)^-w 2 pi
    ratio = density / (level * (2 * np.pi * n) ** -waviness * 2 * np.pi)
    inside = (n > 0.0101) & (n < 9.99)
    mean = ratio[:, inside].mean(axis=0)
    low, high = chi2.ppf([1e-6, 1 - 1e-6], 2 * REALISATIONS) / (2 * REALISATIONS)
    assert np.all((mean > low) & (mean < high))
    assert mean.mean() == pytest.approx(1.0, abs=4 / math.sqrt(REALISATIONS * inside.sum()))
    assert kstest(2 * ratio[:, inside].ravel()[::7], "chi2", args=(2,)).pvalue > 1e-3


def test_synthesis_refuses_a_road_without_waves():
    with pytest.raises(InputError, match="holds no wave"):
        synthesise(jax.random.key(0), 0.1, 0.05, 1e-6)


@pytest.mark.parametrize("convention", ["iso8608", "brancati2022"])
def test_shape_filter_has_its_variance_and_correlation(convention):
    level, step, count = class_level("C"), 0.5, 40
    variance = stationary_variance(level, convention)
    keys = jax.random.split(jax.random.key(1), 4000)
    travel = jnp.full((count,), step)
    z = np.asarray(jax.vmap(lambda k: elevations(k, variance, travel))(keys))
    found = z.var(axis=0)
    assert np.all(np.abs(found / variance - 1) < 5 * math.sqrt(2 / 4000))
    lag = 6
    correlation = (z[:, 0] * z[:, lag]).mean() / variance
    assert correlation == pytest.approx(math.exp(-CUTOFF * lag * step), abs=5 / math.sqrt(4000))


def test_conventions_differ_by_pi_and_unknown_ones_are_told():
    ratio = stationary_variance(1.0) / stationary_variance(1.0, "brancati2022")
    assert ratio == pytest.approx(math.pi, rel=0.002)
    with pytest.raises(InputError, match="'iso' is unknown"):
        stationary_variance(1.0, "iso")


def test_iso_convention_passes_through_the_level_at_the_reference():
    level = class_level("B")
    assert shape_filter_psd(1.0, stationary_variance(level)) == pytest.approx(level)
    assert displacement_psd(1.0, level) == pytest.approx(level)


def test_variance_is_the_integral_of_the_spectrum():
    variance = stationary_variance(class_level("B"))
    w = np.linspace(0, 2000, 4_000_001)
    integral = np.trapezoid(shape_filter_psd(w, variance), w)
    assert integral == pytest.approx(variance, rel=1e-3)


def test_shape_filter_spectrum_lies_on_its_line_in_64_realisations():
    spacing, count, level = 0.1, 4096, class_level("B")
    variance = stationary_variance(level)
    keys = jax.random.split(jax.random.key(5), REALISATIONS)
    z = np.asarray(
        jax.vmap(lambda k: elevations(k, variance, jnp.full((count - 1,), spacing)))(keys)
    )
    # sampled first-order process: closed-form one-sided spectrum per cycle, aliases included
    n = np.fft.rfftfreq(count, spacing)[4:400]
    a = math.exp(-CUTOFF * spacing)
    line = (
        2 * spacing * variance * (1 - a * a) / (1 - 2 * a * np.cos(2 * np.pi * n * spacing) + a * a)
    )
    window = np.hanning(count)
    density = np.abs(np.fft.rfft(window * z, axis=1)[:, 4:400]) ** 2
    density *= 2 * spacing / np.sum(window**2)
    ratio = density.mean(axis=0) / line
    assert ratio.mean() == pytest.approx(1.0, abs=0.02)
    assert np.all(np.abs(ratio - 1) < 6 / math.sqrt(REALISATIONS))


def test_road_velocity_is_white_with_the_stated_intensity():
    """Variance of the elevation's rise over short steps is q dt."""
    level, speed, dt = class_level("B"), 20.0, 1e-3
    travel = jnp.full((200_000,), speed * dt)
    z = np.asarray(elevations(jax.random.key(2), stationary_variance(level), travel))
    q = road_velocity_intensity(level, speed)
    assert np.var(np.diff(z)) == pytest.approx(q * dt * (1 + CUTOFF**2), rel=0.015)


def exact_iri(level, smoothed):
    """IRI of a w = 2 line in closed form: the mean of a Gaussian's modulus.

    Its variance is the integral of |H|^2 over the slope's white spectrum, times sinc^2 for the
    250 mm moving average.
    """
    a, b = golden_car()
    n = np.geomspace(1e-3, 100, 20_000)
    omega = 2 * np.pi * n * SPEED
    response = np.linalg.solve(1j * omega[:, None, None] * np.eye(4) - a, b[None, :, None])
    gain = np.abs(response[:, 0, 0] - response[:, 2, 0]) ** 2
    if smoothed:
        gain *= np.sinc(0.25 * n) ** 2
    return 1e3 * math.sqrt(2 / math.pi * np.trapezoid(gain * level, 2 * np.pi * n))


def test_closed_form_roughness_index_equals_the_lyapunov_equation():
    a, b = golden_car()
    cov = solve_continuous_lyapunov(a, -math.pi * 1e-6 * SPEED * np.outer(b, b))
    c = np.array([1.0, 0.0, -1.0, 0.0])
    expected = 1e3 * math.sqrt(2 / math.pi * (c @ cov @ c)) / SPEED
    assert exact_iri(1e-6, smoothed=False) == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize(
    ("name", "figure"), [("A", 2.17), ("B", 4.35), ("C", 8.65), ("D", 17.3), ("E", 34.8)]
)
def test_roughness_index_of_the_class_lines(name, figure):
    expected = exact_iri(class_level(name), smoothed=True)
    assert expected == pytest.approx(figure, rel=0.005)
    z = synthesise(jax.random.key(4), 20_000.0, 0.05, class_level(name), band=(1e-3, 10.0))
    assert iri(Profile(0.05, np.asarray(z))) == pytest.approx(expected, rel=0.02)


def read_csv(path):
    return np.loadtxt(path, delimiter=",", skiprows=3)


def test_roughness_index_of_the_lidar_road_equals_the_published_program(data):
    rows = read_csv(data / "roads" / "normalized" / "lidar_czech_B.csv")
    golden = np.loadtxt(data / "roads" / "michalsorel_iri" / "golden_iri_20m_method2_nofilter.txt")
    segments = iri_segments(profile_from_samples(rows[:, 0], rows[:, 1]), 20.0, False)
    np.testing.assert_allclose(segments, golden[:, 2], atol=3e-4)
    np.testing.assert_allclose(segments[5:], golden[5:, 2], atol=1e-8)
    assert segments.mean() == pytest.approx(3.3090, abs=5e-4)


def test_roughness_index_needs_a_lead_in():
    with pytest.raises(InputError, match="at least 11 m"):
        iri(Profile(0.1, np.zeros(50)))


@pytest.mark.parametrize(("name", "waviness"), [("A", 2.0), ("C", 2.0), ("D", 1.7), ("B", 2.5)])
def test_fit_recovers_level_and_waviness(name, waviness):
    z = synthesise(jax.random.key(3), 4000.0, 0.1, class_level(name), waviness, (1e-3, 5.0))
    fit = fit_iso8608(profile_psd(Profile(0.1, np.asarray(z))))
    assert fit.waviness == pytest.approx(waviness, abs=0.06)
    assert fit.level == pytest.approx(class_level(name), rel=0.12)
    if waviness == 2.0:
        assert fit.iso_class == name


def test_a_road_too_short_to_fit_is_told():
    rng = np.random.default_rng(0)
    with pytest.raises(InputError, match="third-octave bands"):
        fit_iso8608(profile_psd(Profile(0.5, rng.normal(size=12))))


def test_resampling_keeps_slow_waves_and_removes_what_would_alias():
    x = 0.01 * np.arange(20_001)
    slow, fast = 0.02 * np.sin(2 * np.pi * 0.3 * x), 0.02 * np.sin(2 * np.pi * 7.0 * x)
    coarse = resample(Profile(0.01, slow + fast), 0.1)
    inner = slice(200, -200)
    expected = 0.02 * np.sin(2 * np.pi * 0.3 * coarse.distance)
    assert np.max(np.abs(coarse.elevation - expected)[inner]) < 2e-5
    without = Profile(0.1, (slow + fast)[::10])
    assert np.max(np.abs(without.elevation - expected)[inner]) > 0.015


def test_resampling_finer_goes_through_the_points():
    rng = np.random.default_rng(1)
    profile = Profile(0.25, np.cumsum(rng.normal(size=200)) * 1e-3)
    fine = resample(profile, 0.05)
    np.testing.assert_allclose(fine.elevation[::5], profile.elevation, atol=1e-12)


def test_reflected_continuation_goes_there_and_back():
    profile = Profile(0.5, np.arange(9.0) ** 2 * 1e-3)
    found = elevation_at(profile, np.array([3.0, 5.0, 8.0, 11.0]), reflect=True)
    expected = elevation_at(profile, np.array([3.0, 3.0, 0.0, 3.0]))
    np.testing.assert_allclose(found, expected, atol=1e-12)
    with pytest.raises(InputError, match="beyond the road"):
        elevation_at(profile, np.array([4.5]))


def test_irregular_profiles_are_interpolated_with_a_warning():
    x = np.cumsum(np.random.default_rng(0).uniform(0.2, 0.3, 400))
    with pytest.warns(InputWarning, match="spacing varies"):
        profile = profile_from_samples(x, np.sin(x))
    np.testing.assert_allclose(
        profile.elevation[5:-5], np.sin(x[0] + profile.distance)[5:-5], atol=1e-4
    )


@pytest.mark.parametrize(
    ("x", "z", "message"),
    [
        ([0, 1, 2], [0, 0, 0], "3 points"),
        ([0, 1, 2, 3, 3, 5, 6, 7], [0.0] * 8, "from 3 to 3 m at row 5"),
        ([0, 1, 2, 3, 4, 5, 6, 7], [0, 0, np.nan, 0, 0, 0, 0, 0], "z_m: row 3 of the data"),
    ],
)
def test_unusable_profiles_are_told(x, z, message):
    with pytest.raises(InputError, match=message):
        profile_from_samples(np.array(x, float), np.array(z, float))
