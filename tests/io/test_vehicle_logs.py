"""The log of a full vehicle: every channel with its unit, one corner for the estimators."""

import numpy as np
import pyarrow.parquet as pq
import pytest

from wheelhop.errors import InputError
from wheelhop.io.logs import read_log
from wheelhop.io.vehicle_logs import TRUTH_UNITS, vehicle_columns, write_vehicle_log
from wheelhop.vehicle.simulation import Signals
from wheelhop.vehicle.vehicle_record import VehicleRecord

CORNERS = ("FL", "FR", "RL", "RR")
PER_CORNER = {
    *("body_acceleration", "wheel_acceleration", "compression", "compression_rate"),
    *("wheel_speed", "steer", "drive", "brake", "load", "longitudinal", "lateral"),
    *("tire_deflection", "strut", "kappa", "tan_alpha", "elevation", "pressure"),
}


def record(samples=200, rate=500.0):
    rng = np.random.default_rng(0)
    truth = Signals(
        **{
            f: rng.normal(size=(samples, 4) if f in PER_CORNER else samples)
            for f in Signals._fields
        }
    )
    truth = truth._replace(pressure=2e5 + 1e4 * np.arange(4) + np.zeros((samples, 1)))
    measured = {"v": np.full(samples, 20.0)}
    measured |= {f"{n}_{c}": rng.normal(size=samples) for n in ("a_s", "a_u") for c in CORNERS}
    units = dict.fromkeys(measured, "m/s^2") | {"v": "m/s"}
    return VehicleRecord(np.arange(1, samples + 1) / rate, measured, truth, units)


def test_every_signal_is_written_once_with_its_unit():
    columns, units = vehicle_columns(record())
    assert set(TRUTH_UNITS) == set(Signals._fields)
    assert set(columns) == set(units)
    assert len(columns) == 1 + 9 + 4 * len(PER_CORNER) + len(Signals._fields) - len(PER_CORNER)
    assert units["true_load_RR"] == "N"
    assert units["pressure_FL"] == "Pa"
    np.testing.assert_array_equal(columns["true_load_RL"], record().truth.load[:, 2])


@pytest.mark.parametrize("ending", ["parquet", "csv"])
def test_one_corner_reads_back_as_the_record_gives_it(tmp_path, ending):
    r = record()
    path = write_vehicle_log(tmp_path / f"log.{ending}", r)
    for k, corner in enumerate(CORNERS):
        found, expected = read_log(path, corner=corner), r.corner(corner)
        for name in ("t", "a_s", "a_u", "v", "pressure"):
            np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=1e-8)
        np.testing.assert_allclose(found.pressure, 2e5 + 1e4 * k)


def test_parquet_fields_carry_units(tmp_path):
    schema = pq.read_schema(write_vehicle_log(tmp_path / "log.parquet", record()))
    assert schema.field("true_yaw_rate").metadata[b"unit"] == b"rad/s"


def test_the_corner_must_be_chosen_and_held(tmp_path):
    path = write_vehicle_log(tmp_path / "log.parquet", record())
    with pytest.raises(InputError, match="holds the corners FL, FR, RL, RR"):
        read_log(path)
    with pytest.raises(InputError, match=r"'XX' is not in log\.parquet, which holds only FL"):
        read_log(path, corner="XX")
    single = tmp_path / "single.csv"
    t = np.arange(1, 101) / 100
    rows = np.stack([t, np.sin(t), np.cos(9 * t), 10 + t], axis=1)
    header = "t [s],a_s [m/s^2],a_u [m/s^2],v [m/s]"
    np.savetxt(single, rows, delimiter=",", header=header, comments="")
    assert len(read_log(single).t) == 100
    with pytest.raises(InputError, match="one corner without a name"):
        read_log(single, corner="FL")
