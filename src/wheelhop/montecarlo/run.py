"""Monte Carlo runs as pure functions: draw, simulate, measure, filter, compare."""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.estimators.immuf import (
    CornerState,
    bind_speed,
    immuf,
    immuf_params,
    prior,
)
from wheelhop.evaluation.consistency import nees
from wheelhop.filtering import (
    Gaussian,
    Info,
    InteractingState,
    run_batch,
    standard_deviation,
)
from wheelhop.montecarlo.scenarios import CampaignSettings, Scenario, draw_scenario
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.quarter_car import Accelerations, RelativeState
from wheelhop.vehicle.scenario import (
    constant_travel,
    road_rise_of_class,
    simulate_and_measure,
)
from wheelhop.vehicle.sensors import Sensor
from wheelhop.vehicle.tire import pressure_slope, stiffness_from_pressure

REPORT_RATE = 50.0
"""Rate [Hz] at which errors are kept."""


class RunResult(NamedTuple):
    """Truth of a run, and its errors over time (entries [time], thinned).

    Attributes:
        pressure: true pressure [Pa].
        speed: v [m/s].
        road_class: index of the true class.
        level: Gd(W0) of the road [m^3/rad].
        error: pressure error, estimate minus truth [Pa].
        sigma: the filter's standard deviation of it [Pa].
        nees: of the whole state; chi-square(5) if consistent.
        nees_stiffness: of ln k_t alone; chi-square(1) if consistent.
        true_class_probability: probability the filter gives the true class.
        nis: normalised innovation squared averaged over the reporting interval.
        nonfinite: True where a step left the finite numbers.
    """

    pressure: Any
    speed: Any
    road_class: Any
    level: Any
    error: Any
    sigma: Any
    nees: Any
    nees_stiffness: Any
    true_class_probability: Any
    nis: Any
    nonfinite: Any


def report_stride(settings: CampaignSettings) -> int:
    """Samples between two reported ones."""
    return max(1, round(settings.rate / REPORT_RATE))


def report_times(settings: CampaignSettings) -> np.ndarray:
    """Times [s] of the reported samples."""
    stride = report_stride(settings)
    count = round(settings.duration * settings.rate) // stride
    return stride / settings.rate * np.arange(1, count + 1)


class Drive(NamedTuple):
    """What a run is about: the drawn scenario, the true motion and what the sensors said."""

    scenario: Scenario
    state: RelativeState
    measured: Accelerations


class Kept(NamedTuple):
    """What is kept of each filter step."""

    combined: Gaussian
    log_probabilities: Any
    nis: Any
    nonfinite: Any


def run_many(settings: CampaignSettings, car: QuarterCar, runs: Any) -> RunResult:
    """Runs of a campaign by their numbers: draw, simulate, filter in lanes, compare.

    The true motion starts from a draw of the filter's prior, so that the filter's prior is
    the truth's distribution; the pressure is uniform where the prior is Gaussian.

    Args:
        settings: of the campaign.
        car: the corner.
        runs: numbers of the runs, [runs].
    """
    drives = jax.vmap(partial(simulate_run, settings, car))(runs)
    dt = 1.0 / settings.rate
    filter = immuf(dt)
    params = immuf_params(car, 1.0, dt, settings.tuning, settings.classes, settings.convention)
    samples = drives.measured.a_s.shape[1]
    kept = run_batch(
        filter,
        filter.init(prior(car, settings.tuning), params),
        drives.measured,
        params,
        inputs=jnp.repeat(drives.scenario.speed[:, None], samples, axis=1),
        bind=bind_speed,
        keep=_keep,
    )
    return jax.vmap(partial(compare, settings, car))(drives, kept)


def simulate_run(settings: CampaignSettings, car: QuarterCar, run: Any) -> Drive:
    """Draw and drive run number `run`; vmap over it."""
    scenario = draw_scenario(settings, run)
    samples = round(settings.duration * settings.rate)
    start = RelativeState(
        *(
            s * n
            for s, n in zip(
                standard_deviation(prior(car, settings.tuning))[:4], scenario.motion, strict=True
            )
        )
    )
    road_key, sensor_key = jax.random.split(scenario.key)
    travel = constant_travel(scenario.speed, samples, settings.rate, settings.substeps)
    rise = road_rise_of_class(road_key, scenario.level, travel, settings.convention)
    sensor = Sensor(noise=settings.noise)
    truth, measured = simulate_and_measure(
        sensor_key, car, start, scenario.pressure, rise, 1.0 / settings.rate, (sensor, sensor)
    )
    return Drive(scenario, truth.state, measured)


def compare(settings: CampaignSettings, car: QuarterCar, drive: Drive, kept: Kept) -> RunResult:
    """Errors of one run's estimate against its truth, thinned; vmap over both."""
    scenario, combined = drive.scenario, kept.combined
    samples = drive.measured.a_s.shape[0]
    stiffness = stiffness_from_pressure(scenario.pressure, car.tire)
    ln_k_t = jnp.full((samples,), jnp.log(stiffness))
    full = nees(combined, CornerState(*drive.state, ln_k_t))
    ln_error = combined.mean.ln_k_t - ln_k_t
    estimate = jnp.exp(combined.mean.ln_k_t)
    slope = pressure_slope(car.tire)
    every = report_stride(settings)
    thin = slice(every - 1, None, every)
    return RunResult(
        pressure=scenario.pressure,
        speed=scenario.speed,
        road_class=scenario.road_class,
        level=scenario.level,
        error=(slope * (estimate - stiffness))[thin],
        sigma=(slope * estimate * jnp.sqrt(combined.cov[4][4]))[thin],
        nees=full[thin],
        nees_stiffness=(ln_error**2 / combined.cov[4][4])[thin],
        true_class_probability=jnp.exp(kept.log_probabilities[:, scenario.road_class])[thin],
        nis=jnp.mean(kept.nis[: samples // every * every].reshape(-1, every), axis=1),
        nonfinite=jnp.any(kept.nonfinite),
    )


def _keep(state: InteractingState, info: Info) -> Kept:
    return Kept(state.combined, state.log_probabilities, info.nis, info.flags.nonfinite)
