"""The study of Table 3: what it finds of a known corner, of the full vehicle, and what it keeps."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from wheelhop.errors import DivergenceError, InputError
from wheelhop.plots.table3 import plot_norms, plot_overlay
from wheelhop.studies.brancati import records as brancati_records
from wheelhop.studies.brancati.identification import (
    ALL,
    MORE,
    QUICK,
    StudySettings,
    identification_study,
    plant_damping,
    reading_of,
    validate_study,
)
from wheelhop.studies.brancati.records import (
    DriveSettings,
    drive_classes,
    drive_scenario,
    scenarios_of,
    stored_drives,
)
from wheelhop.studies.corner_errors import errors_of, unsprung_acceleration
from wheelhop.vehicle.corner_modes import corner_modes
from wheelhop.vehicle.parameters import BRANCATI_TABLE_3, brancati_suv, with_suspension
from wheelhop.vehicle.record import CornerRecord
from wheelhop.vehicle.suspension import Suspension

TRUE = Suspension(41e3, 2e6, 2100.0, 900.0)
M_S, M_U = 466.6773, 61.14
LEVEL = 4e-6


def corner(elevation, pressure, s=TRUE, dt=1e-3):
    """Accelerations [time, 2] and suspension velocity of a quarter car by NumPy's own RK4.

    Between the samples the road is a cubic spline.
    """
    road = CubicSpline(dt * np.arange(len(elevation) + 1), [elevation[0], *elevation])
    k_t = 264.7e3 * (1 + 0.7 * (pressure - 250e3) / 250e3)

    def forces(x):
        d, e, v_s, v_u = x
        w = v_s - v_u
        f = s.stiffness * d + s.cubic_stiffness * d**3
        f += s.damping * w + s.quadratic_damping * w * abs(w)
        return -f / M_S, (f - k_t * e) / M_U

    velocity = road(0.5 * dt * np.arange(2 * len(elevation) + 1), 1)

    def slope(x, k):
        return np.array([x[2] - x[3], x[3] - velocity[k], *forces(x)])

    x, rows = np.zeros(4), []
    for k in range(0, 2 * len(elevation), 2):
        k1 = slope(x, k)
        k2 = slope(x + dt / 2 * k1, k + 1)
        k3 = slope(x + dt / 2 * k2, k + 1)
        x = x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + slope(x + dt * k3, k + 2))
        rows.append((*forces(x), x[2] - x[3]))
    return np.array(rows)


def record(scenario, duration=4.0):
    rng = np.random.default_rng(round(scenario.pressure))
    n = round(1e3 * duration)
    velocity = np.sqrt(np.pi * LEVEL * scenario.speed * 1e3) * rng.normal(size=n)
    elevation = 1e-3 * np.cumsum(velocity)
    a = corner(elevation, scenario.pressure)
    full = np.full(n, 1.0)
    t = 1e-3 * np.arange(1, n + 1)
    return CornerRecord(
        t, a[:, 0], a[:, 1], scenario.speed * full, scenario.pressure * full, elevation
    )


@pytest.fixture(scope="module")
def known():
    """Records of a corner whose parameters are known, and the study of them."""
    records = {"B": tuple(record(s) for s in scenarios_of(QUICK.drives, "B"))}
    return records, identification_study(QUICK, records)


def test_a_known_corner_is_found_again(known):
    _, study = known
    found = study.cars["ours B"].suspension
    for name in ("damping", "quadratic_damping", "stiffness", "cubic_stiffness"):
        assert getattr(found, name) == pytest.approx(getattr(TRUE, name), rel=2e-3)
    assert study.norm("ours B", "B") < 1e-3 * study.measured_norm("B")


def test_every_set_is_judged_as_the_fit_judges_itself(known):
    _, study = known
    fit = study.fits["ours B"]
    rmse = dict(zip(study.cars, study.errors.rmse, strict=True))
    np.testing.assert_allclose(rmse["start"], fit.start_rmse, rtol=1e-6)
    np.testing.assert_allclose(rmse["ours B"], fit.rmse, rtol=1e-6, atol=1e-6)
    assert list(study.cars) == ["start", "paper B", "ours B"]
    assert study.norm("start", "B") == pytest.approx(np.linalg.norm(fit.start_rmse))


def test_the_printed_set_is_judged_with_the_signed_law_on_the_same_roads(known):
    """Its errors by a simulation in NumPy."""
    records, study = known
    expected = []
    for r, s in zip(records["B"], study.scenarios, strict=True):
        a = corner(r.elevation, s.pressure, BRANCATI_TABLE_3["B"])
        judged = r.t - r.t[0] >= 1.0
        difference = (a[:, :2] - np.stack([r.a_s, r.a_u], 1))[judged]
        rms = np.sqrt(np.mean(a[judged, 2] ** 2))
        expected.append((*np.sqrt(np.mean(difference**2, axis=0)), rms))
    k = list(study.cars).index("paper B")
    found = np.column_stack([study.errors.rmse[k], study.errors.velocity_rms[k]])
    np.testing.assert_allclose(found, expected, rtol=1e-4)


def test_the_overlay_shows_the_model_that_was_judged(known):
    records, study = known
    r = records["B"][0]
    series = unsprung_acceleration(study.cars["paper B"], r)
    judged = r.t - r.t[0] >= 1.0
    rmse = np.sqrt(np.mean((series - r.a_u)[judged] ** 2))
    assert rmse == pytest.approx(study.errors.rmse[1, 0, 1], rel=1e-6)


def test_the_printed_class_d_set_is_no_car():
    paper = reading_of(with_suspension(brancati_suv(), BRANCATI_TABLE_3["D"]), 0.2)
    ours = reading_of(brancati_suv(), 0.2)
    assert paper.ratio.wheel > 1 > 0.5 > ours.ratio.wheel
    assert paper.damping == pytest.approx(14708 + 4555 * math.sqrt(8 / math.pi) * 0.2)
    assert paper.modes == corner_modes(
        with_suspension(brancati_suv(), BRANCATI_TABLE_3["D"]), 180e3, 0.2
    )


def test_the_vehicles_damper_is_linearised_as_gaussian_motion_sees_it():
    w = 0.3 * np.random.default_rng(0).normal(size=400_000)
    force = 2800.0 * w * (1 - 0.4 * np.tanh(w / 0.1)) / (1 + np.abs(w))
    assert plant_damping(0.3) == pytest.approx(float(w @ force / (w @ w)), rel=3e-3)


@pytest.mark.slow
def test_the_full_vehicles_corner_looks_like_its_own_spring_and_damper(tmp_path):
    """The damper's linearised slope, and the spring plus a part of the anti-roll bar."""
    records = drive_classes(QUICK.drives, ("B",), tmp_path)
    assert stored_drives(tmp_path, QUICK.drives, ("B",)) == 3
    study = identification_study(QUICK, records)
    found = study.cars["ours B"].suspension
    assert found.damping == pytest.approx(
        plant_damping(study.readings["ours B"].velocity_rms), rel=0.07
    )
    assert 33.6e3 < found.stiffness < 33.6e3 + 2 * 15e3
    assert study.norm("ours B", "B") < 0.25 * study.measured_norm("B")
    assert study.norm("ours B", "B") < 0.5 * study.norm("paper B", "B")


