"""Differentiable filters for any state-space model; knows nothing of vehicles."""

from wheelhop.filtering import drive
from wheelhop.filtering.augmented import AugmentedModel, augmented
from wheelhop.filtering.batch import log_likelihood_batch, run_batch
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
from wheelhop.filtering.sigma_points import PairRule, SigmaRule, cubature, gauss_hermite, scaled
from wheelhop.filtering.smoothing import extended_smoother, unscented_smoother
from wheelhop.filtering.unscented import unscented

__all__ = [
    "AugmentedModel",
    "Filter",
    "Flags",
    "Gaussian",
    "Info",
    "InteractingParams",
    "InteractingState",
    "LinearGaussian",
    "PairRule",
    "SigmaRule",
    "StateSpaceModel",
    "augmented",
    "cubature",
    "dense",
    "drive",
    "extended",
    "extended_smoother",
    "gauss_hermite",
    "gaussian",
    "independent",
    "interacting",
    "kalman",
    "log_likelihood_batch",
    "moment_match",
    "normalised_square",
    "run_batch",
    "scaled",
    "standard_deviation",
    "unscented",
    "unscented_smoother",
]
