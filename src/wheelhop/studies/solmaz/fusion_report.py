"""What the two estimators know together: words, claims, table and figure of the fused drive."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from wheelhop.io.report import DataTable, Finding
from wheelhop.plots.lateral_fusion import plot_lateral_fusion
from wheelhop.studies.frame import StudyFigure, verdict_of
from wheelhop.studies.solmaz.fusion import (
    DEMO_PRESSURES,
    DEMO_SPEED,
    LEVELS,
    Course,
    FusionDemo,
)
from wheelhop.studies.solmaz.settings import SolmazSettings
from wheelhop.vehicle.full_vehicle_parameters import CORNERS

SOFT, SURE, CLEAR = 0, 0.9, 0.1
"""Tyre that is soft; probability that counts as sure that one is low, and that it is not."""


def courses(result: FusionDemo) -> dict[str, Course]:
    """By the name of who believes it."""
    return {
        "vertical alone": result.vertical,
        "lateral alone": result.lateral,
        "both": result.fused,
    }


def fusion_in_words(settings: SolmazSettings) -> tuple[str, ...]:
    """What was done."""
    del settings
    pressures = ", ".join(f"{1e-3 * p:g}" for p in DEMO_PRESSURES)
    levels = ", ".join(f"{1e-3 * p:g}" for p in LEVELS)
    return (
        f"One drive of the full vehicle at {3.6 * DEMO_SPEED:g} km/h on a road of class B: "
        f"straight, double lane changes, and tyres of {pressures} kPa (FL, FR, RL, RR) "
        "whose cornering stiffness falls with the pressure. The vertical estimator hears the "
        "wheels' accelerations and was calibrated on a drive before; the lateral one hears "
        f"steering, lateral acceleration and yaw rate and tries {levels} kPa on every tyre. "
        "Fused, every combination is weighed by both, and a mixture of Gaussians remains of each "
        "pressure. It is one drive, and its settings were chosen on drives of the same car.",
    )


def fusion_findings(result: FusionDemo) -> list[Finding]:
    """Whether two know more than one."""
    low = {name: c.low[-1] for name, c in courses(result).items()}
    others = np.delete(low["both"], SOFT)
    more = low["both"][SOFT] > max(low["vertical alone"][SOFT], low["lateral alone"][SOFT])
    sd = {name: 1e-3 * float(c.pressure_sd[-1, SOFT]) for name, c in courses(result).items()}
    error = {
        name: 1e-3 * float(c.pressure[-1, SOFT] - result.true[SOFT])
        for name, c in courses(result).items()
    }
    return [
        Finding(
            "fusion",
            "in this drive both together are surer of the soft tyre than either, and sure that the "
            "others hold",
            "; ".join(f"{name} {p[SOFT]:.2f}" for name, p in low.items())
            + f"; the others, both: at most {others.max():.3f}",
            verdict_of([more, low["both"][SOFT] >= SURE, others.max() <= CLEAR]),
            "Probability that the tyre is below 0.85 of its sound pressure, at the end of the "
            "drive.",
        ),
        Finding(
            "fusion",
            "in this drive the fused pressure of the soft tyre is closest to the truth, and within "
            "its own error",
            "; ".join(f"{n} off by {error[n]:+.0f} kPa, stated {sd[n]:.0f}" for n in error),
            verdict_of(
                [
                    abs(error["both"])
                    < min(abs(error["vertical alone"]), abs(error["lateral alone"])),
                    sd["both"] < min(sd["vertical alone"], sd["lateral alone"]),
                    abs(error["both"]) <= 2.0 * sd["both"],
                ]
            ),
            "Errors at the end of the drive.",
        ),
    ]


def fusion_tables(result: FusionDemo) -> list[DataTable]:
    """Every tyre at the end of the drive."""
    columns: dict[str, list[Any]] = {
        "tyre": list(CORNERS),
        "true [kPa]": [f"{1e-3 * p:.0f}" for p in result.true],
    }
    for name, course in courses(result).items():
        columns[f"{name} [kPa]"] = [
            f"{1e-3 * p:.0f} +- {1e-3 * s:.0f}"
            for p, s in zip(course.pressure[-1], course.pressure_sd[-1], strict=True)
        ]
        columns[f"{name}: P(low)"] = [f"{p:.3f}" for p in course.low[-1]]
    note = f"ln Bayes factor of their agreement {result.agreement[-1]:+.1f} (below 0: contradict)."
    return [DataTable("Pressures at the end of the drive", columns, note)]


def fusion_figures(result: FusionDemo) -> Iterator[StudyFigure]:
    """Pressures over time by either and by both."""
    pressure = {name: c.pressure for name, c in courses(result).items()}
    spread = {name: c.pressure_sd for name, c in courses(result).items()}
    columns: dict[str, Any] = {"time": result.time, "a_y": result.lateral_acceleration}
    for name in pressure:
        for k, corner in enumerate(CORNERS):
            key = f"{name.replace(' ', '_')}_{corner}"
            columns[key] = pressure[name][:, k]
            columns[f"{key}_sd"] = spread[name][:, k]
    columns["ln_bayes_factor"] = result.agreement
    units = {"time": "s", "a_y": "m/s^2", "ln_bayes_factor": "1"}
    yield StudyFigure(
        "fusion",
        plot_lateral_fusion(
            result.time,
            result.lateral_acceleration,
            result.true,
            pressure,
            spread,
            result.agreement,
            "Lane changes and wheel hop together say which tyre is soft, and how soft",
        ),
        columns,
        {name: units.get(name, "Pa") for name in columns},
        "Pressures by the vertical estimator, by the lateral one and by both, one standard "
        "deviation each; below, the lateral acceleration and whether the two agree.",
    )


def fusion_numbers(result: FusionDemo) -> dict[str, Any]:
    """For results.json; SI units."""
    return {
        "true_pressure": result.true,
        "ln_bayes_factor": float(result.agreement[-1]),
        **{
            name.replace(" ", "_"): {
                "pressure": c.pressure[-1],
                "pressure_sd": c.pressure_sd[-1],
                "probability_low": c.low[-1],
            }
            for name, c in courses(result).items()
        },
    }
