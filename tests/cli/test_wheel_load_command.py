"""`wheelhop wheel-load`: a log in, four loads out; what does not go together is refused."""

import json
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from wheelhop.cli import app
from wheelhop.cli.wheel_load_summary import summary_of, verdict_of
from wheelhop.estimators.joint_load_mixture import WheelLoads
from wheelhop.estimators.load_methods import LoadsFound
from wheelhop.io.results import write_table
from wheelhop.vehicle.full_vehicle_parameters import CORNERS, suv

RUNNER = CliRunner(env={"COLUMNS": "160", "NO_COLOR": "1", "TERM": "dumb"})
DT, COUNT = 0.005, 400
T = DT * np.arange(COUNT)
STATIC = np.array([5176.04, 5176.04, 4707.98, 4707.98])
"""Loads at rest of the SUV of Brancati & Tufano 2022, Table 1 [N]."""


def call(*arguments, status=0):
    found = RUNNER.invoke(app, ["wheel-load", *map(str, arguments)])
    text = found.stdout + found.stderr
    assert found.exit_code == status, text
    return " ".join(text.split())


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """The SUV heaving slowly: springs, dampers and inertia by hand, both sides alike."""
    rate = 2.0 * np.pi * 0.5
    q, speed, bend = (
        0.02 * np.sin(rate * T),
        0.02 * rate * np.cos(rate * T),
        -0.02 * rate**2 * np.sin(rate * T),
    )
    columns = {"t": T, "v": np.full(COUNT, 20.0), "a_x": 0.0 * T, "a_y": 0.0 * T}
    units = {"t": "s", "v": "m/s", "a_x": "m/s^2", "a_y": "m/s^2"}
    wheels = np.asarray(suv().chassis.wheel_mass, float)
    springs = zip(
        CORNERS, (33.6e3, 33.6e3, 35.5e3, 35.5e3), (2800.0,) * 2 + (2700.0,) * 2, strict=True
    )
    for k, (corner, spring, damper) in enumerate(springs):
        body = (spring * q + damper * speed) / (STATIC[k] / 9.80665 - wheels[k])
        load = STATIC[k] + spring * q + damper * speed + wheels[k] * (body + bend)
        columns[f"a_s_{corner}"], units[f"a_s_{corner}"] = body, "m/s^2"
        columns[f"compression_{corner}"], units[f"compression_{corner}"] = q, "m"
        columns[f"true_load_{corner}"], units[f"true_load_{corner}"] = load, "N"
    path = tmp_path_factory.mktemp("wheel-load") / "log.csv"
    write_table(path, columns, units)
    return path


def test_help_has_an_example():
    assert "Example: wheelhop wheel-load" in call("--help")


def test_loads_are_printed_drawn_and_written(log, tmp_path):
    said = call(log, "--method", "youla", "--bandwidth", 20, "--out", tmp_path)
    assert "log.csv: 1.995 s at 200 Hz, 72 km/h; youla" in said
    assert "rms" in said
    assert "no wheel lifts" in said
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["settings"]["bandwidth_Hz"] == 20
    results = summary["results"]
    assert list(results["wheels"]) == list(CORNERS)
    for corner, static in zip(CORNERS, STATIC, strict=True):
        wheel = results["wheels"][corner]
        assert wheel["static_N"] == pytest.approx(static, rel=1e-4)
        # the low-pass comes 13 ms late
        assert wheel["rmse_N"] < 40.0
        assert wheel["lowest_N"] == pytest.approx(wheel["true_lowest_N"], rel=0.01)
    assert results["weight_N"] == pytest.approx(STATIC.sum(), rel=1e-4)
    assert f"lowest load {results['lowest']['load_N']:,.0f} +- " in said
    assert (tmp_path / "wheel_load.png").stat().st_size > 10_000
    table = pq.read_table(tmp_path / "wheel_load.parquet")
    wanted = [f"{n}_{c}" for n in ("load", "sigma", "true_load") for c in CORNERS]
    assert table.column_names == ["t", *wanted, "total", "sigma_total"]
    assert table.field("sigma_RL").metadata[b"unit"] == b"N"
    rear = np.asarray(table["load_RR"])
    assert rear[T >= 0.3].min() == pytest.approx(results["wheels"]["RR"]["lowest_N"])


