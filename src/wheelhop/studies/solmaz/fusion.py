"""One drive that both estimators watch: straight on a rough road, lane changes, a soft tyre."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.estimators.calibration import bias_cov, calibrate
from wheelhop.estimators.estimate_vehicle import COMMON_DRIFT, SINGLE_DRIFT, estimate_by_hop
from wheelhop.estimators.four_corners import WHEELS
from wheelhop.estimators.hop_band import HOP_TUNING
from wheelhop.estimators.lateral import LateralSample
from wheelhop.estimators.lateral_bank import (
    bank_prior,
    bind_drive,
    lateral_bank,
    lateral_params,
    readings_and_inputs,
)
from wheelhop.estimators.lateral_fusion import Fused, fuse, fusion_params
from wheelhop.estimators.lateral_model import (
    LATERAL_PRIOR,
    LATERAL_WALK,
    LateralReading,
    LateralTuning,
)
from wheelhop.estimators.pressure import StiffnessBelief, ln_stiffness
from wheelhop.estimators.stiffness import prior_ln_sigma
from wheelhop.estimators.vertical_evidence import no_evidence, vertical_evidence, walked
from wheelhop.filtering import run_batch
from wheelhop.studies.frame import Advance, Store
from wheelhop.studies.solmaz.settings import SolmazSettings
from wheelhop.studies.solmaz.vehicle_drives import SOUND, lateral_suv, sound_vehicle
from wheelhop.studies.solmaz.vehicle_maneuvers import held_angle
from wheelhop.vehicle.curve import Curve
from wheelhop.vehicle.lateral_tire import MAGIC_FORMULA
from wheelhop.vehicle.maneuver import Maneuver
from wheelhop.vehicle.parameters import brancati_suv
from wheelhop.vehicle.pressure_course import PressureCourse
from wheelhop.vehicle.record import CornerRecord
from wheelhop.vehicle.road import class_level, surface_from_tracks
from wheelhop.vehicle.road.build import SPACING, START, lines_of
from wheelhop.vehicle.road.envelope import HALF_LENGTHS, Envelope
from wheelhop.vehicle.road.isotropic import draw_tracks, prepare_isotropic
from wheelhop.vehicle.road.tracks import grid_points, with_lead_in
from wheelhop.vehicle.two_track import Wheels
from wheelhop.vehicle.two_track_of import tires_of, two_track_of
from wheelhop.vehicle.vehicle_record import drive_vehicle

DEMO_SPEED = 25.0
"""Of the drive [m/s]."""

DEMO_DURATION = 60.0
"""Of the drive [s], and of the one before it at the known pressure."""

DEMO_PRESSURES = (180e3, SOUND, SOUND, SOUND)
"""Of the tyres FL, FR, RL, RR [Pa]."""

LEVELS = (140e3, 170e3, 200e3, SOUND)
"""Pressures that the lateral estimator tries on every tyre [Pa]."""

LANE_CHANGES = (20.0, 32.0, 44.0)
"""Times at which double lane changes begin [s]."""

PEAK = 3.0
"""Lateral acceleration that their steering angle would hold on a circle [m/s^2]."""

TUNING = LateralTuning(
    prior=LATERAL_PRIOR._replace(ln_friction=0.1, ln_mass=0.03),
    walk=LATERAL_WALK._replace(side_slip=1e-3, yaw_rate=5e-3, ln_friction=3e-3),
    noise=LateralReading(0.15, 0.003),
    misfit=0.1,
)
"""Of the lateral filters: a rough road shakes the accelerometer by 0.1 m/s^2 and more, and the
full vehicle's roll and its tyres' lag are not in their model."""

TEMPER = 0.1
"""Exponent of the lateral likelihoods: those errors last for about ten samples of 50 Hz."""

SETTLED = 5.0
"""Time after which beliefs are shown [s]: before, that of the vertical estimator is no Gaussian."""

_VERTICAL_RATE = 500.0
_SUBSTEPS = 2
_LATERAL_EVERY = 10
_PERIOD, _GAP = 2.5, 2.0


@dataclass(frozen=True)
class Course:
    """What is believed of the tyres over time.

    Attributes:
        pressure: mean [Pa], [time, 4].
        pressure_sd: [Pa], [time, 4].
        low: probability that a tyre is below 0.85 of the sound pressure, [time, 4].
    """

    pressure: np.ndarray
    pressure_sd: np.ndarray
    low: np.ndarray


@dataclass(frozen=True)
class FusionDemo:
    """One drive seen by both.

    Attributes:
        time: [s], [time].
        lateral_acceleration: as measured [m/s^2], [time].
        true: pressures [Pa], [4].
        vertical, lateral, fused: beliefs, each with the prior of the levels.
        agreement: ln Bayes factor of the two estimators (`lateral_fusion.Fused`), [time].
        gap: vertical less lateral estimate, in standard deviations, [time, 4].
    """

    time: np.ndarray
    lateral_acceleration: np.ndarray
    true: np.ndarray
    vertical: Course
    lateral: Course
    fused: Course
    agreement: np.ndarray
    gap: np.ndarray


def fusion_demo(settings: SolmazSettings, store: Store, advance: Advance) -> FusionDemo:
    """Drive the full vehicle, run both estimators, fuse them ten times a second.

    A first drive at the known pressure calibrates the vertical estimator, as a driver's reset.

    Args:
        settings: of the study.
        store: of what is finished.
        advance: told of the drives, the two estimators and the fusion.
    """
    depends = asdict(settings)
    logs = store.arrays("fusion_drives", depends, partial(_driven, settings))
    advance(1, 4)
    vertical = store.arrays("fusion_vertical", depends, lambda: _vertical(logs))
    advance(2, 4)
    lateral = store.arrays("fusion_lateral", depends, lambda: _lateral(logs))
    advance(3, 4)
    found = _together(vertical, lateral, logs)
    advance(4, 4)
    return found


def _driven(settings: SolmazSettings) -> dict[str, np.ndarray]:
    """What the sensors report of both drives, [2, time] or [2, time, 4]."""
    car, duration = lateral_suv(), _duration(settings)
    x = grid_points(START, DEMO_SPEED * duration + 40.0, SPACING)
    prepared = prepare_isotropic(len(x) * SPACING, SPACING, 2.0, lines_of(car))
    records = []
    for number, (peak, pressures) in enumerate(((0.0, (SOUND,) * 4), (PEAK, DEMO_PRESSURES))):
        road, sensors = jax.random.split(jax.random.fold_in(jax.random.key(settings.seed), number))
        z = draw_tracks(road, prepared, class_level("B"))[:, : len(x)]
        tracks = with_lead_in(z, jnp.asarray(x, z.dtype))
        surface = surface_from_tracks(
            tracks, SPACING, START, Envelope("moving_average", HALF_LENGTHS)
        )
        held = np.asarray(pressures, float)
        records.append(
            drive_vehicle(
                sensors,
                car,
                _lane_changes(peak),
                surface,
                PressureCourse(held, held, 0.0, 1.0),
                duration,
                rate=_VERTICAL_RATE,
                substeps=_SUBSTEPS,
            )
        )
    ratio = float(car.steering_ratio)
    single = {name: np.stack([r.measured[name] for r in records]) for name in _SINGLE}
    corner = {
        name: np.array([[r.measured[f"{name}_{w}"] for w in WHEELS] for r in records])
        for name in ("a_s", "a_u")
    }
    steer = single.pop("steering_wheel") / ratio
    return {"t": records[0].t, "steer": steer, **single, **corner}


_SINGLE = ("v", "a_y", "yaw_rate", "steering_wheel")


def _duration(settings: SolmazSettings) -> float:
    return 30.0 if settings.quick else DEMO_DURATION


def _lane_changes(peak: float) -> Maneuver:
    """A driver who keeps the lane and steers double lane changes on top of that."""
    angle = held_angle(DEMO_SPEED, peak, sound_vehicle())
    wave = np.array([0.0, 0.25, 0.75, 1.0]) * _PERIOD
    begins = np.array([[t, t + _PERIOD + _GAP] for t in LANE_CHANGES]).ravel()
    times = (begins[:, None] + wave).ravel()
    signs = np.tile([0.0, 1.0, -1.0, 0.0, 0.0, -1.0, 1.0, 0.0], len(LANE_CHANGES))
    return Maneuver(
        DEMO_SPEED,
        release=np.inf,
        steer=Curve(times, angle * signs, np.zeros_like(times)),
        follow=1.0,
    )


def _vertical(logs: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Beliefs over ln k_t of the second drive, and the calibration by the first."""
    cars = [brancati_suv("front")] * 2 + [brancati_suv("rear")] * 2
    both = []
    for k in range(2):
        records = [
            CornerRecord(logs["t"], logs["a_s"][k, w], logs["a_u"][k, w], logs["v"][k])
            for w in range(len(WHEELS))
        ]
        both.append(estimate_by_hop(records, cars))
    known, watched = both
    reset = calibrate(
        known.t,
        known.stiffness.mean,
        known.stiffness.cov,
        cars[0].tire,
        SOUND,
        belief_walk=HOP_TUNING.stiffness_walk,
        shortest=20.0,
    )
    return {
        "t": watched.t,
        "mean": watched.stiffness.mean,
        "cov": watched.stiffness.cov,
        "offset": reset.offset,
        "bias": bias_cov(reset, COMMON_DRIFT, SINGLE_DRIFT),
    }


