"""Logs for wheel loads: units, names, gaps, what is missing, and what is refused."""

import numpy as np
import pytest

from wheelhop.errors import InputError, InputWarning
from wheelhop.io.load_logs import LEVER_ARMS, read_load_log
from wheelhop.vehicle.load_record import VehicleLoadSample, checked_load

COUNT, DT = 400, 0.01
T = DT * np.arange(COUNT)
CORNERS = ("FL", "FR", "RL", "RR")


def wave(k):
    return np.sin(5.0 * T + k)


SAMPLE = VehicleLoadSample(
    *(0.8 * wave(k) for k in range(4)),
    *(0.02 * wave(k) for k in range(4)),
    *(3.0 * wave(k) for k in range(4)),
)


def written(path, columns):
    """A CSV of these columns, header to values."""
    rows = np.column_stack(list(columns.values()))
    lines = [",".join(columns), *(",".join(repr(float(v)) for v in row) for row in rows)]
    path.write_text("\n".join(lines))
    return path


def columns(**changed):
    """A log as a test car might export it, in its own units."""
    found = {"t [ms]": 1e3 * T}
    for k, corner in enumerate(CORNERS):
        found[f"a_s_{corner} [g]"] = SAMPLE[k] / 9.80665
        found[f"compression_{corner} [mm]"] = 1e3 * SAMPLE[4 + k]
        found[f"a_u_{corner} [m/s^2]"] = SAMPLE[8 + k]
        found[f"true_load_{corner} [kN]"] = 5.0 + wave(k)
    return {**found, "v [km/h]": np.full(COUNT, 72.0), **changed}


def without(*beginnings):
    return {n: v for n, v in columns().items() if not n.startswith(beginnings)}


