"""Freeze Stone Soup's unscented filter and smoother: python -m tests.oracles.generate_stonesoup.

Needs stonesoup, NumPy and SciPy only; nothing of wheelhop is imported. Writes stonesoup.json
beside itself. Stone Soup predicts first and redraws its points from the prediction, as we do;
its default (alpha, beta, kappa) differ from class to class, so all are given. The quarter car's
process noise is frozen at one state, because Stone Soup's does not depend on it.

Its smoother takes the prediction from a state's hypothesis. A bare prediction in the track
would stand for itself after it has been smoothed, so that a gap would stop the backward pass:
a missing sample is therefore entered as an update that equals its prediction.
"""

import datetime
import json
import pathlib

import numpy as np
import scipy
import stonesoup
from scipy.stats import multivariate_normal
from stonesoup.base import Property
from stonesoup.models.base import GaussianModel
from stonesoup.models.measurement.base import MeasurementModel
from stonesoup.models.transition.base import TransitionModel
from stonesoup.predictor.kalman import CubatureKalmanPredictor, UnscentedKalmanPredictor
from stonesoup.smoother.kalman import UnscentedKalmanSmoother
from stonesoup.types.array import CovarianceMatrix, StateVector, StateVectors
from stonesoup.types.detection import Detection, MissedDetection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.state import GaussianState
from stonesoup.types.track import Track
from stonesoup.types.update import GaussianStateUpdate
from stonesoup.updater.kalman import CubatureKalmanUpdater, UnscentedKalmanUpdater

from tests.oracles import quarter_car_numpy as car

SAMPLES = 60
MISSING = [7, 30, 31, 32]
RULES = {
    "cubature": (1.0, 0.0, 0.0),
    "default": (1.0, 2.0, 0.0),
    "uneven": (0.6, 2.0, 0.5),
}
X0 = np.array([1e-3, -5e-4, 0.02, -0.1, np.log(213e3)])
P0 = np.diag([5e-3, 2e-3, 5e-2, 0.2, 0.12]) ** 2
Q = car.process_cov(X0, 9e-6)
R = np.eye(2) * car.NOISE**2
START = datetime.datetime(2000, 1, 1)


def columns(function, state):
    """A function of one state over the points that Stone Soup keeps as columns."""
    values = [function(np.asarray(x, float).ravel()) for x in np.asarray(state.state_vector).T]
    kind = StateVector if len(values) == 1 else StateVectors
    return kind(np.array(values).T)


class Transition(TransitionModel, GaussianModel):
    ndim_state: int = Property(default=5, doc="states")

    def function(self, state, noise=False, **kwargs):
        return columns(car.transition, state)

    def covar(self, **kwargs):
        return CovarianceMatrix(Q)


class Measurement(MeasurementModel, GaussianModel):
    ndim_state: int = Property(default=5, doc="states")
    mapping: tuple = Property(default=(0, 1, 2, 3, 4), doc="states seen")

    @property
    def ndim_meas(self):
        return 2

    def function(self, state, noise=False, **kwargs):
        return columns(car.observation, state)

    def covar(self, **kwargs):
        return CovarianceMatrix(R)


def run_filter(ys, predictor, updater):
    """Track of updates, and log p(y | past) of every sample."""
    state = GaussianState(StateVector(X0), CovarianceMatrix(P0), timestamp=START)
    track, log_likelihood = Track(), []
    for k, y in enumerate(ys):
        now = START + (k + 1) * datetime.timedelta(seconds=car.DT)
        prediction = predictor.predict(state, timestamp=now)
        if k in MISSING:
            hypothesis = SingleHypothesis(prediction, MissedDetection(timestamp=now))
            state = GaussianStateUpdate(
                prediction.state_vector, prediction.covar, timestamp=now, hypothesis=hypothesis
            )
            log_likelihood.append(0.0)
        else:
            seen = updater.predict_measurement(prediction)
            detection = Detection(StateVector(y), timestamp=now, measurement_model=None)
            state = updater.update(SingleHypothesis(prediction, detection, seen))
            mean = np.asarray(seen.state_vector, float).ravel()
            log_likelihood.append(float(multivariate_normal(mean, seen.covar).logpdf(y)))
        track.append(state)
    return track, log_likelihood


def moments(track):
    means = [np.asarray(s.state_vector, float).ravel().tolist() for s in track]
    covs = [np.asarray(s.covar, float)[np.tril_indices(5)].tolist() for s in track]
    return {"mean": means, "cov": covs}


def run_unscented(ys, rule):
    weights = dict(zip(("alpha", "beta", "kappa"), RULES[rule], strict=True))
    track, log_likelihood = run_filter(
        ys,
        UnscentedKalmanPredictor(Transition(), **weights),
        UnscentedKalmanUpdater(Measurement(), **weights),
    )
    smoothed = UnscentedKalmanSmoother(Transition(), **weights).smooth(track)
    return {
        "filtered": moments(track) | {"log_likelihood": log_likelihood},
        "smoothed": moments(smoothed),
    }


def run_cubature(ys):
    track, log_likelihood = run_filter(
        ys, CubatureKalmanPredictor(Transition()), CubatureKalmanUpdater(Measurement())
    )
    return moments(track) | {"log_likelihood": log_likelihood}


def main():
    rng = np.random.default_rng(20231)
    ys = car.simulate(rng, 9e-6, SAMPLES, np.log(190e3))
    content = {
        "provenance": {
            "program": f"Stone Soup {stonesoup.__version__}, NumPy {np.__version__}, "
            f"SciPy {scipy.__version__}, float64",
            "made_by": "python -m tests.oracles.generate_stonesoup",
            "settings": "UnscentedKalmanPredictor, -Updater, -Smoother(alpha, beta, kappa) as in "
            "`rules`; CubatureKalmanPredictor, -Updater; lower triangles row by row; samples in "
            "`missing` are not seen, log-likelihood 0",
        },
        "rules": RULES,
        "prior_mean": X0.tolist(),
        "prior_cov": P0.tolist(),
        "process_cov": Q.tolist(),
        "missing": MISSING,
        "measurements": ys.tolist(),
        "unscented": {rule: run_unscented(ys, rule) for rule in RULES},
        "cubature_kalman": run_cubature(ys),
    }
    path = pathlib.Path(__file__).with_name("stonesoup.json")
    path.write_text(json.dumps(content, indent=None) + "\n")


if __name__ == "__main__":
    main()
