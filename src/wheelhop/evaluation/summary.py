"""Figures that sum up one estimate, with the truth beside them where it is known."""

from __future__ import annotations

from typing import Any

import numpy as np

from wheelhop.estimators.estimate import PressureEstimate
from wheelhop.evaluation.consistency import inside_fraction
from wheelhop.vehicle.record import CornerRecord

SETTLING_TIME = 2.0
"""Time [s] after which errors are judged (a quarter of a shorter record)."""


def summarise_estimate(
    estimate: PressureEstimate, record: CornerRecord, prior_pressure: float
) -> dict[str, Any]:
    """Result and quality of an estimate; SI units, named in the keys.

    Args:
        estimate: over the record.
        record: the log; where it holds the true pressure, errors are added.
        prior_pressure: the guess [Pa] that an estimate has to beat.
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
        "mean_road_class_probability": dict(zip(estimate.modes, share.tolist(), strict=True)),
        "most_probable_road_class": estimate.modes[int(np.argmax(share))],
        "mean_nis": nis,
        "mean_nis_of_a_single_filter_that_fits": 2.0,
    }
    if record.pressure is not None and np.isfinite(record.pressure).any():
        summary["against_truth"] = _against_truth(estimate, record.pressure, prior_pressure)
    return summary


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
