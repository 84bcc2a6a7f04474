"""Roads of Eq. 5-7 and Fig. 12 against closed forms, NumPy and published roughness."""

import math
from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest
from scipy.integrate import quad
from scipy.signal import lfilter

from wheelhop.errors import InputError
from wheelhop.io.results import write_table
from wheelhop.studies.brancati.measured_road import fit_intervals, measured_road
from wheelhop.studies.brancati.road_rules import (
    RoadSettings,
    folded_psd,
    noise_readings,
    sampling_rules,
    validate_roads,
)
from wheelhop.studies.brancati.road_statistics import (
    degrees_of_freedom,
    line_iri,
    roughness_indices,
)
from wheelhop.studies.brancati.roads import FILTER, PLANT, road_study
from wheelhop.vehicle.road import Profile, fit_iso8608, iri, profile_psd

ALPHA = 0.127
SETTINGS = RoadSettings(classes=("B", "C"), roads=16, length=200.0, dt=3e-3)
TOO_SMOOTH = 10 * math.log10(8 * ALPHA / (math.pi * (1 + ALPHA**2)))


def equation_5(wave, variance):
    """Eq. 5 in space, W = w / v."""
    return 2 * ALPHA * variance / math.pi / (ALPHA**2 + wave**2)


@pytest.fixture(scope="module")
def study():
    said = []
    found = road_study(SETTINGS, lambda k, n: said.append((k, n)))
    assert said == [(k, 8) for k in range(1, 9)]
    return found


def test_printed_variance_is_five_decibels_too_smooth(study):
    assert pytest.approx(-4.9720, abs=1e-4) == TOO_SMOOTH
    for source in (FILTER, PLANT):
        for name, level, nearest in (("B", 4e-6, "A"), ("C", 16e-6, "B")):
            right, printed = (study.of(name, c, source) for c in ("iso8608", "brancati2022"))
            assert right.reference_law == pytest.approx(level, rel=1e-9)
            assert printed.reference_law == pytest.approx(level * 10 ** (TOO_SMOOTH / 10), rel=1e-9)
            assert (right.nearest, printed.nearest) == (name, nearest)
            step = printed.class_error.value - right.class_error.value
            assert step == pytest.approx(TOO_SMOOTH, abs=1e-9)
            np.testing.assert_allclose(printed.iri / right.iri, 10 ** (TOO_SMOOTH / 20), rtol=1e-9)


def test_roads_have_the_spectrum_and_variance_of_equation_5(study):
    """Within four standard errors of the chi-square, the folding of the samples included."""
    for r in study.roads:
        low, high = r.law_error.low, r.law_error.high
        assert abs(r.law_error.value) < 2 * 0.5 * (high - low)
        assert 0.6 * r.reference_law < r.reference.low < r.reference.value < r.reference.high
        assert r.iri.shape == (16,)
        if r.source == PLANT:
            continue
        variance = {"iso8608": math.pi * (1 + ALPHA**2) / (2 * ALPHA), "brancati2022": 4.0}
        variance = variance[r.convention] * {"B": 4e-6, "C": 16e-6}[r.road_class]
        assert r.law_variance == pytest.approx(variance, rel=1e-12)
        np.testing.assert_allclose(r.law, equation_5(r.wavenumber, variance), rtol=1e-12)
        spread = math.sqrt(2 / (ALPHA * SETTINGS.length * SETTINGS.roads))
        assert r.variance == pytest.approx(variance, rel=4 * spread)


def test_folded_spectrum_is_the_sum_over_all_aliases():
    spacing = 0.05
    wave = np.array([0.3, 3.0, 20.0, 62.8])
    fold = 2 * math.pi / spacing * np.arange(-20_000, 20_001)
    expected = equation_5(wave[:, None] + fold, 3e-5).sum(axis=1)
    np.testing.assert_allclose(folded_psd(wave, 3e-5, spacing), expected, rtol=1e-4)


def test_the_papers_rules_of_length_and_sampling():
    rules = sampling_rules(replace(SETTINGS, speed=20.0, dt=2.5e-3)).columns
    np.testing.assert_allclose(rules["limit"], [100.0, 2.5e-3])
    assert rules["kept"].all()
    # a spectrum ~ 1 / W^2 is folded up to (pi / 2)^2 at half the sampling rate
    assert rules["cost_at_limit"][1] == pytest.approx(20 * math.log10(math.pi / 2), abs=1e-3)
    lag = np.arange(-200.0, 200.0, 1e-3)
    spread = math.sqrt(2 / 200.0 * np.exp(-2 * ALPHA * abs(lag)).sum() * 1e-3)
    assert rules["cost_here"][0] == pytest.approx(spread, rel=1e-3)


