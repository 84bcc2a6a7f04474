"""Figures that sum up a campaign."""

from __future__ import annotations

from typing import Any

import numpy as np

from wheelhop.evaluation.consistency import inside_fraction, mean_band
from wheelhop.evaluation.errors import ErrorStatistics
from wheelhop.montecarlo.run import RunResult
from wheelhop.montecarlo.scenarios import CampaignSettings


def summarise_campaign(
    result: RunResult, statistics: ErrorStatistics, settings: CampaignSettings
) -> dict[str, Any]:
    """Errors, stated sigma and consistency at the end of the runs; SI units, in the keys.

    Args:
        result: of all runs.
        statistics: of the pressure errors over the runs.
        settings: of the campaign.
    """
    prior = settings.tuning.prior_pressure
    final = result.error[:, -1]
    per_class = {
        c: float(np.sqrt(np.mean(final[result.road_class == k] ** 2)))
        for k, c in enumerate(settings.classes)
        if np.any(result.road_class == k)
    }
    return {
        "runs": len(final),
        "final_rms_error_Pa": statistics.rms[-1],
        "final_median_abs_error_Pa": float(np.median(np.abs(final))),
        "final_mean_error_Pa": statistics.mean[-1],
        "final_std_error_Pa": statistics.std[-1],
        "final_mean_sigma_Pa": statistics.sigma[-1],
        "final_share_within_1_sigma": inside_fraction(final, result.sigma[:, -1]),
        "final_rms_error_by_class_Pa": per_class,
        "rms_error_of_the_prior_Pa": float(np.sqrt(np.mean((prior - result.pressure) ** 2))),
        "final_mean_nees": float(result.nees[:, -1].mean()),
        "nees_95_percent_band": mean_band(5, len(final)),
        "final_mean_nees_stiffness": float(result.nees_stiffness[:, -1].mean()),
        "nees_stiffness_95_percent_band": mean_band(1, len(final)),
        "mean_nis": float(result.nis.mean()),
        "mean_probability_of_true_class": float(result.true_class_probability.mean()),
        "duration_s": settings.duration,
    }
