"""The full vehicle in the stiffness study: its cases, the band's model, judgements, figures."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm

from wheelhop.errors import InputError
from wheelhop.estimators import hop_band, hop_model
from wheelhop.estimators.road_model import shaping
from wheelhop.io.report import FAILS, HOLDS, IN_PART, OPEN
from wheelhop.studies.stiffness import budget, claims_vehicle, figures_vehicle
from wheelhop.studies.stiffness.frame import QUICK, StiffnessSettings
from wheelhop.studies.stiffness.full_vehicle import (
    FLEET,
    VehicleStudy,
    corners,
    pressure_error,
    true_ln_stiffness,
)
from wheelhop.studies.stiffness.vehicle_cases import (
    DISTURBANCES,
    KNOWN,
    LIDAR,
    NOMINAL,
    SYNTHETIC,
    data_directory,
    random_road,
    to_calibrate,
    to_disturb,
    to_identify,
    to_try,
)
from wheelhop.studies.stiffness.vehicle_drives import (
    Road,
    VehicleDrive,
    drive_vehicles,
    road_tracks,
    vehicle_of,
)
from wheelhop.studies.stiffness.vehicle_estimators import MAIN, ROWS, TUNING, Followed
from wheelhop.vehicle.road import Profile, class_level
from wheelhop.vehicle.tire import stiffness_from_pressure

VALUES = np.array([[2350.0, 38e3, 500.0, 59.0], [2250.0, 40e3, 445.0, 52.0]])
CARS = corners(VALUES)


# what is driven


def test_the_roads_lie_between_the_classes_and_have_other_slopes():
    cases = to_try(StiffnessSettings(), None)
    assert {c.kind for c in cases} == {SYNTHETIC}
    roads = [c.drive.road for c in cases]
    assert min(r.waviness for r in roads) == 1.6
    assert max(r.waviness for r in roads) == 2.7
    off = [10 * np.log10(r.level / 1e-6) % (10 * np.log10(4)) for r in roads]
    assert len({round(float(x), 3) for x in off}) > 4
    assert random_road("C", 2.0, 1.8).level == pytest.approx(class_level("C") * 10**0.2)
    pressures = np.array([c.drive.pressures for c in cases])
    assert len(np.unique(pressures)) == pressures.size
    assert 130e3 <= pressures.min() < pressures.max() <= 230e3
    again = to_try(replace(StiffnessSettings(), seed=1), None)
    assert again[0].drive.pressures != cases[0].drive.pressures


def test_no_drive_shares_its_road_with_those_that_taught_the_estimator():
    settings = StiffnessSettings()
    taught = {d.number for d in (*to_identify(settings), *to_calibrate(settings))}
    tried = {c.drive.number for c in to_try(settings, None)}
    disturbed = {d.number for part in to_disturb(settings) for d in part}
    assert not taught & tried
    assert not taught & disturbed
    assert {p for d in to_calibrate(settings) for p in d.pressures} == {KNOWN}


def test_disturbances_change_the_car_and_nothing_else():
    first, second = to_disturb(StiffnessSettings())
    assert len(first) == len(second) == len(DISTURBANCES) <= FLEET
    assert set(first[0].pressures) == {KNOWN}
    by_name = dict(zip(DISTURBANCES, second, strict=True))
    nominal = vehicle_of(by_name[NOMINAL])
    heavy = vehicle_of(by_name["20 % more load"])
    assert float(heavy.chassis.body_mass / nominal.chassis.body_mass) == pytest.approx(1.2)
    hard = vehicle_of(by_name["dampers 20 % harder"])
    np.testing.assert_allclose(hard.strut.damper.damping, 1.2 * nominal.strut.damper.damping)
    assert by_name["sensor noise x 2, not told"].noise == 2 * by_name[NOMINAL].noise
    assert {d.number for d in second} == {by_name[NOMINAL].number}


def test_measured_roads_are_found_where_they_are_said_to_be(data, monkeypatch, tmp_path):
    monkeypatch.setenv("WHEELHOP_DATA", str(data))
    cases = to_try(StiffnessSettings(), data_directory())
    kinds = [c.kind for c in cases]
    assert kinds.count(LIDAR) == 2
    assert set(kinds) == {SYNTHETIC, LIDAR, "Belgian block", "ride course"}
    block = next(c for c in cases if c.kind == "Belgian block").drive.road.tracks
    assert np.any(block[0].elevation != block[1].elevation)
    monkeypatch.setenv("WHEELHOP_DATA", str(tmp_path))
    assert data_directory() is None


def test_a_short_road_is_driven_there_and_back_from_another_place_each_time():
    z = 0.01 * np.sin(np.arange(401.0) / 7.0)
    road = Road("short", tracks=(Profile(0.05, z), Profile(0.05, -z)))
    x = np.arange(-10.0, 100.0, 0.025)
    drive = VehicleDrive(0, road, 10.0, (KNOWN,) * 4)
    tracks = np.asarray(road_tracks(drive, x, 0))
    assert tracks.shape == (4, len(x))
    np.testing.assert_allclose(tracks[0], tracks[2])
    np.testing.assert_allclose(tracks[0], -tracks[1], atol=1e-12)
    # behind the lead-in, and away from where the road turns back
    late = (x > 11.0) & (np.abs((x + 10.0) % 20.0 - 10.0) > 0.3)
    place = np.interp(x[late] % 40.0, [0.0, 20.0, 40.0], [0.0, 20.0, 0.0])
    np.testing.assert_allclose(
        tracks[0][late], np.interp(place, 0.05 * np.arange(401), z), atol=2e-4
    )
    other = np.asarray(road_tracks(replace(drive, number=1), x, 0))
    late = (x > 11.0) & (np.abs((x + 17.0) % 20.0 - 10.0) > 0.3)
    there = np.interp((x[late] + 7.0) % 40.0, [0.0, 20.0, 40.0], [0.0, 20.0, 0.0])
    expected = np.interp(there, 0.05 * np.arange(401), z)
    np.testing.assert_allclose(other[0][late], expected, atol=2e-4)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"speed": 50.0}, "speed"),
        ({"pressures": (KNOWN, KNOWN, 1e3, KNOWN)}, "pressure"),
        ({"damper": 0.0}, "damper"),
        ({"road": Road("none")}, "road level"),
    ],
)
def test_a_drive_out_of_range_is_refused(change, named):
    drive = VehicleDrive(0, random_road("B"), 15.0, (KNOWN,) * 4)
    with pytest.raises(InputError, match=named):
        drive_vehicles([replace(drive, **change)], 10.0, 22.0, 1)


# the model of the band


def linear_corner(params):
    """x' = A x + b n of the states in their order but the last, by hand."""
    c, s = params.corner, params.corner.car.suspension
    m_s, m_u = float(c.car.sprung_mass), float(c.car.unsprung_mass)
    k, d = float(s.stiffness), float(s.damping)
    k_t = float(stiffness_from_pressure(c.pressure, c.car.tire))
    v, shape = float(c.speed), shaping(float(c.waviness))
    low = 3.0**0.5 * v / float(params.patch)
    a = np.zeros((7, 7))
    a[0, 2:4] = 1.0, -1.0
    a[1, [3, 6]] = 1.0, -1.0
    a[2, [0, 2, 3]] = -k / m_s, -d / m_s, d / m_s
    a[3, :4] = k / m_u, -k_t / m_u, d / m_u, -d / m_u
    a[4, 4], a[5, 5] = (-v * float(p) for p in shape.poles)
    a[6, 4:] = *(low * v * float(r) for r in shape.residues), -low
    b = np.array([0, 0, 0, 0, 1.0, 1.0, low])
    return a, b, np.pi * float(c.level) * v * float(shape.gain)


