"""Tables of all 16 combinations on the paper's own car, and every figure for results.json."""

from __future__ import annotations

from typing import Any

import numpy as np

from wheelhop.estimators.failure_modes import mode_names
from wheelhop.io.report import DataTable
from wheelhop.studies.solmaz.own_plant import BANK, OBSERVER, PRINTED, OwnPlant
from wheelhop.studies.solmaz.own_plant_cases import EXACT_STEER, MAIN, SECOND, STEER_NOISE
from wheelhop.studies.solmaz.own_plant_measures import (
    RIGHT,
    condition_names,
    false_alarms,
    level_shares,
    quantile,
    reliability,
    score,
    soft_right,
    straight,
    sure_alarms,
    swept,
    works,
)
from wheelhop.studies.solmaz.paper_limits import mode_limits
from wheelhop.studies.solmaz.settings import SPEED, SolmazSettings
from wheelhop.vehicle.full_vehicle_parameters import CORNERS
from wheelhop.vehicle.steered_cornering import DRIVER_GAIN

CONTENDERS = (PRINTED, OBSERVER, BANK)


def own_plant_in_words(settings: SolmazSettings) -> tuple[str, ...]:
    """What was done."""
    return (
        "The paper's car at 120 km/h with every one of the 16 combinations of soft tyres, "
        f"{settings.runs} noisy runs each, through a double lane change of "
        f"{0.5 * settings.amplitude:g} rad at the wheels. With sound tyres in front and soft ones "
        "behind the car is unstable at this speed, so that a steering angle given over time would "
        "end in a spin: here a driver also steers by "
        f"{DRIVER_GAIN:g} s times the yaw rate that is missing to what the sound car would do.",
        "Three contenders get the same sensors. As printed: side slip integrated, Eq. 2 and 9 with "
        "their signs. Observer: the same models, each with its own side slip that the sensors pull "
        "back, and a gate of 0.3 m/s^2. Bank of filters: the same 16 hypotheses, each an extended "
        "Kalman filter that also estimates friction, mass and the sensors' offsets, weighed by "
        "their likelihoods.",
        f"White noise of {settings.noise:g} m/s^2, {settings.yaw_rate_noise:g} rad/s and "
        f"{STEER_NOISE:.2g} rad at the wheels. Other strengths of the lane change and what the "
        "estimators are not told have fewer runs.",
        "A run counts as right when all four tyres are told right at the end of the 20 s.",
    )


def own_plant_tables(result: OwnPlant) -> list[DataTable]:
    """Where it works, mode by mode, straight ahead, conditions."""
    return [
        _where(result),
        _strength(result),
        _modes(result),
        _straight(result),
        _conditions(result),
    ]


def _where(result: OwnPlant) -> DataTable:
    every = swept(result)
    peaks, shares = every.peaks, every.shares
    rows = {who: works(peaks, shares[who]) for who in CONTENDERS}
    found = {who: score(result, MAIN, who) for who in CONTENDERS}
    second = {who: score(result, SECOND, who) for who in CONTENDERS}
    columns: dict[str, list[Any]] = {
        "contender": list(CONTENDERS),
        "works from [m/s^2]": [r[0] for r in rows.values()],
        "to [m/s^2]": [r[1] for r in rows.values()],
        "right [%]": [100 * s.right.value for s in found.values()],
        "right when steering ends [%]": [100 * s.steered for s in found.values()],
        "right, steered twice as far [%]": [100 * s.right.value for s in second.values()],
        "right for good, median [s]": [_finite(quantile(s.times, 0.5)) for s in found.values()],
        "right for good, 90 % [s]": [_finite(quantile(s.times, 0.9)) for s in found.values()],
    }
    columns |= {
        f"{corner} right [%]": [100 * s.tires[k] for s in found.values()]
        for k, corner in enumerate(CORNERS)
    }
    note = (
        f"Works: longest stretch of lateral accelerations of the sound car in which at least "
        f"{RIGHT:.0%} of the runs are right, of those tried ({peaks[0]:.2g} to {peaks[-1]:.2g} "
        "m/s^2). A dash: nowhere, or not in that share of the runs."
    )
    return DataTable("Where it works", columns, note)


def _finite(time: float) -> float | None:
    return time if np.isfinite(time) else None


def _strength(result: OwnPlant) -> DataTable:
    found = swept(result)
    columns: dict[str, list[Any]] = {
        "steering angle [rad]": list(found.amplitudes),
        "sound car's a_y [m/s^2]": list(found.peaks),
        "least a_y of a car [m/s^2]": list(found.least),
        "largest [m/s^2]": list(found.most),
        "cars beyond the law": list(found.beyond),
    }
    columns |= {
        f"right {who} [%]": [100 * s.value for s in found.shares[who]] for who in CONTENDERS
    }
    note = (
        "Beyond the law: a load exceeds k1 k2, where the printed force would point outwards and "
        "none is taken. Where the largest a_y stays the same, the driver has lost that car."
    )
    return DataTable("Stronger and weaker lane changes", columns, note)