def test_printed_noise_against_the_variance_that_it_gives():
    """White noise through Eq. 6, its output's density integrated in each reading of the unit."""
    table = noise_readings().columns
    speed, variance = 20.0, 5e-5
    corner = ALPHA * speed
    printed = 2 * math.pi * corner * variance
    radians = quad(lambda w: printed / (corner**2 + w**2), 0, np.inf)[0]
    hertz = quad(lambda f: printed / (corner**2 + (2 * math.pi * f) ** 2), 0, np.inf)[0]
    factor = np.array([radians, hertz, 2 * hertz]) / variance
    np.testing.assert_allclose(table["factor"], factor, rtol=1e-7)
    np.testing.assert_allclose(table["error"], 10 * np.log10(factor), atol=1e-6)
    np.testing.assert_allclose(table["level"], 10 * np.log10(factor) + TOO_SMOOTH, atol=1e-6)
    assert table["level"][2] == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize(("level", "figure"), [(1e-6, 2.17), (4e-6, 4.35), (64e-6, 17.3)])
def test_roughness_of_the_class_lines(level, figure):
    assert line_iri(level) == pytest.approx(figure, rel=0.005)


def test_roads_are_as_rough_as_their_class_line(study):
    for name, figure in (("B", 4.35), ("C", 8.65)):
        for source in (FILTER, PLANT):
            r = study.of(name, "iso8608", source)
            error = r.iri.std(ddof=1) / math.sqrt(SETTINGS.roads)
            assert r.iri.mean() == pytest.approx(figure, abs=4 * error + 0.02 * figure)


@pytest.mark.parametrize("spacing", [0.025, 1 / 30, 0.25])
def test_roughness_of_many_roads_is_that_of_each(spacing):
    z = np.cumsum(np.random.default_rng(0).normal(size=(3, 600)), axis=1) * 1e-3
    expected = [iri(Profile(spacing, row)) for row in z]
    np.testing.assert_allclose(roughness_indices(z, spacing), expected, rtol=1e-9)


def test_stated_uncertainty_is_the_scatter_of_independent_roads():
    spacing, roads, points = 0.1, 200, 3000
    a = math.exp(-ALPHA * spacing)
    normal = np.random.default_rng(1).normal(size=(roads, points))
    z = lfilter([math.sqrt(1 - a * a)], [1.0, -a], normal, axis=1)
    levels = []
    for row in z:
        s = profile_psd(Profile(spacing, row))
        wave = 2 * math.pi * s.frequency
        inside = (wave > 1.0) & (wave < 4.0)
        levels.append(np.mean((s.density / folded_psd(wave, 1.0, spacing))[inside]))
    expected = math.sqrt(2 / degrees_of_freedom(3.0, points * spacing))
    assert np.std(levels) / np.mean(levels) == pytest.approx(expected, rel=0.2)


def test_a_seed_fixes_the_roads_and_classes_have_their_own(study):
    small = replace(SETTINGS, classes=("C",), conventions=("iso8608",))
    again = road_study(small)
    for source in (FILTER, PLANT):
        np.testing.assert_array_equal(
            again.of("C", "iso8608", source).density, study.of("C", "iso8608", source).density
        )
        ratio = study.of("C", "iso8608", source).iri / study.of("B", "iso8608", source).iri
        assert ratio.std() > 0.01
    with pytest.raises(InputError, match="the study has none of"):
        again.of("C", "brancati2022")


def test_tables_are_flat_and_carry_their_units(study, tmp_path):
    tables = study.tables()
    assert set(tables) == {"spectra", "levels", "sampling", "noise"}
    for name, table in tables.items():
        assert len({len(c) for c in table.columns.values()}) == 1
        assert set(table.units) <= set(table.columns)
        back = pq.read_table(write_table(tmp_path / f"{name}.parquet", *table))
        assert back.num_rows == len(next(iter(table.columns.values())))
    levels = pq.read_table(tmp_path / "levels.parquet")
    assert levels.schema.field("iri").metadata == {b"unit": b"m/km"}
    assert levels.column("nearest").to_pylist() == [r.nearest for r in study.roads]
    spectra = tables["spectra"].columns
    np.testing.assert_allclose(
        spectra["class_line"][spectra["road_class"] == "C"],
        16e-6 / spectra["wavenumber"][spectra["road_class"] == "C"] ** 2,
    )


