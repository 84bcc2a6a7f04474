"""Fitting a quarter car's parameters to records, by gradient."""

from wheelhop.identification.descent import Settings
from wheelhop.identification.drives import with_road
from wheelhop.identification.identify import Identification, identify
from wheelhop.identification.parameters import PARAMETERS, SUSPENSION, SearchSpace, search_space

__all__ = [
    "PARAMETERS",
    "SUSPENSION",
    "Identification",
    "SearchSpace",
    "Settings",
    "identify",
    "search_space",
    "with_road",
]
