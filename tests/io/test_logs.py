"""Logs in and out: units, sidecars, and every kind of unusable file told in one line."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from wheelhop.errors import InputError, InputWarning
from wheelhop.io.logs import read_log, write_log
from wheelhop.io.tables import read_table
from wheelhop.io.units import to_si
from wheelhop.vehicle.record import CornerRecord


def good_record(samples=500, rate=500.0, pressure=True):
    rng = np.random.default_rng(0)
    t = np.arange(1, samples + 1) / rate
    return CornerRecord(
        t,
        rng.normal(size=samples),
        5 * rng.normal(size=samples),
        np.full(samples, 16.0),
        np.full(samples, 200e3) if pressure else None,
    )


def write_csv(path, header, columns):
    rows = np.column_stack(columns)
    lines = [header] + [",".join("" if np.isnan(v) else repr(float(v)) for v in r) for r in rows]
    path.write_text("\n".join(lines) + "\n")
    return path


HEADER = "t [s],a_s [m/s^2],a_u [m/s^2],v [m/s]"


def columns(record):
    return [record.t, record.a_s, record.a_u, record.v]


@pytest.mark.parametrize("ending", [".csv", ".parquet"])
@pytest.mark.parametrize("pressure", [True, False])
def test_a_written_log_reads_back(tmp_path, ending, pressure):
    record = good_record(pressure=pressure)
    path = write_log(tmp_path / f"log{ending}", record)
    found = read_log(path)
    for name in ("t", "a_s", "a_u", "v"):
        np.testing.assert_allclose(getattr(found, name), getattr(record, name), rtol=1e-8)
    assert (found.pressure is None) == (not pressure)


def test_units_are_converted(tmp_path):
    r = good_record()
    path = write_csv(
        tmp_path / "log.csv",
        "# a comment\nt [ms],a_s [g],a_u [m/s²],v [km/h]",
        [1e3 * r.t, r.a_s / 9.80665, r.a_u, 3.6 * r.v],
    )
    found = read_log(path)
    np.testing.assert_allclose(found.t, r.t, rtol=1e-9)
    np.testing.assert_allclose(found.a_s, r.a_s, rtol=1e-9)
    np.testing.assert_allclose(found.v, 16.0)


def test_a_toml_beside_the_log_declares_units_and_names(tmp_path):
    r = good_record()
    path = write_csv(tmp_path / "log.csv", "time,body,wheel,speed", columns(r))
    (tmp_path / "log.toml").write_text(
        '[units]\nt = "s"\na_s = "m/s^2"\na_u = "m/s^2"\nv = "m/s"\n'
        '[columns]\nt = "time"\na_s = "body"\na_u = "wheel"\nv = "speed"\n'
    )
    np.testing.assert_allclose(read_log(path).a_u, r.a_u)


def test_parquet_units_may_stand_in_the_column_names(tmp_path):
    r = good_record()
    names = HEADER.split(",")
    pq.write_table(pa.table(dict(zip(names, columns(r), strict=True))), tmp_path / "log.parquet")
    np.testing.assert_allclose(read_log(tmp_path / "log.parquet").a_s, r.a_s)


def damaged(kind):
    """Header and columns of a log with one thing wrong, and what must be said of it."""
    r = good_record()
    t, a_s, a_u, v = (c.copy() for c in columns(r))
    header = HEADER
    if kind == "no unit":
        header = "t [s],a_s,a_u [m/s^2],v [m/s]"
    elif kind == "wrong unit":
        header = "t [s],a_s [m/s^2],a_u [kg],v [m/s]"
    elif kind == "missing column":
        header = "t [s],a_s [m/s^2],wheel [m/s^2],v [m/s]"
    elif kind == "twice":
        header = "t [s],a_s [m/s^2],a_s [m/s^2],v [m/s]"
    elif kind == "backwards":
        t[100] = t[98]
    elif kind == "irregular":
        t[200:] += 0.4 * 0.002
    elif kind == "slow":
        t *= 500 / 40
    elif kind == "long gap":
        t[250:] += 3.0
    elif kind == "stuck":
        a_u[:] = 1.25
    elif kind == "empty channel":
        a_s[:] = np.nan
    elif kind == "reverse":
        v[10] = -1.0
    elif kind == "parked":
        v[:] = 0.0
    elif kind == "km/h as m/s":
        v[:] = 180.0
    elif kind == "gravity":
        a_s += 9.81
    elif kind == "huge":
        a_u *= 1e6
    elif kind == "short":
        t, a_s, a_u, v = (c[:20] for c in (t, a_s, a_u, v))
    elif kind == "two levels":
        a_u[:250], a_u[250:] = 1.0, 2.0
    elif kind == "nan gap":
        t = np.arange(1, 2001) / 500
        a_s, a_u, v = np.tile(a_s, 4), np.tile(a_u, 4), np.tile(v, 4)
        a_s[300:1400] = np.nan
    elif kind == "standstill":
        v[:480] = 0.1
    elif kind == "no speed":
        v[:] = np.nan
    elif kind == "no time":
        t[3] = np.nan
    return header, [t, a_s, a_u, v]


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("no unit", r"column 'a_s': .* declares no unit.*'a_s \[m/s\^2\]'"),
        ("wrong unit", r"column 'a_u': 'kg' is not a unit of acceleration"),
        ("missing column", r"column 'a_u': .*has only t, a_s, wheel, v.*\[columns\]"),
        ("twice", "'a_s' appears twice"),
        ("backwards", r"t: time goes from 0\.2 to 0\.198 s at data row 101"),
        ("irregular", r"t: the interval at data row 201 is 2\.8 ms while the median is 2 ms"),
        ("slow", r"t: the sampling rate of 40 Hz cannot show a wheel hop"),
        ("long gap", r"t: there is a gap of 3\.002 s at data row 251"),
        ("stuck", r"a_u: it is constant at 1\.25 m/s\^2: the channel is stuck"),
        ("empty channel", "a_s: no sample is a number"),
        ("reverse", r"v: speed is -1 m/s at t = 0\.022 s"),
        ("parked", "v: the vehicle never exceeds 0 m/s"),
        ("km/h as m/s", r"v: speed reaches 180 m/s.*km/h"),
        ("gravity", r"a_s: its mean is 9\.\d+ m/s\^2: gravity is still in it"),
        ("huge", "a_u: it reaches"),
        ("short", "t: the log has 20 samples"),
        ("two levels", "a_u: only 0 of 500 samples can be used"),
        ("nan gap", r"a_s: there is a gap of 2\.2 s without a usable sample"),
        ("standstill", "v: the vehicle is slower than 1 m/s for 96 % of the log"),
        ("no speed", "v: no speed in any row"),
        ("no time", "t: no time at data row 4"),
    ],
)
def test_an_unusable_log_is_told(tmp_path, kind, message):
    path = write_csv(tmp_path / "log.csv", *damaged(kind))
    with pytest.raises(InputError, match=message) as caught:
        read_log(path)
    assert caught.value.remedy.endswith(".")


def test_files_that_are_no_tables_are_told(tmp_path):
    cases = {
        "none.csv": None,
        "empty.csv": b"",
        "header.csv": HEADER.encode() + b"\n",
        "text.csv": (HEADER + "\n1,2,x,4\n").encode(),
        "ragged.csv": (HEADER + "\n1,2,3\n").encode(),
        "binary.csv": bytes(range(256)),
        "long.csv": (HEADER + "\n" + "1" * 200_000 + ",2,3,4\n").encode(),
        "broken.parquet": b"PAR1 not really",
        "log.xlsx": b"something",
    }
    messages = {
        "none.csv": "no such file",
        "empty.csv": "the file is empty",
        "header.csv": "no data rows",
        "text.csv": r"line 2, column 'a_u': 'x' is not a number",
        "ragged.csv": "line 2 has 3 cells and the header 4",
        "binary.csv": "not a CSV text",
        "long.csv": "not a CSV text",
        "broken.parquet": "not a readable Parquet file",
        "log.xlsx": "not a known table",
    }
    for name, content in cases.items():
        if content is not None:
            (tmp_path / name).write_bytes(content)
        with pytest.raises(InputError, match=messages[name]):
            read_table(tmp_path / name)


def test_missing_rows_become_missing_samples(tmp_path):
    r = good_record()
    keep = np.ones(500, bool)
    keep[100:110] = False
    path = write_csv(tmp_path / "log.csv", HEADER, [c[keep] for c in columns(r)])
    with pytest.warns(InputWarning, match="10 rows are missing"):
        found = read_log(path)
    assert len(found.t) == 500
    assert np.isnan(found.a_s[100:110]).all()
    np.testing.assert_allclose(found.a_s[110:], r.a_s[110:])
    np.testing.assert_allclose(found.v, 16.0)


def test_nan_gaps_and_a_channel_stuck_for_a_while_are_bridged_with_warnings(tmp_path):
    r = good_record(samples=1500)
    a_s, a_u = r.a_s.copy(), r.a_u.copy()
    a_s[50:60] = np.nan
    a_u[600:900] = a_u[600]
    path = write_csv(tmp_path / "log.csv", HEADER, [r.t, a_s, a_u, r.v])
    with pytest.warns(InputWarning) as caught:
        found = read_log(path)
    said = " ".join(str(w.message) for w in caught)
    assert "300 samples repeat one value" in said
    assert "10 of 1500 samples are missing" in said
    assert np.isnan(found.a_u[600:900]).all()
    assert np.isfinite(found.a_u[900:]).all()


def test_standing_still_for_a_part_is_a_warning(tmp_path):
    r = good_record()
    v = r.v.copy()
    v[:100] = 0.0
    path = write_csv(tmp_path / "log.csv", HEADER, [r.t, r.a_s, r.a_u, v])
    with pytest.warns(InputWarning, match="20 % of the log is slower"):
        read_log(path)


def test_unit_factors():
    assert to_si("x", "pressure", "bar") == 1e5
    assert to_si("x", "speed", "km/h") == pytest.approx(1 / 3.6)
    with pytest.raises(InputError, match="'furlong' is not a unit of length"):
        to_si("x", "length", "furlong")


def test_an_unknown_field_in_the_toml_is_told(tmp_path):
    path = write_csv(tmp_path / "log.csv", HEADER, columns(good_record()))
    (tmp_path / "log.toml").write_text('[units]\naccel = "g"\n')
    with pytest.raises(InputError, match="'accel' is no field"):
        read_log(path)
    (tmp_path / "log.toml").write_text("[units]\nt = 5\n")
    with pytest.raises(InputError, match="5 is no text"):
        read_log(path)
    (tmp_path / "log.toml").write_text("units = 3\n")
    with pytest.raises(InputError, match=r"Write \[units\]"):
        read_log(path)
    (tmp_path / "log.toml").write_text("[units\n")
    with pytest.raises(InputError, match="not TOML"):
        read_log(path)


def test_a_directory_an_upper_case_ending_and_a_text_column(tmp_path):
    with pytest.raises(InputError, match="it is a directory"):
        read_log(tmp_path)
    r = good_record()
    path = write_csv(tmp_path / "LOG.CSV", HEADER, columns(r))
    np.testing.assert_allclose(read_log(path).v, r.v)
    texts = pa.table({"t [s]": r.t, "a_s": ["x"] * len(r.t)})
    pq.write_table(texts, tmp_path / "log.parquet")
    with pytest.raises(InputError, match=r"a_s \(string, no numbers\)"):
        read_log(tmp_path / "log.parquet")
