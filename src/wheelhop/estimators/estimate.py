"""Tyre pressure of one corner's record: the estimator to use."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from wheelhop.estimators.changing import (
    ChangeTuning,
    bind_speed,
    changing_filter,
    changing_modes,
    changing_params,
    changing_prior,
    check_classes,
)
from wheelhop.estimators.pressure_estimate import (
    Kept,
    PressureEstimate,
    filter_record,
    kept_of,
    measured_as,
    pressure_estimate,
)
from wheelhop.estimators.stiffness import StiffnessTuning, validate_tuning
from wheelhop.filtering import Info, InteractingState
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.record import CornerRecord
from wheelhop.vehicle.tire import require_stiff

__all__ = ["PressureEstimate", "estimate_pressure"]


def estimate_pressure(
    record: CornerRecord,
    car: QuarterCar,
    *,
    tuning: StiffnessTuning = StiffnessTuning(),
    changes: ChangeTuning = ChangeTuning(),
    classes: Sequence[str] = (),
    free: Sequence[str] = (),
    on_progress: Callable[[int, int], None] | None = None,
) -> PressureEstimate:
    """Estimate the pressure by recursive maximum likelihood on a road nobody measured.

    An IMM whose members are RML filters over ln k_t and the road's level (`changing`).

    Args:
        record: a checked record (`wheelhop.vehicle.record.checked_record`).
        car: the corner; its tyre turns stiffness into pressure.
        tuning: noise, priors and walks.
        changes: how roads and tyres change.
        classes: ISO 8608 classes, of which the road has one exactly; none: a road of any level.
            A road between two classes is then misread by tens of kPa.
        free: what else to estimate, of `stiffness.EXTRA`.
        on_progress: called with samples done and in all.

    Raises:
        InputError: if tuning, changes or classes are not usable.
        DivergenceError: if the filter leaves the finite numbers.
    """
    require_stiff(car.tire, validate_tuning(tuning).prior_pressure)
    classes, free, dt = check_classes(classes), tuple(free), record.dt
    modes = changing_modes(dt, tuning, changes, classes)
    filter = changing_filter(dt, free)
    params = changing_params(car, float(record.v[0]), dt, tuning, changes, classes, free)
    dtype = params.initial.dtype
    kept = filter_record(
        filter,
        filter.init(changing_prior(params, tuning, changes, classes, free), params),
        measured_as(record, dtype),
        params,
        record.v.astype(dtype),
        record.t,
        bind_speed,
        _keep,
        on_progress,
        whole=False,
    )
    if classes:  # the level of a class is the mixture's
        probabilities = np.exp(kept.log_probabilities.astype(float))
        ln_levels = np.log(modes.levels)
        middle = probabilities @ ln_levels
        spread = np.sum(probabilities * (ln_levels - middle[:, None]) ** 2, axis=1)
        kept = kept._replace(
            ln_level=kept.ln_level + middle, level_variance=kept.level_variance + spread
        )
    level = 1.0 if classes else tuning.prior_level
    return pressure_estimate(record.t, kept, modes.names, car.tire, level)


def _keep(state: InteractingState, info: Info) -> Kept:
    belief = state.combined.theta
    return kept_of(
        info,
        ln_k_t=belief.mean.ln_k_t,
        variance=belief.cov[0][0],
        log_probabilities=state.log_probabilities,
        ln_level=belief.mean.ln_level,
        level_variance=belief.cov[1][1],
    )
