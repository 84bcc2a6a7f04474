"""`wheelhop reproduce`: what it prints and writes, how it resumes and what it refuses."""

import json

import jax.numpy as jnp
import numpy as np
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from wheelhop.cli import app
from wheelhop.io.vehicles import read_vehicle
from wheelhop.studies.brancati import records as brancati_records
from wheelhop.vehicle.parameters import BRANCATI_TABLE_3, brancati_suv
from wheelhop.vehicle.quarter_car import RelativeState, simulate
from wheelhop.vehicle.record import CornerRecord
from wheelhop.vehicle.tire import stiffness_from_pressure

RUNNER = CliRunner(env={"COLUMNS": "120", "NO_COLOR": "1", "TERM": "dumb"})
TABLE = ("reproduce", "brancati", "--table", 3)


def call(*arguments, status=0):
    result = RUNNER.invoke(app, [str(a) for a in arguments])
    text = result.stdout + result.stderr
    assert result.exit_code == status, text
    assert "Traceback" not in text
    return " ".join(text.split())


def quarter_car_drive(settings, scenario):
    """A stand-in for the full vehicle, which costs half a minute to compile: the start's corner."""
    rng = np.random.default_rng(round(scenario.pressure) + settings.seed)
    n = round(1e3 * settings.duration)
    rise = 1e-3 * np.sqrt(np.pi * 4e-6 * scenario.speed * 1e3) * rng.normal(size=n)
    rise[0] = 0.0
    zero = jnp.zeros(())
    car = brancati_suv()
    k_t = stiffness_from_pressure(scenario.pressure, car.tire)
    rest = RelativeState(zero, zero, zero, zero)
    a = simulate(rest, k_t, jnp.asarray(rise)[:, None], 1e-3, car).accelerations
    noise = 0.1 * rng.normal(size=(2, n))
    t, full = 1e-3 * np.arange(1, n + 1), np.ones(n)
    return CornerRecord(
        t,
        np.asarray(a.a_s) + noise[0],
        np.asarray(a.a_u) + noise[1],
        scenario.speed * full,
        scenario.pressure * full,
        np.cumsum(rise),
    )


def test_table_3_end_to_end(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(brancati_records, "drive_scenario", quarter_car_drive)
    said = call(*TABLE, "--quick", "--classes", "D", "--out", "table3")
    for words in ("paper D", "ours D", "14,708", "norm of the RMSE", "each set on every class"):
        assert words in said
    out = tmp_path / "table3"
    written = {p.name for p in out.iterdir() if p.is_file()}
    assert written == {
        *("table3.csv", "table3_rmse.parquet", "suspension_D.toml", "summary.json"),
        *("table3_overlay.png", "table3_rmse.png"),
    }
    assert all(name in said for name in written)

    found, true = read_vehicle(out / "suspension_D.toml"), brancati_suv()
    assert found.suspension.stiffness == pytest.approx(true.suspension.stiffness, rel=0.03)
    assert found.suspension.damping == pytest.approx(true.suspension.damping, rel=0.1)
    assert found.tire == true.tire

    lines = (out / "table3.csv").read_text().splitlines()
    assert lines[0].startswith("set,damping [Ns/m],quadratic_damping [Ns^2/m^2],stiffness [N/m]")
    rows = {row.split(",")[0]: row.split(",")[1:] for row in lines[1:]}
    assert float(rows["paper D"][0]) == BRANCATI_TABLE_3["D"].damping
    assert float(rows["ours D"][0]) == pytest.approx(found.suspension.damping, rel=1e-8)
    assert float(rows["ours D"][4]) > 0
    assert rows["paper D"][4:] == [""] * 8

    errors = pq.read_table(out / "table3_rmse.parquet")
    assert errors.schema.field("rmse_a_u").metadata[b"unit"] == b"m/s^2"
    columns = errors.to_pydict()
    assert columns["set"][::3] == ["start", "paper D", "ours D"]
    assert columns["pressure"][:3] == [130e3, 180e3, 230e3]
    # what is left of the true corner is the noise
    np.testing.assert_allclose(columns["rmse_a_s"][:3], 0.1, rtol=0.05)

    summary = json.loads((out / "summary.json").read_text())
    assert summary["settings"]["quick"] is True
    assert summary["settings"]["classes"] == ["D"]
    sets = summary["results"]["sets"]
    norm = np.linalg.norm([columns["rmse_a_s"][3:6], columns["rmse_a_u"][3:6]])
    assert sets["paper D"]["norm_of_rmse_m_per_s2"]["D"] == pytest.approx(norm)
    assert sets["paper D"]["hop_damping_ratio"] > 1 > sets["ours D"]["hop_damping_ratio"]

    def never(*args):
        raise AssertionError("a drive was driven again")

    monkeypatch.setattr(brancati_records, "drive_scenario", never)
    said = call(*TABLE, "--quick", "--classes", "D", "--out", "table3")
    assert "resuming: 3 of 3 drives are in table3/records already" in said
    again = json.loads((out / "summary.json").read_text())["results"]["sets"]["ours D"]
    assert again["parameters"] == sets["ours D"]["parameters"]
    said = call(*TABLE, "--quick", "--classes", "D", "--seed", 1, "--out", "table3", status=2)
    assert "--out: table3/records holds drives of other settings (seed)" in said


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("reproduce", "kalman", "--table", 3), "PAPER: 'kalman' is unknown. There is"),
        (("reproduce", "brancati", "--table", 9), "--table: 9 of brancati is not reproduced"),
        (("reproduce", "brancati", "--runs", 1), "--runs: 1 runs is outside 2"),
        (("reproduce", "brancati", "--duration", 1), "--duration: 1 s is outside 4"),
        (("reproduce", "brancati", "--classes", "E"), "--classes: 'E' is not in the paper's"),
        (("reproduce", "brancati", "--measured-road", "no.txt"), "--measured-road: no.txt is no"),
        ((*TABLE, "--runs", 10), "--runs: table 3 has none"),
        ((*TABLE, "--classes", "AE"), "--classes: 'E' is not in the paper's Table 3"),
        ((*TABLE, "--classes", "AA"), "Give each class once"),
        ((*TABLE, "--duration", 1), "--duration: 1 s is outside"),
        ((*TABLE, "--noise", -1), "--noise: -1 m/s^2 is outside"),
        ((*TABLE, "--starts", 0), "--starts: 0 starting points is outside"),
        ((*TABLE, "--precision", "float16"), "--precision: 'float16' is unknown"),
        ((*TABLE, "--out", "FILE"), "is no usable directory"),
    ],
)
def test_what_cannot_be_reproduced_is_refused_by_name(tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("")
    said = call(*("file" if a == "FILE" else a for a in arguments), status=2)
    assert message in said
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_help_has_an_example():
    assert "wheelhop reproduce brancati --table 3" in call("reproduce", "--help")
