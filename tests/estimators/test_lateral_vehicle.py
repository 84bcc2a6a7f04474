"""Which tyres are soft, for a user: verdicts that wait for cornering, thinning, refusals."""

from functools import cache

import numpy as np
import pytest

from tests.oracles import two_track_numpy as paper
from wheelhop.errors import InputError, InputWarning
from wheelhop.estimators.failure_modes import level_table, mode_names
from wheelhop.estimators.lateral import LateralSample
from wheelhop.estimators.lateral_vehicle import (
    CORNERING,
    HELD,
    NOT_ENOUGH,
    RATE,
    SOUND,
    SURE,
    UNDECIDED,
    VEHICLE_TEMPER,
    peak_so_far,
    vehicle_params,
    verdicts,
    which_tires_are_soft,
)
from wheelhop.vehicle.lateral_tire import ARCTANGENT, NOMINAL_TIRE, SOFT_TIRE
from wheelhop.vehicle.two_track import SOLMAZ_CAR

DT, SAMPLES, SPEED = 0.02, 400, 80 / 3.6
LEVELS = (SOFT_TIRE, NOMINAL_TIRE)


@cache
def record(soft, amplitude=0.02):
    """A double lane change of the paper's car in NumPy, with noise."""
    t = DT * np.arange(1, SAMPLES + 1)

    def steer(times):
        return paper.double_lane_change(times, amplitude, 1.5)

    tires = paper.combinations()[mode_names().index(soft)]
    _, rate, a_y = (entry[0] for entry in paper.simulate(t, steer, SPEED, tires[None]))
    rng = np.random.default_rng(3)
    noise = rng.standard_normal((2, SAMPLES)) * np.array([[0.05], [0.002]])
    return LateralSample(steer(t), np.full(SAMPLES, SPEED), a_y + noise[0], rate + noise[1])


def judge(sample, dt=DT, **options):
    return which_tires_are_soft(sample, dt, SOLMAZ_CAR, LEVELS, ARCTANGENT, **options)


def test_the_soft_tyre_is_told_once_the_car_has_cornered():
    found = judge(record("FL"))
    assert found.told == "FL"
    first = np.flatnonzero(found.verdict != NOT_ENOUGH)[0]
    assert found.t[first] > 1.5
    assert found.peak[first] >= CORNERING > found.peak[first - 1]
    np.testing.assert_allclose(found.soft[-1], [1, 0, 0, 0], atol=1.0 - SURE)
    np.testing.assert_allclose(found.probabilities.sum(axis=1), 1.0, rtol=1e-6)
    np.testing.assert_allclose(found.t, DT * np.arange(SAMPLES))
    assert 1.0 < found.nis.mean() < 3.0
    assert found.modes == mode_names()


def test_nothing_is_told_of_a_straight_drive():
    found = judge(record("FL", amplitude=0.0))
    assert set(found.verdict) == {NOT_ENOUGH}


def test_a_faster_record_gives_what_every_second_sample_gives():
    slow = record("FR")
    fast = LateralSample(*(np.repeat(entry, 2) for entry in slow))
    one, other = judge(slow), judge(fast, dt=DT / 2)
    np.testing.assert_allclose(one.probabilities, other.probabilities, atol=1e-9)
    np.testing.assert_allclose(other.t, one.t + DT / 2)


def test_gaps_are_bridged_and_told():
    gappy = LateralSample(*(np.array(entry) for entry in record("FL")))
    gappy.lateral_acceleration[100:140] = np.nan
    gappy.steer[200:205] = np.nan
    with pytest.warns(InputWarning):
        found = judge(gappy)
    assert found.told == "FL"


def test_verdicts_add_up_what_concerns_the_same_tyres():
    sure, steady = np.ones(200), np.full(200, 2.0)
    spread = np.zeros((200, 81))
    table = level_table(3)
    fl = [k for k, row in enumerate(table) if row[0] < 2 and (row[1:] == 2).all()]
    spread[:, fl] = 0.5
    assert set(verdicts(spread, steady, DT)[-10:]) == {"FL"}
    p = np.zeros((200, 16))
    p[:, -1] = sure
    assert verdicts(p, steady, DT)[-1] == SOUND
    assert verdicts(p, 0.9 * CORNERING * sure, DT)[-1] == NOT_ENOUGH
    p[:, -1], p[:, 0] = 0.8, 0.2
    assert verdicts(p, steady, DT)[-1] == UNDECIDED


def test_a_verdict_waits_until_it_has_held():
    p = np.zeros((200, 16))
    p[:100, 7] = 1.0
    p[100:, 3] = 1.0
    told = verdicts(p, np.full(200, 2.0), DT)
    wait = round(HELD / DT)
    assert set(told[: wait - 1]) == {UNDECIDED}
    assert set(told[wait:100]) == {"FL"}
    assert set(told[100 : 100 + wait - 1]) == {UNDECIDED}
    assert told[100 + wait] == "FL+FR"


def test_the_peak_is_that_of_the_half_second_before():
    rng = np.random.default_rng(0)
    a = rng.standard_normal(120)
    a[30:45] = np.nan
    width = round(0.5 / DT)
    means = []
    for k in range(len(a)):
        window = a[max(0, k - width + 1) : k + 1]
        known = window[np.isfinite(window)]
        means.append(abs(known.sum()) / max(len(known), 0.5 * width))
    np.testing.assert_allclose(peak_so_far(a, DT), np.maximum.accumulate(means), atol=1e-12)
    both = peak_so_far(np.stack([a, -a]), DT)
    np.testing.assert_allclose(both[0], both[1])


@pytest.mark.parametrize("dt", [0.01, 1 / RATE, 0.05])
def test_a_second_weighs_the_same_at_every_rate(dt):
    params = vehicle_params(SOLMAZ_CAR, LEVELS, dt)
    np.testing.assert_allclose(params.temper / dt, VEHICLE_TEMPER * RATE, rtol=1e-6)


@pytest.mark.parametrize(
    ("change", "dt", "field"),
    [
        ({}, 0.2, "dt"),
        ({}, 1e-4, "dt"),
        ({"steer": np.full(SAMPLES, 0.8)}, DT, "steer"),
        ({"speed": np.full(SAMPLES, 1.0)}, DT, "speed"),
        ({"speed": np.full(SAMPLES, 200.0)}, DT, "speed"),
        ({"yaw_rate": np.full(SAMPLES, np.inf)}, DT, "yaw_rate"),
        ({"yaw_rate": np.full(SAMPLES, 12.0)}, DT, "yaw_rate"),
        ({"yaw_rate": np.zeros(SAMPLES - 1)}, DT, "samples"),
    ],
)
def test_records_that_cannot_be_used_are_refused(change, dt, field):
    with pytest.raises(InputError, match=field):
        judge(record("FL")._replace(**change), dt)


def test_a_record_too_short_or_settings_out_of_range_are_refused():
    short = LateralSample(*(entry[:10] for entry in record("FL")))
    with pytest.raises(InputError, match="covers"):
        judge(short)
    with pytest.raises(InputError, match="samples"):
        judge(LateralSample(*(entry[:1] for entry in record("FL"))))
    for options in ({"temper": 0.0}, {"friction": 5.0}):
        with pytest.raises(InputError, match=next(iter(options))):
            judge(record("FL"), **options)
