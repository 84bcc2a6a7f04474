"""`wheelhop identify --blind`: car and roads from logs without a road, and what it refuses."""

import json
import math
from dataclasses import replace
from itertools import takewhile

import jax
import numpy as np
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from wheelhop.cli import app
from wheelhop.errors import InputError
from wheelhop.identification import search_space
from wheelhop.identification.blind import BlindIdentification
from wheelhop.identification.blind_summary import summarise_blind
from wheelhop.identification.descent import Descended
from wheelhop.identification.drives import prepare
from wheelhop.identification.parameters import value_of
from wheelhop.identification.uncertainty import Uncertainty
from wheelhop.io.logs import read_log, write_log
from wheelhop.io.vehicles import read_vehicle, write_vehicle
from wheelhop.plots.identification_blind import plot_blind_roads
from wheelhop.vehicle.parameters import brancati_suv
from wheelhop.vehicle.road import class_level
from wheelhop.vehicle.road.shape_filter import CUTOFF
from wheelhop.vehicle.scenario import (
    constant_pressure,
    constant_travel,
    drive,
    road_rise_of_class,
)

RUNNER = CliRunner(env={"COLUMNS": "200", "NO_COLOR": "1", "TERM": "dumb"})
FITTED = {"suspension.damping": "_Ns_per_m", "suspension.stiffness": "_N_per_m"}
# one number of logs, samples and starts, the same parameters and bounds: others compile again
LIGHT = ("--parameters", ",".join(FITTED), "--starts", 2, "--noise", "fit", "--blind")
NOISE = 0.5
LEVELS = {"low": class_level("C") * (1 + CUTOFF**2), "high": class_level("D") * (1 + CUTOFF**2)}
"""Of the simulated roads, whose shape filter flattens below the reference wavenumber."""


def call(*arguments, status=0):
    result = RUNNER.invoke(app, [str(a) for a in arguments])
    text = result.stdout + result.stderr
    assert result.exit_code == status, text
    assert "Traceback" not in text
    return " ".join(text.split())


def results(directory):
    return json.loads((directory / "summary.json").read_text())["results"]


def record(road_class, speed, kpa, seed, rate=250.0, seconds=4.0):
    road, sensors = jax.random.split(jax.random.key(seed))
    travel = constant_travel(speed, round(seconds * rate), rate, 20)
    rise = road_rise_of_class(road, class_level(road_class), travel)
    pressure = constant_pressure(1e3 * kpa)
    return drive(sensors, brancati_suv(), rise, pressure, speed, rate)[0]


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """Logs at 130 and 230 kPa on roads of class C and D, a start far off, and broken logs."""
    place = tmp_path_factory.mktemp("logs")
    low, high = record("C", 14.0, 130, 1), record("D", 20.0, 230, 2)
    write_log(place / "low.parquet", low)
    write_log(place / "high.parquet", replace(high, elevation=None))
    write_log(place / "plain.parquet", replace(low, pressure=None, elevation=None))
    write_log(place / "parked.parquet", replace(low, v=np.where(low.t < 1, 0.0, low.v)))
    write_log(place / "still.parquet", replace(low, a_u=0.01 * low.a_u))
    write_log(place / "short.parquet", record("C", 14.0, 130, 1, seconds=2.0))
    car = brancati_suv()
    far = replace(car, suspension=replace(car.suspension, damping=1600.0, stiffness=26e3))
    write_vehicle(place / "far.toml", far)
    # a wheel of 2 kg with such a damper settles within a fiftieth of the filter's step
    stiff = replace(far.suspension, damping=49e3)
    write_vehicle(place / "stiff.toml", replace(far, suspension=stiff, unsprung_mass=2.0))
    write_vehicle(place / "damped.toml", replace(far, tire=replace(far.tire, damping=50.0)))
    np.savetxt(place / "road.csv", [[0, 0], [1, 0.1]], delimiter=",", header="x_m,z_m", comments="")
    return place


