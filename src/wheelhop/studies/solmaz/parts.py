"""The parts of the Solmaz study: a further one joins by one entry."""

from __future__ import annotations

from wheelhop.studies.frame import Part
from wheelhop.studies.solmaz.full_vehicle import full_vehicle
from wheelhop.studies.solmaz.full_vehicle_claims import full_vehicle_findings
from wheelhop.studies.solmaz.full_vehicle_figures import full_vehicle_figures
from wheelhop.studies.solmaz.full_vehicle_tables import (
    full_vehicle_in_words,
    full_vehicle_numbers,
    full_vehicle_tables,
)
from wheelhop.studies.solmaz.fusion import fusion_demo
from wheelhop.studies.solmaz.fusion_report import (
    fusion_figures,
    fusion_findings,
    fusion_in_words,
    fusion_numbers,
    fusion_tables,
)
from wheelhop.studies.solmaz.own_plant import own_plant
from wheelhop.studies.solmaz.own_plant_claims import own_plant_findings
from wheelhop.studies.solmaz.own_plant_figures import own_plant_figures
from wheelhop.studies.solmaz.own_plant_tables import (
    own_plant_in_words,
    own_plant_numbers,
    own_plant_tables,
)
from wheelhop.studies.solmaz.paper import paper
from wheelhop.studies.solmaz.paper_claims import paper_findings
from wheelhop.studies.solmaz.paper_figures import paper_figures
from wheelhop.studies.solmaz.paper_tables import paper_in_words, paper_numbers, paper_tables
from wheelhop.studies.solmaz.settings import SolmazSettings

PARTS: tuple[Part[SolmazSettings], ...] = (
    Part(
        "paper",
        "The paper's simulation",
        paper,
        paper_in_words,
        paper_findings,
        paper_tables,
        paper_figures,
        paper_numbers,
    ),
    Part(
        "own_plant",
        "All 16 combinations on the paper's own car",
        own_plant,
        own_plant_in_words,
        own_plant_findings,
        own_plant_tables,
        own_plant_figures,
        own_plant_numbers,
    ),
    Part(
        "vehicle",
        "The full vehicle",
        full_vehicle,
        full_vehicle_in_words,
        full_vehicle_findings,
        full_vehicle_tables,
        full_vehicle_figures,
        full_vehicle_numbers,
    ),
    Part(
        "fusion",
        "Both estimators together",
        fusion_demo,
        fusion_in_words,
        fusion_findings,
        fusion_tables,
        fusion_figures,
        fusion_numbers,
    ),
)
"""In the order of the report."""
