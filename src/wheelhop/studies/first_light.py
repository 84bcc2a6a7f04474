"""First light: a leaking tyre on a random road, seen by an IMM of unscented filters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import jax

from wheelhop.estimators.estimate_immuf import estimate_by_immuf
from wheelhop.estimators.immuf import Tuning
from wheelhop.estimators.pressure_estimate import PressureEstimate
from wheelhop.vehicle.parameters import QuarterCar, brancati_suv
from wheelhop.vehicle.record import CornerRecord, checked_record
from wheelhop.vehicle.road import class_level
from wheelhop.vehicle.scenario import RATE, Leak, constant_travel, drive, road_rise_of_class

LEAK = Leak(start=230e3, end=180e3, begin=6.0, finish=12.0)


@dataclass(frozen=True)
class FirstLight:
    """Settings of the study.

    Attributes:
        road_class: ISO 8608 class of the true road.
        speed: v [m/s].
        duration: of the drive [s].
        leak: pressure over time.
        seed: of road and sensors.
    """

    road_class: str = "B"
    speed: float = 60.0 / 3.6
    duration: float = 20.0
    leak: Leak = LEAK
    seed: int = 0


def simulate_first_light(settings: FirstLight, car: QuarterCar) -> CornerRecord:
    """The log of the drive."""
    road_key, sensor_key = jax.random.split(jax.random.key(settings.seed))
    samples = round(settings.duration * RATE)
    travel = constant_travel(settings.speed, samples, RATE)
    rise = road_rise_of_class(road_key, class_level(settings.road_class), travel)
    record, _ = drive(sensor_key, car, rise, settings.leak, settings.speed)
    return checked_record(record)


def run_first_light(
    settings: FirstLight = FirstLight(),
    tuning: Tuning = Tuning(),
    on_progress: Callable[[int, int], None] | None = None,
) -> tuple[CornerRecord, PressureEstimate]:
    """Simulate the drive and estimate the pressure from its two accelerometers."""
    car = brancati_suv()
    record = simulate_first_light(settings, car)
    return record, estimate_by_immuf(record, car, tuning=tuning, on_progress=on_progress)