@pytest.fixture
def work(tmp_path, monkeypatch, logs):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(scope="module")
def fitted(logs, tmp_path_factory):
    """One identification that several tests look at: what it said and wrote."""
    out = tmp_path_factory.mktemp("out") / "fit"
    files = (logs / "low.parquet", logs / "high.parquet")
    vehicle = ("--vehicle", logs / "damped.toml")
    return call("identify", *files, *vehicle, *LIGHT, "--iterations", 20, "--out", out), out


def test_it_says_what_it_found_and_what_it_is_worth(fitted):
    said, out = fitted
    assert "--blind: the elevation in low.parquet is not used" in said
    assert "the tyre's damping counts as none" in said
    found = results(out)
    assert len(found["roads"]) == 2
    for row, letter in zip(found["roads"], "CD", strict=True):
        assert f"{row['name']} │ {row['level_m3_per_rad']:.3g} │" in said
        assert f"│ {letter} │ {row['mean_nis']:.2f}" in said
    assert f"noise of a_u │ m/s^2 │ {found['noise_a_u']['value_m_per_s2']:.4f}" in said
    assert "2 of 2 starts ended at the best maximum" in said
    assert "least known combination" in said
    assert "taken as known: waviness 2" in said
    # the road drowns what the wheel's accelerometer adds
    (problem,) = found["problems"]
    assert "the records hardly determine" in problem
    assert "noise_a_u" in problem
    assert f"problem {problem}" in said


def test_car_roads_and_noise_are_the_true_ones(fitted):
    """Within four of the stated errors, which are small enough to mean something."""
    _, out = fitted
    found, car, truth = results(out), read_vehicle(out / "vehicle.toml"), brancati_suv()
    for name, unit in FITTED.items():
        row = found["parameters"][name + unit]
        assert row["estimate"] == value_of(car, name)
        error = max(row["standard_error"], row["robust_standard_error"])
        assert abs(row["estimate"] - value_of(truth, name)) < 4 * error
        assert row["relative_error"] == pytest.approx(error / row["estimate"])
        assert row["relative_error"] < 0.1
    for row in found["roads"]:
        true = LEVELS[row["name"].removesuffix(".parquet")]
        error = max(row["standard_error_m3_per_rad"], row["robust_standard_error_m3_per_rad"])
        assert abs(row["level_m3_per_rad"] - true) < 4 * error
        assert error < 0.15 * true
        assert row["mean_nis"] == pytest.approx(2.0, abs=0.2)
    assert [row["iso_8608_class"] for row in found["roads"]] == ["C", "D"]
    for signal in ("noise_a_s", "noise_a_u"):
        row = found[signal]
        assert row["fitted"]
        assert abs(row["value_m_per_s2"] - NOISE) < 4 * row["standard_error_m_per_s2"]
    assert found["noise_a_s"]["relative_error"] < 0.1
    assert found["waviness"] == {"value": 2.0, "fitted": False}
    # what was not fitted is the start's
    assert value_of(car, "suspension.cubic_stiffness") == 1e5
    assert value_of(car, "tire.damping") == 50.0


def test_the_vehicle_says_where_it_comes_from_and_what_it_is_worth(fitted, logs):
    _, out = fitted
    text = (out / "vehicle.toml").read_text()
    assert f"# start: {logs / 'damped.toml'}" in text
    assert "# without a road: log-likelihood" in text
    assert "on roads of ISO 8608 C, D; +- is a standard error" in text
    assert text.count("; +- ") == 3


