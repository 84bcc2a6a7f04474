"""The parts of the Filipozzi study: a further one joins by one entry."""

from __future__ import annotations

from wheelhop.studies.filipozzi.coupling import coupling
from wheelhop.studies.filipozzi.coupling_report import (
    coupling_figures,
    coupling_findings,
    coupling_in_words,
    coupling_numbers,
    coupling_tables,
)
from wheelhop.studies.filipozzi.design import design
from wheelhop.studies.filipozzi.design_report import (
    design_figures,
    design_findings,
    design_in_words,
    design_numbers,
    design_tables,
)
from wheelhop.studies.filipozzi.maneuvers import maneuvers
from wheelhop.studies.filipozzi.maneuvers_claims import maneuvers_findings
from wheelhop.studies.filipozzi.maneuvers_figures import maneuvers_figures
from wheelhop.studies.filipozzi.maneuvers_tables import (
    maneuvers_in_words,
    maneuvers_numbers,
    maneuvers_tables,
)
from wheelhop.studies.filipozzi.noise import noise
from wheelhop.studies.filipozzi.noise_report import (
    noise_figures,
    noise_findings,
    noise_in_words,
    noise_numbers,
    noise_tables,
)
from wheelhop.studies.filipozzi.robustness import robustness
from wheelhop.studies.filipozzi.robustness_claims import robustness_findings
from wheelhop.studies.filipozzi.robustness_figures import robustness_figures
from wheelhop.studies.filipozzi.robustness_report import (
    robustness_in_words,
    robustness_numbers,
    robustness_tables,
)
from wheelhop.studies.filipozzi.settings import FilipozziSettings
from wheelhop.studies.filipozzi.weighing import weighing
from wheelhop.studies.filipozzi.weighing_report import (
    weighing_figures,
    weighing_findings,
    weighing_in_words,
    weighing_numbers,
    weighing_tables,
)
from wheelhop.studies.frame import Part

PARTS: tuple[Part[FilipozziSettings], ...] = (
    Part(
        "coupling",
        "Which load compresses which suspension",
        coupling,
        coupling_in_words,
        coupling_findings,
        coupling_tables,
        coupling_figures,
        coupling_numbers,
    ),
    Part(
        "design",
        "Design of the observer, and what its sensors determine",
        design,
        design_in_words,
        design_findings,
        design_tables,
        design_figures,
        design_numbers,
    ),
    Part(
        "mass",
        "Mass and centre of mass at rest",
        weighing,
        weighing_in_words,
        weighing_findings,
        weighing_tables,
        weighing_figures,
        weighing_numbers,
    ),
    Part(
        "maneuvers",
        "Braking, lane change, bounce sweep, slope",
        maneuvers,
        maneuvers_in_words,
        maneuvers_findings,
        maneuvers_tables,
        maneuvers_figures,
        maneuvers_numbers,
    ),
    Part(
        "robustness",
        "Wrong springs and dampers",
        robustness,
        robustness_in_words,
        robustness_findings,
        robustness_tables,
        robustness_figures,
        robustness_numbers,
    ),
    Part(
        "noise",
        "Noisy sensors",
        noise,
        noise_in_words,
        noise_findings,
        noise_tables,
        noise_figures,
        noise_numbers,
    ),
)
"""In the order of the report."""
