"""`wheelhop bound` end to end."""

import json

import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from wheelhop.cli import app
from wheelhop.evaluation.bounds import corner_information
from wheelhop.evaluation.linearisation import linearised
from wheelhop.evaluation.spectra import IsoRoad
from wheelhop.vehicle.parameters import brancati_suv

RUNNER = CliRunner(env={"COLUMNS": "200", "NO_COLOR": "1", "TERM": "dumb"})


def call(*arguments, status=0):
    result = RUNNER.invoke(app, ["bound", *(str(a) for a in arguments)])
    text = result.stdout + result.stderr
    assert result.exit_code == status, text
    assert "Traceback" not in text
    return " ".join(text.split())


def results(directory):
    return json.loads((directory / "summary.json").read_text())["results"]


def test_help_has_an_example():
    assert "Example: wheelhop bound" in call("--help")


def test_table_figure_and_files(tmp_path):
    said = call("--speed", 60, "--class", "B", "--time", 10, "--out", tmp_path)
    assert "road level unknown" in said
    assert "wrote bound.png, bound.parquet, summary.json" in said
    table = pq.read_table(tmp_path / "bound.parquet")
    assert table.schema.field("unknown_pressure").metadata[b"unit"] == b"Pa"
    assert table["time"].to_numpy()[-1] == pytest.approx(10.0)
    found = results(tmp_path)
    # 11.4 to 11.8 % at 2 s, 5.1 to 5.2 % at 10 s
    assert found["unknown"]["stiffness"][0] == pytest.approx(0.116, abs=0.003)
    assert found["unknown"]["stiffness"][-1] == pytest.approx(0.052, abs=0.001)
    assert found["unknown"]["pressure_Pa"][-1] == pytest.approx(
        table["unknown_pressure"].to_numpy()[-1]
    )
    percent = 100 * found["unknown"]["stiffness"][-1]
    assert f"{found['unknown']['pressure_Pa'][-1] / 1e3:.1f} ({percent:.1f})" in said
    assert (tmp_path / "bound.png").stat().st_size > 10_000


def test_a_prior_and_a_walk_keep_the_bound_between_two_limits(tmp_path):
    call(
        "--class",
        "8e-6",
        "--prior-pressure-sigma",
        5,
        "--walk",
        1,
        "--time",
        100,
        "--unknown",
        "level,m_s,k_s,c_s,m_u",
        "--out",
        tmp_path,
    )
    found = results(tmp_path)
    # a common factor of masses, springs and dampers stays unknown, the walk itself is followed
    assert 5e3 < found["more"]["pressure_Pa"][-1] < 1e3 * (25 + 100) ** 0.5
    car, road = brancati_suv(), IsoRoad(8e-6)
    linear = linearised(car, 180e3, road, 60 / 3.6)
    rate = float(corner_information(linear, 180e3, road, 60 / 3.6, free=("k_t",)).rate[0, 0])
    # P' = walk^2 - rate P^2 has come to rest
    pascal = 250e3 / 0.7 * (1 + 0.7 * (180 - 250) / 250)
    steady = pascal * (1e3 / pascal / rate**0.5) ** 0.5
    assert found["known"]["pressure_Pa"][-1] == pytest.approx(steady, rel=1e-6)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("--class", "Z"), "Use one of A to H"),
        (("--unknown", "level,mass"), "--unknown: 'mass' is no parameter"),
        (("--speed", 0), "--speed: 0 km/h is outside"),
        (("--noise", 0), "--noise"),
        (("--walk", -1), "--walk"),
        (("--time", 0.1), "--time"),
        (("--vehicle", "none.toml"), "none.toml"),
    ],
)
def test_bad_input_says_what_to_do(tmp_path, arguments, says):
    assert says in call(*arguments, "--out", tmp_path / "out", status=2)
    assert not (tmp_path / "out").exists()