def test_lever_arms_say_no_sigma(log, tmp_path):
    said = call(log, "--method", "algebraic", "--payload", 200, "--out", tmp_path)
    summary = json.loads((tmp_path / "summary.json").read_text())
    wheel = summary["results"]["wheels"]["FL"]
    assert wheel["mean_sigma_N"] is None
    assert wheel["share_within_2_sigma"] is None
    assert summary["results"]["weight_N"] == pytest.approx(STATIC.sum() + 200 * 9.80665, rel=1e-4)
    assert "+-" not in said
    assert wheel["lifted_s"] is None
    assert "whether a wheel lifts cannot be told" in said
    assert "no wheel lifts" not in said


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--vehicle", "golf"), "--vehicle: 'golf' is no full vehicle"),
        (("--vehicle", "bmw-e90", "--no-anti-roll"), "bmw-e90 is as published"),
        (("--method", "magic"), "--method: 'magic' is unknown. Use one of"),
        (("--method", "youla", "--bandwidth", 60), "--bandwidth: 60 Hz is outside 0.1 to 50 Hz"),
        (("--method", "unbiased", "--bandwidth", 0.05), "--bandwidth: 0.05 Hz"),
        (("--method", "youla", "--find-springs"), "--find-springs: youla takes the springs"),
        (("--noise", 0), "--noise: 0 m/s^2"),
        (("--compression-noise", 5000), "--compression-noise: 5000 mm"),
        (("--payload", 9000), "--payload: 9000 kg"),
        (("--precision", "half"), "--precision: 'half' is unknown"),
    ],
)
def test_what_does_not_go_together_is_refused_in_one_line(log, tmp_path, arguments, message):
    assert message in call(log, *arguments, "--out", tmp_path, status=2)


def test_a_log_without_compressions_is_told_what_else_would_do(tmp_path):
    path = tmp_path / "log.csv"
    write_table(path, {"t": T, "a_x": T, "a_y": T}, {"t": "s", "a_x": "g", "a_y": "g"})
    said = call(path, "--method", "youla", "--out", tmp_path, status=2)
    assert "compression_FL, compression_FR, compression_RL, compression_RR" in said
    assert "--method algebraic" in said


def results(load, sigma=50.0, truth=None, joint=None, given=None):
    """Of four constant loads but for what the front left does."""
    loads = np.broadcast_to(STATIC, (COUNT, 4)).copy()
    loads[:, 0] = load
    spread = np.full((COUNT, 4), sigma)
    found = LoadsFound(T, loads, spread, loads.sum(1), 2.0 * spread[:, 0], STATIC, joint)
    return summary_of(found, truth, 0.3, given)


def believed(mass, nis=12.0):
    """What the joint filter finds beside the loads."""
    each, none = np.full(COUNT, mass), np.full((COUNT, 4), np.nan)
    return WheelLoads(
        t=T,
        load=none,
        sigma=none,
        total=none[:, 0],
        total_sigma=none[:, 0],
        covariance=np.full((COUNT, 4, 4), np.nan),
        compression_rate=none,
        roll_moment=none[:, 0],
        pitch_moment=none[:, 0],
        body_mass=each,
        body_mass_sigma=0.0 * T + 3.0,
        load_walk=none[:, 0],
        nis=0.0 * T + nis,
        freedom=np.full(COUNT, 12),
    )


def test_the_verdict_names_lift_only_where_it_is_sure():
    dip = np.where((T > 1.008) & (T < 1.098), 100.0, STATIC[0])
    assert "off the ground or nearly: FL for 0.09 s" in verdict_of(results(dip))
    assert "lowest load 100 +- 50 N at FL, 1.01 s" in verdict_of(results(dip))
    unsure = verdict_of(results(dip, 400.0))
    assert "off the ground" not in unsure
    assert "may have lifted, zero being within two sigma: FL" in unsure
    assert "no wheel lifts" in verdict_of(results(STATIC[0]))
    # what a record begins with does not count
    assert "no wheel lifts" in verdict_of(results(np.where(T < 0.2, -1e4, STATIC[0])))


