"""Differentiable filters for any state-space model; knows nothing of vehicles."""

from wheelhop.filtering import drive
from wheelhop.filtering.gaussian import (
    Gaussian,
    dense,
    gaussian,
    independent,
    moment_match,
    normalised_square,
    standard_deviation,
)
from wheelhop.filtering.interacting import InteractingParams, InteractingState, interacting
from wheelhop.filtering.interface import Filter, Flags, Info, StateSpaceModel
from wheelhop.filtering.sigma_points import SigmaRule, cubature, scaled
from wheelhop.filtering.unscented import unscented

__all__ = [
    "Filter",
    "Flags",
    "Gaussian",
    "Info",
    "InteractingParams",
    "InteractingState",
    "SigmaRule",
    "StateSpaceModel",
    "cubature",
    "dense",
    "drive",
    "gaussian",
    "independent",
    "interacting",
    "moment_match",
    "normalised_square",
    "scaled",
    "standard_deviation",
    "unscented",
]
