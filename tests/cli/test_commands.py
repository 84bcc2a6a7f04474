"""Every command end to end: what it prints, what it writes, and how it refuses bad input."""

import io
import json

import numpy as np
import pyarrow.parquet as pq
import pytest
from rich.console import Console
from typer.testing import CliRunner

from wheelhop.cli import app
from wheelhop.io.logs import write_log
from wheelhop.vehicle.record import CornerRecord

RUNNER = CliRunner(env={"COLUMNS": "200", "NO_COLOR": "1", "TERM": "dumb"})


def call(*arguments, status=0):
    result = RUNNER.invoke(app, [str(a) for a in arguments])
    text = result.stdout + result.stderr
    assert result.exit_code == status, text
    assert "Traceback" not in text
    return " ".join(text.split())


def summary(directory, name="summary.json"):
    return json.loads((directory / name).read_text())


@pytest.fixture
def work(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    rng = np.random.default_rng(0)
    n = 400
    record = CornerRecord(
        np.arange(1, n + 1) / 500, rng.normal(size=n), 3 * rng.normal(size=n), np.full(n, 16.0)
    )
    return write_log(tmp_path_factory.mktemp("log") / "log.csv", record)


def road_file(path, length=60.0, spacing=0.1):
    rng = np.random.default_rng(1)
    x = spacing * np.arange(int(length / spacing) + 1)
    z = np.cumsum(rng.normal(size=len(x))) * 1e-3
    np.savetxt(path, np.column_stack([x, z]), delimiter=",", header="x_m,z_m", comments="")
    return path


COMMANDS = (
    "bound",
    "cornering",
    "demo",
    "estimate",
    "identify",
    "simulate",
    "road",
    "montecarlo",
    "vehicle",
    "reproduce",
    "wheel-load",
)


@pytest.mark.parametrize("command", COMMANDS)
def test_help_has_an_example(command):
    assert f"Example: wheelhop {command}" in call(command, "--help")


def test_version_and_bare_call():
    assert "wheelhop 0." in call("--version")
    assert all(command in call("--help") for command in COMMANDS)


def test_estimate_writes_what_it_promises(work, log):
    said = call("estimate", log, "--out", "result")
    assert "Brancati & Tufano 2022 SUV, front-left corner (no --vehicle given)" in said
    assert "the log holds no true pressure" in said
    table = pq.read_table(work / "result" / "estimate.parquet")
    assert table.schema.names[:4] == ["t", "pressure", "pressure_sigma", "stiffness"]
    assert {"probability_steady", "level", "level_sigma"} <= set(table.schema.names)
    assert table.schema.field("level").metadata[b"unit"] == b"m^3/rad"
    assert table.schema.field("pressure").metadata[b"unit"] == b"Pa"
    assert table.num_rows == 400
    content = summary(work / "result")
    assert content["settings"]["tuning"]["noise_a_s"] == 0.5
    final = table["pressure"].to_numpy()[-1]
    assert content["results"]["final_pressure_Pa"] == pytest.approx(final)
    assert (work / "result" / "estimate.png").stat().st_size > 10_000


def test_the_papers_filter_and_exact_classes_can_be_chosen(work, log):
    call("estimate", log, "--method", "immuf", "--out", "immuf")
    table = pq.read_table(work / "immuf" / "estimate.parquet")
    assert {"probability_A", "probability_D"} <= set(table.schema.names)
    call("estimate", log, "--classes", "BC", "--out", "classes")
    content = summary(work / "classes")
    assert content["settings"]["classes"] == ["B", "C"]
    assert list(content["results"]["mean_mode_probability"])[:2] == ["B", "B, tyre changes"]


@pytest.mark.parametrize(
    ("options", "field", "remedy"),
    [
        (("--method", "magic"), "--method", "Use one of"),
        (("--free", "mass"), "--free", "Use some of"),
        (("--method", "immuf", "--free", "waviness"), "--free", "Leave one of them out"),
        (("--method", "hop"), "--method", "is for four tyres"),
        (("--classes", "BB"), "--classes", "Give each class once"),
        (("--calibrate", 230), "--calibrate", "Give a log of four corners"),
        (("--walk", 99), "tuning.stiffness_walk", "Give a value in that range"),
        (("--noise", 0), "tuning.noise_a_s", "Give a value in that range"),
    ],
)
def test_estimate_refuses_options_that_do_not_fit(work, log, options, field, remedy):
    said = call("estimate", log, *options, "--out", "result", status=2)
    assert field in said
    assert remedy in said
    assert not (work / "result").exists()


def test_simulate_then_estimate_on_a_measured_road(work):
    road = road_file(work / "road.csv")
    call("vehicle", "--axle", "rear", "--out", "rear.toml")
    said = call(
        "simulate",
        "--road",
        road,
        "--speed",
        72,
        "--pressure",
        200,
        "--vehicle",
        "rear.toml",
        "--out",
        "drive.csv",
    )
    assert "1500 samples over 3.00 s and 60.0 m" in said
    assert summary(work, "drive.summary.json")["settings"]["pressure_kPa"] == [200.0, 200.0]
    assert (work / "drive.png").exists()
    said = call("estimate", "drive.csv", "--vehicle", "rear.toml", "--out", "result")
    assert "against the truth after" in said
    truth = summary(work / "result")["results"]["against_truth"]
    assert truth["rms_error_of_the_prior_Pa"] == pytest.approx(10e3)


def test_demo_finds_the_leak_then_calibrates_and_watches(work):
    """The README's story with the log that the demo writes."""
    said = call("demo", "--duration", 40, "--out", "demo")
    assert "alarm front right" in said
    results = summary(work / "demo")["results"]
    assert {event["wheel"] for event in results["alarms"]} == {"FR"}
    assert 10.0 < results["alarms"][0]["time"] < 40.0
    assert max(results["rms_error_Pa"]) < 25e3
    for name in ("estimate.png", "estimate.parquet", "log.parquet"):
        assert (work / "demo" / name).stat().st_size > 10_000

    said = call("estimate", "demo/log.parquet", "--placard", 160, "--out", "soft")
    assert "no alarm" in said
    again = pq.read_table(work / "soft" / "estimate.parquet")
    first = pq.read_table(work / "demo" / "estimate.parquet")
    late = [t["ln_stiffness_FR"].to_numpy()[-50:] for t in (first, again)]
    np.testing.assert_allclose(*late, atol=0.05)  # the placard is where the prior begins, no more

    call("estimate", "demo/log.parquet", "--calibrate", 250, "--out", "reset")
    offset = json.loads((work / "reset" / "calibration.json").read_text())["offset"]
    assert len(offset) == 4
    reset = ("--calibration", "reset/calibration.json")
    call("estimate", "demo/log.parquet", *reset, "--out", "after")
    shift = {
        name: np.log(pq.read_table(work / name / "estimate.parquet")["pressure_FL"].to_numpy())
        for name in ("demo", "after")
    }
    assert (shift["after"] > shift["demo"]).all()  # 250 kPa were claimed, 230 were there

    said = call("estimate", "demo/log.parquet", *reset, "--method", "hop", "--out", "bad", status=2)
    assert "was made with another method" in said
    (work / "bad.json").write_text("{}")
    said = call(
        "estimate", "demo/log.parquet", "--calibration", "bad.json", "--out", "bad", status=2
    )
    assert "calibration.offset" in said
    for option in ("--placard", "--calibrate", "--walk"):
        said = call("estimate", "demo/log.parquet", option, "nan", "--out", "bad", status=2)
        assert option in said
    said = call("demo", "--duration", "inf", "--out", "bad", status=2)
    assert "--duration" in said
    said = call("estimate", "demo/log.parquet", "--classes", "AB", "--out", "bad", status=2)
    assert "Add --corner FL" in said
    said = call("estimate", "demo/log.parquet", "--method", "hop", "--out", "hop")
    assert "(4 where the model fits)" in said
    said = call("estimate", "demo/log.parquet", "--corner", "FL", "--out", "one")
    assert "innovations: mean NIS" in said


def test_the_same_seed_gives_the_same_log(work):
    for name, seed in (("a", 3), ("b", 3), ("c", 4)):
        call("simulate", "--road", "iso:B", "--duration", 1, "--seed", seed, "--out", f"{name}.csv")
    texts = [(work / f"{name}.csv").read_text() for name in "abc"]
    assert texts[0] == texts[1]
    assert texts[0] != texts[2]


def test_random_roads_of_any_waviness_sensors_and_directories(work):
    call(
        "simulate",
        "--road",
        "iso:C",
        "--waviness",
        2.4,
        "--duration",
        1,
        "--dropout",
        0.1,
        "--resolution",
        0.05,
        "--end-pressure",
        150,
        "--out",
        "run",
    )
    table = pq.read_table(work / "run" / "log.parquet")
    assert np.isnan(table["a_u"].to_numpy()).mean() == pytest.approx(0.1, abs=0.06)
    assert table["pressure"].to_numpy()[-1] == pytest.approx(150e3)
    assert summary(work / "run")["results"]["samples"] == 500
    assert (work / "run" / "log.png").exists()


def test_road_measures_and_plots(work):
    said = call("road", road_file(work / "road.csv"), "--out", "road")
    assert "ISO 8608 class" in said
    results = summary(work / "road")["results"]
    assert results["length_m"] == pytest.approx(60.0)
    assert results["iri_m_per_km"] > 0
    assert (work / "road" / "road.png").stat().st_size > 10_000


def test_a_road_too_short_for_the_roughness_index_says_so(work):
    said = call("road", road_file(work / "road.csv", length=8.0, spacing=0.01), "--out", "road")
    assert "needs at least 11 m" in said
    assert summary(work / "road")["results"]["iri_m_per_km"] is None


def test_montecarlo_writes_statistics_and_resumes(work):
    arguments = ("montecarlo", "--runs", 4, "--duration", 0.5, "--out", "mc")
    said = call(*arguments)
    assert "guessing the prior" in said
    table = pq.read_table(work / "mc" / "montecarlo.parquet")
    assert {"t", "error_mean", "error_std", "sigma_mean", "nees_mean"} <= set(table.schema.names)
    assert pq.read_table(work / "mc" / "runs.parquet").num_rows == 4
    before = (work / "mc" / "runs" / "runs-0000000.npz").stat().st_mtime_ns
    call(*arguments)
    assert (work / "mc" / "runs" / "runs-0000000.npz").stat().st_mtime_ns == before
    assert "another campaign" in call(*arguments, "--seed", 9, status=2)


def test_float32_is_a_choice(work, log):
    call("estimate", log, "--precision", "float32", "--out", "result")
    assert summary(work / "result")["settings"]["precision"] == "float32"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("estimate", "missing.csv"), "missing.csv: there is no such file"),
        (("estimate", "LOG", "--vehicle", "no.toml"), "no.toml: there is no such file"),
        (("estimate", "LOG", "--noise", "0"), "tuning.noise_a_s: 0 m/s^2 is outside"),
        (("estimate", "LOG", "--classes", "ABX"), "'X' is not an ISO 8608 class"),
        (("estimate", "LOG", "--classes", "AA"), "Give each class once"),
        (("estimate", "LOG", "--precision", "float16"), "'float16' is unknown"),
        (("demo", "--road", "Q"), "'Q' is not an ISO 8608 class"),
        (("simulate", "--road", "iso:Z"), "'Z' is not an ISO 8608 class"),
        (("simulate", "--road", "nowhere.csv"), "nowhere.csv: there is no such file"),
        (("simulate", "--road", "iso:B", "--speed", "0"), "--speed: 0 km/h is outside"),
        (("simulate", "--road", "iso:B", "--speed", "-5"), "--speed: -5 km/h is outside"),
        (("simulate", "--road", "iso:B", "--pressure", "3"), "--pressure: 3 kPa is outside"),
        (("simulate", "--road", "iso:B", "--rate", "10"), "--rate: 10 Hz is outside"),
        (("simulate", "--road", "iso:B", "--duration", "-1"), "--duration: -1 s is outside"),
        (("simulate", "--road", "iso:B", "--convention", "x"), "convention: 'x' is unknown"),
        (("simulate", "--road", "iso:B", "--noise", "-1"), "sensor.noise: -1"),
        (("simulate", "--road", "ROAD", "--duration", "99"), "--reflect"),
        (("simulate", "--road", "ROAD", "--track", "q"), "no elevation column 'q'"),
        (("road", "LOG"), "Name the distance column x_m"),
        (("montecarlo", "--runs", "1"), "--runs: 1 has no spread"),
        (("vehicle", "--axle", "middle"), "'middle' is not an axle"),
        (("vehicle", "--load", "1e9"), "quarter_car.sprung_mass"),
        (("vehicle", "--out", "."), "is a directory"),
        (("estimate", "LOG", "--out", "ROAD"), "--out"),
        (("simulate", "--road", "iso:B", "--duration", "0.1", "--rate", "50"), "are 5 samples"),
    ],
)
def test_bad_input_ends_with_status_2_one_line_and_nothing_written(work, log, arguments, message):
    road = road_file(work / "road.csv")
    places = {"LOG": str(log), "ROAD": str(road)}
    before = sorted(work.iterdir())
    said = call(*(places.get(a, a) for a in arguments), status=2)
    assert message in said
    assert "error" in said
    assert sorted(work.iterdir()) == before


