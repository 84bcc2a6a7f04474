"""Which tyres of a real vehicle are soft: the bank of lateral filters with settings for a car that
is not its model, and a verdict that waits until the vehicle has cornered enough."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.errors import DivergenceError, InputError, require_in_range
from wheelhop.estimators.failure_modes import level_table, mode_names, mode_of
from wheelhop.estimators.lateral import LateralSample
from wheelhop.estimators.lateral_bank import (
    bank_prior,
    bind_drive,
    lateral_bank,
    lateral_params,
    readings_and_inputs,
)
from wheelhop.estimators.lateral_model import LATERAL_PRIOR, LATERAL_WALK, LateralTuning
from wheelhop.filtering import run_batch
from wheelhop.filtering.multiple_model import MultipleModelParams
from wheelhop.vehicle.lateral_record import checked_lateral
from wheelhop.vehicle.lateral_tire import MAGIC_FORMULA, TireLaw
from wheelhop.vehicle.two_track import TwoTrack, Wheels, wheel_loads
from wheelhop.vehicle.two_track import validate as validate_car

VEHICLE_LATERAL_TUNING = LateralTuning(
    prior=LATERAL_PRIOR._replace(ln_friction=0.3, ln_mass=0.06),
    walk=LATERAL_WALK._replace(side_slip=1e-3, yaw_rate=7e-4),
    misfit=0.03,
    gate=0.3,
)
"""For a real vehicle: its roll, the lag of its tyres and their camber are not in the model, so that
side slip and yaw rate walk more than those of a vehicle that is the model, and the mean mass comes
out too large, by 8 % in the drives below.

Chosen on 256 drives of the 14-degree-of-freedom SUV with soft tyres of 150 of 230 kPa, which had
lost 31 % of their cornering stiffness: every combination, slaloms and double lane changes of 0.4 to
4.5 m/s^2 at 18 to 25 m/s, random offsets of the sensors; in half of them friction of 0.45 to 1 and
load of 0.85 to 1.15. Figure of merit: the mean logarithm of the probability of the true
combination at the end, of the drives that kept to the road. Without a gate it is -0.14, and -0.21
with a walk of the yaw rate of 3e-3; at full friction -0.12, and from
-0.18 with that walk it falls to -0.33 with a third and to -3.3 with three times both walks. Between
a misfit of 0 and 0.1, and priors of ln friction from 0.2 to 0.5 and of ln mass from 0.03 to 0.1, it
moves by less than 0.03. To delay the steer by a relaxation length of 0.15 m gained 0.01, one of
0.6 m lost 2.3; it was left out.