def test_history_climbs_to_the_summary_and_the_figure_is_there(fitted):
    _, out = fitted
    history, found = pq.read_table(out / "history.parquet"), results(out)
    assert history.schema.field("log_likelihood_1").metadata[b"unit"] == b"1"
    ends = []
    for name in ("log_likelihood_1", "log_likelihood_2"):
        values = history[name].to_numpy()
        assert (np.diff(values) >= -1e-6).all()
        assert values[-1] > values[0] + 100
        ends.append(values[-1])
    assert history["log_likelihood_1"][0].as_py() == pytest.approx(found["start_log_likelihood"])
    assert ends == pytest.approx(found["ascent"]["log_likelihood"])
    assert found["log_likelihood"] == pytest.approx(max(ends), abs=1e-3)
    assert len(found["labels"]) == len(found["correlation"]) == 2 + 2 + 2
    assert (out / "roads.png").stat().st_size > 20_000


def test_settings_are_those_of_a_fit_without_a_road(fitted):
    _, out = fitted
    settings = json.loads((out / "summary.json").read_text())["settings"]
    assert settings["blind"] is True
    assert settings["noise_m_per_s2"] == "fit"
    assert settings["waviness"] == 2.0
    assert settings["settling_s"] == 0.5
    assert settings["starts"] == 2


def test_too_few_iterations_are_a_problem_that_is_told(work, logs):
    files = (logs / "plain.parquet", logs / "high.parquet")
    vehicle = ("--vehicle", logs / "far.toml", "--pressure", 130)
    said = call("identify", *files, *vehicle, *LIGHT, "--iterations", 1, "--out", "fit")
    assert "problem the best of 2 starts was still climbing" in said
    assert "elevation" not in said
    assert "damping counts as none" not in said
    assert "# problem: the best of 2" in (work / "fit" / "vehicle.toml").read_text()
    assert math.isfinite(results(work / "fit")["log_likelihood"])


def test_a_likelihood_that_is_nowhere_finite_ends_with_status_1(work, logs):
    files = (logs / "low.parquet", logs / "high.parquet")
    said = call(
        "identify", *files, *LIGHT, "--vehicle", logs / "stiff.toml", "--out", "fit", status=1
    )
    assert "diverged none of 2 starts gave a finite likelihood" in said
    assert list(work.iterdir()) == []


def made_up():
    """A fit of one parameter and the waviness; its second road is unknown, its third misfits."""
    one = np.ones(1)
    ascent = Descended(np.zeros((1, 5)), 9.0 * one, one > 0, 9.0 * one[None], one, one, 0)
    errors = np.array([150.0, 0.1, 2e-6, np.inf, 8e-6])
    return BlindIdentification(
        car=brancati_suv(),
        start=brancati_suv(),
        space=search_space(("suspension.damping",)),
        values=np.array([1500.0]),
        labels=("suspension.damping", "waviness", *(f"road level of {n}" for n in "abc")),
        estimates=np.array([1500.0, 2.2, 8e-6, 1.6e-5, 6.4e-5]),
        uncertainty=Uncertainty(errors, 0.5 * errors, np.eye(5), ()),
        at_bound=("",),
        names=("a", "b", "c"),
        levels=np.array([8e-6, 1.6e-5, 6.4e-5]),
        classes=("C", "C", "D"),
        waviness=2.2,
        noise=(0.4, 0.6),
        nis=np.array([2.1, 1.9, 2.9]),
        log_likelihood=-9.0,
        start_log_likelihood=-9.0,
        ascent=ascent,
        problems=(),
    )


def test_figure_shows_errors_as_factors_and_what_does_not_fit():
    """Two sigma of 25 % are a factor exp(0.5) both ways; class ranges end at half and double."""
    figure = plot_blind_roads(made_up())
    top, bottom = figure.axes
    fits, misfits = top.containers
    assert "NIS far from 2" in misfits.get_label()
    first = fits.lines[2][0].get_segments()[0]
    np.testing.assert_allclose(first[:, 0], [8 / np.exp(0.5), 8 * np.exp(0.5)])
    np.testing.assert_allclose(misfits.lines[0].get_xdata(), [64.0])
    assert "not determined" in [text.get_text() for text in top.texts]
    assert {"B", "C", "D", "E"} <= {text.get_text() for text in top.texts}
    edges = {round(float(band.get_x()), 6) for band in top.patches}
    assert {8.0, 32.0, 128.0} <= edges
    ends = [bar.get_width() + bar.get_x() for bar in bottom.patches]
    assert sorted(ends) == pytest.approx([5.0, 10.0])
    assert top.get_xlabel().endswith("[10⁻⁶ m³/rad]")


