"""The paper's Monte Carlo scenarios: pressure, speed, road class and initial motion at random."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from wheelhop.errors import InputError, require_in_range
from wheelhop.estimators.immuf import ROAD_CLASSES, Tuning, validate_tuning
from wheelhop.vehicle.road import class_level
from wheelhop.vehicle.road.shape_filter import stationary_variance


@dataclass(frozen=True)
class CampaignSettings:
    """What defines a Monte Carlo campaign; equal settings give equal results.

    Attributes:
        runs: number of independent runs.
        duration: of each run [s].
        rate: sampling rate [Hz].
        substeps: simulation steps per sample.
        pressure: range of the true pressure [Pa] (Brancati & Tufano 2022, Table 4).
        speed: range of the speed [m/s].
        classes: ISO 8608 classes, drawn with equal probability.
        level_spread: half width of a uniform error of the road's level about its class centre,
            in classes; 0 for exact classes, 0.5 for roads of any level.
        noise: standard deviation of both accelerometers [m/s^2]; the filter believes what its
            tuning says, which may be something else.
        convention: of the road levels, in the truth and in the filter.
        tuning: of the filter.
        seed: of all random numbers.
    """

    runs: int = 100
    duration: float = 10.0
    rate: float = 500.0
    substeps: int = 10
    pressure: tuple[float, float] = (130e3, 230e3)
    speed: tuple[float, float] = (40.0 / 3.6, 80.0 / 3.6)
    classes: tuple[str, ...] = ROAD_CLASSES
    level_spread: float = 0.0
    noise: float = 0.5
    convention: str = "iso8608"
    tuning: Tuning = field(default_factory=Tuning)
    seed: int = 0


class Scenario(NamedTuple):
    """One run's truth.

    Attributes:
        key: JAX random key of the road and the sensors.
        pressure: tyre pressure [Pa].
        speed: v [m/s].
        road_class: index into the settings' classes.
        level: Gd(W0) [m^3/rad].
        motion: initial motion in standard deviations of the filter's prior, [4].
    """

    key: Any
    pressure: Any
    speed: Any
    road_class: Any
    level: Any
    motion: Any


def validate_settings(settings: CampaignSettings) -> CampaignSettings:
    """The same settings, checked.

    Raises:
        InputError: naming the setting that is out of range.
    """
    s = settings
    if s.runs < 2:
        raise InputError("--runs", f"{s.runs} has no spread", "Give at least 2.")
    require_in_range("duration", s.duration, 0.2, 3600.0, "s")
    require_in_range("rate", s.rate, 50.0, 20e3, "Hz")
    require_in_range("substeps", s.substeps, 1, 1000, "per sample")
    for name, (low, high), least, most, unit in (
        ("pressure", s.pressure, 20e3, 1.5e6, "Pa"),
        ("speed", s.speed, 1.0, 100.0, "m/s"),
    ):
        require_in_range(name, low, least, most, unit)
        require_in_range(name, high, low, most, unit)
    require_in_range("level spread", s.level_spread, 0.0, 4.0, "classes")
    require_in_range("noise", s.noise, 1e-3, 100.0, "m/s^2")
    for name in s.classes:
        class_level(name)
    stationary_variance(1.0, s.convention)
    validate_tuning(s.tuning)
    return s


def draw_scenario(settings: CampaignSettings, run: Any) -> Scenario:
    """Truth of one run; it depends on the seed and the run's number alone.

    Args:
        settings: of the campaign.
        run: number of the run, a traced integer under vmap.
    """
    key = jax.random.fold_in(jax.random.key(settings.seed), run)
    keys = jax.random.split(key, 6)
    levels = jnp.array([class_level(c) for c in settings.classes])
    index = jax.random.randint(keys[2], (), 0, len(settings.classes))
    shift = jax.random.uniform(keys[3], (), float, -1.0, 1.0) * settings.level_spread
    low, high = settings.pressure
    slow, fast = settings.speed
    return Scenario(
        key=keys[5],
        pressure=jax.random.uniform(keys[0], (), float, low, high),
        speed=jax.random.uniform(keys[1], (), float, slow, fast),
        road_class=index,
        level=levels[index] * 4.0**shift,
        motion=jax.random.normal(keys[4], (4,), float),
    )
