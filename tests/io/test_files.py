"""Vehicles, roads and results on disk."""

import json

import numpy as np
import pyarrow.parquet as pq
import pytest

from wheelhop.errors import InputError
from wheelhop.io.results import (
    output_directory,
    write_atomically,
    write_json,
    write_table,
)
from wheelhop.io.roads import read_road
from wheelhop.io.vehicles import read_vehicle, write_vehicle
from wheelhop.vehicle.parameters import brancati_suv


def test_a_vehicle_reads_back_as_written(tmp_path):
    car = brancati_suv("rear", 140.0)
    found = read_vehicle(write_vehicle(tmp_path / "car.toml", car, "rear\nloaded"))
    assert found == car
    assert (tmp_path / "car.toml").read_text().startswith("# rear\n# loaded\n")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[tire]", "[tyre]", r"\[tire\]: this section is missing"),
        ("damping =", "dampingg =", r"\[suspension\]: 'dampingg' is unknown"),
        ("sprung_mass = 466", "sprung_mass = -466", r"quarter_car\.sprung_mass: -466"),
        ("stiffness = 264700.0", 'stiffness = "hard"', r"tire\.stiffness: 'hard' is not a number"),
        ("nominal_pressure = 250000.0", "", r"tire\.nominal_pressure: .* lacks it"),
        ("[quarter_car]", "[quarter_car", "not TOML"),
    ],
)
def test_a_bad_vehicle_file_is_told(tmp_path, old, new, message):
    path = write_vehicle(tmp_path / "car.toml", brancati_suv())
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(InputError, match=message):
        read_vehicle(path)


def test_a_road_with_several_tracks(tmp_path):
    x = 0.1 * np.arange(50)
    rows = np.column_stack([x, np.sin(x), np.cos(x), x])
    path = tmp_path / "road.csv"
    np.savetxt(path, rows, delimiter=",", header="x_m,left,middle,right", comments="")
    np.testing.assert_allclose(read_road(path).elevation, np.cos(x), atol=1e-12)
    np.testing.assert_allclose(read_road(path, "left").elevation, np.sin(x), atol=1e-12)
    with pytest.raises(InputError, match="Use one of left, middle, right"):
        read_road(path, "centre")


def test_a_road_in_millimetres(tmp_path):
    path = tmp_path / "road.csv"
    rows = np.column_stack([np.arange(20), np.arange(20)])
    np.savetxt(path, rows, delimiter=",", header="x [m],z [mm]", comments="")
    assert read_road(path).elevation[-1] == pytest.approx(0.019)


def test_a_road_without_distance_is_told(tmp_path):
    path = tmp_path / "road.csv"
    path.write_text("s,z\n0,1\n")
    with pytest.raises(InputError, match="Name the distance column x_m"):
        read_road(path)


def test_a_failing_write_leaves_the_old_file_and_no_litter(tmp_path):
    path = tmp_path / "result.json"
    write_json(path, {"a": 1})

    def fail(temporary):
        temporary.write_text("half")
        raise RuntimeError("disk full")

    with pytest.raises(RuntimeError):
        write_atomically(path, fail)
    assert json.loads(path.read_text()) == {"a": 1}
    assert [p.name for p in tmp_path.iterdir()] == ["result.json"]


def test_json_is_plain_and_nan_becomes_null(tmp_path):
    content = {"x": np.float32(1.5), "n": np.int64(2), "bad": float("nan"), "v": np.ones(2)}
    found = json.loads(write_json(tmp_path / "s.json", content).read_text())
    assert found == {"x": 1.5, "n": 2, "bad": None, "v": [1.0, 1.0]}


def test_tables_carry_their_units(tmp_path):
    columns = {"t": np.arange(3.0), "p": np.ones(3)}
    path = write_table(tmp_path / "x.parquet", columns, {"t": "s", "p": "Pa"})
    schema = pq.read_table(path).schema
    assert schema.field("p").metadata == {b"unit": b"Pa"}
    with pytest.raises(InputError, match="no known ending"):
        write_table(tmp_path / "x.xls", columns, {})


def test_a_file_in_the_place_of_the_output_directory_is_told(tmp_path):
    (tmp_path / "out").write_text("")
    with pytest.raises(InputError, match="no usable directory"):
        output_directory(tmp_path / "out")
