"""Tables of the full vehicle, what was done, and every figure for results.json."""

from __future__ import annotations

from typing import Any

import numpy as np

from wheelhop.estimators.failure_modes import mode_names
from wheelhop.estimators.lateral_vehicle import CORNERING, HELD, SURE
from wheelhop.io.report import DataTable
from wheelhop.studies.solmaz.full_vehicle import (
    BANK,
    OFFSETS,
    SWITCHED,
    FullVehicleResult,
)
from wheelhop.studies.solmaz.full_vehicle_measures import (
    Tally,
    by_peak,
    reliability,
    tally,
    times,
    works_from,
)
from wheelhop.studies.solmaz.settings import SolmazSettings
from wheelhop.studies.solmaz.vehicle_conditions import ASSUMED, MAIN, conditions
from wheelhop.studies.solmaz.vehicle_drives import SOUND, lateral_suv
from wheelhop.vehicle.full_vehicle_parameters import CORNERS
from wheelhop.vehicle.full_vehicle_state import STANDARD_GRAVITY
from wheelhop.vehicle.magic_formula import slip_stiffness


def full_vehicle_in_words(settings: SolmazSettings) -> tuple[str, ...]:
    """What was done."""
    main = conditions(settings)[MAIN]
    few = min(c.runs for c in conditions(settings).values())
    return (
        "An SUV of 14 degrees of freedom with relaxing Magic Formula tyres; a driver follows a "
        f"double lane change of 3.5 m at {main.speeds[0]:g} to {main.speeds[1]:g} m/s that asks "
        f"for {main.peaks[0]:g} to {main.peaks[1]:g} m/s^2. Sound tyres have {SOUND / 1e3:g} kPa, "
        f"soft ones {ASSUMED / 1e3:g} kPa, which take {lost_stiffness():.0%} of the cornering "
        f"stiffness. Each of the 16 combinations has {main.runs} drives, of other conditions "
        f"{few}; speed, lane change, noise and offsets of the sensors differ in each.",
        "The estimators know the vehicle as a two-track model with the same tyres: no roll, no "
        "relaxation, no camber. They get the sensors of stability control with noise of "
        f"{settings.noise:g} m/s^2 and {settings.yaw_rate_noise:g} rad/s and offsets of "
        f"{OFFSETS.lateral_acceleration:g} m/s^2, {OFFSETS.yaw_rate:g} rad/s, "
        f"{OFFSETS.steering_wheel:g} rad at the steering wheel and {OFFSETS.speed:g} m/s "
        "(standard deviations). The bank's tuning was chosen on other random drives of this car.",
        f"A combination is told once its probability has been {SURE:g} for {HELD:g} s and the "
        f"lateral acceleration over half a second has reached {CORNERING:g} m/s^2; until then the "
        "bank says that it does not know. "
        "Runs that spin or roll over are counted and left out.",
    )


def lost_stiffness(law: str = "falling") -> float:
    """Share of the cornering stiffness that a soft tyre has lost at the mean wheel load [-].

    Args:
        law: of the pressure, a key of `vehicle_drives.PRESSURE_LAWS`.
    """
    vehicle = lateral_suv(law)
    c = vehicle.chassis
    load = 0.25 * STANDARD_GRAVITY * float(np.asarray(c.body_mass) + np.sum(c.wheel_mass))
    loads = np.full(4, load)
    soft, sound = (
        float(np.sum(slip_stiffness(loads, np.full(4, p), vehicle.tire.slip)[1]))
        for p in (ASSUMED, SOUND)
    )
    return 1.0 - soft / sound


def full_vehicle_tables(result: FullVehicleResult) -> list[DataTable]:
    """Over lateral acceleration, combination by combination, condition by condition."""
    outcome = result.outcomes[MAIN]
    peaks = [(f"{name} m/s^2", t) for name, t in by_peak(outcome)]
    each = [(name, tally(outcome, outcome.true == mode)) for mode, name in enumerate(mode_names())]
    every = [(name, tally(found)) for name, found in result.outcomes.items()]
    return [
        _table("By the lateral acceleration reached", "lateral acceleration", peaks),
        _table("Combination by combination", "truly soft", each),
        _table("Condition by condition", "condition", every),
    ]


def _table(title: str, first: str, rows: list[tuple[str, Tally]]) -> DataTable:
    tallies = [t for _, t in rows]

    def percent(values: Any) -> list[str]:
        return ["-" if np.isnan(v) else f"{100 * v:.1f}" for v in values]

    columns: dict[str, list[Any]] = {
        first: [name for name, _ in rows],
        "runs": [t.runs for t in tallies],
        "lost control": [t.lost for t in tallies],
        "bank right [%]": percent(t.right.value for t in tallies),
        "told right [%]": percent(t.outcomes[0] for t in tallies),
        "nothing told [%]": percent(1.0 - t.told for t in tallies),
        "told, soft tyre missed [%]": percent(t.outcomes[3] for t in tallies),
        "told, sound called soft [%]": percent(t.outcomes[4] for t in tallies),
        "told wrong at any time [%]": percent(t.ever for t in tallies),
        "worst tyre right [%]": percent(t.tires.min() for t in tallies),
        "observer right [%]": percent(t.switched.value for t in tallies),
    }
    return DataTable(title, columns, "Right: all four tyres, by what is most probable at the end.")


def full_vehicle_numbers(result: FullVehicleResult) -> dict[str, Any]:
    """Every figure; SI units, shares as fractions."""
    stated, observed = reliability(result)
    outcome = result.outcomes[MAIN]
    edge = works_from(outcome)
    return {
        "works_from": edge if np.isfinite(edge) else None,
        "detection_time": {
            who: {
                f"{q:.0%}": _finite(np.quantile(times(result, who), q, method="inverted_cdf"))
                for q in (0.25, 0.5, 0.75, 0.9)
            }
            for who in (BANK, SWITCHED)
        },
        "reliability": {"stated": stated.tolist(), "observed": observed.tolist()},
        "conditions": {name: _numbers(tally(found)) for name, found in result.outcomes.items()},
        "by_peak": {name: _numbers(t) for name, t in by_peak(outcome)},
        "friction_at_end": {
            name: float(np.mean(found.bank.friction[~found.lost, -1]))
            for name, found in result.outcomes.items()
        },
        "wheels_lifted": {
            name: float(np.mean(found.lifted)) for name, found in result.outcomes.items()
        },
        "shown": {"verdict": result.shown.told, "mass": float(result.shown.mass[-1])},
    }


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _numbers(t: Tally) -> dict[str, Any]:
    return {
        "runs": t.runs,
        "lost_control": t.lost,
        "right": list(t.right),
        "observer_right": list(t.switched),
        "told": t.told,
        "told_right": float(t.outcomes[0]),
        "told_a_soft_tire_missed": float(t.outcomes[3]),
        "told_a_sound_tire_called_soft": float(t.outcomes[4]),
        "told_wrong_ever": t.ever,
        "tires_right": dict(zip(CORNERS, t.tires.tolist(), strict=True)),
        "false_alarms": _finite(t.alarms),
    }
