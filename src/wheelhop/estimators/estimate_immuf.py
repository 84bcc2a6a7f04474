"""Tyre pressure of one corner's record by the IMM of unscented filters with k_t in the state."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from wheelhop.estimators.immuf import (
    ROAD_CLASSES,
    Tuning,
    bind_speed,
    immuf,
    immuf_params,
    prior,
)
from wheelhop.estimators.pressure_estimate import (
    Kept,
    PressureEstimate,
    filter_record,
    kept_of,
    measured_as,
    pressure_estimate,
)
from wheelhop.filtering import Info, InteractingState
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.record import CornerRecord
from wheelhop.vehicle.tire import require_stiff


def estimate_by_immuf(
    record: CornerRecord,
    car: QuarterCar,
    *,
    tuning: Tuning = Tuning(),
    cars: Sequence[QuarterCar] | None = None,
    classes: Sequence[str] = ROAD_CLASSES,
    on_progress: Callable[[int, int], None] | None = None,
) -> PressureEstimate:
    """Estimate the pressure with the filter of Brancati & Tufano 2022, corrected (`immuf`).

    For comparison: `estimate.estimate_pressure` is much more accurate.

    Args:
        record: a checked record (`wheelhop.vehicle.record.checked_record`).
        car: the corner; its tyre turns stiffness into pressure.
        tuning: the filter's tuning.
        cars: one parameter set per class instead of `car` in the members.
        classes: ISO 8608 classes of the members.
        on_progress: called with samples done and in all.

    Raises:
        InputError: if tuning or classes are not usable.
        DivergenceError: if the filter leaves the finite numbers.
    """
    require_stiff(car.tire, tuning.prior_pressure)
    filter = immuf(record.dt)
    params = immuf_params(cars or car, record.v[0], record.dt, tuning, classes)
    dtype = params.initial.dtype
    kept = filter_record(
        filter,
        filter.init(prior(car, tuning), params),
        measured_as(record, dtype),
        params,
        record.v.astype(dtype),
        record.t,
        bind_speed,
        _keep,
        on_progress,
    )
    return pressure_estimate(record.t, kept, tuple(classes), car.tire)


def _keep(state: InteractingState, info: Info) -> Kept:
    belief = state.combined
    return kept_of(
        info,
        ln_k_t=belief.mean.ln_k_t,
        variance=belief.cov[-1][-1],
        log_probabilities=state.log_probabilities,
    )