def test_warnings_are_told_and_the_estimate_goes_on(work, log):
    lines = log.read_text().splitlines()
    cells = lines[50].split(",")
    cells[1] = ""
    lines[50] = ",".join(cells)
    (work / "gap.csv").write_text("\n".join(lines))
    said = call("estimate", "gap.csv", "--out", "result")
    assert "warning a_s: 1 of 400 samples are missing" in said


def test_measured_roads_run_through_the_whole_chain(work, data):
    """The LIDAR road and the Belgian block: the chain of the README, in short."""
    roads = data / "roads" / "normalized"
    lidar, block = roads / "lidar_czech_B.csv", roads / "belgian_block_7tracks.csv"
    said = call("road", lidar, "--out", "road")
    assert "544.00 m" in said
    assert summary(work / "road")["results"]["iso_class"] == "B"
    call("simulate", "--road", lidar, "--duration", 3, "--out", "lidar.parquet")
    call("estimate", "lidar.parquet", "--out", "lidar")
    call(
        "simulate",
        "--road",
        block,
        "--duration",
        3,
        "--reflect",
        "--track",
        "z_v+0.4",
        "--out",
        "block.parquet",
    )
    said = call("estimate", "block.parquet", "--out", "block")
    assert "against the truth after" in said
    assert "overconfident" in said


def test_headings_of_tables_keep_their_units():
    from wheelhop.cli.session import headed_table

    console = Console(width=80, file=io.StringIO())
    console.print(headed_table("time [s]", "estimate [kPa]", title="pressure"))
    assert "time [s]" in console.file.getvalue()
    assert "estimate [kPa]" in console.file.getvalue()
