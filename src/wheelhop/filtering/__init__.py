"""Differentiable filters for any state-space model; knows nothing of vehicles."""

from wheelhop.filtering import drive
from wheelhop.filtering.extended import extended
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
from wheelhop.filtering.kalman import LinearGaussian, kalman
from wheelhop.filtering.sigma_points import SigmaRule, cubature, scaled
from wheelhop.filtering.smoothing import extended_smoother, unscented_smoother
from wheelhop.filtering.unscented import unscented

__all__ = [
    "Filter",
    "Flags",
    "Gaussian",
    "Info",
    "InteractingParams",
    "InteractingState",
    "LinearGaussian",
    "SigmaRule",
    "StateSpaceModel",
    "cubature",
    "dense",
    "drive",
    "extended",
    "extended_smoother",
    "gaussian",
    "independent",
    "interacting",
    "kalman",
    "moment_match",
    "normalised_square",
    "scaled",
    "standard_deviation",
    "unscented",
    "unscented_smoother",
]
