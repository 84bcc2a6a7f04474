"""Four tyres on a random road, one of which leaks: the log of a whole vehicle's corners."""

from __future__ import annotations

from dataclasses import dataclass, field

import jax
import numpy as np

from wheelhop.estimators.four_corners import WHEELS
from wheelhop.vehicle.parameters import QuarterCar, brancati_suv
from wheelhop.vehicle.record import CornerRecord, checked_record
from wheelhop.vehicle.road import class_level
from wheelhop.vehicle.scenario import (
    RATE,
    Leak,
    constant_pressure,
    constant_travel,
    drive,
    road_rise_of_class,
)


@dataclass(frozen=True)
class FourTyres:
    """Settings of the drive.

    Attributes:
        road_class: ISO 8608 class of the road; every wheel meets a stretch of its own.
        speed: v [m/s].
        duration: of the drive [s].
        placard: pressure of the tyres that hold [Pa].
        leaking: name of the wheel that leaks.
        leak: its pressure over time.
        seed: of roads and sensors.
    """

    road_class: str = "B"
    speed: float = 60.0 / 3.6
    duration: float = 60.0
    placard: float = 230e3
    leaking: str = "FR"
    leak: Leak = field(default=Leak(start=230e3, end=170e3, begin=15.0, finish=40.0))
    seed: int = 0


def corners() -> tuple[QuarterCar, ...]:
    """The corners FL, FR, RL, RR of the SUV of Brancati & Tufano 2022."""
    front, rear = brancati_suv("front"), brancati_suv("rear")
    return front, front, rear, rear


def simulate_four_tyres(settings: FourTyres) -> list[CornerRecord]:
    """Records of the four corners with their true pressures.

    Raises:
        InputError: if a setting is out of range.
    """
    level = class_level(settings.road_class)
    samples = round(settings.duration * RATE)
    travel = constant_travel(settings.speed, samples, RATE)
    records = []
    for k, (name, car) in enumerate(zip(WHEELS, corners(), strict=True)):
        road_key, sensor_key = jax.random.split(
            jax.random.fold_in(jax.random.key(settings.seed), k)
        )
        leak = settings.leak if name == settings.leaking else constant_pressure(settings.placard)
        rise = road_rise_of_class(road_key, level, travel)
        record, _ = drive(sensor_key, car, rise, leak, settings.speed)
        records.append(checked_record(record))
    return records


def true_pressure(records: list[CornerRecord]) -> np.ndarray:
    """True pressure [Pa], [time, 4]."""
    return np.stack([np.asarray(record.pressure) for record in records], axis=-1)