@pytest.fixture(scope="module")
def corner():
    params = hop_band.hop_params(CARS, 0.016, TUNING, waviness=2.4)
    return jax.tree.map(lambda leaf: leaf[2], params.inner)


def test_means_of_the_wheel_acceleration_follow_the_exact_linear_corner(corner):
    model = hop_model.hop_model(64)
    a, _, _ = linear_corner(corner)
    x = np.array([0.01, -0.004, 0.2, -0.7, 0.003, 0.001, 0.3])
    moved = model.transition(hop_model.HopState(*map(jnp.asarray, x), jnp.asarray(9.0)), corner)
    exact = expm(0.016 * a) @ x
    np.testing.assert_allclose([float(v) for v in moved[:7]], exact, rtol=1e-6, atol=1e-9)
    assert float(moved.before) == x[3]
    (mean,) = model.observation(moved, corner)
    # the mean of v_u' over the interval, by its integral
    fine = np.array([(a @ expm(t * a) @ x)[3] for t in np.linspace(0.0, 0.016, 401)])
    assert float(mean) == pytest.approx(np.trapezoid(fine, dx=0.016 / 400) / 0.016, rel=1e-4)


def test_road_noise_is_the_integral_of_the_exact_response(corner):
    cov = hop_model.hop_noise_cov(corner, 8)
    found = np.zeros((8, 8))
    for i, row in enumerate(cov):
        found[i, : i + 1] = [float(v) for v in row]
    a, b, q = linear_corner(corner)
    block = np.zeros((14, 14))
    block[:7, :7], block[:7, 7:], block[7:, 7:] = -a, q * np.outer(b, b), a.T
    both = expm(0.016 * block)
    exact = both[7:, 7:].T @ both[:7, 7:]
    scale = np.sqrt(np.diag(exact))
    np.testing.assert_allclose(
        found[:7, :7] / np.outer(scale, scale),
        np.tril(exact) / np.outer(scale, scale),
        atol=2e-3,
    )
    assert not found[7].any()