def test_scales_that_were_found_are_in_the_summary():
    scale = np.array([1.5, 0.7])
    joint = replace(believed(1800.0), scale=scale, scale_sigma=0.02 * scale)
    found = results(STATIC[0], joint=joint)
    assert (found["springs_scale"], found["dampers_scale"]) == pytest.approx((1.5, 0.7))
    assert found["springs_scale_sigma"] == pytest.approx(0.03)
    assert "explains nothing" not in verdict_of(found)
    far = replace(joint, scale=np.array([1.0, 6.0]), scale_sigma=np.array([0.3, 0.1]))
    doubted = verdict_of(results(STATIC[0], joint=far))
    assert "the dampers seem 6 times as strong as the vehicle's, which explains nothing" in doubted
    assert "this drive tells little of the springs" in doubted
    assert "springs_scale" not in results(STATIC[0], joint=believed(1800.0))


def test_a_sum_beside_the_weight_is_said_and_explained():
    heavy = verdict_of(results(STATIC[0] + 0.05 * STATIC.sum()))
    assert "sum of loads 5.0 % above the weight" in heavy
    assert "payload" in heavy
    assert "sum of loads equals the weight" in verdict_of(results(STATIC[0] - 2.0))
    light = verdict_of(results(STATIC[0] - 0.01 * STATIC.sum()))
    assert "sum of loads 1.0 % below the weight" in light
    assert "payload" not in light


def test_a_payload_that_the_filter_has_found_is_quoted():
    share = 0.05 * STATIC.sum()
    mass = share / 9.80665
    found = verdict_of(results(STATIC[0] + share, joint=believed(1800.0 + mass), given=1800.0))
    assert f"sprung mass found is {mass:,.0f} +- 3 kg more than the 1,800 kg" in found
    assert "look for a payload" not in found
    # the mass does not explain it
    other = verdict_of(results(STATIC[0] + share, joint=believed(1800.0), given=1800.0))
    assert "look for a payload" in other


def test_the_verdict_doubts_what_the_truth_or_the_innovations_contradict():
    truth = np.broadcast_to(STATIC, (COUNT, 4))
    fits = verdict_of(results(STATIC[0], truth=truth, joint=believed(1800.0)))
    assert fits.endswith("no wheel lifts")
    off = np.where(np.arange(COUNT) % 2, STATIC[0] + 150.0, STATIC[0])
    doubted = verdict_of(results(off, truth=truth))
    assert "two sigma at FL 50 % of the samples, where 95 % should" in doubted
    assert "NIS 40.0 where 12 fits" in verdict_of(results(off, joint=believed(1800.0, nis=40.0)))
    assert "innovations are smaller" in verdict_of(results(off, joint=believed(1800.0, nis=3.0)))


def test_only_the_method_that_tells_its_progress_shows_a_bar(log, tmp_path):
    assert "samples of filters" not in call(log, "--method", "algebraic", "--out", tmp_path)


@pytest.mark.slow
def test_a_simulated_drive_goes_straight_into_the_joint_method(tmp_path):
    settings = {"vehicle": "suv", "maneuver": "brake-step", "duration": 2, "rate": 250}
    options = [word for name, value in settings.items() for word in (f"--{name}", str(value))]
    made = RUNNER.invoke(app, ["simulate", *options, "--out", str(tmp_path)])
    assert made.exit_code == 0, made.stderr
    said = call(tmp_path / "log.parquet", "--out", tmp_path / "loads")
    assert "samples of filters" in said
    assert "joint, with wheel accelerometers" in said
    assert "turn the sign" not in said
    assert "sigma is too small" not in said
    found = json.loads((tmp_path / "loads" / "summary.json").read_text())["results"]
    for wheel in found["wheels"].values():
        assert wheel["rmse_N"] < 60.0
        assert 0.9 < wheel["share_within_2_sigma"] < 0.995
        assert wheel["true_lowest_N"] < 0.99 * wheel["static_N"]
    assert found["rmse_of_sum_N"] < 120.0
    assert abs(found["sum_over_weight"]) < 0.01

    # extensions for compressions
    table = pq.read_table(tmp_path / "log.parquet")
    for corner in CORNERS:
        place = table.column_names.index(f"compression_{corner}")
        turned = pa.array(-np.asarray(table.column(place)))
        table = table.set_column(place, table.schema.field(place), turned)
    pq.write_table(table, tmp_path / "log.parquet")
    said = call(tmp_path / "log.parquet", "--out", tmp_path / "loads")
    assert "compression: by its sign the nose rises where a_x < 0 brakes" in said
    assert "sigma is too small for the errors" in said
