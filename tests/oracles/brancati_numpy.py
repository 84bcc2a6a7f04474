"""Brancati & Tufano 2022 in plain NumPy, from the paper's equations, written apart from wheelhop.

Where the paper's form has a resolution, the last argument chooses: True for the printed one.
The state is [z_s, z_u, v_s, v_u, k_t], a road is an elevation [m], and a car a dictionary with
m_s, m_u, k_s, k_nl, c_s, c_nl.
"""

from itertools import pairwise

import numpy as np


def sprung_mass(chassis, load, opposite_arm, wheelbase):
    """Eq. 2."""
    return (chassis + load) * opposite_arm / (2 * wheelbase)


def stiffness(pressure, k_t0, p_0, p_fz1):
    """Eq. 3 and 4."""
    dp = (pressure - p_0) / p_0
    return k_t0 * (1 + p_fz1 * dp)


def observation(x, z_r, car, same_sign):
    """Eq. 1 and 16: accelerations of both masses; printed: the same sign of (dv)^2 on both."""
    z_s, z_u, v_s, v_u, k_t = x
    square = (v_s - v_u) ** 2 if same_sign else (v_s - v_u) * abs(v_s - v_u)
    on_body = -car["k_s"] * (z_s - z_u) - car["k_nl"] * (z_s - z_u) ** 3
    on_body += -car["c_s"] * (v_s - v_u) - car["c_nl"] * square
    on_wheel = -car["k_s"] * (z_u - z_s) - car["k_nl"] * (z_u - z_s) ** 3
    on_wheel += -car["c_s"] * (v_u - v_s) + (-1 if same_sign else 1) * car["c_nl"] * square
    on_wheel += -k_t * (z_u - z_r)
    return np.array([on_body / car["m_s"], on_wheel / car["m_u"]])


def transition(x, z_r, dt, car, same_sign):
    """Eq. 15."""
    z_s, z_u, v_s, v_u, k_t = x
    a_s, a_u = observation(x, z_r, car, same_sign)
    return np.array([z_s + v_s * dt, z_u + v_u * dt, v_s + a_s * dt, v_u + a_u * dt, k_t])


def road_psd(omega, alpha, v, variance):
    """Eq. 5, one-sided in the angular frequency omega [rad/s]."""
    return 2 * alpha * v * variance / np.pi / ((alpha * v) ** 2 + omega**2)


def road(normals, alpha, speeds, dt, variance):
    """Eq. 6, solved exactly between samples: elevation before the first and after every step."""
    z = [np.sqrt(variance) * normals[0]]
    for v, n in zip(speeds, normals[1:], strict=True):
        decay = np.exp(-alpha * v * dt)
        z.append(decay * z[-1] + np.sqrt(variance * (1 - decay**2)) * n)
    return np.array(z)


def class_level(a):
    """Eq. 7."""
    return 4.0**a * 1e-6


def markov(modes, stay=0.97):
    """Eq. 17 for any number of modes."""
    pz = np.full((modes, modes), (1 - stay) / (modes - 1))
    np.fill_diagonal(pz, stay)
    return pz


def process_cov(q, dt):
    """Eq. 18."""
    return np.diag(q) * dt**3


def sensor_cov(sigma_s, sigma_u, standard_deviations):
    """Eq. 19."""
    if standard_deviations:
        return np.array([[sigma_s, 0.0], [0.0, sigma_u]])
    return np.array([[sigma_s**2, 0.0], [0.0, sigma_u**2]])


def predict_modes(mu, pz, untransposed):
    """Eq. 9; resolved: Pz[i, j] leads from i to j."""
    return pz @ mu if untransposed else pz.T @ mu


def mixing_weights(mu, predicted, pz, of_the_prediction):
    """Weight of mode j in mode i at [i, j], Eq. 10 and 11; resolved: Bayes' rule."""
    modes = len(mu)
    weights = np.zeros((modes, modes))
    for i in range(modes):
        for j in range(modes):
            if of_the_prediction:
                weights[i, j] = pz[i, j] * predicted[j] / predicted[i]
            else:
                weights[i, j] = pz[j, i] * mu[j] / sum(pz[k, i] * mu[k] for k in range(modes))
    return weights


def mix(weights, means, covs, no_spread):
    """Eq. 10 and 11: mean and covariance each mode starts from."""
    mixed_means, mixed_covs = [], []
    for row in weights:
        mean = sum(w * m for w, m in zip(row, means, strict=True))
        cov = sum(w * p for w, p in zip(row, covs, strict=True))
        if not no_spread:
            cov = cov + sum(
                w * np.outer(m - mean, m - mean) for w, m in zip(row, means, strict=True)
            )
        mixed_means.append(mean)
        mixed_covs.append(cov)
    return mixed_means, mixed_covs


