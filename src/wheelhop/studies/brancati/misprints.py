"""What each misprint of the paper does to its filter, on the same runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace

import numpy as np

from wheelhop.estimators.candidate import track
from wheelhop.estimators.candidates import KEPT, printed
from wheelhop.estimators.printed import NONE_OF_THEM, Misprints
from wheelhop.studies.brancati.contenders import filter_keys, true_stiffness
from wheelhop.studies.brancati.monte_carlo import STRIDE, kept_times
from wheelhop.studies.brancati.plant import RATE, Driven, Plant
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.tire import pressure_slope

MEANING = {
    "damping": "quadratic damping with one sign on both masses (Eq. 1, 15, 16)",
    "prediction": "mode probabilities by Pz instead of its transpose (Eq. 9)",
    "weights": "mixing weights of the predicted probabilities (Eq. 10, 11)",
    "spread": "no spread of the means in the mixed covariance (Eq. 11)",
    "determinant": "1/det instead of 1/sqrt(det) in the likelihood (Eq. 12)",
    "sensors": "standard deviations on the diagonal of R (Eq. 19, 22)",
}
"""The misprints in words, by field of `Misprints`."""


@dataclass(frozen=True)
class MisprintEffect:
    """One variant of the printed filter on the Monte Carlo's runs.

    Attributes:
        name: of the variant.
        misprints: that it keeps.
        finite: share of runs whose estimate stays finite.
        final_rmse: of the pressure in the last second [Pa], over the finite runs.
        median_error: median size of the error at the end [Pa], over the finite runs.
        sigma: median stated standard deviation at the end [Pa].
        nees: mean normalised error squared of k_t in the last second; 1 if sigma is honest.
    """

    name: str
    misprints: Misprints
    finite: float
    final_rmse: float
    median_error: float
    sigma: float
    nees: float


def variants() -> dict[str, Misprints]:
    """The literal filter, the one that is compared, none of them, and each by itself."""
    chosen = {
        "all, taken literally": Misprints(),
        "all but the weights (as printed)": KEPT,
        "none": NONE_OF_THEM,
    }
    for field in fields(Misprints):
        chosen[f"only: {MEANING[field.name]}"] = replace(NONE_OF_THEM, **{field.name: True})
    return chosen


def misprint_effects(
    plant: Plant,
    cars: Mapping[str, QuarterCar],
    driven: Driven,
    tuning: Mapping[str, float] | None = None,
    chosen: Mapping[str, Misprints] | None = None,
    on_progress: Callable[[int, int], None] | None = None,
) -> list[MisprintEffect]:
    """Run every variant with one tuning on the Monte Carlo's first runs.

    Args:
        plant: what the drives share.
        cars: the corner by road class.
        driven: runs 0 to n - 1.
        tuning: of the printed filter; its default for None.
        chosen: variants by name; all for None.
        on_progress: called with variants done and in all.
    """
    chosen = variants() if chosen is None else chosen
    car = next(iter(cars.values()))
    keys = filter_keys(np.arange(len(driven.records)), plant.seed)
    slope = float(pressure_slope(car.tire))
    effects = []
    for name, misprints in chosen.items():
        candidate = printed(cars, 1.0 / RATE, None, plant.convention, misprints, name, plant.noise)
        found = track(candidate, driven.records, keys, tuning, stride=STRIDE, check=False)
        t = kept_times(plant, found.stiffness.shape[1])
        last = t > t[-1] - 1.0
        at = np.round(t * RATE).astype(int) - 1
        error = slope * (found.stiffness - true_stiffness(driven, car)[:, at])[:, last]
        sigma = slope * found.sigma[:, last]
        good = np.isfinite(error).all(axis=1) & np.isfinite(sigma).all(axis=1)
        effects.append(_effect(name, misprints, good, error[good], sigma[good]))
        if on_progress is not None:
            on_progress(len(effects), len(chosen))
    return effects


def _effect(
    name: str, misprints: Misprints, good: np.ndarray, error: np.ndarray, sigma: np.ndarray
) -> MisprintEffect:
    if not good.any():
        nothing = float("nan")
        return MisprintEffect(name, misprints, 0.0, nothing, nothing, nothing, nothing)
    with np.errstate(over="ignore"):
        return MisprintEffect(
            name,
            misprints,
            float(good.mean()),
            float(np.sqrt(np.mean(error**2))),
            float(np.median(np.abs(error[:, -1]))),
            float(np.median(sigma[:, -1])),
            float(np.mean((error / sigma) ** 2)),
        )