def test_theta_takes_effect_on_all_that_it_names(corner):
    params = hop_band.hop_params(CARS, 0.016, TUNING)
    assert params.inner.corner.noise_a_u[0] == pytest.approx(0.5 / 8**0.5)
    theta = hop_band.theta_type(hop_band.FREE)(np.log(2e5), 0.3, 0.4, 0.1)
    bound = hop_band.bind_hop(corner, jax.tree.map(jnp.asarray, theta)).corner
    assert float(stiffness_from_pressure(bound.pressure, bound.car.tire)) == pytest.approx(2e5)
    assert float(bound.level / corner.corner.level) == pytest.approx(np.exp(0.3))
    assert float(bound.waviness) == pytest.approx(2.8)
    assert float(bound.car.suspension.damping) == pytest.approx(2250.0 * np.exp(0.1))


def test_blocks_are_averaged():
    samples = np.arange(2 * 19 * 4.0).reshape(2, 19, 4)
    found = hop_band.means(samples, 8)
    assert found.shape == (2, 2, 4)
    np.testing.assert_allclose(found[1, 1], samples[1, 8:16].mean(axis=0))


# judgements


def invented(error=0.0, kinds=(SYNTHETIC, LIDAR)):
    """A study whose final pressures are off by these [cases] or [cases, 4]."""
    cases = [c for c in to_try(StiffnessSettings(), None) if c.kind == SYNTHETIC][: len(kinds)]
    cases = tuple(c._replace(kind=kind) for c, kind in zip(cases, kinds, strict=True))
    pressure = np.array([c.drive.pressures for c in cases])
    off = np.broadcast_to(np.asarray(error, float), (4, len(cases))).T
    told = true_ln_stiffness(pressure * (1.0 + off))
    theta = np.zeros((len(cases), 3, 7))
    theta[:, :, :4] = told[:, None]
    cov = np.broadcast_to(0.02**2 * np.eye(4), (len(cases), 3, 4, 4))
    rows = {row: Followed(theta, cov) for row in ROWS}
    rough = np.array([[KNOWN] * 4, [190e3, 230e3, 200e3, 150e3]])
    disturbed = np.broadcast_to(true_ln_stiffness(rough)[:, None], (2, len(DISTURBANCES), 4)).copy()
    return VehicleStudy(
        np.array([20.0, 40.0, 60.0]),
        cases,
        VALUES,
        np.array([0.06, 0.06]),
        pressure,
        rows,
        {row: np.zeros(4) for row in ROWS},
        disturbed,
        rough,
        disturbed[:, 0].copy(),
    )


