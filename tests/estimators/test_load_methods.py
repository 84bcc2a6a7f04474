"""The loads of a record by each method, beside loads that NumPy makes from the same motion."""

import math
from dataclasses import replace

import numpy as np
import pytest

from wheelhop.errors import InputError
from wheelhop.estimators import load_methods
from wheelhop.estimators.joint_load_mixture import WheelLoads
from wheelhop.estimators.load_methods import (
    ALGEBRAIC,
    JOINT,
    SENSORS,
    UNBIASED,
    YOULA,
    loads_by,
)
from wheelhop.vehicle.full_vehicle_parameters import suv
from wheelhop.vehicle.load_record import LoadRecord, VehicleLoadSample

G = 9.80665
DT, COUNT = 0.004, 500
T = DT * np.arange(COUNT)
SPRING, DAMPER = (33.6e3, 35.5e3), (2800.0, 2700.0)
BARS = {True: (15e3, 8e3), False: (0.0, 0.0)}
AMPLITUDE = np.array([0.020, -0.012, 0.006, 0.015])
RATE = 2.0 * math.pi * 0.8


def weights(vehicle):
    """Sprung and unsprung mass of the corners, by moments about the axles."""
    c = vehicle.chassis
    wheel = np.asarray(c.wheel_mass, float)
    base = float(c.front_arm) + float(c.rear_arm)
    share = np.array([c.rear_arm, c.rear_arm, c.front_arm, c.front_arm], float) / base
    return 0.5 * float(c.body_mass) * share, wheel


def motion(t, vehicle, bars):
    """(a_s, q, load), each [time, 4], of four struts that swing one against the other."""
    sprung, wheel = weights(vehicle)
    spring, damper, bar = (np.repeat(pair, 2) for pair in (SPRING, DAMPER, BARS[bars]))
    phase = RATE * t[:, None]
    q, rate = AMPLITUDE * np.sin(phase), AMPLITUDE * RATE * np.cos(phase)
    bend = -AMPLITUDE * RATE**2 * np.sin(phase)
    other = q[:, [1, 0, 3, 2]]
    body = 0.7 * np.cos(phase) * np.array([1.0, 0.5, -0.4, 0.8])
    strut = G * sprung + spring * q + damper * rate + bar * (q - other)
    return body, q, strut + wheel * (G + body + bend)


def record(vehicle, bars):
    body, q, _ = motion(T, vehicle, bars)
    none = np.full(COUNT, np.nan)
    return LoadRecord(T, VehicleLoadSample(*body.T, *q.T, *[none] * 4))


POLE = math.sqrt(math.sqrt(2.0) - 1.0)
"""Of two equal poles, -3 dB per that of the poles."""


@pytest.mark.parametrize("bars", [True, False])
@pytest.mark.parametrize(("method", "lag"), [(YOULA, math.sqrt(2.0) + 0.2), (UNBIASED, 2.0 * POLE)])
def test_a_slow_motion_comes_out_as_its_load_delayed_by_the_low_pass(method, lag, bars):
    """Springs, dampers, preloads and bars of every corner are the vehicle's, signs included."""
    vehicle = suv(bars)
    found = loads_by(method, record(vehicle, bars), vehicle, 20.0)
    late = lag / (2.0 * math.pi * 20.0)
    wanted = motion(T - late, vehicle, bars)[2]
    settled = slice(100, -1)
    swing = np.ptp(wanted, axis=0)
    np.testing.assert_array_less(np.abs(found.load - wanted)[settled] / swing, 0.01)
    # a bar that is left out would show
    others = motion(T - late, vehicle, not bars)[2]
    assert (np.abs(others - wanted).max(0) / swing).min() > 0.05
    np.testing.assert_allclose(found.total[settled], found.load.sum(1)[settled])
    assert np.isfinite(found.sigma[settled]).all()
    sides = np.sqrt(np.sum(found.sigma**2, 1))[settled]
    np.testing.assert_array_less(found.total_sigma[settled], 2.0 * sides)


def test_loads_at_rest_are_the_weight():
    vehicle = suv()
    sprung, wheel = weights(vehicle)
    still = np.zeros(COUNT)
    at_rest = LoadRecord(T, VehicleLoadSample(*[still] * 12), None, still, still)
    for method in (YOULA, UNBIASED, ALGEBRAIC):
        found = loads_by(method, at_rest, vehicle)
        np.testing.assert_allclose(found.static, G * (sprung + wheel), rtol=1e-9)
        np.testing.assert_allclose(
            found.load[100:-1], np.broadcast_to(found.static, (COUNT - 101, 4)), rtol=2e-4
        )


