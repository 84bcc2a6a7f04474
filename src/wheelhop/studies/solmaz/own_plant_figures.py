"""Figures of all 16 combinations on the paper's own car, with the numbers behind them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from wheelhop.estimators.failure_modes import mode_names
from wheelhop.plots.confusion import (
    plot_conditions,
    plot_confusion,
    plot_detection,
    plot_levels,
    plot_over_acceleration,
)
from wheelhop.studies.frame import StudyFigure
from wheelhop.studies.solmaz.outcomes import SOUND
from wheelhop.studies.solmaz.own_plant import BANK, OBSERVER, PRINTED, OwnPlant
from wheelhop.studies.solmaz.own_plant_cases import MAIN
from wheelhop.studies.solmaz.own_plant_measures import (
    RIGHT,
    condition_names,
    false_alarms,
    level_shares,
    reliability,
    score,
    soft_right,
    swept,
    works,
)
from wheelhop.studies.solmaz.settings import ONSET
from wheelhop.vehicle.full_vehicle_parameters import CORNERS

CONTENDERS = (PRINTED, OBSERVER, BANK)
LEVEL_NAMES = ("soft", "half", "sound")


def own_plant_figures(result: OwnPlant) -> Iterator[StudyFigure]:
    """Confusion, lateral acceleration, conditions, detection, levels."""
    yield confusion_figure(result)
    yield acceleration_figure(result)
    yield conditions_figure(result)
    yield detection_figure(result)
    yield levels_figure(result)


def _key(who: str) -> str:
    return who.replace(" ", "_")


def confusion_figure(result: OwnPlant) -> StudyFigure:
    """What is told of every combination."""
    found = {who: score(result, MAIN, who) for who in CONTENDERS}
    names = mode_names()
    columns: dict[str, object] = {"true": np.repeat(names, len(names)), "told": names * len(names)}
    columns |= {_key(who): s.confusion.ravel() for who, s in found.items()}
    case = result.cases[MAIN]
    return StudyFigure(
        "own_plant_confusion",
        plot_confusion(
            {who: s.confusion for who, s in found.items()},
            names,
            {who: s.tires for who, s in found.items()},
            CORNERS,
            "All 16 combinations of soft tyres, with noise: what each method says in the end",
        ),
        columns,
        {},
        f"Share of {case.runs} runs of every combination [%] that are told as each, at the end of "
        f"a double lane change of {case.amplitude:g} rad at 120 km/h; shares below 0.5 % are left "
        "out. Rows are the truth.",
    )


def acceleration_figure(result: OwnPlant) -> StudyFigure:
    """How much lateral acceleration is needed."""
    found = swept(result)
    peaks, shares = found.peaks, found.shares
    stretches = {who: works(peaks, s) for who, s in shares.items()}
    # a single level is luck rather than a range
    floors = {w: low if high > low else float("nan") for w, (low, high) in stretches.items()}
    columns: dict[str, object] = {"peak": peaks}
    for who, each in shares.items():
        for part in ("value", "low", "high"):
            columns[f"{_key(who)}_{part}"] = [getattr(s, part) for s in each]
    return StudyFigure(
        "own_plant_acceleration",
        plot_over_acceleration(
            peaks, shares, RIGHT, floors, "How hard the car must corner for the method to work"
        ),
        columns,
        {"peak": "m/s^2"},
        "Share of runs told right in the end over the strength of the lane change, with 95 % "
        f"Wilson intervals. Dotted: at least {RIGHT:.0%} are right there and at the next level.",
    )


def conditions_figure(result: OwnPlant) -> StudyFigure:
    """What the estimators do not know of."""
    names = condition_names(result)
    right = {w: [soft_right(result, n, w) for n in names] for w in CONTENDERS}
    alarms = {w: [false_alarms(result, n, w) for n in names] for w in CONTENDERS}
    labels = ["as the estimators believe", *names[1:]]
    columns: dict[str, object] = {"condition": labels}
    for who in CONTENDERS:
        columns[f"right_{_key(who)}"] = [s.value for s in right[who]]
        columns[f"alarms_{_key(who)}"] = [s.value for s in alarms[who]]
    return StudyFigure(
        "own_plant_conditions",
        plot_conditions(
            labels, right, alarms, "What the estimators are not told, and what it does to them"
        ),
        columns,
        {},
        "Share of runs with soft tyres in which all four tyres are told right in the end, and of "
        "runs of the sound car that end with a soft tyre named; 95 % Wilson intervals.",
    )


def detection_figure(result: OwnPlant) -> StudyFigure:
    """How soon, and how sure."""
    times = {who: score(result, MAIN, who).times for who in CONTENDERS}
    found = reliability(result)
    span = float(result.time[-1]) - ONSET
    kinds = ["detection"] * sum(map(len, times.values())) + ["reliability"] * len(found.stated)
    gaps = np.full(len(found.stated), np.nan)
    rest = np.full(len(kinds) - len(gaps), np.nan)
    every = np.concatenate([np.where(np.isfinite(t), t, np.nan) for t in times.values()])
    who = np.concatenate([np.repeat(w, len(t)) for w, t in times.items()])
    return StudyFigure(
        "own_plant_detection",
        plot_detection(
            times,
            found.stated,
            found.observed,
            span,
            "How soon the right tyres are named for good, and what the bank's word is worth",
        ),
        {
            "kind": kinds,
            "contender": [*who, *[BANK] * len(gaps)],
            "time": np.concatenate([every, gaps]),
            "stated": np.concatenate([rest, found.stated]),
            "observed": np.concatenate([rest, found.observed]),
        },
        {"time": "s"},
        "Left: share of all runs that are told right from a time on until the end. Right: stated "
        "probability of the combination named and how often it is right, after the onset.",
    )


def levels_figure(result: OwnPlant) -> StudyFigure:
    """Three levels of every tyre."""
    shares = {
        f"{who}, {result.peaks[case][SOUND]:.2g} m/s²": level_shares(trial, who)[0]
        for case, trial in result.levels.items()
        for who in trial.told
    }
    columns: dict[str, object] = {
        "true": np.repeat(LEVEL_NAMES, len(LEVEL_NAMES)),
        "told": LEVEL_NAMES * len(LEVEL_NAMES),
    }
    columns |= {
        f"{_key(who)}_{k}": level_shares(trial, who)[0].ravel()
        for k, trial in enumerate(result.levels.values())
        for who in trial.told
    }
    return StudyFigure(
        "own_plant_levels",
        plot_levels(shares, LEVEL_NAMES, "81 models: how soft a tyre is told to be"),
        columns,
        {},
        "Share of the tyres of each level [%] told as each in the end, in two lane changes by "
        "the sound car's largest lateral acceleration; the columns are numbered likewise.",
    )