SMALL = DriveSettings(speeds=(15.0,), pressures=(130e3, 230e3), duration=4.0)


def test_finished_drives_are_kept_and_not_driven_again(tmp_path, monkeypatch):
    driven = []

    def drive(settings, scenario):
        driven.append(str(scenario))
        return record(scenario)

    monkeypatch.setattr(brancati_records, "drive_scenario", drive)
    said = []
    first = drive_classes(SMALL, ("A",), tmp_path, lambda k, n: said.append((k, n)))
    assert driven == ["class A, 54 km/h, 130 kPa", "class A, 54 km/h, 230 kPa"]
    assert said == [(1, 2), (2, 2)]
    (tmp_path / scenarios_of(SMALL, "A")[1].file).write_bytes(b"damaged")
    again = drive_classes(SMALL, ("A", "C"), tmp_path)
    assert driven[2:] == [
        "class A, 54 km/h, 230 kPa",
        "class C, 54 km/h, 130 kPa",
        "class C, 54 km/h, 230 kPa",
    ]
    for a, b in zip(first["A"], again["A"], strict=True):
        np.testing.assert_allclose(a.a_u, b.a_u, rtol=1e-12)
        np.testing.assert_allclose(a.elevation, b.elevation, rtol=1e-12)
    with pytest.raises(InputError, match=r"drives of other settings \(seed\)"):
        drive_classes(replace(SMALL, seed=1), ("A",), tmp_path)
    (tmp_path / "settings.json").write_text("{")
    with pytest.raises(InputError, match="drives of other settings"):
        stored_drives(tmp_path, SMALL, ("A",))