def correct_modes(predicted, innovations, covs, no_root):
    """Eq. 12; resolved: Gaussian densities. Its c takes out the largest exponent, too."""
    log_weights = []
    for mu, nu, s in zip(predicted, innovations, covs, strict=True):
        determinant = np.linalg.det(s)
        scale = determinant if no_root else np.sqrt((2 * np.pi) ** len(nu) * determinant)
        log_weights.append(np.log(mu / scale) - 0.5 * nu @ np.linalg.inv(s) @ nu)
    weights = np.exp(np.array(log_weights) - max(log_weights))
    return weights / weights.sum()


def combine(mu, means, covs):
    """Eq. 13 and 14."""
    mean = sum(m * x for m, x in zip(mu, means, strict=True))
    spreads = [np.outer(x - mean, x - mean) for x in means]
    return mean, sum(m * (p + a) for m, p, a in zip(mu, covs, spreads, strict=True))


def cubature_points(mean, cov):
    """2n points of equal weight on the axes of the Cholesky factor, sqrt(n) away."""
    n = len(mean)
    root = np.sqrt(n) * np.linalg.cholesky(cov).T
    return np.concatenate([mean + root, mean - root])


def unscented_step(mean, cov, y, f, h, q, r):
    """Mean, covariance, innovation and its covariance; points are redrawn after the prediction.

    P - K S K^T is written as the mean of the points' own squares, plus K R K^T.
    """
    x = np.array([f(p) for p in cubature_points(mean, cov)])
    mean = x.mean(axis=0)
    cov = (x - mean).T @ (x - mean) / len(x) + q
    x = cubature_points(mean, cov)
    z = np.array([h(p) for p in x])
    expected = z.mean(axis=0)
    s = (z - expected).T @ (z - expected) / len(x) + r
    gain = (x - mean).T @ (z - expected) / len(x) @ np.linalg.inv(s)
    left = (x - mean) - (z - expected) @ gain.T
    innovation = y - expected
    return mean + gain @ innovation, left.T @ left / len(x) + gain @ r @ gain.T, innovation, s


def immuf(ys, mean, cov, cars, roads, pz, q, sigmas, dt, kept):
    """Eq. 9 to 19 over a record.

    Args:
        ys: [time, 2].
        mean, cov: prior of every mode.
        cars: one for each mode.
        roads: elevations [time + 1, modes].
        q: q_1 to q_5.
        sigmas: of both sensors.
        kept: dictionary of the misprints that are kept, by name.

    Returns:
        Combined means and covariances, probabilities, and the modes' means and covariances.
    """
    modes = len(cars)
    means, covs, mu = [mean] * modes, [cov] * modes, np.full(modes, 1 / modes)
    big_q, r = process_cov(q, dt), sensor_cov(*sigmas, kept["sensors"])
    history = []
    for y, (before, now) in zip(ys, pairwise(roads), strict=True):
        predicted = predict_modes(mu, pz, kept["prediction"])
        weights = mixing_weights(mu, predicted, pz, kept["weights"])
        means, covs = mix(weights, means, covs, kept["spread"])
        steps = [
            unscented_step(
                means[i],
                covs[i],
                y,
                lambda x, i=i, z=before: transition(x, z[i], dt, cars[i], kept["damping"]),
                lambda x, i=i, z=now: observation(x, z[i], cars[i], kept["damping"]),
                big_q,
                r,
            )
            for i in range(modes)
        ]
        means, covs, innovations, spreads = zip(*steps, strict=True)
        mu = correct_modes(predicted, innovations, spreads, kept["determinant"])
        history.append((*combine(mu, means, covs), mu, np.array(means), np.array(covs)))
    return [np.array(h) for h in zip(*history, strict=True)]


def simulate(rng, mean, cov, cars, roads, pz, q, sigmas, dt):
    """States [time, 5] and measurements [time, 2] of Eq. 8 with modes that jump by Pz[i, j].

    Damping and sensors are the resolved ones: what the resolved filter is exact for.
    """
    modes = len(cars)
    x, mode = rng.multivariate_normal(mean, cov, method="cholesky"), rng.integers(modes)
    xs, ys = [], []
    for before, now in pairwise(roads):
        mode = rng.choice(modes, p=pz[mode])
        noise = rng.normal(size=5) * np.sqrt(np.diag(process_cov(q, dt)))
        x = transition(x, before[mode], dt, cars[mode], False) + noise
        xs.append(x)
        ys.append(observation(x, now[mode], cars[mode], False) + rng.normal(size=2) * sigmas)
    return np.array(xs), np.array(ys)