def test_summary_tells_what_was_fitted_beside_the_car():
    summary = summarise_blind(made_up())
    expected = {"standard_error": 0.1, "robust_standard_error": 0.05, "relative_error": 0.1 / 2.2}
    assert summary["waviness"] == pytest.approx({"value": 2.2, "fitted": True, **expected})
    assert summary["noise_a_u"] == {"value_m_per_s2": 0.6, "fitted": False}
    assert summary["roads"][0]["relative_error"] == pytest.approx(0.25)
    assert summary["roads"][1]["relative_error"] == math.inf


BLIND = ("low", "--blind")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--blind",), "LOG: there is none"),
        (("low", "--waviness", "2"), "--waviness: on a known road it has no meaning. Leave it out"),
        (("low", "--noise", "fit"), "--noise: on a known road it has no meaning"),
        ((*BLIND, "--road", "ROAD"), "--road: a fit with --blind reads no road. Leave one"),
        ((*BLIND, "--track", "left"), "--track: a fit with --blind"),
        ((*BLIND, "--reflect"), "--reflect: a fit with --blind"),
        ((*BLIND, "--waviness", "steep"), "--waviness: 'steep' is no number. Give one from 1 to 3"),
        ((*BLIND, "--waviness", "3.5"), "--waviness: 3.5 (no unit) is outside"),
        ((*BLIND, "--waviness", "nan"), "--waviness: nan (no unit) is outside"),
        ((*BLIND, "--noise", "0.5"), "--noise: '0.5' is not A_S,A_U. Give two"),
        ((*BLIND, "--noise", "0.5,0"), "--noise: 0 m/s^2 is outside"),
        ((*BLIND, "--noise", "1,2,3"), "--noise: '1,2,3' is not A_S,A_U"),
        ((*BLIND, "--parameters", "tire.damping"), "tire.damping cannot be fitted without a road"),
        ((*BLIND, "--starts", "0"), "--starts: 0 starting points is outside"),
        ((*BLIND, "--settling", "-1"), "settling: -1 s"),
        ((*BLIND, "--settling", "3"), "Give at least 5 s"),
        (("plain", "--blind"), "plain.parquet: pressure: the log has no such column"),
        (("parked", "--blind"), "parked.parquet: v: the vehicle is slower than 1 m/s for 25%"),
        (("low", "still", "--blind"), "still.parquet: a_u: it varies by"),
        (("short", "--blind"), "short.parquet: t: the record lasts 2 s"),
        (("high",), "or fit without a road by --blind"),
    ],
)
def test_bad_input_ends_with_status_2_one_line_and_nothing_written(work, logs, arguments, message):
    files = list(takewhile(lambda a: not a.startswith("--"), arguments))
    given = [logs / f"{name}.parquet" for name in files]
    given += [logs / "road.csv" if a == "ROAD" else a for a in arguments[len(files) :]]
    result = RUNNER.invoke(app, ["identify", *(str(a) for a in given)])
    lines = [line for line in result.stderr.splitlines() if line.strip()]
    # a log's reader may warn of it first
    told = [line for line in lines if not line.startswith("warning ")]
    assert result.exit_code == 2, result.stdout + result.stderr
    assert len(told) == 1
    assert told[0].startswith("error ")
    assert message in told[0]
    assert list(work.iterdir()) == []


def test_the_remedy_for_a_missing_elevation_names_the_function(logs):
    with pytest.raises(InputError, match="use `identify_blind`"):
        prepare([read_log(logs / "high.parquet")])


def test_help_names_it():
    said = call("identify", "--help")
    assert "--blind" in said
    assert "--blind --noise fit" in said
