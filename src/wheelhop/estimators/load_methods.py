"""The loads of the four wheels of a record by the method that a user names."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from wheelhop.errors import InputError
from wheelhop.estimators.algebraic_load import algebraic_loads, distribution_of
from wheelhop.estimators.inverse_load import LoadSensors
from wheelhop.estimators.joint_load import wheel_loads
from wheelhop.estimators.joint_load_params import JointLoadTuning
from wheelhop.estimators.load_by_corners import (
    LoadsFound,
    as_numbers,
    loads_by_derivative,
    loads_by_unbiased,
    loads_by_youla,
    loads_found,
    static_loads,
    suspension_signals,
)
from wheelhop.vehicle.full_vehicle_state import FullVehicle
from wheelhop.vehicle.load_record import LoadRecord
from wheelhop.vehicle.vehicle_design import as_arrays

JOINT, YOULA, UNBIASED, ALGEBRAIC = "joint", "youla", "unbiased", "algebraic"
DERIVATIVE = "derivative"

BANDWIDTH = 30.0
"""At which `YOULA`, `UNBIASED` and `DERIVATIVE` pass a load with -3 dB [Hz]."""

SENSORS = LoadSensors(acceleration_noise=0.5, deflection_noise=5e-4)
"""Those of `wheelhop simulate`."""

Progress = Callable[[int, int], None]
"""Called with work done and work in all."""


def loads_by(
    method: str,
    record: LoadRecord,
    vehicle: FullVehicle,
    bandwidth: float = BANDWIDTH,
    sensors: LoadSensors = SENSORS,
    on_progress: Progress | None = None,
    find_springs: bool = False,
) -> LoadsFound:
    """The loads of a record.

    `JOINT` filters the four corners together with the struts' own laws. `YOULA`, `UNBIASED` and
    `DERIVATIVE` (which has no accelerometers) take springs and dampers as linear; an axle with an
    anti-roll bar is a half car. `ALGEBRAIC` needs a_x and a_y alone, and says no standard
    deviation. Errors of springs and dampers are in no standard deviation but where `JOINT` finds
    them; it finds the sprung mass and has its error in.

    Args:
        method: one of `NAMES`.
        record: of the sensors.
        vehicle: parameters.
        bandwidth: at which `YOULA`, `UNBIASED` and `DERIVATIVE` pass a load with -3 dB [Hz]; of
            records slower than 16 times that `YOULA` passes less, `passed_bandwidth` tells it.
        sensors: their noise.
        on_progress: called with work done and work in all, by `JOINT` alone.
        find_springs: by `JOINT` alone: find from a_x and a_y how strong springs and dampers are.

    Raises:
        InputError: for another method, signals that the record lacks, a bandwidth beyond half the
            sampling rate, or springs to be found by another method than `JOINT`.
        DivergenceError: if the joint filter leaves the finite numbers.
    """
    if method not in NAMES:
        raise InputError("method", f"{method!r} is unknown", f"Use one of {', '.join(NAMES)}.")
    if method == JOINT:
        return _joint(record, as_arrays(vehicle), sensors, on_progress, find_springs)
    if find_springs:
        raise InputError(
            "find_springs", f"{method} takes the springs as given", f"Use the method {JOINT}."
        )
    return METHODS[method](record, as_arrays(vehicle), bandwidth, sensors)


def _joint(
    record: LoadRecord,
    vehicle: FullVehicle,
    sensors: LoadSensors,
    on_progress: Progress | None,
    find_springs: bool,
) -> LoadsFound:
    suspension_signals(record)
    horizontal = (
        _horizontal(record, "find the loads with the springs given") if find_springs else None
    )
    tuning = JointLoadTuning(
        body_acceleration=sensors.acceleration_noise,
        compression=sensors.deflection_noise,
        wheel_acceleration=sensors.acceleration_noise,
    )
    found = wheel_loads(
        record.sample, record.dt, vehicle, tuning, on_progress=on_progress, horizontal=horizontal
    )
    static = static_loads(vehicle)
    return LoadsFound(
        record.t, found.load, found.sigma, found.total, found.total_sigma, static, found
    )


def _algebraic(
    record: LoadRecord, vehicle: FullVehicle, bandwidth: float, sensors: LoadSensors
) -> LoadsFound:
    del bandwidth, sensors
    a_x, a_y = as_numbers(_horizontal(record, "use a method with springs and dampers"))
    load = np.asarray(algebraic_loads(a_x, a_y, distribution_of(vehicle)))
    return loads_found(record, vehicle, list(load.T), [np.full(len(load), np.nan)] * 4, np.nan)


def _horizontal(record: LoadRecord, otherwise: str) -> tuple[np.ndarray, np.ndarray]:
    """a_x and a_y of a record, which it must have; else the message says what to do."""
    if record.a_x is None or record.a_y is None:
        missing = "a_x" if record.a_x is None else "a_y"
        raise InputError(missing, "the log lacks it", f"Add it, or {otherwise}.")
    return record.a_x, record.a_y


METHODS: dict[str, Callable[[LoadRecord, FullVehicle, float, LoadSensors], LoadsFound]] = {
    YOULA: loads_by_youla,
    UNBIASED: loads_by_unbiased,
    DERIVATIVE: loads_by_derivative,
    ALGEBRAIC: _algebraic,
}
"""Of single corners and axles, by the name a user gives."""

NAMES = (JOINT, *METHODS)
"""Of all methods."""
