"""Vehicles, roads and results on disk."""

import json

import numpy as np
import pyarrow.parquet as pq
import pytest

from wheelhop.errors import InputError
from wheelhop.io.results import (
    output_directory,
    require_writable,
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


def write_road(path, header, *columns):
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=header, comments="")
    return path


def test_a_road_with_several_tracks(tmp_path):
    x = 0.1 * np.arange(50)
    path = write_road(
        tmp_path / "r.csv", "x_m,speed,z_left,z_mid,z_right", x, 9 * x, np.sin(x), np.cos(x), x
    )
    profile, name = read_road(path)
    assert name == "z_mid"
    np.testing.assert_allclose(profile.elevation, np.cos(x), atol=1e-12)
    np.testing.assert_allclose(read_road(path, "z_left")[0].elevation, np.sin(x), atol=1e-12)
    with pytest.raises(InputError, match="Use one of z_left, z_mid, z_right"):
        read_road(path, "centre")


@pytest.mark.parametrize("header", ["x [m],z [mm]", "x_m,z_mm", "x_km,z [mm]"])
def test_a_road_declares_its_units(tmp_path, header):
    x = np.arange(20.0) * (1e-3 if "km" in header else 1.0)
    profile, _ = read_road(write_road(tmp_path / "r.csv", header, x, np.arange(20.0)))
    assert profile.elevation[-1] == pytest.approx(0.019)
    assert profile.length == pytest.approx(19.0)


@pytest.mark.parametrize(
    ("header", "x", "z", "message"),
    [
        ("s,z", np.arange(9.0), np.arange(9.0), "Name the distance column x_m"),
        ("x_m,height", np.arange(9.0), np.arange(9.0), "choose a column with --track"),
        ("x_m,z [bar]", np.arange(9.0), np.arange(9.0), "'bar' is not a unit of length"),
        ("x_m,z_m", 0.1 * np.arange(99), 50.0 * (-1.0) ** np.arange(99), "write z_mm"),
        ("x_m,z_m", np.r_[np.arange(9.0), 60 + np.arange(9.0)], np.zeros(18), "a hole of 52 m"),
    ],
)
def test_an_unusable_road_file_is_told(tmp_path, header, x, z, message):
    with pytest.raises(InputError, match=message):
        read_road(write_road(tmp_path / "r.csv", header, x, z))


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


def test_a_full_disk_is_told_and_leaves_no_litter(tmp_path):
    def fail(temporary):
        raise OSError(28, "No space left on device")

    with pytest.raises(InputError, match="No space left on device"):
        write_atomically(tmp_path / "x.json", fail)
    assert list(tmp_path.iterdir()) == []


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
    with pytest.raises(InputError, match="no usable directory"):
        require_writable(tmp_path / "out" / "deeper")
    with pytest.raises(InputError, match="is a directory"):
        write_json(tmp_path, {})
    require_writable(tmp_path / "new" / "deeper")
    assert not (tmp_path / "new").exists()
