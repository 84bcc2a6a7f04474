"""The chapter of the maneuvers, on results made by hand: scores, measures, verdicts, output."""

import json
import math

import numpy as np
import pytest

from wheelhop.estimators.algebraic_load import distribution_of
from wheelhop.io.report import FAILS, HOLDS
from wheelhop.studies.filipozzi.drives import (
    BRAKE,
    LANE_CHANGE,
    LANE_CHANGE_BARRED,
    ROAD,
    SLOPE,
    SWEEP,
    Drive,
)
from wheelhop.studies.filipozzi.maneuvers import (
    ALGEBRAIC,
    JOINT_WHEEL,
    METHODS,
    WORDS,
    Maneuvers,
    score,
    total_error,
)
from wheelhop.studies.filipozzi.maneuvers_claims import maneuvers_findings
from wheelhop.studies.filipozzi.maneuvers_figures import maneuvers_figures
from wheelhop.studies.filipozzi.maneuvers_measures import (
    body_frequency,
    missed_body,
    shaped,
    static_part,
    steady,
    tilt_error,
    waves,
)
from wheelhop.studies.filipozzi.maneuvers_tables import (
    maneuvers_in_words,
    maneuvers_numbers,
    maneuvers_tables,
)
from wheelhop.studies.filipozzi.methods import DERIVATIVE, HALF_CAR, UNBIASED, YOULA
from wheelhop.studies.filipozzi.settings import FilipozziSettings
from wheelhop.studies.filipozzi.vehicles import paper_vehicle

DT = 2e-3
STATIC = np.array([5100.0, 5100.0, 4700.0, 4700.0])
SIGNS = np.array([1.0, -1.0, 1.0, -1.0])


def _drive(seconds=4.0, load=None, **changed):
    t = np.arange(1, round(seconds / DT) + 1) * DT
    four, one = np.zeros((len(t), 4)), np.zeros(len(t))
    values = dict.fromkeys(Drive._fields, four)
    values |= dict.fromkeys(("a_x", "a_y", "speed", "roll", "pitch"), one)
    moving = 400.0 * np.sin(2.0 * math.pi * np.maximum(t - 1.0, 0.0))[:, None] * SIGNS
    values |= {"t": t, "load": STATIC + moving if load is None else load(t)}
    return Drive(**(values | changed))


def _late(load, k):
    return np.concatenate([np.repeat(load[:1], k, axis=0), load[: len(load) - k]])


def test_score_finds_a_known_delay_and_bias():
    drive = _drive()
    found = score(drive, _late(drive.load, 4))
    assert found.delay == pytest.approx(4 * DT)
    assert found.aligned == pytest.approx(0.0, abs=1e-9)
    # of a sine of 1 Hz that comes late by 8 ms: 2 sin(w tau / 2) of its rms
    expected = 2.0 * math.sin(math.pi * 4 * DT) * 400.0 / math.sqrt(2.0)
    assert found.rmse == pytest.approx(expected * math.sqrt(3.0 / 3.5), rel=0.01)
    assert abs(found.bias) < 1.0
    biased = score(drive, drive.load - 30.0)
    assert biased.bias == pytest.approx(-30.0)
    assert biased.steady == pytest.approx(-30.0)
    assert biased.rmse == pytest.approx(30.0)
    assert biased.converged == 0.0
    assert total_error(drive, drive.load - 30.0) == pytest.approx(120.0)


def test_score_finds_the_convergence_of_the_last_corner():
    drive = _drive()
    t = drive.t[:, None]
    # below 5 % from ln(20) time constants on, of the slowest corner
    slow = np.array([0.01, 0.01, 0.03, 0.02])
    found = score(drive, drive.load * (1.0 - np.exp(-t / slow)))
    assert found.converged == pytest.approx(0.03 * math.log(20.0), abs=2 * DT)
    assert math.isnan(score(drive, 1.06 * drive.load).converged)
    gap = drive.load.copy()
    gap[-3:] = np.nan
    assert score(drive, gap).rmse == 0.0