def _prior() -> np.ndarray:
    """Of the modes: a half that all tyres are sound, the rest shared."""
    modes = len(LEVELS) ** len(WHEELS)
    prior = np.full(modes, 0.5 / (modes - 1))
    prior[-1] = 0.5
    return prior


def _lateral(logs: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Log probabilities of the modes in the second drive."""
    car = sound_vehicle()
    levels = Wheels(*zip(*(tires_of(car, np.full(4, p)) for p in LEVELS), strict=True))
    kind = jnp.result_type(float)
    params = lateral_params(
        two_track_of(car, jnp.full(4, SOUND, kind)),
        levels,
        _LATERAL_EVERY / _VERTICAL_RATE,
        tuning=TUNING,
        prior=_prior(),
        temper=TEMPER,
    )
    params = jax.tree.map(lambda a: jnp.asarray(a, kind), params)
    chosen = slice(_LATERAL_EVERY - 1, None, _LATERAL_EVERY)
    names = ("steer", "v", "a_y", "yaw_rate")
    sample = LateralSample(*(jnp.asarray(logs[n][1, chosen], kind) for n in names))
    readings, inputs = readings_and_inputs(sample)
    filter = lateral_bank(MAGIC_FORMULA)
    state = filter.init(bank_prior(params), params)
    # as a batch of one: compiled in a fraction of the time of the loop as one native function
    ys, us = jax.tree.map(lambda a: a[None], (readings, inputs))
    found = run_batch(filter, state, ys, params, inputs=us, bind=bind_drive, keep=_keep)
    return {"t": logs["t"][chosen], "log_probabilities": np.asarray(found[0], float)}


def _keep(state: Any, info: Any) -> Any:
    del info
    return state.log_probabilities


def _together(
    vertical: dict[str, np.ndarray], lateral: dict[str, np.ndarray], logs: dict[str, np.ndarray]
) -> FusionDemo:
    tire = brancati_suv().tire
    params = fusion_params(LEVELS, tire, prior=_prior())
    kind = params.reference.dtype
    shown = vertical["t"] >= SETTLED
    time = vertical["t"][shown]
    mean, cov, t = (jnp.asarray(vertical[name][shown], kind) for name in ("mean", "cov", "t"))
    at = np.searchsorted(lateral["t"], time + 1e-6) - 1
    told = jnp.asarray(lateral["log_probabilities"][at], kind)
    # the estimator's own errors at the known pressure shift its belief and its prior alike
    origin = params.reference + jnp.asarray(vertical["offset"], kind)
    before = StiffnessBelief(
        jnp.broadcast_to(ln_stiffness(HOP_TUNING.prior_pressure, tire), (4,)),
        prior_ln_sigma(HOP_TUNING, tire) ** 2 * jnp.eye(4, dtype=kind),
    )
    bias = jnp.asarray(vertical["bias"], kind)

    @jax.jit
    def run(log_probabilities: Any, mean: Any, cov: Any, t: Any) -> tuple[Fused, Fused, Fused]:
        prior = walked(before, HOP_TUNING.stiffness_walk, t)
        evidence = vertical_evidence(StiffnessBelief(mean, cov), origin, prior, bias)
        silent = no_evidence(origin)
        return (
            fuse(params.log_prior, evidence, params),
            fuse(log_probabilities, silent, params),
            fuse(log_probabilities, evidence, params),
        )

    alone, other, fused = jax.vmap(run)(told, mean, cov, t)
    a_y = np.interp(time, logs["t"], logs["a_y"][1])
    return FusionDemo(
        time,
        a_y,
        np.array(DEMO_PRESSURES),
        _course(alone),
        _course(other),
        _course(fused),
        np.asarray(fused.agreement, float),
        np.asarray(fused.gap, float),
    )


def _course(found: Fused) -> Course:
    return Course(*(np.asarray(a, float) for a in (found.pressure, found.pressure_sd, found.low)))
