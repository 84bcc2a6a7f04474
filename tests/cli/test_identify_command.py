"""`wheelhop identify`: from logs with a road to a fitted vehicle, and how bad input is refused."""

import json
import tomllib
from dataclasses import replace
from itertools import takewhile

import jax
import numpy as np
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from wheelhop.cli import app
from wheelhop.identification.parameters import value_of
from wheelhop.io.logs import read_log, write_log
from wheelhop.io.results import write_table
from wheelhop.io.vehicles import read_vehicle, write_vehicle
from wheelhop.vehicle.parameters import brancati_suv
from wheelhop.vehicle.road import Profile
from wheelhop.vehicle.scenario import Leak, drive, road_rise_from_profile
from wheelhop.vehicle.sensors import Sensor

RUNNER = CliRunner(env={"COLUMNS": "200", "NO_COLOR": "1", "TERM": "dumb"})
FITTED = ("suspension.damping", "suspension.stiffness")
# one number of logs and starts, the same parameters and bounds for all: others compile again
LIGHT = (
    *("--parameters", ",".join(FITTED), "--bounds", "suspension.damping=500:8000"),
    *("--starts", 2, "--iterations", 12),
)
SPEED, RATE, SECONDS = 16.0, 500.0, 4.0


def call(*arguments, status=0):
    result = RUNNER.invoke(app, [str(a) for a in arguments])
    text = result.stdout + result.stderr
    assert result.exit_code == status, text
    assert "Traceback" not in text
    return " ".join(text.split())


def summary(directory):
    return json.loads((directory / "summary.json").read_text())


def road():
    """A random road of 80 m, rough enough to move the suspension."""
    z = np.cumsum(np.random.default_rng(3).normal(size=1601)) * 2e-3
    return Profile(0.05, z - np.linspace(0, z[-1], len(z)))


def record(kpa, seed, seconds=SECONDS):
    rise = road_rise_from_profile(road(), SPEED, seconds, RATE)
    leak = Leak(1e3 * kpa, 1e3 * kpa, 0.0, seconds)
    quiet = Sensor(0.1, 0.0, 0.0, 0.0)
    key = jax.random.key(seed)
    return drive(key, brancati_suv(), rise, leak, SPEED, RATE, sensors=(quiet, quiet))[0]


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """Logs at 130 and 230 kPa, a start far off, and broken logs."""
    place = tmp_path_factory.mktemp("logs")
    low, high = record(130, 1), record(230, 2)
    write_log(place / "low.parquet", low)
    write_log(place / "high.parquet", high)
    write_log(place / "plain.parquet", replace(low, pressure=None, elevation=None))
    write_log(place / "no-pressure.parquet", replace(low, pressure=None))
    write_log(place / "no-road.parquet", replace(low, elevation=None))
    write_log(place / "short.parquet", record(130, 1, seconds=2.0))
    write_log(place / "smooth.parquet", replace(low, elevation=0.0 * low.elevation))
    write_log(place / "still.parquet", replace(low, a_u=1e-3 * low.a_u))
    write_log(place / "mad.parquet", replace(low, pressure=1e-3 * low.pressure))
    for name in ("low", "high"):
        r = read_log(place / f"{name}.parquet")
        write_log(place / f"{name}-mountains.parquet", replace(r, elevation=1e9 * r.elevation))
    write_table(
        place / "two-corners.parquet",
        {"t": low.t, "v": low.v, "a_s_FL": low.a_s, "a_u_FL": low.a_u}
        | {"a_s_FR": low.a_s, "a_u_FR": low.a_u},
        {"t": "s", "v": "m/s"} | {f"a_{s}_{c}": "m/s^2" for s in "su" for c in ("FL", "FR")},
    )
    profile = road()
    table = np.column_stack([0.05 * np.arange(len(profile.elevation)), profile.elevation])
    np.savetxt(place / "road.csv", table, delimiter=",", header="x_m,z_m", comments="")
    np.savetxt(place / "stub.csv", table[:400], delimiter=",", header="x_m,z_m", comments="")
    car = brancati_suv()
    far = replace(car, suspension=replace(car.suspension, damping=3600.0, stiffness=25e3))
    write_vehicle(place / "far.toml", far)
    return place


@pytest.fixture
def work(tmp_path, monkeypatch, logs):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(scope="module")
def fitted(logs, tmp_path_factory):
    """One identification that several tests look at: what it said and wrote."""
    out = tmp_path_factory.mktemp("out") / "fit"
    files = (logs / "low.parquet", logs / "high.parquet", logs / "low.parquet")
    return call("identify", *files, "--vehicle", logs / "far.toml", *LIGHT, "--out", out), out