def test_tilt_is_measured_from_the_road():
    d = distribution_of(paper_vehicle())
    mass = float(d.mass)
    t = np.arange(1, 11) * DT
    one = np.ones(len(t))

    def drive(slope, **changed):
        ahead = -float(d.wheelbase) * math.sin(slope) * one
        z = np.stack([0 * one, 0 * one, ahead, ahead], 1)
        return _drive(10 * DT, elevation=z, **changed)

    braked = tilt_error(drive(0.0, a_x=-4.6 * one, pitch=0.02 * one))
    # along the leaning axis: what it shows of the true vertical force, worked out as vectors
    shown = np.array([-4.6, 9.80665])
    along_normal = shown @ np.array([-math.sin(0.02), math.cos(0.02)])
    np.testing.assert_allclose(braked, mass * (shown[1] - along_normal), rtol=1e-6)
    assert braked[0] < -150.0
    # nose up by the angle of the road is no lean at all
    np.testing.assert_allclose(tilt_error(drive(0.2, a_x=2.0 * one, pitch=-0.2 * one)), 0.0, atol=1)
    # a turn to the left, outwards lean: the axis holds a part of the sideways force
    assert tilt_error(drive(0.0, a_y=5.0 * one, roll=0.07 * one))[0] < -0.9 * mass * 5.0 * 0.07


def test_waves_steady_errors_and_static_parts():
    t = np.arange(1, 4001) * DT
    sine = np.sin(2.0 * math.pi * 1.5 * t)[:, None] * np.ones(4)
    drive = _drive(8.0, load=lambda _: STATIC + 300.0 * sine, elevation=0.02 * sine)
    wave = waves(drive, drive.load, 0)
    np.testing.assert_allclose(wave.frequency, 1.5, rtol=0.01)
    np.testing.assert_allclose(wave.load, 300.0, rtol=1e-3)
    np.testing.assert_allclose(wave.road, 0.02, rtol=1e-3)
    assert body_frequency(0) == pytest.approx(1.35, abs=0.05)
    turning = drive._replace(a_y=np.sin(2.0 * math.pi * 0.5 * t))
    off = 50.0 * turning.a_y[:, None] + 7.0 * np.cos(2.0 * math.pi * 3.0 * t)[:, None]
    static, rest = static_part(turning, drive.load + off)
    assert static == pytest.approx(50.0 / math.sqrt(2.0), rel=0.02)
    assert rest == pytest.approx(7.0 / math.sqrt(2.0), rel=0.02)
    result = _result(**{BRAKE: {YOULA: np.array([1.0, 2.0, 3.0, 4.0])}})
    np.testing.assert_allclose(steady(result, BRAKE, YOULA), [1.0, 2.0, 3.0, 4.0])


def test_shaping_filter_of_a_sine():
    t = np.arange(1, 2001) * DT
    sine = np.sin(2.0 * math.pi * 10.0 * t)[:, None] * np.ones(4)
    drive = _drive(4.0, load=lambda _: STATIC + 1000.0 * sine)
    s = 2j * math.pi * 10.0
    w = 2.0 * math.pi * 30.0
    gain = w**2 / ((s**2 + math.sqrt(2.0) * w * s + w**2) * (0.1 / w * s + 1.0) ** 2)
    expected = STATIC + 1000.0 * (gain * np.exp(s * t)).imag[:, None]
    np.testing.assert_allclose(shaped(drive, 30.0), expected, atol=1e-6)


def test_derivative_filters_miss_the_body():
    swing = 3.0 * np.sin(2.0 * math.pi * np.arange(1, 2001) * DT)[:, None] * np.ones(4)
    drive = _drive(body_acceleration=swing)
    missed = -np.array([61.14, 61.14, 52.75, 52.75]) * swing
    result = _result(
        drives={BRAKE: drive},
        loads={(BRAKE, DERIVATIVE): drive.load + missed, (BRAKE, YOULA): _late(drive.load, 4)},
    )
    difference, aligned, left = missed_body(result, BRAKE)
    assert difference > aligned > 100.0
    assert left == pytest.approx(0.0, abs=1e-6)


_ERRORS = {
    ALGEBRAIC: 150.0,
    YOULA: 10.0,
    UNBIASED: 11.0,
    DERIVATIVE: 12.0,
    HALF_CAR: 10.0,
    "joint": 5.0,
    JOINT_WHEEL: 2.0,
}


def _result(drives=None, loads=None, **errors):
    """Loads that are off by constants; drives of a sine."""
    t = np.arange(1, round(4.0 / DT) + 1) * DT
    hertz = 1.0 + 0.6 * t
    sweep = np.sin(2.0 * math.pi * (t + 0.3 * t**2))[:, None] * np.ones(4)
    swell = (300.0 / (1.0 + 8.0 * (hertz - 1.45) ** 2))[:, None]
    made = {n: _drive() for n in WORDS}
    made[SWEEP] = _drive(load=lambda _: STATIC + swell * sweep, elevation=0.01 * sweep)
    made |= drives or {}
    found = {
        n: {m: made[n].load + errors.get(n, {}).get(m, _ERRORS[m]) for m in METHODS} for n in WORDS
    }
    found[SWEEP][ALGEBRAIC] = np.broadcast_to(STATIC, made[SWEEP].load.shape)
    for (name, method), load in (loads or {}).items():
        found[name][method] = load
    return Maneuvers(FilipozziSettings(rate=1.0 / DT), made, found)


