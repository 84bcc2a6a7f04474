"""What is refused of a drive, and what is told of it."""

import math

import numpy as np
import pytest

from wheelhop.errors import DivergenceError, InputError, InputWarning
from wheelhop.vehicle.drive_checks import (
    check_drive,
    checked_surroundings,
    refuse_runaway,
    warn_of_rims,
)
from wheelhop.vehicle.full_vehicle_parameters import suv
from wheelhop.vehicle.full_vehicle_state import Surroundings
from wheelhop.vehicle.maneuver import Brake, Maneuver, straight
from wheelhop.vehicle.pressure_course import held
from wheelhop.vehicle.simulation import Signals

T = np.array([0.1, 0.2, 0.3])
FOUR = ("body_acceleration", "wheel_acceleration", "compression", "compression_rate", "wheel_speed",
        "steer", "drive", "brake", "load", "longitudinal", "lateral", "tire_deflection", "strut",
        "kappa", "tan_alpha", "elevation", "pressure")  # fmt: skip


def signals(**changed):
    values = {name: np.zeros((3, 4) if name in FOUR else 3) for name in Signals._fields}
    for name, value in changed.items():
        values[name][1] = value
    return Signals(**values)


@pytest.mark.parametrize(
    ("field", "value"),
    [("grade", 1.0), ("bank", -0.6), ("friction", math.nan), ("friction", 0.0), ("gravity", -9.8)],
)
def test_surroundings_out_of_range_are_named(field, value):
    with pytest.raises(InputError, match=rf"surroundings\.{field}"):
        checked_surroundings(Surroundings(**{field: value}))
    assert checked_surroundings(Surroundings()) == Surroundings()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"a_z": math.nan}, "leaves the finite numbers at t = 0.2 s"),
        ({"roll": 1.2}, "rolls over at t = 0.2 s"),
        ({"tire_deflection": 0.4}, "sinks a wheel through the road at t = 0.2 s"),
    ],
)
def test_a_drive_that_is_not_physical_is_refused_with_its_time(change, words):
    with pytest.raises(DivergenceError, match=words):
        refuse_runaway(signals(**change), T, 0.36)
    refuse_runaway(signals(tire_deflection=0.1), T, 0.36)


def test_a_tire_on_its_rim_is_told():
    with pytest.warns(InputWarning, match="100 mm"):
        warn_of_rims(signals(tire_deflection=0.1), 0.36)


@pytest.mark.parametrize(
    ("maneuver", "pressure", "duration", "rate", "substeps", "field"),
    [
        (straight(300.0), 2e5, 1.0, 1e3, 2, "maneuver.speed"),
        (Maneuver(20.0, brake=Brake(-1.0, 0.0)), 2e5, 1.0, 1e3, 2, "brake.torque"),
        (straight(20.0), 2e3, 1.0, 1e3, 2, "pressure.start FL"),
        (straight(20.0), 2e5, 0.0, 1e3, 2, "duration"),
        (straight(20.0), 2e5, 1.0, 10.0, 2, "rate"),
        (straight(20.0), 2e5, 1.0, 200.0, 2, "substeps"),
    ],
)
def test_a_drive_that_cannot_be_is_refused_by_name(
    maneuver, pressure, duration, rate, substeps, field
):
    with pytest.raises(InputError, match=field):
        check_drive(suv(), maneuver, held(np.full(4, pressure)), duration, rate, substeps)