def test_it_says_what_it_found_and_what_it_is_worth(fitted):
    said, _ = fitted
    assert "warning" in said
    assert "low.parquet: it is given twice; used once" in said
    assert "low.parquet │ 130, 58" in said
    assert "wheel-hop frequency" in said
    assert "2 of 2 starts ended at the best minimum" in said
    assert "least known combination" in said
    assert "problem" not in said


def test_the_fitted_vehicle_is_the_true_one_and_can_be_read(fitted):
    _, out = fitted
    car, truth = read_vehicle(out / "vehicle.toml"), brancati_suv()
    found = summary(out)["results"]["parameters"]
    units = {"suspension.damping": "_Ns_per_m", "suspension.stiffness": "_N_per_m"}
    for name in FITTED:
        row = found[name + units[name]]
        assert row["estimate"] == value_of(car, name)
        error = max(row["standard_error"], row["robust_standard_error"])
        # the simulator takes finer steps than the fit, so four sigma and half a percent
        assert abs(row["estimate"] - value_of(truth, name)) < 4 * error + 5e-3 * row["estimate"]
        assert row["relative_error"] == pytest.approx(error / row["estimate"])
    assert found["suspension.damping_Ns_per_m"]["upper_bound"] == 8000.0
    assert value_of(car, "suspension.cubic_stiffness") == 1e5
    text = (out / "vehicle.toml").read_text()
    assert text.count("+- ") == 3
    assert "# logs: " in text
    assert tomllib.loads(text)["suspension"]["damping"] == value_of(car, "suspension.damping")


def test_the_replay_holds_the_errors_that_the_summary_states(fitted):
    """Root mean squares recomputed from the written series, with NumPy."""
    _, out = fitted
    content = summary(out)
    table = pq.read_table(out / "replay.parquet").to_pydict()
    columns = {name: np.array(values) for name, values in table.items()}
    for row in content["results"]["records"]:
        of_log = (columns["log"] == row["name"]) & columns["judged"]
        # the settling second is left out
        assert of_log.sum() == round((SECONDS - 1.0) * RATE)
        for signal in ("a_s", "a_u"):
            measured = columns[f"{signal}_measured"][of_log]
            for which, key in (("start", "start_rmse"), ("fit", "rmse")):
                error = columns[f"{signal}_{which}"][of_log] - measured
                assert np.sqrt(np.mean(error**2)) == pytest.approx(
                    row[f"{signal}_{key}_m_per_s2"], rel=1e-9
                )
    rmse = [r[f"{s}_rmse_m_per_s2"] for r in content["results"]["records"] for s in ("a_s", "a_u")]
    assert content["results"]["loss_m_per_s2"] == pytest.approx(np.linalg.norm(rmse))
    # little more than the sensor's noise of 0.1 m/s^2 stays
    assert max(rmse) < 0.2


def test_history_falls_from_every_start_and_the_figures_are_there(fitted):
    _, out = fitted
    history = pq.read_table(out / "history.parquet")
    assert history.schema.names == [
        *("iteration", "warm_up", "seconds", "evaluations", "loss_1", "loss_2")
    ]
    assert history.schema.field("loss_1").metadata[b"unit"] == b"m/s^2"
    for name in ("loss_1", "loss_2"):
        loss = history[name].to_numpy()
        assert (np.diff(loss) <= 0).all()
        assert loss[-1] < 0.5 * loss[0]
    result = summary(out)["results"]
    assert history["loss_1"][0].as_py() == pytest.approx(result["start_loss_m_per_s2"], rel=1e-9)
    for name in ("overlay", "spectra", "descent", "correlation"):
        assert (out / f"{name}.png").stat().st_size > 20_000


def test_physical_reading_of_the_start_is_that_of_its_state_matrix(fitted):
    """Product and sum of the four eigenvalues in closed form: k k_t / (m_s m_u) and the trace."""
    _, out = fitted
    reading = summary(out)["results"]["physical_reading"]
    car = brancati_suv()
    m_s, m_u = float(car.sprung_mass), float(car.unsprung_mass)
    k_t = 264.7e3 * (1 + 0.7 * (180 - 250) / 250)
    assert reading["pressure_Pa"] == pytest.approx(180e3)
    start = reading["start"]
    assert start["tire_stiffness_N_per_m"] == pytest.approx(k_t)
    ride, hop = (2 * np.pi * start[f"{mode}_frequency_Hz"] for mode in ("ride", "wheel_hop"))
    assert ride**2 * hop**2 == pytest.approx(25e3 * k_t / (m_s * m_u), rel=1e-9)
    c = start["equivalent_damping_Ns_per_m"]
    velocity = start["suspension_velocity_rms_m_per_s"]
    assert c == pytest.approx(3600.0 + 500.0 * np.sqrt(8 / np.pi) * velocity)
    shares = start["ride_damping_ratio"] * ride + start["wheel_hop_damping_ratio"] * hop
    assert 2 * shares == pytest.approx(c / m_s + c / m_u, rel=1e-9)
    assert reading["fit"]["wheel_hop_damping_ratio"] < start["wheel_hop_damping_ratio"]


