"""What is driven on the paper's own car: truths, conditions, and what the sensors say of them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.estimators.failure_modes import stacked_tires
from wheelhop.estimators.lateral import LateralSample
from wheelhop.studies.solmaz.outcomes import MODES, SOUND
from wheelhop.studies.solmaz.settings import DURATION, ONSET, SPEED, SolmazSettings
from wheelhop.vehicle.cornering import DT, Cornering, double_lane_change
from wheelhop.vehicle.lateral_tire import NOMINAL_TIRE, SOFT_TIRE, ArctangentTire
from wheelhop.vehicle.steered_cornering import drive_cornering
from wheelhop.vehicle.two_track import SOLMAZ_CAR, Wheels

STEER_NOISE = 0.002 / 16.0
"""Of the angle of the front wheels [rad]: that of a steering-wheel sensor, geared."""

OFFSETS = (0.1, 0.005, 0.001)
"""Standard deviations of the sensors' offsets where they have any: accelerometer [m/s^2], yaw rate
[rad/s], angle of the front wheels [rad]."""

STIFF_TIRE = ArctangentTire(
    NOMINAL_TIRE.k1,
    NOMINAL_TIRE.k2**2 / SOFT_TIRE.k2,
    NOMINAL_TIRE.k3**2 / SOFT_TIRE.k3,
)
"""A tyre that grips more where the paper's soft one grips less, by the same ratios."""

HALF_TIRE = ArctangentTire(
    NOMINAL_TIRE.k1,
    0.5 * (NOMINAL_TIRE.k2 + SOFT_TIRE.k2),
    0.5 * (NOMINAL_TIRE.k3 + SOFT_TIRE.k3),
)
"""Half way from the sound to the soft tyre."""

LEVELS = (SOFT_TIRE, HALF_TIRE, NOMINAL_TIRE)
"""Of the version with three levels."""

MAIN, SECOND, STRAIGHT = "main", "stronger", "straight"
EXACT_STEER = "straight, steering sensor without noise"
LEVEL_CASES = (MAIN, "sweep 0.0045")
"""That the version with three levels is tried in."""

_SWEEP = (0.0006, 0.0012, 0.002, 0.003, 0.0045, 0.0065, 0.01, 0.015, 0.02, 0.03, 0.045)
"""Amplitudes of the front wheels' angle [rad]; the sound car reaches 0.1 to 4 m/s^2."""

_SHARE, _SOUND_SHARE, _SECOND_SHARE = 0.04, 0.68, 0.16
"""Runs per run of the main case: of a condition's soft cars and its sound car, of the second
amplitude."""


@dataclass(frozen=True)
class Case:
    """One set of drives.

    Attributes:
        name: of the case.
        number: of its random numbers.
        amplitude: of the front wheels' angle [rad].
        runs: of every car with a soft tyre.
        sound_runs: of the sound car.
        friction: of the road [-].
        load: mass and yaw inertia per those that the estimators believe [-].
        soft: tyre that is called soft, as it is.
        believed: as the estimators believe it to be.
        steer_noise: of the steering sensor, in `STEER_NOISE`.
        offsets: size of the sensors' offsets, in `OFFSETS`.
        dropout: share of the samples of every sensor that are missing [-].
    """

    name: str
    number: int
    amplitude: float
    runs: int
    sound_runs: int
    friction: float = 1.0
    load: float = 1.0
    soft: ArctangentTire = SOFT_TIRE
    believed: ArctangentTire = SOFT_TIRE
    steer_noise: float = 1.0
    offsets: float = 0.0
    dropout: float = 0.0


def cases(settings: SolmazSettings) -> dict[str, Case]:
    """Every case by name; amplitudes of the sweep are named "sweep 0.01"."""
    few, many = _runs(settings, _SHARE), _runs(settings, _SOUND_SHARE)
    calm = 0.5 * settings.amplitude
    usual = Case("", 0, calm, few, few if settings.quick else many)
    main = replace(usual, name=MAIN, runs=settings.runs, sound_runs=settings.runs)
    more = _runs(settings, _SECOND_SHARE)
    second = Case(SECOND, 0, settings.amplitude, more, more)
    still = replace(usual, name=STRAIGHT, amplitude=0.0)
    exact = replace(still, name=EXACT_STEER, steer_noise=0.0)
    found = [main, second, still, exact]
    found += conditions(usual, settings.amplitude)
    sweep = _SWEEP[::4] if settings.quick else _SWEEP
    found += [Case(f"sweep {a:g}", 0, a, few, few) for a in sweep]
    return {case.name: replace(case, number=k) for k, case in enumerate(found)}


