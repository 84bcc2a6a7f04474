"""Which tyre is soft on the 14-degree-of-freedom vehicle, whose estimators know a simpler one.

The same records go to the bank of filters with probabilities and to the switched models with an
observer of the side slip, both on the reduced two-track model with the tyres' Magic Formula.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace
from functools import lru_cache, partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.estimators.lateral import STEADY_TUNING, LateralSample
from wheelhop.estimators.lateral_vehicle import (
    VEHICLE_LATERAL_TUNING,
    VEHICLE_TEMPER,
    SoftTires,
    peak_so_far,
    which_tires_are_soft,
)
from wheelhop.studies.frame import Advance, Store
from wheelhop.studies.solmaz.judges import EVERY, Verdicts, by_filters, by_switching
from wheelhop.studies.solmaz.sensor_errors import (
    STABILITY_CONTROL,
    SensorErrors,
    with_sensor_errors,
)
from wheelhop.studies.solmaz.settings import SolmazSettings
from wheelhop.studies.solmaz.vehicle_conditions import (
    ASSUMED,
    MAIN,
    Condition,
    Piece,
    conditions,
    lanes_of,
    pieces,
)
from wheelhop.studies.solmaz.vehicle_drives import (
    RATE,
    SOUND,
    LateralSignals,
    drive_cornering,
    sound_vehicle,
)
from wheelhop.vehicle.lateral_record import LateralRecord
from wheelhop.vehicle.lateral_tire import MAGIC_FORMULA
from wheelhop.vehicle.two_track import TwoTrack, Wheels
from wheelhop.vehicle.two_track_of import tires_of, two_track_of

BANK, SWITCHED = "bank of filters", "observer"

OFFSETS = SensorErrors(0.1, 0.003, 0.016, 0.1)
"""Standard deviations of the sensors' offsets: 0.016 rad of the steering wheel are 0.001 rad of the
front wheels."""

DURATION, QUICK_DURATION = 20.0, 12.0
"""Of a drive [s]."""

SHOWN = (3, 2.5)
"""Mode of the run that is shown over time, FL+FR, and the lateral acceleration [m/s^2] that its own
comes closest to."""

_SPUN, _ROLLED = 0.2, 0.3


class Outcome(NamedTuple):
    """Of the drives of a condition.

    Attributes:
        true: mode of every run, [runs].
        speed: [m/s], [runs].
        peak: largest lateral acceleration that the body's accelerometer sees [m/s^2], [runs].
        lost: whether the vehicle spun or rolled over, [runs].
        lifted: whether a wheel left the road, [runs].
        cornered: as from `lateral_vehicle.peak_so_far` [m/s^2], [runs, time].
        bank, switched: verdicts on the runs.
    """

    true: np.ndarray
    speed: np.ndarray
    peak: np.ndarray
    lost: np.ndarray
    lifted: np.ndarray
    cornered: np.ndarray
    bank: Verdicts
    switched: Verdicts


class FullVehicleResult(NamedTuple):
    """Results.

    Attributes:
        settings: that made them.
        time: of the verdicts [s], [time].
        conditions: by name.
        outcomes: of the conditions.
        record: of the run that is shown over time.
        shown: what is believed of it.
    """

    settings: SolmazSettings
    time: np.ndarray
    conditions: dict[str, Condition]
    outcomes: dict[str, Outcome]
    record: LateralRecord
    shown: SoftTires


def full_vehicle(settings: SolmazSettings, store: Store, advance: Advance) -> FullVehicleResult:
    """Drive every condition and let both estimators judge it.

    Args:
        settings: of the study.
        store: of what is finished.
        advance: told of the pieces.
    """
    every = conditions(settings)
    work = {name: list(pieces(condition, settings)) for name, condition in every.items()}
    total, done = sum(len(p) for p in work.values()) + 1, 0
    outcomes = {}
    for name, condition in every.items():
        found = []
        for piece in work[name]:
            advance(done, total)
            key = f"vehicle_{condition.number}_{piece.number}"
            judge = partial(judged, piece, condition, settings)
            found.append(store.arrays(key, _depends(condition, piece, settings), judge))
            done += 1
        outcomes[name] = _joined(found)
    advance(done, total)
    example = store.arrays(
        "vehicle_example",
        _depends(every[MAIN], work[MAIN][0], settings),
        partial(_example, work[MAIN][0], every[MAIN], settings),
    )
    sample = LateralSample(*(example[name] for name in LateralSample._fields))
    record = LateralRecord((1.0 + np.arange(len(sample.steer))) / RATE, sample)
    car, levels = believed_vehicle("falling")
    shown = which_tires_are_soft(sample, 1.0 / RATE, car, levels)
    advance(total, total)
    time = np.arange(EVERY, round(duration_of(settings) * RATE) + 1, EVERY) / RATE
    return FullVehicleResult(settings, time, every, outcomes, record, shown)


def duration_of(settings: SolmazSettings) -> float:
    """Of a drive [s]."""
    return QUICK_DURATION if settings.quick else DURATION


def _depends(condition: Condition, piece: Piece, settings: SolmazSettings) -> dict[str, Any]:
    noise = {"noise": settings.noise, "yaw_rate_noise": settings.yaw_rate_noise}
    size = {"lanes": len(piece.true), "duration": duration_of(settings)}
    return asdict(condition) | noise | size | {"seed": settings.seed, "piece": piece.number}


@lru_cache(maxsize=4)
def believed_vehicle(law: str) -> tuple[TwoTrack, Wheels]:
    """The vehicle as the estimators know it: model, and each wheel's soft and sound tyre.

    Args:
        law: of the pressure that they believe.
    """
    kind = jnp.result_type(float)
    vehicle = sound_vehicle(law)
    soft, sound = (tires_of(vehicle, jnp.full(4, p, kind)) for p in (ASSUMED, SOUND))
    levels = Wheels(*((a, b) for a, b in zip(soft, sound, strict=True)))
    return two_track_of(vehicle, jnp.full(4, SOUND, kind)), levels


def judged(piece: Piece, condition: Condition, settings: SolmazSettings) -> dict[str, np.ndarray]:
    """What becomes of some drives, as arrays.

    Args:
        piece: the drives.
        condition: of theirs.
        settings: noise of the sensors.
    """
    signals = drive_cornering(piece.runs, duration_of(settings), piece.seed)
    sample = sensed(signals, piece, condition, settings)
    return {
        "true": piece.true,
        "speed": piece.speed,
        "peak": np.abs(signals.lateral_acceleration).max(axis=1),
        "lost": lost_control(signals),
        "lifted": signals.load.min(axis=(1, 2)) <= 0.0,
        "cornered": peak_so_far(sample.lateral_acceleration, 1.0 / RATE)[:, EVERY - 1 :: EVERY],
        **told(sample, condition.believed, lanes_of(settings)),
    }


def lost_control(signals: LateralSignals) -> np.ndarray:
    """Whether the vehicle slid by more than 0.2 rad or leaned by more than 0.3 rad, [runs]."""
    slid = np.abs(signals.side_slip).max(axis=1) > _SPUN
    return np.asarray(slid | (np.abs(signals.roll).max(axis=1) > _ROLLED))


def sensed(
    signals: LateralSignals, piece: Piece, condition: Condition, settings: SolmazSettings
) -> LateralSample:
    """What the sensors say of some drives.

    Args:
        signals: of the drives.
        piece: the drives.
        condition: size of the offsets.
        settings: noise of the sensors.
    """
    noise = replace(
        STABILITY_CONTROL, lateral_acceleration=settings.noise, yaw_rate=settings.yaw_rate_noise
    )
    offsets = SensorErrors(*(condition.offsets * size for size in vars(OFFSETS).values()))
    return with_sensor_errors(jax.random.key(piece.seed), signals, noise, biased=offsets)


def told(sample: LateralSample, believed: str, lanes: int) -> dict[str, np.ndarray]:
    """Verdicts of both, as arrays.

    Args:
        sample: of the sensors, [runs, time].
        believed: law of the pressure that they believe.
        lanes: runs judged at once.
    """
    car, levels = believed_vehicle(believed)
    dt = 1.0 / RATE
    bank = by_filters(
        sample, dt, car, levels, VEHICLE_LATERAL_TUNING, VEHICLE_TEMPER, MAGIC_FORMULA, lanes
    )
    switched = by_switching(sample, dt, car, levels, STEADY_TUNING, law=MAGIC_FORMULA, lanes=lanes)
    found: dict[str, np.ndarray] = {}
    for who, verdicts in ((BANK, bank), (SWITCHED, switched)):
        small: list[np.ndarray] = [verdicts.selected.astype(np.int8)]
        small += [entry.astype(np.float32) for entry in verdicts[1:]]
        found |= {f"{who} {n}": v for n, v in zip(Verdicts._fields, small, strict=True)}
    return found


def _joined(parts: list[dict[str, np.ndarray]]) -> Outcome:
    whole: Mapping[str, np.ndarray] = {
        name: np.concatenate([part[name] for part in parts]) for name in parts[0]
    }

    def verdicts(who: str) -> Verdicts:
        selected, *rest = (whole[f"{who} {name}"] for name in Verdicts._fields)
        return Verdicts(selected.astype(int), *rest)

    plain = {name: whole[name] for name in Outcome._fields[:-2]}
    return Outcome(**plain, bank=verdicts(BANK), switched=verdicts(SWITCHED))


def _example(piece: Piece, condition: Condition, settings: SolmazSettings) -> dict[str, np.ndarray]:
    """What the sensors say of the run that is shown."""
    mode, wanted = SHOWN
    signals = drive_cornering(piece.runs, duration_of(settings), piece.seed)
    sample = sensed(signals, piece, condition, settings)
    peak = np.abs(signals.lateral_acceleration).max(axis=1)
    chosen = int(np.argmin(np.abs(peak - wanted) + np.where(piece.true == mode, 0.0, 1e3)))
    return {
        name: np.asarray(entry)[chosen]
        for name, entry in zip(LateralSample._fields, sample, strict=True)
    }
