"""The figures of the full vehicle, with the numbers behind them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from wheelhop.plots.stiffness_vehicle import plot_budget, plot_vehicle_errors, plot_what_helps
from wheelhop.studies.frame import StudyFigure
from wheelhop.studies.stiffness.claims_vehicle import (
    LIMIT,
    budget_of,
    errors_over_time,
    final_error,
)
from wheelhop.studies.stiffness.full_vehicle import VehicleStudy
from wheelhop.studies.stiffness.vehicle_estimators import ROWS

_WHEELS = ("FL", "FR", "RL", "RR")


def vehicle_figures(study: VehicleStudy) -> Iterator[StudyFigure]:
    """Errors over time, what the model must hold, and the budget."""
    names, kinds = [c.name for c in study.cases], [c.kind for c in study.cases]
    error, count = errors_over_time(study), len(study.time)
    columns = {"drive": np.repeat(names, count), "time": np.tile(study.time, len(names))}
    columns |= {f"error_{w}": error[..., k].ravel() for k, w in enumerate(_WHEELS)}
    yield StudyFigure(
        "vehicle_errors",
        plot_vehicle_errors(
            study.time,
            error,
            kinds,
            names,
            LIMIT,
            "Pressure of four tyres on roads nobody measured",
        ),
        columns,
        {"time": "s"},
        "Relative error of each tyre's pressure on the full vehicle; shaded: 5 %.",
    )
    means = {row: final_error(study, row).mean(axis=1) for row in ROWS}
    yield StudyFigure(
        "vehicle_what_helps",
        plot_what_helps(means, names, LIMIT, title="What the estimator's model must hold"),
        {"drive": names, **{row: list(v) for row, v in means.items()}},
        {},
        "Relative error of the pressure at the end of every drive, mean of four tyres, by model.",
    )
    budget = budget_of(study)
    moves = {
        "calibrated before it, or not at all": budget.before,
        "there at the calibration": budget.with_it,
    }
    columns = {"disturbance": np.array(budget.names)}
    for label, move in moves.items():
        columns |= {f"{w}, {label}": move[:, k] for k, w in enumerate(_WHEELS)}
    yield StudyFigure(
        "vehicle_budget",
        plot_budget(
            {label: move[1:] for label, move in moves.items()},
            budget.names[1:],
            LIMIT,
            "What moves the estimated pressure",
        ),
        columns,
        {},
        "Relative move of the pressure by each disturbance, mean and range of four tyres.",
    )
