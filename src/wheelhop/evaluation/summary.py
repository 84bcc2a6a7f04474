"""Figures that sum up one estimate, with the truth beside them where it is known."""

from __future__ import annotations

from typing import Any

import numpy as np

from wheelhop.estimators.pressure_estimate import PressureEstimate
from wheelhop.evaluation.consistency import inside_fraction
from wheelhop.vehicle.record import CornerRecord
from wheelhop.vehicle.road import class_of_level

SETTLING_TIME = 2.0
"""Time [s] after which errors are judged (a quarter of a shorter record)."""

WORST_NIS = 2.4
"""Mean NIS beyond which the members' models are doubted; 2 where a single one fits."""

PLAUSIBLE_PRESSURE = (0.2, 1.6)
"""Range of plausible pressures, relative to the nominal one."""

_ROWS = 10
_MODE_WINDOW = 0.5


def summarise_estimate(
    estimate: PressureEstimate,
    record: CornerRecord,
    prior_pressure: float,
    nominal_pressure: float,
) -> dict[str, Any]:
    """Result and quality of an estimate; SI units, named in the keys.

    Args:
        estimate: over the record.
        record: the log; where it holds the true pressure, errors are added.
        prior_pressure: the guess [Pa] that an estimate has to beat.
        nominal_pressure: of the tyre [Pa], for what is plausible.
    """
    t = estimate.t
    complete = estimate.missing == 0
    nis = float(np.mean(estimate.nis[complete])) if complete.any() else float("nan")
    share = estimate.mode_probabilities.mean(axis=0)
    summary: dict[str, Any] = {
        "duration_s": float(t[-1] - t[0] + record.dt),
        "samples": len(t),
        "sampling_rate_Hz": 1.0 / record.dt,
        "mean_speed_m_per_s": float(np.mean(record.v)),
        "missing_measurements": int(np.sum(estimate.missing)),
        "guarded_steps": int(np.sum(estimate.guarded)),
        "restarted_members": int(np.sum(estimate.lost_members)),
        "final_pressure_Pa": float(estimate.pressure[-1]),
        "final_pressure_sigma_Pa": float(estimate.pressure_sigma[-1]),
        "final_stiffness_N_per_m": float(estimate.stiffness[-1]),
        **_road(estimate, share),
        "mean_nis": nis,
        "mean_nis_of_a_single_filter_that_fits": 2.0,
    }
    summary["doubts"] = _doubts(summary, nominal_pressure)
    summary["over_time"] = _rows(estimate, record)
    if record.pressure is not None and np.isfinite(record.pressure).any():
        summary["against_truth"] = _against_truth(estimate, record.pressure, prior_pressure)
    return summary


def _road(estimate: PressureEstimate, share: np.ndarray) -> dict[str, Any]:
    """The road: its level at the end where it is estimated, else the classes' probabilities."""
    shares = dict(zip(estimate.modes, share.tolist(), strict=True))
    if estimate.level is None or estimate.level_sigma is None:
        return {
            "mean_road_class_probability": shares,
            "most_probable_road_class": estimate.modes[int(np.argmax(share))],
        }
    return {
        "mean_mode_probability": shares,
        "final_road_level_m3_per_rad": float(estimate.level[-1]),
        "final_road_level_sigma_of_log": float(estimate.level_sigma[-1]),
        "final_road_class": class_of_level(float(estimate.level[-1])),
    }


def _doubts(summary: dict[str, Any], nominal_pressure: float) -> list[str]:
    """Reasons not to use the estimate, in plain words; none where nothing speaks against it."""
    doubts = []
    if summary["mean_nis"] > WORST_NIS:
        doubts.append(
            "the innovations are larger than any member expects: the road is rougher than the "
            "filter allows, or the vehicle's parameters are wrong"
        )
    low, high = (factor * nominal_pressure for factor in PLAUSIBLE_PRESSURE)
    final = summary["final_pressure_Pa"]
    if not low < final < high:
        doubts.append(
            f"{final / 1e3:.0f} kPa is no plausible pressure of a tyre of "
            f"{nominal_pressure / 1e3:.0f} kPa: do not use this estimate"
        )
    return doubts


def _rows(estimate: PressureEstimate, record: CornerRecord) -> list[dict[str, Any]]:
    """The estimate at ten times; the road class is averaged over the half second before."""
    window = max(1, round(_MODE_WINDOW / record.dt))
    times = np.unique(np.linspace(0, len(estimate.t) - 1, _ROWS + 1).round().astype(int)[1:])
    rows = []
    for k in times:
        row: dict[str, Any] = {
            "t_s": float(estimate.t[k]),
            "pressure_Pa": float(estimate.pressure[k]),
            "pressure_sigma_Pa": float(estimate.pressure_sigma[k]),
        }
        if estimate.level is None:
            share = estimate.mode_probabilities[max(0, k + 1 - window) : k + 1].mean(axis=0)
            row["road_class"] = estimate.modes[int(np.argmax(share))]
            row["road_class_probability"] = float(share.max())
        else:
            row["road_class"] = class_of_level(float(estimate.level[k]))
            row["road_level_m3_per_rad"] = float(estimate.level[k])
        if record.pressure is not None:
            row["true_pressure_Pa"] = float(record.pressure[k])
        rows.append(row)
    return rows


def _against_truth(
    estimate: PressureEstimate, truth: np.ndarray, prior_pressure: float
) -> dict[str, float]:
    t = estimate.t
    settled = t - t[0] >= min(SETTLING_TIME, 0.25 * (t[-1] - t[0]))
    used = settled & np.isfinite(truth)
    error = (estimate.pressure - truth)[used]
    sigma = estimate.pressure_sigma[used]
    return {
        "judged_from_s": float(t[used][0]),
        "rms_error_Pa": float(np.sqrt(np.mean(error**2))),
        "mean_error_Pa": float(np.mean(error)),
        "final_error_Pa": float(error[-1]),
        "rms_error_of_the_prior_Pa": float(np.sqrt(np.mean((prior_pressure - truth[used]) ** 2))),
        "share_within_1_sigma": inside_fraction(error, sigma, 1.0),
        "share_within_2_sigma": inside_fraction(error, sigma, 2.0),
        "mean_nees": float(np.mean((error / sigma) ** 2)),
    }
