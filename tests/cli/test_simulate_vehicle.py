"""`wheelhop simulate --vehicle suv`: a full vehicle's drive end to end, and what it refuses."""

import json

import numpy as np
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from wheelhop.cli import app

RUNNER = CliRunner(env={"COLUMNS": "200", "NO_COLOR": "1", "TERM": "dumb"})
# one length and speed for all: a road of another length compiles again
DRIVE = ("simulate", "--vehicle", "suv", "--speed", 60, "--duration", 4)


def call(*arguments, status=0):
    result = RUNNER.invoke(app, [str(a) for a in arguments])
    text = result.stdout + result.stderr
    assert result.exit_code == status, text
    assert "Traceback" not in text
    return " ".join(text.split())


@pytest.fixture
def work(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def summary(directory):
    return json.loads((directory / "summary.json").read_text())


def test_a_lane_change_writes_everything_and_one_corner_is_estimated(work):
    said = call(
        *DRIVE,
        *("--maneuver", "lane-change", "--peak", 0.3, "--road", "iso:C"),
        *("--pressures", "230,230,130,230", "--animate", "--out", "drive"),
    )
    assert "suv, lane-change at 60 km/h, road iso:C; 4 s at 1000 Hz" in said
    assert "wrote log.parquet, vehicle.png, summary.json, animation.gif" in said
    table = pq.read_table(work / "drive" / "log.parquet")
    assert table.num_rows == 4000
    assert {"a_s_FL", "a_u_RR", "v", "yaw_rate", "true_load_FL"} <= set(table.schema.names)
    assert table.schema.field("pressure_RL").metadata[b"unit"] == b"Pa"
    found = summary(work / "drive")
    results, corners = found["results"], found["results"]["corners"]
    assert found["settings"]["pressures_kPa"] == [230.0, 230.0, 130.0, 230.0]
    # by the yaw rate: the accelerometer feels the rough road as well
    cornering = results["largest_yaw_rate_rad_per_s"] * 60 / 3.6
    assert cornering == pytest.approx(0.3 * 9.81, rel=0.1)
    assert results["largest_a_y_m_per_s2"] > 0.95 * cornering
    assert results["distance_m"] == pytest.approx(60 / 3.6 * 4, rel=0.02)
    assert 9 < corners["RL"]["wheel_hop_Hz"] < corners["RR"]["wheel_hop_Hz"] - 0.5
    for name in ("vehicle.png", "animation.gif"):
        assert 10_000 < (work / "drive" / name).stat().st_size < 3_000_000

    log = work / "drive" / "log.parquet"
    said = call("estimate", log, "--out", "all")
    assert "warning" in said  # a rough road, a lane change and wrong dampers are no quarter cars
    final = summary(work / "all")["results"]["final_pressure_Pa"]
    assert min(final, key=final.get) == "RL"
    said = call("estimate", log, "--corner", "RL", "--out", "result", status=2)
    assert "wheelhop vehicle --axle rear" in said
    said = call("estimate", log, "--corner", "FL", "--out", "result")
    assert "against the truth after" in said
    assert summary(work / "result")["results"]["over_time"][0]["true_pressure_Pa"] == 230e3


def test_two_measured_tracks_and_a_leak(work):
    x = 0.1 * np.arange(1101)
    left, right = 0.01 * np.sin(x), 0.02 * np.cos(0.7 * x)
    rows = np.column_stack([x, left, right])
    header = "x_m,z_left_m,z_right_m"
    np.savetxt("road.csv", rows, delimiter=",", header=header, comments="")
    call(
        *DRIVE,
        *("--road", "road.csv", "--pressures", "230", "--end-pressures", "230,230,180,230"),
        *("--noise", 0, "--no-anti-roll", "--out", "drive"),
    )
    table = pq.read_table(work / "drive" / "log.parquet").to_pydict()
    column = {name: np.array(table[name]) for name in table}
    np.testing.assert_allclose(column["pressure_RL"][[-1]], 180e3, rtol=1e-6)
    np.testing.assert_allclose(column["pressure_FL"], 230e3)
    np.testing.assert_array_equal(column["a_u_FL"], column["true_wheel_acceleration_FL"])
    # the contact patch smooths waves of 6 m by less than 1 %
    front = column["true_x"] + 1.347
    after = front > 12.0
    datum = 0.5 * (left[0] + right[0])
    for corner, z in (("FL", left), ("FR", right)):
        expected = np.interp(front, x, z) - datum
        np.testing.assert_allclose(column[f"elevation_{corner}"][after], expected[after], atol=3e-4)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--vehicle", "suv", "--pressure", 200), "--pressure: the full vehicle suv does not"),
        (("--vehicle", "suv", "--convention", "iso8608"), "--convention: the full vehicle suv"),
        (("--vehicle", "suv", "--maneuver", "loop"), "--maneuver: 'loop' is unknown. Use one of"),
        (("--vehicle", "suv", "--peak", 0.5), "Use it with --maneuver lane-change"),
        (("--vehicle", "suv", "--contact", "flat"), "--contact: 'flat' is unknown"),
        (("--vehicle", "suv", "--pressures", "230,230"), "not one or four numbers"),
        (("--vehicle", "suv", "--pressures", "230,230,180,x"), "not one or four numbers"),
        (("--vehicle", "suv", "--pressures", "230,230,180,3"), "--pressures: 3 kPa is outside"),
        (("--vehicle", "suv", "--end-pressures", "1"), "--end-pressures: 1 kPa is outside"),
        (("--vehicle", "suv", "--speed", 900), "--speed: 900 km/h is outside"),
        (("--vehicle", "suv", "--duration", 0), "--duration: 0 s is outside"),
        (("--vehicle", "suv", "--rate", 1), "--rate: 1 Hz is outside"),
        (("--vehicle", "suv", "--noise", -1), "sensor.noise: -1"),
        (("--vehicle", "suv", "--waviness", 2.2), "Use it with a random road"),
        (("--vehicle", "suv", "--road", "iso:B", "--reflect"), "Use it with a measured road"),
        (("--vehicle", "suv", "--road", "iso:B", "--track", "z"), "Use it with a table"),
        (("--vehicle", "suv", "--road", "iso:Q"), "'Q' is not an ISO 8608 class"),
        (("--vehicle", "suv", "--road", "no.csv"), "no.csv: there is no such file"),
        (("--vehicle", "suv", "--road", "ROAD"), "--reflect to continue the road"),
        (("--vehicle", "suv", "--tire", "no.tir"), "no.tir"),
        (("--vehicle", "suv", "--out", "drive.csv"), "Name a directory"),
        (("--vehicle", "bmw-e90", "--no-anti-roll"), "Use it with suv"),
        (("--vehicle", "lorry"), "'lorry' is neither a full vehicle nor a file"),
        ((), "--road: it is missing"),
        (("--road", "iso:B", "--maneuver", "slope"), "--maneuver: a single corner does not take"),
        (("--road", "iso:B", "--pressures", "230"), "Give --pressure. Choose a full vehicle"),
        (("--road", "iso:B", "--animate"), "--animate: a single corner does not take it"),
        (("--road", "iso:B", "--no-anti-roll"), "--anti-roll/--no-anti-roll: a single corner"),
    ],
)
def test_what_does_not_fit_is_refused_by_name(work, arguments, message):
    x = 0.1 * np.arange(301)
    np.savetxt("road.csv", np.stack([x, 0 * x], 1), delimiter=",", header="x_m,z_m", comments="")
    before = sorted(work.iterdir())
    places = {"ROAD": "road.csv"}
    said = call("simulate", *(places.get(a, a) for a in arguments), status=2)
    assert message in said
    assert sorted(work.iterdir()) == before
