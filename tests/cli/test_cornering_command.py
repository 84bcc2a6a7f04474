"""`wheelhop cornering`: a log in, the soft tyre out; what does not go together is refused."""

import json

import jax
import numpy as np
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from wheelhop.cli import app
from wheelhop.cli.cornering import known_vehicle
from wheelhop.io.results import write_table
from wheelhop.vehicle.cornering import double_lane_change, simulate_cornering
from wheelhop.vehicle.full_vehicle_state import STANDARD_GRAVITY
from wheelhop.vehicle.lateral_tire import NOMINAL_TIRE, SOFT_TIRE
from wheelhop.vehicle.two_track import SOLMAZ_CAR, Wheels

UNITS = {"t": "s", "v": "m/s", "a_y": "m/s^2", "yaw_rate": "rad/s", "steer": "rad"}
SPEED = 20.0


def call(*arguments, status=0):
    found = CliRunner().invoke(app, ["cornering", *map(str, arguments)])
    assert found.exit_code == status, found.output
    return found.output


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """The paper's car, front right soft, through a lane change at 72 km/h."""
    tires = Wheels(NOMINAL_TIRE, SOFT_TIRE, NOMINAL_TIRE, NOMINAL_TIRE)
    found = jax.jit(
        lambda: simulate_cornering(
            double_lane_change(0.03, 0.5, 2.0, 0.0), SPEED, tires, SOLMAZ_CAR, duration=5.0, dt=0.02
        )
    )()
    rng = np.random.default_rng(1)
    columns = {
        "t": np.asarray(found.time),
        "v": np.full(250, SPEED),
        "a_y": found.lateral_acceleration + 0.05 * rng.normal(size=250),
        "yaw_rate": found.yaw_rate + 0.002 * rng.normal(size=250),
        "steer": np.asarray(found.steer),
    }
    path = tmp_path_factory.mktemp("cornering") / "log.parquet"
    write_table(path, columns, UNITS)
    return path


def test_the_soft_tyre_is_named_and_everything_written(log, tmp_path):
    said = call(log, "--vehicle", "solmaz", "--lost", 0.49, "--out", tmp_path)
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["results"]["verdict"] == "FR"
    assert summary["results"]["probability_soft"]["FR"] > 0.99
    assert "FR" in said
    assert "72 km/h" in said
    assert (tmp_path / "soft_tires.png").stat().st_size > 10_000
    table = pq.read_table(tmp_path / "soft_tires.parquet")
    modes = [name for name in table.column_names if name.startswith("probability_")]
    assert len(modes) == 16 + 4
    assert table.field("side_slip").metadata[b"unit"] == b"rad"
    last = {name: table[name].to_pylist()[-1] for name in modes}
    assert last["probability_soft_FR"] == pytest.approx(
        summary["results"]["probability_soft"]["FR"]
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--vehicle", "golf"), "--vehicle: 'golf' is unknown"),
        (("--soft", 150), "--soft: without --ppy1"),
        (("--vehicle", "solmaz", "--soft", 150), "--soft: the tyres of solmaz know no pressure"),
        (("--lost", 1.5), "--lost: 1.5"),
        (("--friction", 0), "--friction: 0"),
        (("--steering-ratio", 0), "steering ratio: 0"),
        (("--ppy1", 9), "--ppy1: 9"),
        (("--precision", "half"), "--precision: 'half' is unknown"),
    ],
)
def test_what_does_not_go_together_is_refused_in_one_line(log, tmp_path, arguments, message):
    said = call(log, *arguments, "--out", tmp_path, status=2)
    assert message in " ".join(said.split())


def test_a_soft_tyre_has_lost_the_stated_share_of_cornering_stiffness():
    load = 0.25 * SOLMAZ_CAR.mass * STANDARD_GRAVITY
    paper = known_vehicle("solmaz", 0.3, None, None, None)
    soft, sound = (float(paper.law.stiffness(load, t)) for t in paper.levels.front_left)
    assert soft / sound == pytest.approx(0.7)
    suv = known_vehicle("suv", 0.3, None, None, None)
    soft, sound = (float(suv.law.stiffness(5000.0, t)) for t in suv.levels.rear_right)
    assert soft / sound == pytest.approx(0.7)
    pressed = known_vehicle("suv", 0.3, 230.0, 150.0, 0.9)
    soft, sound = (float(pressed.law.stiffness(5000.0, t)) for t in pressed.levels.rear_right)
    assert soft / sound == pytest.approx((1 - 0.9 * 100 / 250) / (1 - 0.9 * 20 / 250))