def test_a_relative_error_of_pressure_comes_back():
    pressure = np.array([130e3, 180e3, 230e3, 250e3])
    found = pressure_error(true_ln_stiffness(pressure * 1.04), pressure)
    np.testing.assert_allclose(found, 0.04, rtol=1e-9)


def test_verdicts_follow_the_errors():
    def verdicts(study):
        return {
            f.claim.split(":")[0]: f.verdict for f in claims_vehicle.vehicle_findings(study)[:4]
        }

    good = verdicts(invented([0.04, -0.049]))
    assert good[SYNTHETIC] == good[LIDAR] == HOLDS
    assert good["Belgian block"] == OPEN
    mixed = verdicts(invented([0.0, -0.051]))
    assert mixed[SYNTHETIC] == HOLDS
    assert mixed[LIDAR] == FAILS
    some = np.array([[0.0, 0.0], [0.06, 0.0], [0.0, 0.0], [0.0, 0.0]])
    assert verdicts(invented(some))[SYNTHETIC] == IN_PART


def test_the_budget_tells_what_a_calibration_removes():
    study, late = invented(), list(DISTURBANCES).index("dampers 20 % softer")
    study.disturbed[0, late] += 0.05
    study.disturbed[1, late] += 0.08
    study.mistimed[1] -= 0.02
    found = budget.error_budget(study, np.full(4, 0.01))
    truth = true_ln_stiffness(study.disturbed_pressure)[1]
    pressure = study.disturbed_pressure[1]
    np.testing.assert_allclose(found.before[late], pressure_error(truth + 0.08, pressure))
    np.testing.assert_allclose(found.with_it[late], pressure_error(truth + 0.03, pressure))
    np.testing.assert_allclose(found.calibrated[0], pressure_error(truth - 0.01, pressure))
    assert found.names[-1] == budget.MISTIMED
    np.testing.assert_allclose(found.before[-1], pressure_error(truth - 0.02, pressure))
    np.testing.assert_allclose(found.before[0], 0.0, atol=1e-12)
    finding = claims_vehicle.vehicle_findings(study)[-1]
    # 8 % of stiffness are more than 10 % of pressure
    assert finding.verdict == IN_PART
    assert "dampers 20 % softer: mean +1" in finding.measured


def test_the_bound_knows_time_and_tracks():
    best = budget.band_bound(CARS, 60.0)
    assert 0.02 < best < 0.08
    assert budget.band_bound(CARS, 60.0, tracks=4) < best < budget.band_bound(CARS, 60.0, tracks=1)
    # half the time with twice the tracks is the same record
    assert budget.band_bound(CARS, 30.0, tracks=4) == pytest.approx(best)


def test_tables_numbers_and_figures_hold_every_drive_and_disturbance():
    study = invented([0.03, -0.9])
    tried, _, moved = claims_vehicle.vehicle_tables(study)
    assert len(tried.columns["drive"]) == 2
    assert tried.columns["FL [%]"][0] == "+3.0"
    assert len(moved.columns["disturbance"]) == len(DISTURBANCES) + 1
    numbers = claims_vehicle.vehicle_numbers(study)
    first = numbers["error_at_the_end"][study.cases[0].name][MAIN]["RR"]
    assert first == pytest.approx(0.03)
    figures = {f.name: f for f in figures_vehicle.vehicle_figures(study)}
    assert set(figures) == {"vehicle_errors", "vehicle_what_helps", "vehicle_budget"}
    for figure in figures.values():
        assert len({len(c) for c in figure.columns.values()}) == 1
        figure.figure.canvas.draw()
    shown = figures["vehicle_what_helps"].figure.axes[0]
    # what is beyond the axis stands at its edge
    drawn = [np.asarray(line.get_xdata(), float) for line in shown.lines]
    assert min(x.min() for x in drawn) == pytest.approx(-80.0)


def test_the_quick_settings_are_short():
    assert QUICK.longest <= 10.0
    assert "10 s" in claims_vehicle.vehicle_in_words(QUICK)[0]