def test_every_unit_is_converted(tmp_path):
    found = read_load_log(written(tmp_path / "drive.csv", columns()))
    assert found.dt == pytest.approx(DT)
    for got, wanted in zip(found.sample, SAMPLE, strict=True):
        np.testing.assert_allclose(got, wanted, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(found.speed, 20.0)
    np.testing.assert_allclose(found.true_load[:, 2], 5e3 + 1e3 * wave(2))
    assert found.a_x is None
    assert found.a_y is None


def test_without_wheel_accelerometers_or_all_true_loads_the_log_still_serves(tmp_path):
    found = read_load_log(written(tmp_path / "drive.csv", without("a_u", "v", "true_load_RR")))
    assert np.isnan(np.stack(found.sample[8:])).all()
    assert found.speed is None
    assert found.true_load is None
    np.testing.assert_allclose(found.sample.a_s_RR, SAMPLE.a_s_RR, atol=1e-14)


def test_wheel_accelerometers_can_be_left_out():
    found = checked_load(T, SAMPLE).without_wheel_accelerometers()
    assert np.isnan(np.stack(found.sample[8:])).all()
    np.testing.assert_array_equal(np.stack(found.sample[:8]), np.stack(SAMPLE[:8]))


def test_a_declaration_beside_the_log_names_columns_and_units(tmp_path):
    renamed = without("compression_FL", "true_load_FL") | {"pot 1": 1e3 * SAMPLE.compression_FL}
    renamed |= {"wheel force 1": 5e3 + wave(0)}
    path = written(tmp_path / "drive.csv", renamed)
    (tmp_path / "drive.toml").write_text(
        '[columns]\ncompression_FL = "pot 1"\ntrue_load_FL = "wheel force 1"\n'
        '[units]\ncompression_FL = "mm"\ntrue_load_FL = "N"\n'
    )
    found = read_load_log(path)
    np.testing.assert_allclose(found.sample.compression_FL, SAMPLE.compression_FL, atol=1e-15)
    np.testing.assert_allclose(found.true_load[:, 0], 5e3 + wave(0))


def test_lever_arms_need_two_columns_and_no_suspension(tmp_path):
    log = {"t [s]": T, "a_x [g]": 0.3 * wave(0), "a_y [m/s^2]": wave(1)}
    found = read_load_log(written(tmp_path / "drive.csv", log), None, LEVER_ARMS)
    np.testing.assert_allclose(found.a_x, 0.3 * 9.80665 * wave(0))
    assert np.isnan(np.stack(found.sample)).all()


@pytest.mark.parametrize(
    ("absent", "needed", "message"),
    [
        (("a_s_RL",), None, "column a_s_RL: .*has only t, "),
        (("a_s_RL", "a_s_RR"), None, "columns a_s_RL, a_s_RR"),
        (("t",), None, "column t: "),
        (("compression_FR",), None, "--method algebraic .* a_x and a_y, which this log lacks too"),
        (("a_x",), LEVER_ARMS, "columns a_x, a_y: .* another --method"),
    ],
)
def test_missing_columns_are_named_with_what_else_would_do(tmp_path, absent, needed, message):
    path = written(tmp_path / "drive.csv", without(*absent))
    options = {} if needed is None else {"needed": needed}
    with pytest.raises(InputError, match=message):
        read_load_log(path, None, **options)


def test_a_log_without_compressions_but_with_a_x_and_a_y_says_so(tmp_path):
    log = without("compression") | {"a_x [g]": wave(0), "a_y [g]": wave(1)}
    with pytest.raises(InputError, match="a_x and a_y, which this log has"):
        read_load_log(written(tmp_path / "drive.csv", log))


def test_units_that_are_missing_or_strange_are_refused(tmp_path):
    bare = without("compression_FL") | {"compression_FL": SAMPLE.compression_FL}
    with pytest.raises(InputError, match=r"compression_FL.*declares no unit"):
        read_load_log(written(tmp_path / "a.csv", bare))
    strange = without("true_load_FL") | {"true_load_FL [kg]": wave(0)}
    with pytest.raises(InputError, match=r"true_load_FL.*'kg' is not a unit of force"):
        read_load_log(written(tmp_path / "b.csv", strange))


def test_a_declared_column_that_is_not_there_is_refused(tmp_path):
    path = written(tmp_path / "drive.csv", columns())
    (tmp_path / "drive.toml").write_text('[columns]\nv = "gps speed"\n')
    with pytest.raises(InputError, match="column gps speed"):
        read_load_log(path)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        (
            {"compression_RL": 20.1 * wave(0)},
            r'compression_RL: it reaches 2.* m, as a .* millimetres does.*compression_RL = "mm"',
        ),
        ({"compression_FR": 0.4 + 0.01 * wave(0)}, "compression_FR: .*design place"),
        ({"a_s_FR": 9.81 + wave(0)}, "a_s_FR: its mean is 9.8.*gravity is still in it. Subtract"),
        ({"a_u_RR": wave(0) - 9.81}, "a_u_RR: its mean is -9.*Turn its sign"),
        ({"a_s_FL": 801.0 * wave(0)}, "a_s_FL: it reaches 80.* m/s"),
        ({"a_s_RL": np.where(T < 3.0, np.nan, 0.0)}, "a_s_RL: 75 % of its samples are missing"),
        ({"compression_RL": np.full(COUNT, np.nan)}, "compression_RL: it has no .*algebraic needs"),
        ({"a_u_FL": np.full(COUNT, np.nan)}, "a_u_FL: it has no sample.*leave the column out"),
        ({"a_s_FR": wave(0)[:-1]}, r"a_s_FR: its shape is \(399,\), \(400,\) by the time"),
        ({"a_u_FR": np.zeros((COUNT, 1))}, r"a_u_FR: its shape is \(400, 1\)"),
    ],
)
def test_signals_that_cannot_be_are_refused_with_the_remedy(changed, message):
    with pytest.raises(InputError, match=message):
        checked_load(T, SAMPLE._replace(**changed))


@pytest.mark.parametrize(
    ("time", "message"),
    [
        (T[::-1], "t: time goes from"),
        (np.where(T[5] == T, np.nan, T), "t: no time at data row 6"),
        (0.1 * np.arange(COUNT), "sampling rate: 10 Hz"),
        (1e-3 * T, "t: the log covers 0.00399 s with 400 rows"),
        (np.where(T[150] == T, T[149] + 1e-4, T), "closer than half the interval"),
        (np.where(T > 2.0, T + 9.0, T), "t: 900 of 1300 samples are missing"),
        (np.full(COUNT, 3.0), "t: it is 3 s in all 400 rows. Give the column that counts"),
        (np.floor(10.0 * T) / 10.0, "t: 360 of 400 rows have .*more digits"),
        (T[:, None], r"t: it has the shape \(400, 1\)"),
        (0.0202 * np.arange(COUNT), "sampling rate: 49.5.* Hz"),
    ],
)
def test_times_that_cannot_be_used_are_refused(time, message):
    with pytest.raises(InputError, match=message):
        checked_load(time, SAMPLE)