def _modes(result: OwnPlant) -> DataTable:
    growth = mode_limits(SPEED).growth
    found = {who: score(result, MAIN, who) for who in CONTENDERS}
    columns: dict[str, list[Any]] = {
        "soft tyres": list(mode_names()),
        "growth straight ahead [1/s]": list(growth),
        "largest a_y [m/s^2]": list(result.peaks[MAIN]),
    }
    columns |= {f"right {who} [%]": list(100 * s.truths) for who, s in found.items()}
    columns |= {
        f"90 % right after, {who} [s]": [_finite(t) for t in s.slowest] for who, s in found.items()
    }
    note = (
        "Growth of the linear car without a driver; positive is unstable. Where the lateral "
        "acceleration is far beyond that of the other cars the driver has lost the car."
    )
    return DataTable("Combination by combination", columns, note)


def _straight(result: OwnPlant) -> DataTable:
    found = {who: straight(result, who) for who in CONTENDERS}
    columns: dict[str, list[Any]] = {
        "contender": list(CONTENDERS),
        "sound car: a soft tyre named [%]": [100 * s.sound for s in found.values()],
        "and sure of it [%]": [100 * s.sound_sure for s in found.values()],
        "soft cars: a sound tyre called soft [%]": [100 * s.soft for s in found.values()],
        "sure [%]": [100 * s.soft_sure for s in found.values()],
        "sound cars, sure in the end [%]": [100 * s.sound_end for s in found.values()],
        "changes of mind [1/min]": [s.switches for s in found.values()],
    }
    note = "Shares of the time. Switched models are sure of whatever they say."
    return DataTable("20 s straight ahead", columns, note)


def _conditions(result: OwnPlant) -> DataTable:
    names = condition_names(result)
    columns: dict[str, list[Any]] = {
        "condition": ["as the estimators believe", *names[1:]],
        "sound car's a_y [m/s^2]": [result.peaks[n][-1] for n in names],
    }
    for who in CONTENDERS:
        columns[f"right, {who} [%]"] = [100 * soft_right(result, n, who).value for n in names]
    for who in CONTENDERS:
        alarms = [100 * false_alarms(result, n, who).value for n in names]
        columns[f"false alarms, {who} [%]"] = alarms
    columns["bank sure [%]"] = [100 * sure_alarms(result, n) for n in names]
    note = (
        "Right: runs with soft tyres. False alarms: runs of the sound car that end with a soft "
        "tyre named; sure, with a probability beyond 90 %."
    )
    return DataTable("What the estimators are not told", columns, note)


def own_plant_numbers(result: OwnPlant) -> dict[str, Any]:
    """Every figure; SI units, shares as fractions."""
    every = swept(result)
    peaks, shares = every.peaks, every.shares
    found = reliability(result)
    contenders = {}
    for who in CONTENDERS:
        one, low_high = score(result, MAIN, who), works(peaks, shares[who])
        contenders[who] = {
            "works_from_to": [_number(a) for a in low_high],
            "right": one.right._asdict(),
            "right_when_steering_ends": one.steered,
            "right_steered_twice_as_far": score(result, SECOND, who).right._asdict(),
            "tires_right": dict(zip(CORNERS, one.tires.tolist(), strict=True)),
            "truths_right": dict(zip(mode_names(), one.truths.tolist(), strict=True)),
            "time_right_for_good": {
                f"{q:.0%}": _number(quantile(one.times, q)) for q in (0.1, 0.5, 0.9)
            },
            "straight": straight(result, who)._asdict(),
            "right_over_acceleration": [s._asdict() for s in shares[who]],
            "conditions": {
                name: {
                    "soft_right": soft_right(result, name, who)._asdict(),
                    "sound_called_soft": false_alarms(result, name, who)._asdict(),
                }
                for name in condition_names(result)
            },
        }
    return {
        "contenders": contenders,
        "accelerations": peaks.tolist(),
        "reliability": {
            "stated": found.stated.tolist(),
            "observed": found.observed.tolist(),
            "samples": found.samples.tolist(),
        },
        "largest_lateral_acceleration": dict(
            zip(mode_names(), result.peaks[MAIN].tolist(), strict=True)
        ),
        "straight_exact_steer": straight(result, BANK, EXACT_STEER)._asdict(),
        "levels": {
            case: {
                who: dict(
                    zip(("all_right", "tires_found"), level_shares(trial, who)[1:], strict=True)
                )
                for who in trial.told
            }
            for case, trial in result.levels.items()
        },
    }


def _number(value: float) -> float | None:
    return value if np.isfinite(value) else None
