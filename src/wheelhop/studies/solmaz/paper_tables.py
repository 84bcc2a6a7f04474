"""Tables of the paper's simulation, and its figures by name for results.json."""

from __future__ import annotations

from typing import Any

import numpy as np

from wheelhop.estimators.failure_modes import mode_names
from wheelhop.io.report import DataTable
from wheelhop.studies.solmaz.paper import Paper
from wheelhop.studies.solmaz.paper_claims import errors, selection
from wheelhop.studies.solmaz.paper_limits import mode_limits
from wheelhop.studies.solmaz.settings import SPEED, SolmazSettings


def paper_in_words(settings: SolmazSettings) -> tuple[str, ...]:
    """What was done."""
    return (
        "The paper's car (1300 kg, 1.2 m and 1.3 m to the axles, track 1.5 m, centre of mass 0.7 m "
        "high, 1200 kg m^2) with its arctangent tyres, the front left one soft, at 120 km/h "
        f"through a double lane change of {settings.amplitude:g} rad at the wheels that begins at "
        "5 s. The car is integrated at 5 ms under the loads of its own lateral acceleration; the "
        "16 models get its steering angle, speed, lateral acceleration and yaw rate at 100 Hz.",
        f"As in the paper the sensors are perfect first; then {settings.runs} runs have white "
        f"noise of {settings.noise:g} m/s^2 and {settings.yaw_rate_noise:g} rad/s, and one has a "
        "biased accelerometer.",
    )


def paper_tables(result: Paper) -> list[DataTable]:
    """The methods side by side, and the limits of the 16 models."""
    return [_methods(result), _models()]


def _methods(result: Paper) -> DataTable:
    found = {name: selection(result, name) for name in result.tracks}
    off = {name: errors(result, name) for name in result.tracks}
    columns: dict[str, list[Any]] = {
        "side slip and equations": list(found),
        "first right [s]": [f"{s.first:.2f}" for s in found.values()],
        "right, perfect sensors [%]": [f"{100 * s.clean:.1f}" for s in found.values()],
        "right, noise, median run [%]": [
            f"{100 * float(np.median(s.noisy)):.1f}" for s in found.values()
        ],
        "right, bias [%]": [f"{100 * s.biased:.1f}" for s in found.values()],
        "runs right at the end [%]": [f"{100 * s.at_end:.0f}" for s in found.values()],
        "soft tyre named straight ahead [%]": [f"{100 * s.straight:.0f}" for s in found.values()],
        "rms error of a_y [m/s^2]": [f"{e['lateral acceleration'][0]:.1e}" for e in off.values()],
        "rms error of yaw rate [rad/s]": [f"{e['yaw rate'][0]:.1e}" for e in off.values()],
    }
    note = (
        "Right: share of the samples from 1 s after the onset of steering on that name model 8. "
        "Errors are those of the model selected, with perfect sensors, from the onset on."
    )
    return DataTable("Selection of the soft front left tyre", columns, note)


def _models() -> DataTable:
    limits = mode_limits(SPEED)
    columns: dict[str, list[Any]] = {
        "model": list(range(1, 17)),
        "soft tyres": list(mode_names()),
        "critical speed [km/h]": [
            f"{3.6 * v:.0f}" if np.isfinite(v) else "none" for v in limits.critical_speed
        ],
        "growth at 120 km/h [1/s]": [f"{g:.2f}" for g in limits.growth],
        "law valid below [m/s^2]": [f"{a:.2f}" for a in limits.guard],
    }
    note = (
        "Computed for the linear model straight ahead: a positive growth means that the car "
        "diverges. The law is valid while no load exceeds k1 k2."
    )
    return DataTable("The 16 models", columns, note)


def paper_numbers(result: Paper) -> dict[str, Any]:
    """Every figure; SI units, shares as fractions."""
    limits = mode_limits(SPEED)
    methods = {}
    for name in result.tracks:
        s = selection(result, name)
        methods[name] = {
            "first_right_after_onset_s": s.first,
            "right_for_good_after_onset_s": s.held,
            "share_right_perfect": s.clean,
            "share_right_biased": s.biased,
            "share_right_noisy": {
                f"{q:.0%}": float(np.quantile(s.noisy, q)) for q in (0.05, 0.25, 0.5, 0.75, 0.95)
            },
            "runs_right_at_end": s.at_end,
            "share_soft_named_straight": s.straight,
            "share_right_straight": s.straight_right,
            "rms_error_and_signal": {k: list(v) for k, v in errors(result, name).items()},
            "guards_acting_at_once": int(result.tracks[name].overloaded.max()),
        }
    return {
        "methods": methods,
        "largest_lateral_acceleration": float(np.abs(result.lateral_acceleration).max()),
        "largest_yaw_rate": float(np.abs(result.yaw_rate).max()),
        "largest_side_slip": float(np.abs(result.side_slip).max()),
        "models": {
            name: {"critical_speed": v if np.isfinite(v) else None, "growth": g, "guard": a}
            for name, v, g, a in zip(mode_names(), *limits, strict=True)
        },
    }
