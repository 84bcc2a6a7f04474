"""The parts of the Solmaz study: a further one joins by one entry."""

from __future__ import annotations

from wheelhop.studies.frame import Part
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
)
"""In the order of the report."""