def test_a_measured_road_and_a_stated_pressure_stand_in_for_the_columns(work, logs):
    said = call(
        *("identify", logs / "plain.parquet", logs / "high.parquet", *LIGHT),
        *("--pressure", 130, "--road", logs / "road.csv", "--out", "fit"),
    )
    assert "plain.parquet │ 130, 58" in said
    content = summary(work / "fit")
    assert content["settings"]["pressure_kPa"] == 130.0
    assert content["results"]["unexplained_share"] < 0.05


def test_a_runaway_ends_with_status_1_and_nothing_written(work, logs):
    files = [logs / f"{name}-mountains.parquet" for name in ("low", "high")]
    said = call("identify", *files, *LIGHT, "--out", "fit", status=1)
    assert "diverged none of 2 starts gave a finite simulation" in said
    assert list(work.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "LOG: there is none. Name at least one log"),
        (("low", "--parameters", "spring"), "parameters: 'spring' is unknown. Use some of"),
        (("low", "--parameters", ","), "parameters: []. Name each parameter"),
        (("low", "--bounds", "suspension.damping=5"), "'suspension.damping=5' is not NAME=LOW:"),
        (("low", "--bounds", "suspension.damping=9:5"), "suspension.damping: 9 to 5 Ns/m. Give"),
        (("low", "--bounds", "tire.damping=1:2"), "'tire.damping' is not fitted"),
        (("low", "--bounds", "suspension.damping=3000:9000"), "the start, 2400 Ns/m, is outside"),
        (("missing",), "missing.parquet: there is no such file"),
        (("no-pressure",), "no-pressure.parquet: pressure: the log has no such column"),
        (("no-pressure", "--pressure", "2"), "--pressure: 2 kPa is outside 20 to 1500 kPa"),
        (("low", "--pressure", "200"), "--pressure: every log has its own column"),
        (("mad",), "mad.parquet: pressure: 130 Pa is outside"),
        (("no-road",), "by --road ROAD.csv"),
        (("no-road", "--road", "STUB"), "by --reflect"),
        (("low", "--road", "STUB"), "--road: every log has its own column"),
        (("low", "--reflect"), "--reflect: there is no measured road. Name one by --road"),
        (("low", "short"), "short.parquet: t: the record lasts 2 s"),
        (("low", "--settling", "3"), "Give at least 5 s"),
        (("low", "--settling", "-1"), "settling: -1 s"),
        (("smooth",), "smooth.parquet: elevation: the road's velocity varies by"),
        (("still",), "still.parquet: a_u: it varies by"),
        (("two-corners",), "--corner: two-corners.parquet holds the corners FL, FR. Choose one"),
        (("low", "--corner", "FL"), "one corner without a name. Leave --corner out"),
        (("two-corners", "--corner", "RL"), "the default vehicle is a front corner"),
        (("low", "--starts", "0"), "--starts: 0 starting points is outside"),
        (("low", "--iterations", "0"), "--iterations: 0 iterations is outside"),
        (("low", "--precision", "float16"), "'float16' is unknown"),
        (("low", "--vehicle", "no.toml"), "no.toml: there is no such file"),
        (("low", "--out", "ROAD"), "is no usable directory"),
    ],
)
def test_bad_input_ends_with_status_2_one_line_and_nothing_written(work, logs, arguments, message):
    words = {"STUB": logs / "stub.csv", "ROAD": logs / "road.csv"}
    files = list(takewhile(lambda a: not a.startswith("--"), arguments))
    given = [logs / f"{name}.parquet" for name in files]
    given += [words.get(a, a) for a in arguments[len(files) :]]
    result = RUNNER.invoke(app, ["identify", *(str(a) for a in given)])
    told = [line for line in result.stderr.splitlines() if line.strip()]
    assert result.exit_code == 2, result.stdout + result.stderr
    assert len(told) == 1
    assert told[0].startswith("error ")
    assert message in told[0]
    assert list(work.iterdir()) == []


def test_help_has_an_example():
    said = call("identify", "--help")
    assert "Example: wheelhop identify" in said
    assert "identify" in call("--help")
