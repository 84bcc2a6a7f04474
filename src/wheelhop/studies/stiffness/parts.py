"""The parts of the stiffness study: a further one joins by one entry."""

from __future__ import annotations

from wheelhop.studies.frame import Part
from wheelhop.studies.stiffness import (
    claims,
    claims_alarms,
    claims_classes,
    claims_pairs,
    claims_tables,
    figures,
    figures_classes,
    figures_pairs,
)
from wheelhop.studies.stiffness.alarm_drives import DURATION, alarm_drives, count_of
from wheelhop.studies.stiffness.axle_pairs import axle_pairs
from wheelhop.studies.stiffness.claims_vehicle import (
    vehicle_findings,
    vehicle_in_words,
    vehicle_numbers,
    vehicle_tables,
)
from wheelhop.studies.stiffness.continuous import continuous
from wheelhop.studies.stiffness.exact_classes import exact_classes
from wheelhop.studies.stiffness.figures_vehicle import vehicle_figures
from wheelhop.studies.stiffness.frame import StiffnessSettings
from wheelhop.studies.stiffness.full_vehicle import vehicle_study
from wheelhop.studies.stiffness.several_wheels import several_wheels


def _classes_in_words(settings: StiffnessSettings) -> tuple[str, ...]:
    return (
        f"Twelve combinations of pressure and class, {settings.runs} runs of 10 s each at 40 to 80 "
        "km/h; the road changes, or the tyre leaks, at 5 s. The estimator is an interacting "
        "multiple model of recursive maximum likelihood filters: one mode for each class whose "
        "tyre holds, and one whose tyre changes. It has the tuning for exact classes and is not "
        "told which it is.",
    )


def _continuous_in_words(settings: StiffnessSettings) -> tuple[str, ...]:
    return (
        f"{settings.runs} runs of one corner: pressure uniform between 130 and 230 kPa, speed "
        "between 40 and 80 km/h, and the logarithm of the road's level between the smooth edge of "
        "class A and the rough edge of class D. The prior has the mean and the spread of what is "
        "drawn. The bound is averaged over the operating points of the first "
        f"{min(settings.runs, settings.bound_runs)} runs.",
    )


def _wheels_in_words(settings: StiffnessSettings) -> tuple[str, ...]:
    return (
        f"{settings.runs} runs of four corners with a pressure and a road of their own; the roads "
        "are equally rough, and how rough is not known. Drawn as for one corner.",
    )


def _pairs_in_words(settings: StiffnessSettings) -> tuple[str, ...]:
    return (
        f"{settings.runs} runs of a front and a rear corner; the rear wheel meets the front "
        "wheel's road a wheelbase later, as coherent as it is said. The estimator is told the "
        "coherence, and a speed that is off by 1.5 % rms; it finds the delay. Drawn as for one "
        "corner.",
    )


def _alarms_in_words(settings: StiffnessSettings) -> tuple[str, ...]:
    return (
        f"{count_of(settings)} drives of {DURATION:g} s for each loss, and four times as many of "
        "sound tyres: four corners, roads of any roughness, the filter of `wheelhop estimate` over "
        "what changes, and its alarms.",
    )


PARTS = (
    Part(
        "exact_classes",
        "Roads of exact classes, the class unknown",
        exact_classes,
        _classes_in_words,
        claims_classes.class_findings,
        claims_tables.class_tables,
        figures_classes.class_figures,
        claims_tables.class_numbers,
    ),
    Part(
        "continuous",
        "Roads of any roughness",
        continuous,
        _continuous_in_words,
        claims.continuous_findings,
        claims_tables.continuous_tables,
        figures.continuous_figures,
        claims_tables.continuous_numbers,
    ),
    Part(
        "four_corners",
        "Four corners of one roughness",
        several_wheels,
        _wheels_in_words,
        claims.wheels_findings,
        claims_tables.wheels_tables,
        figures.wheels_figures,
        claims_tables.wheels_numbers,
    ),
    Part(
        "axle_pair",
        "Front and rear wheel in one track",
        axle_pairs,
        _pairs_in_words,
        claims_pairs.pair_findings,
        claims_pairs.pair_tables,
        figures_pairs.pair_figures,
        claims_pairs.pair_numbers,
    ),
    Part(
        "vehicle",
        "The full vehicle",
        vehicle_study,
        vehicle_in_words,
        vehicle_findings,
        vehicle_tables,
        vehicle_figures,
        vehicle_numbers,
    ),
    Part(
        "alarms",
        "Alarms",
        alarm_drives,
        _alarms_in_words,
        claims_alarms.alarm_findings,
        claims_alarms.alarm_tables,
        claims_alarms.alarm_figures,
        claims_alarms.alarm_numbers,
    ),
)
"""In the order of the report."""
