"""The paper's simulation: a double lane change at 120 km/h with a soft front left tyre."""

from __future__ import annotations

from dataclasses import asdict
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.estimators.failure_modes import stacked_tires
from wheelhop.estimators.lateral import (
    LateralSample,
    SwitchedInfo,
    SwitchedParams,
    SwitchedState,
    SwitchTuning,
    switched,
)
from wheelhop.studies.frame import Advance, Store
from wheelhop.studies.solmaz.settings import (
    DURATION,
    SPEED,
    SolmazSettings,
    maneuver,
    sensor_noise,
)
from wheelhop.vehicle.cornering import DT, simulate_cornering
from wheelhop.vehicle.lateral_tire import NOMINAL_TIRE, SOFT_TIRE
from wheelhop.vehicle.two_track import SOLMAZ_CAR, Wheels

PRINTED = "as printed"
CORRECTED = "right turns corrected"
OBSERVER = "observer"

METHODS = {
    PRINTED: ("integrated", True),
    CORRECTED: ("integrated", False),
    OBSERVER: ("observer", False),
}
"""Side slip, and whether Eq. 2 and 9 are kept as printed, by name."""

BIAS = 0.05
"""Of the accelerometer, where its drift is shown [m/s^2]."""

TUNING = SwitchTuning()
"""Weights of the cost; the paper gives none."""

CLEAN, BIASED, NOISY = 0, 1, 2
"""Place of the run with perfect sensors, of that with a bias alone, and of the first noisy one."""


class Track(NamedTuple):
    """What a method says over all runs.

    Attributes:
        selected: model believed, from zero, [2 + runs, time].
        side_slip: that the model believed takes [rad], [2 + runs, time].
        lateral_acceleration: of the model believed, with perfect sensors [m/s^2], [time].
        yaw_rate: likewise [rad/s], [time].
        cost: J of all models, with perfect sensors, [time, 16].
        overloaded: tyres of the model believed on which the law's guard acts, with perfect
            sensors, [time].
    """

    selected: np.ndarray
    side_slip: np.ndarray
    lateral_acceleration: np.ndarray
    yaw_rate: np.ndarray
    cost: np.ndarray
    overloaded: np.ndarray


class Paper(NamedTuple):
    """Results.

    Attributes:
        settings: that made them.
        time: [s], [time].
        steer: [rad], [time].
        side_slip: true [rad], [time].
        yaw_rate: true [rad/s], [time].
        lateral_acceleration: true [m/s^2], [time].
        tracks: of `METHODS`.
    """

    settings: SolmazSettings
    time: np.ndarray
    steer: np.ndarray
    side_slip: np.ndarray
    yaw_rate: np.ndarray
    lateral_acceleration: np.ndarray
    tracks: dict[str, Track]


def paper(settings: SolmazSettings, store: Store, advance: Advance) -> Paper:
    """Simulate the drive and let every method select its models.

    Args:
        settings: of the study.
        store: of what is finished.
        advance: told of the drive and the methods.
    """
    total = 1 + len(METHODS)
    truth = store.arrays("paper_truth", settings.amplitude, partial(_driven, settings))
    advance(1, total)
    tracks = {}
    for name, (slip, printed) in METHODS.items():
        work = partial(_selected, slip, printed, truth, settings)
        found = store.arrays(f"paper_{name.replace(' ', '_')}", _depends(settings), work)
        tracks[name] = Track(**found)
        advance(1 + len(tracks), total)
    return Paper(settings, **truth, tracks=tracks)


def _depends(settings: SolmazSettings) -> dict[str, Any]:
    content = asdict(settings)
    del content["quick"]
    return content


def _driven(settings: SolmazSettings) -> dict[str, np.ndarray]:
    tires = Wheels(SOFT_TIRE, NOMINAL_TIRE, NOMINAL_TIRE, NOMINAL_TIRE)
    found = jax.jit(partial(_drive, tires=tires))(maneuver(settings))
    names = ("time", "steer", "side_slip", "yaw_rate", "lateral_acceleration")
    return {name: np.asarray(getattr(found, name)) for name in names}


def _drive(steer: Any, tires: Wheels) -> Any:
    return simulate_cornering(steer, SPEED, tires, SOLMAZ_CAR, duration=DURATION)


def _selected(
    slip: str, printed: bool, truth: dict[str, np.ndarray], settings: SolmazSettings
) -> dict[str, np.ndarray]:
    samples = sensor_samples(truth, settings)
    chosen = switched(slip, printed)

    def one(y: LateralSample) -> Any:
        params = SwitchedParams(SOLMAZ_CAR, stacked_tires((SOFT_TIRE, NOMINAL_TIRE)), DT, TUNING)

        def step(state: SwitchedState, now: LateralSample) -> tuple[SwitchedState, Track]:
            after, info = chosen.step(state, now, params)
            return after, _keep(after, info)

        return jax.lax.scan(step, chosen.init(params), y)[1]

    found = jax.tree.map(np.asarray, jax.jit(jax.vmap(one))(samples))
    clean = {
        name: getattr(found, name)[CLEAN]
        for name in ("lateral_acceleration", "yaw_rate", "cost", "overloaded")
    }
    return {"selected": found.selected, "side_slip": found.side_slip, **clean}


def _keep(state: SwitchedState, info: SwitchedInfo) -> Track:
    at = info.selected
    return Track(
        selected=at.astype(jnp.int32),
        side_slip=state.side_slip[at],
        lateral_acceleration=info.lateral_acceleration[at],
        yaw_rate=info.yaw_rate[at],
        cost=info.cost,
        overloaded=info.overloaded,
    )


def sensor_samples(truth: dict[str, np.ndarray], settings: SolmazSettings) -> LateralSample:
    """What the sensors say: perfect, with `BIAS` alone, and with noise; [2 + runs, time]."""
    count = len(truth["time"])
    shape = (NOISY + settings.runs, count)
    a, r = np.zeros(shape), np.zeros(shape)
    a[BIASED] = BIAS
    a[NOISY:], r[NOISY:] = sensor_noise(settings, count)
    entries = (
        np.broadcast_to(truth["steer"], shape),
        np.full(shape, SPEED),
        truth["lateral_acceleration"] + a,
        truth["yaw_rate"] + r,
    )
    return LateralSample(*(jnp.asarray(entry, float) for entry in entries))