def conditions(usual: Case, amplitude: float) -> list[Case]:
    """What the estimators do not know of; on a slippery road the driver steers less.

    Args:
        usual: a case without any of it.
        amplitude: that the driver steers on a dry road where the road's friction is lacking [rad].
    """
    slippery = [
        replace(usual, name=f"friction {mu:g}", friction=mu, amplitude=mu * amplitude)
        for mu in (0.7, 0.5, 0.3)
    ]
    return [
        replace(usual, name="offsets of the sensors", offsets=1.0),
        replace(usual, name="5 % of the samples missing", dropout=0.05),
        *slippery,
        replace(usual, name="friction 0.3, steered as if dry", friction=0.3),
        replace(usual, name="20 % less load", load=0.8),
        replace(usual, name="20 % more load", load=1.2),
        replace(usual, name="opposite pressure sign, unknown", soft=STIFF_TIRE),
        replace(usual, name="opposite pressure sign, known", soft=STIFF_TIRE, believed=STIFF_TIRE),
    ]


def _runs(settings: SolmazSettings, share: float) -> int:
    return max(1, round(share * settings.runs))


def truths(case: Case) -> np.ndarray:
    """True mode of every run, [runs]."""
    return np.repeat(
        np.arange(MODES), [case.sound_runs if m == SOUND else case.runs for m in range(MODES)]
    )


def driven(case: Case, samples: int = round(DURATION / DT)) -> Cornering:
    """What the car does in every mode, noise-free, [16, time]."""
    return drive(stacked_tires((case.soft, NOMINAL_TIRE)), case, samples)


def drive(tires: Wheels, case: Case, samples: int = round(DURATION / DT)) -> Cornering:
    """What cars on given tyres do in a case, noise-free.

    Args:
        tires: `Wheels` with leaves [cars].
        case: amplitude, friction and load.
        samples: of a drive.
    """
    plain = [
        jnp.asarray(v, jnp.result_type(float)) for v in (case.amplitude, case.friction, case.load)
    ]
    tires = jax.tree.map(lambda a: jnp.asarray(a, jnp.result_type(float)), tires)
    return jax.tree.map(np.asarray, _compiled(samples)(tires, *plain))


@lru_cache(maxsize=4)
def _compiled(samples: int) -> Any:
    def one(tires: Wheels, amplitude: Any, friction: Any, load: Any) -> Cornering:
        car = replace(
            SOLMAZ_CAR, mass=load * SOLMAZ_CAR.mass, yaw_inertia=load * SOLMAZ_CAR.yaw_inertia
        )
        sound = Wheels(*[NOMINAL_TIRE] * 4)
        steer = double_lane_change(amplitude, ONSET)
        return drive_cornering(
            steer, SPEED, tires, car, sound, SOLMAZ_CAR, friction, samples=samples
        )

    return jax.jit(jax.vmap(one, in_axes=(0, None, None, None)))


def sensed(
    drives: Cornering, rows: np.ndarray, case: Case, settings: SolmazSettings
) -> LateralSample:
    """What the sensors say, [rows, time]; the errors of a run depend on its place among those of
    its row, its case's number and the seed alone.

    Args:
        drives: noise-free, [cars, time].
        rows: car of every run, [rows].
        case: offsets and dropouts.
        settings: noise and seed.
    """
    count = drives.time.shape[-1]
    noise, offset, uniform = _drawn(rows, count, case, settings)
    sizes = np.array([settings.noise, settings.yaw_rate_noise, case.steer_noise * STEER_NOISE])
    error = sizes[:, None] * noise + case.offsets * (np.array(OFFSETS) * offset)[..., None]
    error[uniform < case.dropout] = np.nan
    a, r, steer = np.moveaxis(error, 1, 0)
    entries = (
        drives.steer[rows] + steer,
        np.full(steer.shape, SPEED),
        drives.lateral_acceleration[rows] + a,
        drives.yaw_rate[rows] + r,
    )
    return LateralSample(*(np.asarray(e, jnp.result_type(float)) for e in entries))


def _drawn(
    rows: np.ndarray, count: int, case: Case, settings: SolmazSettings
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Normal numbers [rows, 3, time] and [rows, 3], uniform ones [rows, 3, time]."""
    noise = np.empty((len(rows), 3, count))
    offset = np.empty((len(rows), 3))
    uniform = np.ones((len(rows), 3, count) if case.dropout else (len(rows), 3, 1))
    seen: dict[int, int] = {}
    for k, row in enumerate(rows):
        seen[row] = seen.get(row, -1) + 1
        rng = np.random.default_rng([settings.seed, case.number, int(row), seen[row]])
        offset[k] = rng.standard_normal(3)
        noise[k] = rng.standard_normal((3, count))
        if case.dropout:
            uniform[k] = rng.random((3, count))
    return noise, offset, np.broadcast_to(uniform, noise.shape)
