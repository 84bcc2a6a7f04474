"""Figures of the full vehicle, with the numbers behind them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from wheelhop.estimators.failure_modes import mode_names
from wheelhop.plots.confusion import plot_confusion, plot_detection
from wheelhop.plots.soft_tires import plot_outcomes, plot_soft_tires
from wheelhop.studies.frame import StudyFigure
from wheelhop.studies.solmaz.full_vehicle import BANK, SHOWN, SWITCHED, FullVehicleResult
from wheelhop.studies.solmaz.full_vehicle_measures import (
    Tally,
    by_peak,
    outcome_shares,
    reliability,
    selected_at,
    tally,
    times,
    works_from,
)
from wheelhop.studies.solmaz.outcomes import confusion, tires_right
from wheelhop.studies.solmaz.vehicle_conditions import MAIN, ONSET
from wheelhop.vehicle.full_vehicle_parameters import CORNERS

EARLY = 2.0
"""Time after the onset of steering [s] at which the bank is shown beside its end."""


def full_vehicle_figures(result: FullVehicleResult) -> Iterator[StudyFigure]:
    """One record, all modes, over lateral acceleration, over time, condition by condition."""
    yield record_figure(result)
    yield confusion_figure(result)
    yield peak_figure(result)
    yield detection_figure(result)
    yield conditions_figure(result)


def record_figure(result: FullVehicleResult) -> StudyFigure:
    """One lane change."""
    found, soft = result.shown, mode_names()[SHOWN[0]]
    columns = {"time": result.record.t[0] + found.t, "friction": found.friction}
    columns |= {f"soft_{corner}": found.soft[:, k] for k, corner in enumerate(CORNERS)}
    columns |= {"peak": found.peak, "verdict": found.verdict}
    return StudyFigure(
        "vehicle_record",
        plot_soft_tires(
            result.record, found, f"A double lane change on soft tyres {soft}: who is to blame"
        ),
        columns,
        {"time": "s", "peak": "m/s^2"},
        f"Truly soft: {soft}. Grey: nothing is told.",
    )


def confusion_figure(result: FullVehicleResult) -> StudyFigure:
    """What is told of every combination."""
    outcome = result.outcomes[MAIN]
    true = outcome.true[~outcome.lost]
    last = result.time[-1] - ONSET
    told = {
        SWITCHED: selected_at(result, SWITCHED, last),
        f"bank, {EARLY:g} s": selected_at(result, BANK, EARLY),
        "bank": selected_at(result, BANK, last),
    }
    matrices = {name: confusion(true, modes) for name, modes in told.items()}
    names = mode_names()
    row, column = np.indices((len(names), len(names)))
    columns = {"true": np.array(names)[row.ravel()], "told": np.array(names)[column.ravel()]}
    columns |= {name: m.ravel() for name, m in matrices.items()}
    right = np.mean(told["bank"] == true)
    return StudyFigure(
        "vehicle_confusion",
        plot_confusion(
            matrices,
            names,
            {name: tires_right(true, modes) for name, modes in told.items()},
            CORNERS,
            f"On a vehicle that is not its model the bank names {right:.0%} right at the end",
        ),
        columns,
        {},
        "Share of the runs of each combination (rows) that are told as each (columns) [%], at the "
        f"end and {EARLY:g} s after steering began.",
    )


def peak_figure(result: FullVehicleResult) -> StudyFigure:
    """What becomes of the runs over the lateral acceleration they reach."""
    bins = by_peak(result.outcomes[MAIN])
    names = [f"{name} m/s²" for name, _ in bins]
    edge = works_from(result.outcomes[MAIN])
    title = (
        f"From {edge:g} m/s² on the bank finds the soft tyres; below, it often says nothing"
        if np.isfinite(edge) and edge > 0.0
        else "What the bank says, by the strength of the lane change"
    )
    return _outcomes(
        "vehicle_peaks",
        names,
        [t for _, t in bins],
        title,
        "Runs by the largest lateral acceleration that the body's accelerometer sees.",
    )


def conditions_figure(result: FullVehicleResult) -> StudyFigure:
    """What becomes of the runs, condition by condition."""
    return _outcomes(
        "vehicle_conditions",
        list(result.outcomes),
        [tally(outcome) for outcome in result.outcomes.values()],
        "What the estimators are not told, and what becomes of the runs",
        "Runs that lost control are left out.",
    )


def _outcomes(
    name: str, rows: list[str], tallies: list[Tally], title: str, caption: str
) -> StudyFigure:
    shares = outcome_shares(tallies)
    switched = np.array([t.switched.value for t in tallies])
    columns = {"row": np.array(rows), "runs": np.array([t.runs for t in tallies]), **shares}
    columns["observer_right"] = switched
    words = [f"{row}  ({t.runs})" for row, t in zip(rows, tallies, strict=True)]
    return StudyFigure(
        name,
        plot_outcomes(words, shares, switched, SWITCHED, title),
        columns,
        {},
        f"{caption} In brackets the number of runs.",
    )


def detection_figure(result: FullVehicleResult) -> StudyFigure:
    """How soon, and how far the probabilities can be trusted."""
    found = {who: times(result, who) for who in (SWITCHED, BANK)}
    stated, observed = reliability(result)
    span = float(result.time[-1] - ONSET)
    return StudyFigure(
        "vehicle_detection",
        plot_detection(
            found, stated, observed, span, "How soon the truth is named, and what it is worth"
        ),
        dict(found),
        dict.fromkeys(found, "s"),
        "Left: from the onset of steering. Right: of the bank, over all times after it.",
    )
