"""Logs of stability control's sensors: units, names, gaps, and what is refused."""

import numpy as np
import pytest

from wheelhop.errors import InputError, InputWarning
from wheelhop.io.lateral_logs import read_lateral_log
from wheelhop.vehicle.lateral_record import LateralSample, checked_lateral

COUNT, DT = 300, 0.01
T = DT * np.arange(COUNT)
STEER = 0.02 * np.sin(3.0 * T)
SAMPLE = LateralSample(STEER, np.full(COUNT, 20.0), 3.0 * np.sin(3.0 * T), 0.15 * np.sin(3.0 * T))


def written(path, columns):
    """A CSV of these columns, header to values."""
    rows = np.column_stack(list(columns.values()))
    lines = [",".join(columns), *(",".join(repr(float(v)) for v in row) for row in rows)]
    path.write_text("\n".join(lines))
    return path


def log(path, **changed):
    """A log as stability control might export it, in its own units."""
    columns = {
        "t [s]": T,
        "v [km/h]": 3.6 * SAMPLE.speed,
        "a_y [g]": SAMPLE.lateral_acceleration / 9.80665,
        "yaw_rate [deg/s]": np.rad2deg(SAMPLE.yaw_rate),
        "steering_wheel [deg]": 16.0 * np.rad2deg(STEER),
    }
    return written(path, {**columns, **changed})


def test_every_unit_is_converted_and_the_steering_wheel_divided_by_its_ratio(tmp_path):
    found = read_lateral_log(log(tmp_path / "drive.csv"), 16.0)
    assert found.dt == pytest.approx(DT)
    for got, wanted in zip(found.sample, SAMPLE, strict=True):
        np.testing.assert_allclose(got, wanted, rtol=1e-12, atol=1e-14)


def test_the_front_wheels_angle_is_taken_where_the_log_has_it(tmp_path):
    path = log(tmp_path / "drive.csv", **{"steer [rad]": 2.0 * STEER})
    np.testing.assert_allclose(read_lateral_log(path, 16.0).sample.steer, 2.0 * STEER)


def test_a_declaration_names_columns_and_units(tmp_path):
    path = written(
        tmp_path / "drive.csv",
        {"time": T, "v": SAMPLE.speed, "lat": SAMPLE[2], "r": SAMPLE[3], "steer": STEER},
    )
    (tmp_path / "drive.toml").write_text(
        '[columns]\nt = "time"\na_y = "lat"\nyaw_rate = "r"\n'
        '[units]\nt = "s"\nv = "m/s"\na_y = "m/s^2"\nyaw_rate = "rad/s"\nsteer = "rad"\n'
    )
    found = read_lateral_log(path, 16.0)
    np.testing.assert_allclose(found.sample.lateral_acceleration, SAMPLE.lateral_acceleration)


def test_rows_left_out_become_missing_samples_on_the_grid():
    kept = np.delete(np.arange(COUNT), [100, 101, 200])
    with pytest.warns(InputWarning, match="3 of 300 samples are missing in time"):
        found = checked_lateral(T[kept], LateralSample(*(entry[kept] for entry in SAMPLE)))
    assert len(found.t) == COUNT
    lost = np.flatnonzero(np.isnan(found.sample.yaw_rate))
    np.testing.assert_array_equal(lost, [100, 101, 200])


def test_stamps_rounded_or_jittering_lose_no_row():
    rng = np.random.default_rng(0)
    for rate, spread, digits in ((60.0, 0.0, 2), (120.0, 0.0, 3), (100.0, 2e-3, 6)):
        t = np.arange(600) / rate + rng.uniform(-spread, spread, 600)
        entry = np.sin(np.arange(600.0))
        sample = LateralSample(0.1 * entry, np.full(600, 20.0), entry, entry)
        found = checked_lateral(np.round(t, digits), sample).sample
        np.testing.assert_array_equal(found.yaw_rate, entry)


def test_rows_too_close_to_be_told_apart_are_refused():
    t = T.copy()
    t[150] = t[149] + 1e-4
    with pytest.raises(InputError, match="are closer than half the interval"):
        checked_lateral(t, SAMPLE)


def test_infinite_samples_are_missing():
    sample = SAMPLE._replace(yaw_rate=np.where(T[3] == T, np.inf, SAMPLE.yaw_rate))
    with pytest.warns(InputWarning, match="yaw_rate"):
        found = checked_lateral(T, sample)
    assert np.isnan(found.sample.yaw_rate[3])


def test_missing_entries_are_told():
    gap = SAMPLE.yaw_rate.copy()
    gap[:30] = np.nan
    with pytest.warns(InputWarning, match="yaw_rate: 10 % of its samples"):
        checked_lateral(T, SAMPLE._replace(yaw_rate=gap))


@pytest.mark.parametrize(
    ("time", "changed", "message"),
    [
        (T[::-1], {}, "t: time goes from"),
        (np.where(T[5] == T, np.nan, T), {}, "t: no time at data row 6"),
        (0.5 * np.arange(COUNT), {}, "sampling rate: 2 Hz"),
        (1e-3 * T, {}, "t: the log covers 0.00299 s"),
        (T, {"yaw_rate": 57.3 * SAMPLE.yaw_rate}, "yaw_rate: it reaches 8.59"),
        (T, {"lateral_acceleration": 10.0 * SAMPLE[2]}, "lateral_acceleration: it reaches"),
        (T, {"speed": -SAMPLE.speed}, "speed: it falls to -20 m/s"),
        (T, {"steer": np.where(T < 2.0, np.nan, STEER)}, "steer: 67 % of its samples are missing"),
    ],
)
def test_what_cannot_be_used_is_refused_by_name(time, changed, message):
    with pytest.raises(InputError, match=message):
        checked_lateral(time, SAMPLE._replace(**changed))


def test_a_log_without_a_needed_column_or_unit_is_refused(tmp_path):
    path = written(tmp_path / "a.csv", {"t [s]": T, "v [m/s]": SAMPLE.speed})
    with pytest.raises(InputError, match="column 'a_y'"):
        read_lateral_log(path, 16.0)
    with pytest.raises(InputError, match=r"steering ratio: 0\.5"):
        read_lateral_log(log(tmp_path / "b.csv"), 0.5)
    bare = log(tmp_path / "c.csv", steer=STEER)
    with pytest.raises(InputError, match=r"column .steer.: c\.csv declares no unit"):
        read_lateral_log(bare, 16.0)