def test_lever_arms_share_what_a_x_and_a_y_shift_and_know_no_sigma():
    vehicle = suv()
    none, ones = np.full(COUNT, np.nan), np.ones(COUNT)
    empty = VehicleLoadSample(*[none] * 12)
    found = loads_by(ALGEBRAIC, LoadRecord(T, empty, None, -3.0 * ones, 2.0 * ones), vehicle)
    np.testing.assert_allclose(found.total, found.static.sum(), rtol=1e-9)
    front_left, front_right, rear_left, rear_right = found.load[0] - found.static
    assert front_left + front_right > 0 > rear_left + rear_right
    assert front_right > front_left
    assert rear_right > rear_left
    assert np.isnan(found.sigma).all()
    assert np.isnan(found.total_sigma).all()


def test_what_a_method_lacks_is_named():
    vehicle = suv()
    none = np.full(COUNT, np.nan)
    empty = LoadRecord(T, VehicleLoadSample(*[none] * 12))
    with pytest.raises(InputError, match="a_x: the log lacks it"):
        loads_by(ALGEBRAIC, empty, vehicle)
    with pytest.raises(InputError, match=r"a_s_FL: the log lacks it.*algebraic"):
        loads_by(YOULA, empty, vehicle)
    with pytest.raises(InputError, match="method: 'guess' is unknown"):
        loads_by("guess", empty, vehicle)
    with pytest.raises(InputError, match="bandwidth: 200 Hz"):
        loads_by(YOULA, record(vehicle, True), vehicle, 200.0)


def test_the_joint_filter_gets_the_record_and_the_sensors_noise(monkeypatch):
    """Its own tests filter with it: here, what it is given and what becomes of its answer."""
    given = {}
    load = np.arange(4.0 * COUNT).reshape(COUNT, 4)
    line = load[:, 0]
    answer = WheelLoads(
        T + 9.0, load, load + 1.0, load.sum(1), line + 2.0, load[:, None] + load[:, :, None], load,
        *[line] * 7,
    )  # fmt: skip

    def stands_in(sample, dt, vehicle, tuning, on_progress, horizontal):
        given.update(sample=sample, dt=dt, vehicle=vehicle, tuning=tuning, horizontal=horizontal)
        assert on_progress is None
        return answer

    monkeypatch.setattr(load_methods, "wheel_loads", stands_in)
    vehicle = suv()
    mine = record(vehicle, True)
    sensors = SENSORS._replace(acceleration_noise=0.3, deflection_noise=2e-4)
    found = loads_by(JOINT, mine, vehicle, sensors=sensors)
    assert given["sample"] is mine.sample
    assert given["dt"] == pytest.approx(DT)
    tuning = given["tuning"]
    assert (tuning.body_acceleration, tuning.wheel_acceleration) == (0.3, 0.3)
    assert tuning.compression == 2e-4
    np.testing.assert_array_equal(found.t, T)
    np.testing.assert_array_equal(found.load, answer.load)
    np.testing.assert_array_equal(found.sigma, answer.sigma)
    np.testing.assert_array_equal(found.total_sigma, answer.total_sigma)
    np.testing.assert_allclose(found.static, G * np.sum(weights(vehicle), 0), rtol=1e-9)
    assert found.joint is answer

    assert given["horizontal"] is None
    a_x, a_y = np.sin(T), np.cos(T)
    told = replace(mine, a_x=a_x, a_y=a_y)
    assert loads_by(JOINT, told, vehicle, find_springs=True).joint is answer
    assert given["horizontal"][0] is a_x
    assert given["horizontal"][1] is a_y
    loads_by(JOINT, told, vehicle)
    assert given["horizontal"] is None


def test_springs_are_found_by_the_joint_filter_from_a_x_and_a_y_alone():
    vehicle = suv()
    mine = record(vehicle, True)
    with pytest.raises(InputError, match=r"a_x: the log lacks it.*with the springs given"):
        loads_by(JOINT, mine, vehicle, find_springs=True)
    with pytest.raises(InputError, match="a_y: the log lacks it"):
        loads_by(JOINT, replace(mine, a_x=T), vehicle, find_springs=True)
    with pytest.raises(InputError, match="find_springs: youla takes the springs as given"):
        loads_by(YOULA, mine, vehicle, find_springs=True)