def test_panels_name_the_convention_and_its_level(study):
    first, second = study.panels
    assert first.startswith("iso8608: +0.")
    assert second.startswith("brancati2022: -4.")
    assert [line.nearest for line in study.panels[second]] == ["A", "B"]
    assert list(study.indices) == [
        f"{c}, {s}" for c in ("iso8608", "brancati2022") for s in (FILTER, PLANT)
    ]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"classes": ("A", "Z")}, "'Z' is no class"),
        ({"classes": ("AB",)}, "'AB' is no class"),
        ({"classes": ()}, "no class or convention"),
        ({"conventions": ("mine",)}, "'mine' is unknown"),
        ({"roads": 1}, "roads: 1 roads is outside"),
        ({"length": 99.0}, "length: 99 m is outside 100"),
        ({"dt": 3.1e-3}, "dt: 0.0031 s is outside"),
        ({"speed": 0.0}, "speed: 0 m/s is outside"),
        ({"band": (5.0, 5.0)}, "5 to 5 rad/m is no band"),
        ({"band": (0.5, 100.0)}, "0.5 to 100 rad/m is no band"),
    ],
)
def test_settings_out_of_range_are_named(changes, message):
    with pytest.raises(InputError, match=message):
        validate_roads(replace(SETTINGS, **changes))


def test_the_papers_measured_road(data):
    folder = data / "roads" / "michalsorel_iri"
    road = measured_road(folder / "profile_1.txt")
    golden = np.loadtxt(folder / "golden_iri_20m_method2_nofilter.txt")
    assert golden.shape[0] == len(road.iri_segments) == 27
    np.testing.assert_allclose(road.iri_segments, golden[:, 2], atol=3e-4)
    assert road.iri_segments.mean() == pytest.approx(3.3090, abs=5e-4)
    assert (road.fit.iso_class, road.iri_class) == ("B", "B")
    # the line of waviness 2 that has this index, by the published index of class A
    assert road.iri_level == pytest.approx(1e-6 * (3.3090 / 2.17) ** 2, rel=0.01)
    assert road.waviness.low > 2.0
    tables = road.tables()
    assert tables["profile"].columns["distance"][-1] == pytest.approx(544.0)
    for table in tables.values():
        assert len({len(c) for c in table.columns.values()}) == 1
        assert set(table.units) <= set(table.columns)


def iso_road(rng, level, points=2000, spacing=0.25):
    """A Gaussian road of 500 m with Gd(W) = level W^-2 by NumPy, cut out of one twice as long."""
    wave = 2 * math.pi * np.fft.rfftfreq(2 * points, spacing)
    step = wave[1]
    wave[0] = np.inf
    normal = rng.normal(size=(2, len(wave)))
    amplitude = 0.5 * np.sqrt(level / wave**2 * step) * (normal[0] - 1j * normal[1])
    return 2 * points * np.fft.irfft(amplitude)[:points]


def test_a_road_of_known_spectrum_is_read_back(tmp_path):
    """Level and waviness, their stated intervals against the scatter of independent roads."""
    levels, slopes, stated = [], [], []
    for k in range(60):
        profile = Profile(0.25, iso_road(np.random.default_rng(k), 8e-6))
        level, waviness = fit_intervals(fit_iso8608(profile_psd(profile)), profile.length)
        levels.append(math.log(level.value))
        slopes.append(waviness.value)
        stated.append((math.log(level.high / level.low) / 4, (waviness.high - waviness.low) / 4))
    assert np.mean(levels) == pytest.approx(math.log(8e-6), abs=0.1)
    assert np.mean(slopes) == pytest.approx(2.0, abs=0.1)
    scatter = np.array([np.std(levels), np.std(slopes)])
    np.testing.assert_allclose(np.mean(stated, axis=0), scatter, rtol=0.35)

    file = tmp_path / "road.csv"
    rows = np.column_stack([profile.distance, profile.elevation])
    np.savetxt(file, rows, delimiter=",", header="x_m,z_m", comments="")
    road = measured_road(file)
    assert road.name == "z_m"
    assert road.level.value == pytest.approx(math.exp(levels[-1]), rel=1e-6)
    spectrum = road.tables()["spectrum"].columns
    total = np.trapezoid(spectrum["density"], spectrum["wavenumber"])
    assert total == pytest.approx(np.trapezoid(*reversed(_per_cycle(profile))), rel=1e-6)


def _per_cycle(profile):
    s = profile_psd(profile)
    return s.frequency, s.density


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("one two\n", "no table of numbers"),
        ("0 0 0\n1 0 0\n", "it has 3 columns"),
        ("\n".join(f"{0.1 * k} {0.001 * math.sin(k)}" for k in range(180)), "20 m"),
    ],
)
def test_a_file_that_is_no_road_is_told(tmp_path, text, message):
    file = tmp_path / "road.txt"
    file.write_text(text)
    with pytest.raises(InputError, match=message):
        measured_road(file)


def test_a_missing_file_is_told(tmp_path):
    with pytest.raises(InputError, match="none"):
        measured_road(tmp_path / "none.txt")