def test_other_columns_of_another_length_or_without_samples_are_refused():
    with pytest.raises(InputError, match="a_x: its shape"):
        checked_load(T, SAMPLE, a_x=T[1:])
    with pytest.raises(InputError, match=r"a_x: it has no sample.*not needed\.$"):
        checked_load(T, SAMPLE, a_x=np.full(COUNT, np.nan))
    with pytest.raises(InputError, match=r"true_load: its shape is \(400, 3\)"):
        checked_load(T, SAMPLE, true_load=np.zeros((COUNT, 3)))


def test_50_hz_serves_however_its_times_are_rounded():
    time = 0.02 * np.arange(COUNT) * (1.0 + 1e-9)
    assert checked_load(time, SAMPLE).dt == pytest.approx(0.02)


def test_lever_arms_ignore_a_suspension_without_units(tmp_path):
    log = {"t [s]": T, "a_x [g]": 0.3 * wave(0), "a_y [g]": wave(1), "a_s_FL": wave(0)}
    path = written(tmp_path / "drive.csv", log | {"compression_FL [mm]": np.full(COUNT, np.nan)})
    assert np.isnan(np.stack(read_load_log(path, None, LEVER_ARMS).sample)).all()


def dynamics(pitch=0.0, roll=0.0, heave=0.0):
    """A slow drive: a_x, a_y, heave of the struts behind it, and noise of the compressions."""
    draw = np.random.default_rng(3).normal(0.0, 1e-3, (4, COUNT))
    turn = np.sin(2.0 * T)
    parts = zip((-1, -1, 1, 1), (-1, 1, -1, 1), strict=True)
    q = [
        0.01 * turn * (pitch * p + roll * r + heave) + e
        for (p, r), e in zip(parts, draw, strict=True)
    ]
    body = [0.9 * abs(heave) * turn + 0.0 * T] * 4
    sample = VehicleLoadSample(*body, *q, *SAMPLE[8:])
    return sample, 3.0 * abs(pitch) * turn, 3.0 * abs(roll) * turn


@pytest.mark.parametrize("kind", ["pitch", "roll", "heave"])
def test_compressions_of_the_wrong_sign_are_told(kind):
    reverse, a_x, a_y = dynamics(**{kind: -1.0})
    with pytest.warns(InputWarning, match="turn the sign of compression_FL"):
        checked_load(T, reverse, a_x=a_x, a_y=a_y)
    # warnings are errors
    right, a_x, a_y = dynamics(**{kind: 1.0})
    checked_load(T, right, a_x=a_x, a_y=a_y)
    # too little motion to judge by
    checked_load(
        T,
        reverse._replace(
            **dict(zip(reverse._fields[:4], 0.1 * np.stack(reverse[:4]), strict=True))
        ),
        a_x=0.1 * a_x,
        a_y=0.1 * a_y,
    )


def test_offsets_gaps_and_sensors_at_rest_are_told():
    with pytest.warns(InputWarning, match=r"a_s_FL: its mean is 0\.9"):
        checked_load(T, SAMPLE._replace(a_s_FL=SAMPLE.a_s_FL + 0.9))
    with pytest.warns(InputWarning, match=r"compression_RR: it moves by 0\.04 mm"):
        checked_load(T, SAMPLE._replace(compression_RR=1e-3 * SAMPLE.compression_RR))
    holed = SAMPLE._replace(a_u_FL=np.where(T < 0.4, np.inf, SAMPLE.a_u_FL))
    with pytest.warns(InputWarning, match="a_u_FL: 10 % of its samples"):
        found = checked_load(T, holed)
    assert np.isnan(found.sample.a_u_FL[T < 0.395]).all()


def test_rows_left_out_become_missing_samples_on_the_grid():
    kept = np.delete(np.arange(COUNT), [100, 101, 200])
    sample = VehicleLoadSample(*(entry[kept] for entry in SAMPLE))
    truth = np.stack([5e3 + entry for entry in SAMPLE[:4]], 1)[kept]
    with pytest.warns(InputWarning, match="3 of 400 samples are missing in time"):
        found = checked_load(T[kept], sample, true_load=truth)
    np.testing.assert_allclose(found.t, T, atol=1e-12)
    for signal in (found.sample.compression_FR, found.true_load[:, 1]):
        np.testing.assert_array_equal(np.flatnonzero(np.isnan(signal)), [100, 101, 200])