def _verdict(result, words):
    matching = [f for f in maneuvers_findings(result) if words in f.claim]
    assert len(matching) == 1
    return matching[0].verdict


@pytest.mark.parametrize(
    ("words", "drive", "method", "worse"),
    [
        ("half car is needed", LANE_CHANGE_BARRED, HALF_CAR, 200.0),
        ("in braking both", BRAKE, YOULA, 200.0),
        ("steady-state error", BRAKE, YOULA, -151.0),
        ("slope both observers", SLOPE, UNBIASED, 200.0),
        ("perform similarly", LANE_CHANGE, UNBIASED, 80.0),
        ("derivative filters without", SLOPE, DERIVATIVE, 80.0),
        ("faster than wheel hop", ROAD, YOULA, 100.0),
        ("is the vertical force", LANE_CHANGE, YOULA, 150.0),
        ("one filter of all", ROAD, "joint", 30.0),
        ("accelerometers on the wheels the joint", ROAD, JOINT_WHEEL, 30.0),
    ],
)
def test_verdicts_follow_the_numbers(words, drive, method, worse):
    bars = {LANE_CHANGE_BARRED: {YOULA: 200.0}}
    assert _verdict(_result(**bars), words) == HOLDS
    assert _verdict(_result(**(bars | {drive: {method: worse}})), words) != HOLDS


def test_slow_convergence_and_wrong_amplitudes_flip_their_verdicts():
    drive = _drive()
    start = 1.0 - np.exp(-drive.t[:, None] / 0.02)
    both = {(BRAKE, m): drive.load * start for m in (YOULA, UNBIASED)}
    assert _verdict(_result(loads=both), "uninitialised") == HOLDS
    late = drive.load * (1.0 - np.exp(-drive.t[:, None] / 0.1))
    slow = {(n, m): late for n in (BRAKE, LANE_CHANGE, SLOPE) for m in (YOULA, UNBIASED)}
    assert _verdict(_result(loads=slow), "uninitialised") == FAILS
    sweep = _result().drives[SWEEP]
    weak = STATIC + 0.9 * (sweep.load - STATIC)
    assert _verdict(_result(), "reproduce the response") == HOLDS
    assert _verdict(_result(loads={(SWEEP, YOULA): weak}), "reproduce the response") != HOLDS
    # a swell far from the body's frequency is no resonance of the suspension
    moved = sweep._replace(load=STATIC + 300.0 * sweep.elevation / 0.01 * sweep.t[:, None])
    assert _verdict(_result(drives={SWEEP: moved}), "near the suspension's") == FAILS


def test_transient_of_the_lane_change_decides():
    t = np.arange(1, 2001) * DT
    turning = _drive(a_y=5.0 * np.sin(2.0 * math.pi * t))
    fast = turning.load + 200.0 * np.sin(2.0 * math.pi * 3.0 * t)[:, None]
    slow = turning.load + 40.0 * turning.a_y[:, None]

    def verdict(load):
        result = _result(drives={LANE_CHANGE: turning}, loads={(LANE_CHANGE, ALGEBRAIC): load})
        return _verdict(result, "double lane change")

    assert verdict(fast) == HOLDS
    assert verdict(slow) != HOLDS


def test_chapter_writes_itself():
    result = _result()
    tables = maneuvers_tables(result)
    paper = tables[0].columns
    assert paper["rms error [N]"][:2] == ["150", "10"]
    assert paper["bias [N]"][:2] == ["+150", "+10"]
    assert "steady-state" in paper["paper"][0]
    assert len(paper["method"]) == 4 * len(METHODS)
    assert tables[2].columns["sum [N]"][0] == "+600"
    numbers = json.loads(json.dumps(maneuvers_numbers(result)))
    assert numbers[ROAD][YOULA]["rmse"] == pytest.approx(10.0)
    assert numbers[ROAD][YOULA]["sum_error"] == pytest.approx(40.0)
    assert "500 Hz" in maneuvers_in_words(result.settings)[0]
    figures = list(maneuvers_figures(result))
    names = [figure.name for figure in figures]
    assert names[:4] == ["figure_5a", "figure_5b", "figure_6", "sweep_amplitude"]
    assert len(set(names)) == len(names)
    for figure in figures:
        assert len({len(column) for column in figure.columns.values()}) == 1
        assert set(figure.units) <= set(figure.columns)
