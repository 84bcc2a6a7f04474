"""Fitting a quarter car's parameters, and tyres, to records, by gradient."""

from wheelhop.identification.blind import BlindIdentification, identify_blind
from wheelhop.identification.descent import Settings
from wheelhop.identification.drives import with_road
from wheelhop.identification.identify import Identification, identify
from wheelhop.identification.lateral import TireFit, fit_tires
from wheelhop.identification.lateral_loss import Own
from wheelhop.identification.lateral_records import LateralNoise
from wheelhop.identification.parameters import PARAMETERS, SUSPENSION, SearchSpace, search_space
from wheelhop.identification.replay import Replay, replay
from wheelhop.identification.summary import summarise_identification

__all__ = [
    "PARAMETERS",
    "SUSPENSION",
    "BlindIdentification",
    "Identification",
    "LateralNoise",
    "Own",
    "Replay",
    "SearchSpace",
    "Settings",
    "TireFit",
    "fit_tires",
    "identify",
    "identify_blind",
    "replay",
    "search_space",
    "summarise_identification",
    "with_road",
]
