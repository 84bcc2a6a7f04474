"""Freeze filterpy's UKF and IMM on a quarter car: python -m tests.oracles.generate_filterpy.

Needs filterpy, NumPy and SciPy only; nothing of wheelhop is imported. Writes filterpy.json
beside itself. filterpy predicts first and redraws its points after the prediction, as we do.
The process noise depends on the mean that each prediction starts from (after mixing).
"""

import json
import pathlib

import filterpy
import numpy as np
import scipy
from filterpy.kalman import (
    IMMEstimator,
    MerweScaledSigmaPoints,
    UnscentedKalmanFilter,
    unscented_transform,
)

from tests.oracles import quarter_car_numpy as car

SAMPLES = 100
LEVELS = [1e-6, 4e-6, 16e-6, 64e-6]
RULES = {
    "cubature": (1.0, 0.0, 0.0),
    "default": (1.0, 2.0, 0.0),
    "uneven": (0.6, 2.0, 0.5),
}
X0 = np.array([1e-3, -5e-4, 0.02, -0.1, np.log(213e3)])
P0 = np.diag([5e-3, 2e-3, 5e-2, 0.2, 0.12]) ** 2
PZ = np.array(
    [
        [0.97, 0.01, 0.01, 0.01],
        [0.02, 0.94, 0.02, 0.02],
        [0.005, 0.01, 0.98, 0.005],
        [0.01, 0.03, 0.01, 0.95],
    ]
)
MU0 = np.array([0.4, 0.3, 0.2, 0.1])
MISSING = [10, 11, 40]


class Filter(UnscentedKalmanFilter):
    def predict(self, *args, **kwargs):
        self.Q = car.process_cov(self.x, self.level)
        super().predict(*args, **kwargs)


def make(level, rule):
    alpha, beta, kappa = RULES[rule]
    points = MerweScaledSigmaPoints(5, alpha=alpha, beta=beta, kappa=kappa)
    kf = Filter(
        5, 2, car.DT, hx=car.observation, fx=lambda x, dt: car.transition(x, dt), points=points
    )
    kf.level, kf.x, kf.P = level, X0.copy(), P0.copy()
    kf.R = np.eye(2) * car.NOISE**2
    return kf


def run_ukf(ys, rule):
    kf = make(LEVELS[1], rule)
    out = {"mean": [], "cov": [], "log_likelihood": []}
    means, covs = [], []
    for k, y in enumerate(ys):
        kf.predict()
        kf.update(None if k in MISSING else y)
        out["mean"].append(kf.x.tolist())
        out["cov"].append(kf.P[np.tril_indices(5)].tolist())
        out["log_likelihood"].append(0.0 if k in MISSING else float(kf.log_likelihood))
        means.append(kf.x.copy())
        covs.append(kf.P.copy())
    out["smoothed_mean"], out["smoothed_cov"] = smooth(kf, np.array(means), np.array(covs))
    return out


def smooth(kf, means, covs):
    """filterpy's RTS smoother. It knows one Q, so its transform is handed that of each step."""
    noises = iter([car.process_cov(m, kf.level) for m in means[-2::-1]])

    def transform(points, mean_weights, cov_weights, _, *rest):
        return unscented_transform(points, mean_weights, cov_weights, next(noises), *rest)

    mean, cov, _ = kf.rts_smoother(means, covs, UT=transform)
    rows, columns = np.tril_indices(5)
    return mean.tolist(), cov[:, rows, columns].tolist()


def make_imm(rule):
    return IMMEstimator([make(level, rule) for level in LEVELS], MU0.copy(), PZ)


def run_imm(ys, rule):
    imm = make_imm(rule)
    out = {"mean": [], "cov": [], "probabilities": [], "log_likelihood": []}
    for y in ys:
        imm.predict()
        cbar = imm.cbar.copy()
        imm.update(y)
        likelihood = np.array([f.likelihood for f in imm.filters])
        out["mean"].append(imm.x.tolist())
        out["cov"].append(imm.P[np.tril_indices(5)].tolist())
        out["probabilities"].append(imm.mu.tolist())
        out["log_likelihood"].append(float(np.log(cbar @ likelihood)))
    return out


def main():
    rng = np.random.default_rng(20221)
    ys = car.simulate(rng, 6e-6, SAMPLES, np.log(190e3))
    content = {
        "provenance": {
            "program": f"filterpy {filterpy.__version__}, NumPy {np.__version__}, "
            f"SciPy {scipy.__version__}, float64",
            "made_by": "python -m tests.oracles.generate_filterpy",
            "settings": "UnscentedKalmanFilter, MerweScaledSigmaPoints(alpha, beta, kappa) as in "
            "`rules`; IMMEstimator; lower triangles row by row; the UKF misses the "
            "samples in `missing`, the IMM none",
        },
        "rules": RULES,
        "levels": LEVELS,
        "prior_mean": X0.tolist(),
        "prior_cov": P0.tolist(),
        "transition_matrix": PZ.tolist(),
        "initial": MU0.tolist(),
        "missing": MISSING,
        "measurements": ys.tolist(),
        "ukf": {rule: run_ukf(ys, rule) for rule in RULES},
        "imm": {rule: run_imm(ys, rule) for rule in RULES},
    }
    path = pathlib.Path(__file__).with_name("filterpy.json")
    path.write_text(json.dumps(content, indent=None) + "\n")


if __name__ == "__main__":
    main()