The gate of 0.3 m/s^2 costs 0.05, and one of 0.5 costs 0.09, but straight ahead there is a little
false evidence of soft tyres, without end: of 64 sound cars that drove straight for a minute without
a gate, 94 % were sure of soft tyres; with 0.3 none, and one after two minutes."""

VEHICLE_TEMPER = 0.3
"""Exponent of the likelihoods at `RATE`: what the model leaves out lasts for several samples. Of
the drives above at full friction in which the bank was sure, without a gate, it was wrong in 3 %
with 1, in none with 0.3 and 0.1; with 0.1 it was sure in 62 % of the drives, with 0.3 in 71 %."""

RATE = 50.0
"""Rate [Hz] at about which the bank runs; of faster records it takes every n-th sample."""

SURE = 0.9
"""Probability from which on a combination of soft tyres is told."""

CORNERING = 0.5
"""Lateral acceleration [m/s^2], averaged over half a second, below which nothing is told."""

HELD = 1.0
"""Time [s] for which the same combination must have been so probable before it is told. In the
drives above, without a gate, a wrong one was told at some time in 10 % when told at once, in 1 %
with this; at the end in none."""

NOT_ENOUGH, UNDECIDED, SOUND = "not enough cornering", "undecided", "no tyre is soft"

_AVERAGED = 0.5
_SLOWEST = 5.0
_SLOWEST_RATE, _FASTEST_RATE = 20.0, 1000.0
_LARGEST_STEER = 0.6


@dataclass(frozen=True)
class SoftTires:
    """What is believed of the tyres over time; arrays [time] unless said otherwise.

    Attributes:
        t: [s] from the first sample.
        modes: names of the hypotheses, as `failure_modes.mode_names`.
        probabilities: of the hypotheses, [time, modes].
        soft: probability that each tyre is below its sound level, FL, FR, RL, RR, [time, 4].
        friction: mean of the road's friction relative to the tyres' data.
        friction_sigma: standard deviation of its logarithm.
        mass: [kg]; beside the load it takes up what the model leaves out.
        side_slip: [rad].
        nis: normalised innovation squared of the mixture, about 2 where one hypothesis fits.
        peak: largest lateral acceleration so far, averaged over half a second [m/s^2].
        verdict: "not enough cornering", "undecided", "no tyre is soft", or the soft tyres, as
            "FL+RR".
    """

    t: np.ndarray
    modes: tuple[str, ...]
    probabilities: np.ndarray
    soft: np.ndarray
    friction: np.ndarray
    friction_sigma: np.ndarray
    mass: np.ndarray
    side_slip: np.ndarray
    nis: np.ndarray
    peak: np.ndarray
    verdict: np.ndarray

    @property
    def told(self) -> str:
        """The last verdict."""
        return str(self.verdict[-1])


def which_tires_are_soft(
    samples: LateralSample,
    dt: float,
    car: TwoTrack,
    levels: Sequence[Any] | Wheels,
    law: TireLaw = MAGIC_FORMULA,
    tuning: LateralTuning = VEHICLE_LATERAL_TUNING,
    *,
    friction: float = 1.0,
    temper: float = VEHICLE_TEMPER,
) -> SoftTires:
    """Find the soft tyres in a record of stability control's sensors.

    Args:
        samples: of the sensors, entries [time], NaN where one is missing. The steer is that of the
            front wheels, not of the steering wheel.
        dt: sampling interval [s].
        car: the vehicle with sound tyres, as from `two_track_of`.
        levels: tyres from the softest to the sound one, as in `failure_modes.stacked_tires`.
        law: of the tyres.
        tuning: of the filters.
        friction: expected of the road, relative to the tyres' data [-].
        temper: exponent of the likelihoods at `RATE`.

    Raises:
        InputError: for signals that are not finite, too short, too slow or in another unit.
        DivergenceError: if every filter leaves the finite numbers.
    """
    validate_car(car)
    require_in_range("friction", friction, 0.05, 2.0, "(no unit)")
    require_in_range("temper", temper, 1e-3, 1.0, "(no unit)")
    stride, thin = _thinned(samples, dt)
    params = vehicle_params(car, levels, stride * dt, tuning, temper)
    _refuse_too_slow(thin, params, stride * dt, law)
    kind = jnp.result_type(float)
    readings, inputs = readings_and_inputs(jax.tree.map(lambda a: jnp.asarray(a, kind), thin))
    filter = lateral_bank(law)
    state = filter.init(bank_prior(params, friction), params)
    # as a batch of one: compiled in a fraction of the time of `drive.run_compiled`
    batch = jax.tree.map(lambda a: a[None], (readings, inputs))
    found = run_batch(filter, state, batch[0], params, inputs=batch[1], bind=bind_drive, keep=_keep)
    log_p, mean, variance, nis = jax.tree.map(lambda a: np.asarray(a[0], float), found)
    if not np.isfinite(log_p.max(axis=-1)).all():
        raise DivergenceError(
            "every hypothesis left the finite numbers; check the units of the record and the car"
        )
    probabilities = np.exp(log_p)
    levels_of_each = round(probabilities.shape[-1] ** 0.25)
    below = level_table(levels_of_each) < levels_of_each - 1
    peak = peak_so_far(thin.lateral_acceleration, stride * dt)
    return SoftTires(
        t=dt * (stride * np.arange(1, len(peak) + 1) - 1),
        modes=mode_names(levels_of_each),
        probabilities=probabilities,
        soft=probabilities @ below.astype(float),
        friction=np.exp(mean.ln_friction),
        friction_sigma=np.sqrt(variance),
        mass=float(car.mass) * np.exp(mean.ln_mass),
        side_slip=mean.side_slip,
        nis=nis,
        peak=peak,
        verdict=verdicts(probabilities, peak, stride * dt),
    )


def vehicle_params(
    car: TwoTrack,
    levels: Sequence[Any] | Wheels,
    dt: float,
    tuning: LateralTuning = VEHICLE_LATERAL_TUNING,
    temper: float = VEHICLE_TEMPER,
) -> MultipleModelParams:
    """Parameters of `lateral_bank` at a sampling interval.

    What the model leaves out lasts longer than a sample, so that a record tells by its length, not
    by its samples: the exponent of the likelihoods goes with the interval.

    Args:
        car, levels: as in `which_tires_are_soft`.
        dt: [s].
        tuning: of the filters.
        temper: exponent at `RATE`.
    """
    exponent = min(1.0, temper * dt * RATE)
    params = lateral_params(car, levels, dt, tuning=tuning, temper=exponent)
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.result_type(float)), params)


def peak_so_far(lateral_acceleration: Any, dt: float) -> np.ndarray:
    """Largest lateral acceleration so far, averaged over the half second before [m/s^2].

    Args:
        lateral_acceleration: as measured [m/s^2], NaN where missing, [..., time].
        dt: sampling interval [s].
    """
    measured = np.asarray(lateral_acceleration, float)
    known = np.isfinite(measured)
    width = max(1, round(_AVERAGED / dt))

    def summed(a: np.ndarray) -> np.ndarray:
        total = np.cumsum(a, axis=-1)
        total[..., width:] = total[..., width:] - total[..., :-width]
        return total

    total, count = summed(np.where(known, measured, 0.0)), summed(known.astype(float))
    # the first half second is an average of few: weighed as if the rest were zero
    mean = total / np.maximum(count, 0.5 * width)
    return np.asarray(np.maximum.accumulate(np.abs(mean), axis=-1))


def verdicts(probabilities: np.ndarray, peak: np.ndarray, dt: float) -> np.ndarray:
    """In words what may be told, [time].

    Args:
        probabilities: of the hypotheses, [time, modes].
        peak: as from `peak_so_far`, [time].
        dt: sampling interval [s].
    """
    levels = round(probabilities.shape[-1] ** 0.25)
    combination = [mode_of((row < levels - 1).tolist()) for row in level_table(levels)]
    names = np.array([SOUND if name == "none" else name for name in mode_names()])
    p = np.zeros((len(names), *probabilities.shape[:-1]))
    np.add.at(p, combination, np.moveaxis(probabilities, -1, 0))
    best = p.argmax(axis=0)
    unsure = np.where(peak < CORNERING, NOT_ENOUGH, UNDECIDED)
    return np.where(is_told(best, p.max(axis=0), peak, dt), names[best], unsure)


def is_told(best: np.ndarray, probability: np.ndarray, peak: np.ndarray, dt: float) -> np.ndarray:
    """Whether the most probable combination may be told, [..., time].

    Args:
        best: the most probable combination, [..., time].
        probability: of it, [..., time].
        peak: as from `peak_so_far`, [..., time].
        dt: sampling interval [s].
    """
    sure = (probability >= SURE) & (peak >= CORNERING)
    index = np.arange(best.shape[-1])
    begins = np.ones(best.shape, bool)
    begins[..., 1:] = ~sure[..., :-1] | (best[..., 1:] != best[..., :-1])
    since = np.maximum.accumulate(np.where(begins, index, 0), axis=-1)
    return np.asarray(sure & ((index - since) * dt >= HELD - 1e-6))


def _keep(state: Any, info: Any) -> Any:
    belief = state.combined
    names = type(belief.mean)._fields
    k = names.index("ln_friction")
    return state.log_probabilities, belief.mean, belief.cov[k][k], info.nis


def _thinned(samples: LateralSample, dt: float) -> tuple[int, LateralSample]:
    """Checked, and every n-th of them: n and the samples."""
    require_in_range("dt", dt, 1.0 / _FASTEST_RATE, 1.0 / _SLOWEST_RATE, "s")
    lengths = {np.shape(entry) for entry in samples}
    if len(lengths) != 1 or len(next(iter(lengths))) != 1:
        raise InputError(
            "samples", f"entries of shapes {sorted(lengths)}", "Give all four as [time]."
        )
    for name, entry in zip(samples._fields, samples, strict=True):
        if np.isinf(np.asarray(entry, float)).any():
            raise InputError(
                name, "has samples that are infinite", "Give NaN where one is missing."
            )
    if np.size(samples.steer) < 2:
        raise InputError("samples", f"{np.size(samples.steer)} of them", "Give a drive.")
    sample = checked_lateral(dt * np.arange(np.size(samples.steer)), samples).sample
    steer = float(np.nanmax(np.abs(sample.steer)))
    if steer > _LARGEST_STEER:
        raise InputError(
            "steer",
            f"it reaches {steer:.3g} rad, more than front wheels turn at speed",
            "Give the angle of the wheels: that of the steering wheel over the steering ratio.",
        )
    stride = max(1, round(1.0 / (RATE * dt)))
    return stride, LateralSample(*(entry[stride - 1 :: stride] for entry in sample))


def _refuse_too_slow(
    thin: LateralSample, params: MultipleModelParams, dt: float, law: TireLaw
) -> None:
    """At low speed the tyres pull the side slip back faster than the midpoint rule follows."""
    members = params.members
    car = jax.tree.map(lambda leaf: leaf[0], members.car)
    sound = jax.tree.map(lambda leaf: leaf[-1], members.tires)
    still = wheel_loads(jnp.zeros_like(car.mass), car)
    stiffness = sum(float(law.stiffness(f, t)) for f, t in zip(still, sound, strict=True))
    slowest = max(_SLOWEST, dt * stiffness / float(car.mass))
    found = float(np.nanmin(thin.speed))
    if found < slowest:
        raise InputError(
            "speed",
            f"it falls to {found:.3g} m/s, and the model holds above {slowest:.3g} m/s at this "
            "sampling rate",
            "Cut the record to where the vehicle drives.",
        )
