"""Differentiable filters for any state-space model; knows nothing of vehicles."""

from wheelhop.filtering import drive, parameterisation
from wheelhop.filtering.augmented import AugmentedModel, augmented
from wheelhop.filtering.batch import log_likelihood_batch, run_batch, total_batch
from wheelhop.filtering.constrained import ConstrainedParams, constrained
from wheelhop.filtering.decoupling import (
    DecoupledModel,
    StrongObservability,
    UnknownInputModel,
    decoupled,
    strong_observability,
)
from wheelhop.filtering.extended import extended
from wheelhop.filtering.fixed_lag import FixedLagState, fixed_lag
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
from wheelhop.filtering.interacting_smoothing import (
    interacting_extended_smoother,
    interacting_unscented_smoother,
)
from wheelhop.filtering.interface import Filter, Flags, Info, StateSpaceModel
from wheelhop.filtering.joint_sensitivity import joint_sensitivity
from wheelhop.filtering.kalman import LinearGaussian, kalman
from wheelhop.filtering.multiple_model import (
    MultipleModelParams,
    MultipleModelState,
    multiple_model,
)
from wheelhop.filtering.parallel import (
    parallel_filter,
    parallel_log_likelihood,
    parallel_smoother,
)
from wheelhop.filtering.robust import gated, huber, student_t
from wheelhop.filtering.sensitivity import (
    SensitivityParams,
    SensitivityPrior,
    SensitivityState,
    sensitivity,
)
from wheelhop.filtering.sigma_points import (
    PairRule,
    SigmaRule,
    cubature,
    gauss_hermite,
    scaled,
)
from wheelhop.filtering.smoothing import extended_smoother, unscented_smoother
from wheelhop.filtering.square_root import (
    SquareRootGaussian,
    square_root_unscented,
    square_root_unscented_smoother,
)
from wheelhop.filtering.stream import Packed, packed
from wheelhop.filtering.unknown_input import UnknownInputState, unknown_input
from wheelhop.filtering.unscented import unscented

__all__ = [
    "AugmentedModel",
    "ConstrainedParams",
    "DecoupledModel",
    "Filter",
    "FixedLagState",
    "Flags",
    "Gaussian",
    "Info",
    "InteractingParams",
    "InteractingState",
    "LinearGaussian",
    "MultipleModelParams",
    "MultipleModelState",
    "Packed",
    "PairRule",
    "SensitivityParams",
    "SensitivityPrior",
    "SensitivityState",
    "SigmaRule",
    "SquareRootGaussian",
    "StateSpaceModel",
    "StrongObservability",
    "UnknownInputModel",
    "UnknownInputState",
    "augmented",
    "constrained",
    "cubature",
    "decoupled",
    "dense",
    "drive",
    "extended",
    "extended_smoother",
    "fixed_lag",
    "gated",
    "gauss_hermite",
    "gaussian",
    "huber",
    "independent",
    "interacting",
    "interacting_extended_smoother",
    "interacting_unscented_smoother",
    "joint_sensitivity",
    "kalman",
    "log_likelihood_batch",
    "moment_match",
    "multiple_model",
    "normalised_square",
    "packed",
    "parallel_filter",
    "parallel_log_likelihood",
    "parallel_smoother",
    "parameterisation",
    "run_batch",
    "scaled",
    "sensitivity",
    "square_root_unscented",
    "square_root_unscented_smoother",
    "standard_deviation",
    "strong_observability",
    "student_t",
    "total_batch",
    "unknown_input",
    "unscented",
    "unscented_smoother",
]
