"""Figures of the roads: labels with units, and what they draw is the data."""

import numpy as np
import pytest

from wheelhop.plots.brancati_road import Indices, RoadLine, plot_measured_road, plot_road_classes
from wheelhop.vehicle.road import Profile, fit_iso8608, profile_psd


def line(name, level, nearest):
    wave = np.geomspace(0.1, 60, 50)
    return RoadLine(name, wave, 1.1 * level / wave**2, level / wave**2, nearest)


def test_classes_are_level_strips_with_the_roads_between_them(tmp_path):
    panels = {
        "as ISO 8608": [line("A", 1e-6, "A"), line("B", 4e-6, "B")],
        "as printed": [line("A", 0.3e-6, "A"), line("B", 1.3e-6, "A")],
    }
    indices = {
        "right": [Indices("A", np.array([2.0, 2.4]), 2.17), Indices("B", np.array([4.0, 4.4]), 4.3)]
    }
    figure = plot_road_classes(panels, indices, (0.5, 15.0), "Random roads")
    figure.savefig(tmp_path / "roads.png", dpi=40)
    left, right, below = figure.axes
    assert left.get_ylabel().endswith("[m³/rad]")
    assert right.get_xlabel() == "wavenumber Ω [rad/m]"
    assert below.get_ylabel() == "IRI [m/km]"
    assert "made as B, is A" in [t.get_text() for t in right.texts]
    drawn = [np.asarray(artist.get_ydata(), float) for artist in right.lines]
    roads = [y for y in drawn if len(y) == 50 and np.allclose(y, 1.1 * 1.3e-6)]
    assert len(roads) == 1
    assert {"2.2", "4.2", "2.17", "4.3"} <= {t.get_text() for t in below.texts}
    assert [t.get_text() for t in below.get_xticklabels()] == ["class A", "class B"]


def test_measured_road_lies_between_the_class_lines_above_its_profile(tmp_path):
    z = 5.0 + 1e-3 * np.cumsum(np.random.default_rng(0).normal(size=2000))
    profile = Profile(0.25, z)
    spectrum = profile_psd(profile)
    fit = fit_iso8608(spectrum)
    wave, density = 2 * np.pi * spectrum.frequency, spectrum.density / (2 * np.pi)
    figure = plot_measured_road(profile, wave, density, fit, "Measured road")
    figure.savefig(tmp_path / "road.png", dpi=40)
    top, bottom = figure.axes
    labels = {artist.get_label(): artist for artist in top.lines}
    (fitted,) = (a for name, a in labels.items() if name.startswith("fit: "))
    x, y = fitted.get_data()
    assert np.log(y[1] / y[0]) / np.log(x[1] / x[0]) == pytest.approx(-fit.waviness)
    assert f"waviness {fit.waviness:.2f}" in fitted.get_label()
    np.testing.assert_allclose(labels["measured road"].get_ydata(), density)
    # third octaves of the same density lie on the measured curve's level
    octaves = labels["third octaves"].get_data()
    near = np.interp(octaves[0], wave, density)
    assert np.median(np.abs(np.log(octaves[1] / near))) < 1.0
    assert [t.get_text() for t in top.texts] == list("ABCDEFGH")
    assert top.get_ylabel() == "displacement PSD [m³/rad]"
    assert bottom.get_xlabel() == "distance [m]"
    assert bottom.lines[0].get_ydata()[0] == 0.0
    np.testing.assert_allclose(bottom.lines[0].get_ydata(), z - z[0])