def test_a_drive_that_is_lost_is_named(monkeypatch):
    def lost(*args, **options):
        raise DivergenceError("rolled over at 2 s")

    monkeypatch.setattr(brancati_records, "drive_vehicle", lost)
    with pytest.raises(DivergenceError, match="class A, 60 km/h, 130 kPa: rolled over"):
        drive_scenario(QUICK.drives, scenarios_of(QUICK.drives, "A")[0])


def test_each_scenario_has_a_road_of_its_own_whatever_else_is_driven():
    key = brancati_records._key
    few, many = scenarios_of(SMALL, "A"), scenarios_of(DriveSettings(), "B")
    keys = {str(key(SMALL, s)) for s in (*few, *many)}
    assert len(keys) == len(few) + len(many)
    assert str(key(SMALL, many[0])) == str(key(DriveSettings(), many[0]))
    assert str(key(SMALL, few[0])) != str(key(replace(SMALL, seed=1), few[0]))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"classes": ("A", "E")}, "'E' is not in the paper's Table 3"),
        ({"classes": ("A", "A")}, "Give each class once"),
        ({"starts": 0}, "--starts: 0 starting points is outside"),
        ({"extended": ("suspension.colour",)}, "'suspension.colour' is unknown"),
        ({"drives": DriveSettings(duration=2.0)}, "--duration: 2 s is outside"),
        ({"drives": DriveSettings(noise=-1.0)}, "--noise: -1 m/s"),
        ({"drives": DriveSettings(speeds=())}, "speeds"),
        ({"drives": DriveSettings(pressures=(1.0,))}, "pressures: 1 Pa is outside"),
    ],
)
def test_settings_out_of_range_are_named(changes, message):
    with pytest.raises(InputError, match=message):
        validate_study(replace(StudySettings(), **changes))


@pytest.mark.slow
def test_two_classes_have_a_set_for_both_and_a_larger_one():
    settings = replace(QUICK, classes=("A", "B"), extended=StudySettings().extended)
    records = {c: tuple(record(s) for s in scenarios_of(QUICK.drives, c)) for c in "AB"}
    said = []
    study = identification_study(settings, records, lambda k, n: said.append((k, n)))
    assert list(study.fits) == ["ours A", "ours B", ALL, MORE]
    assert [k for k, _ in said] == sorted(k for k, _ in said)
    assert study.cars[MORE].sprung_mass == pytest.approx(M_S, rel=1e-2)
    assert study.errors.rmse.shape == (7, 6, 2)


def test_figures_have_units_and_show_the_numbers():
    t = 1e-3 * np.arange(4000)
    signals = {"vehicle": np.sin(9 * t), "fit": np.sin(9 * t), "paper": np.cos(9 * t)}
    figure = plot_overlay(t, {"230 kPa": signals, "130 kPa": signals}, title="wheel")
    assert [ax.get_ylabel() for ax in figure.axes] == ["wheel acceleration [m/s²]"] * 2
    shown = figure.axes[0].lines[0].get_xdata()
    assert shown[-1] - shown[0] == pytest.approx(2.0, abs=2e-3)
    figure = plot_norms("AB", {"start": [1.0, 2.0], "paper": [3.0, 4.0]}, [8.0, 9.0], "norms")
    (ax,) = figure.axes
    assert "[m/s²]" in ax.get_ylabel()
    assert [text.get_text() for text in ax.texts] == ["1", "2", "3", "4"]
    lines = {line.get_label(): line.get_ydata() for line in ax.lines}
    np.testing.assert_allclose(lines["paper"], [3.0, 4.0])


def test_errors_of_one_set_do_not_depend_on_the_others():
    records = [record(s) for s in scenarios_of(SMALL, "B")]
    cars = [brancati_suv(), with_suspension(brancati_suv(), TRUE)]
    both, one = errors_of(cars, records), errors_of(cars[1:], records)
    np.testing.assert_allclose(both.rmse[1:], one.rmse, rtol=1e-9, atol=1e-9)
