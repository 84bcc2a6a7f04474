"""Fitting a quarter car's parameters to records, by gradient."""

from wheelhop.identification.blind import BlindIdentification, identify_blind
from wheelhop.identification.descent import Settings
from wheelhop.identification.drives import with_road
from wheelhop.identification.identify import Identification, identify
from wheelhop.identification.parameters import PARAMETERS, SUSPENSION, SearchSpace, search_space
from wheelhop.identification.replay import Replay, replay
from wheelhop.identification.summary import summarise_identification

__all__ = [
    "PARAMETERS",
    "SUSPENSION",
    "BlindIdentification",
    "Identification",
    "Replay",
    "SearchSpace",
    "Settings",
    "identify",
    "identify_blind",
    "replay",
    "search_space",
    "summarise_identification",
    "with_road",
]
