"""Standard errors against dense least squares written out in NumPy."""

import numpy as np
import pytest

from wheelhop.identification.loss import Sums
from wheelhop.identification.parameters import search_space
from wheelhop.identification.uncertainty import uncertainty

NAMES = ("suspension.damping", "suspension.stiffness", "tire.stiffness")
SPACE = search_space(NAMES)
VALUES = np.array([2400.0, 33.6e3, 264.7e3])
SLOPES = np.array([2000.0, 3e4, 2e5])
R, B, N = 4, 5, 40
"""Records, blocks, samples per block."""


def jacobians(rng):
    """de/dfree of every sample, [records, channel, samples, n]; ill-scaled and correlated."""
    j = rng.normal(size=(R, 2, B * N, 3)) * np.array([1.0, 0.2, 3.0])
    j[..., 2] += 0.9 * j[..., 0]
    return j * np.array([1.0, 5.0])[:, None, None]


def sums_of(j, e):
    jb = j.reshape(R, 2, B, N, 3)
    eb = e.reshape(R, 2, B, N)
    return Sums(
        np.einsum("rcbn,rcbn->rbc", eb, eb),
        np.einsum("rcbn,rcbni->rbci", eb, jb),
        np.einsum("rcbni,rcbnj->rbcij", jb, jb),
    )


def test_white_residuals_give_the_textbook_covariance():
    rng = np.random.default_rng(0)
    j, e = jacobians(rng), 0.5 * rng.normal(size=(R, 2, B * N))
    weight = np.full((R, 2), 3.7)
    found = uncertainty(sums_of(j, e), weight, np.full((R, 2), B * N), SLOPES, VALUES, SPACE)
    dense = (j / SLOPES).reshape(-1, 3)
    cov = 0.25 * np.linalg.inv(dense.T @ dense)
    sigma = np.sqrt(np.diag(cov))
    np.testing.assert_allclose(found.standard_errors, sigma, rtol=0.08)
    np.testing.assert_allclose(found.robust_errors, sigma, rtol=0.5)
    np.testing.assert_allclose(found.correlation, cov / np.outer(sigma, sigma), atol=0.03)
    relative = cov / np.outer(VALUES, VALUES)
    spread = np.sqrt(np.linalg.eigvalsh(relative))
    np.testing.assert_allclose([d.relative_error for d in found.directions], spread, rtol=0.08)


def test_records_of_unequal_noise_and_weight_follow_the_sandwich():
    """cov = H^-1 J^T W C W J H^-1 with the dense residual covariance C known to be diagonal."""
    rng = np.random.default_rng(1)
    noise = np.array([[0.1, 2.0], [0.5, 0.5], [3.0, 0.2], [1.0, 1.0]])
    weight = np.array([[1.0, 0.1], [0.4, 1.0], [0.2, 3.0], [1.0, 1.0]])
    j = jacobians(rng)
    e = noise[..., None] * rng.normal(size=(R, 2, B * N))
    found = uncertainty(sums_of(j, e), weight, np.full((R, 2), B * N), SLOPES, VALUES, SPACE)
    dense = (j / SLOPES).reshape(-1, 3)
    w = np.broadcast_to(weight[..., None], (R, 2, B * N)).ravel()
    c = np.broadcast_to(noise[..., None] ** 2, (R, 2, B * N)).ravel()
    inverse = np.linalg.inv(dense.T @ (w[:, None] * dense))
    cov = inverse @ (dense.T @ ((w * w * c)[:, None] * dense)) @ inverse
    np.testing.assert_allclose(found.standard_errors, np.sqrt(np.diag(cov)), rtol=0.1)


def test_coloured_residuals_widen_the_robust_errors_to_what_repeats_show():
    """Residuals and Jacobian constant in stretches of a block: the spread over many repeats."""
    rng = np.random.default_rng(2)
    slow = np.repeat(jacobians(rng)[:, :, :: N // 2], N // 2, axis=2)
    dense = (slow / SLOPES).reshape(-1, 3)
    solve = np.linalg.pinv(dense)
    estimates, stated, white = [], [], []
    for _ in range(200):
        e = np.repeat(rng.normal(size=(R, 2, 2 * B)), N // 2, axis=2)
        estimates.append(solve @ e.ravel())
        found = uncertainty(
            sums_of(slow, e), np.ones((R, 2)), np.full((R, 2), B * N), SLOPES, VALUES, SPACE
        )
        stated.append(found.robust_errors)
        white.append(found.standard_errors)
    spread = np.std(estimates, axis=0)
    np.testing.assert_allclose(np.sqrt(np.mean(np.square(stated), 0)), spread, rtol=0.25)
    assert np.all(np.mean(white, 0) < 0.4 * spread)


def test_a_combination_that_the_data_do_not_see_is_named_and_has_no_finite_error():
    """Only the sum of the relative changes of the first two is seen."""
    rng = np.random.default_rng(3)
    j = jacobians(rng)
    seen = j[..., 0].copy()
    j[..., 0] = seen * SLOPES[0] / VALUES[0]
    j[..., 1] = seen * SLOPES[1] / VALUES[1]
    e = rng.normal(size=(R, 2, B * N))
    found = uncertainty(
        sums_of(j, e), np.ones((R, 2)), np.full((R, 2), B * N), SLOPES, VALUES, SPACE
    )
    assert np.all(np.isinf(found.standard_errors[:2]))
    assert np.isfinite(found.standard_errors[2])
    (worst,) = [d for d in found.weak if np.isinf(d.relative_error)]
    weights = np.array([worst.weights[name] for name in NAMES])
    expected = np.array([1.0, -1.0, 0.0]) / np.sqrt(2.0)
    np.testing.assert_allclose(weights * np.sign(weights[0]), expected, atol=1e-6)
    assert "not determined at all" in str(worst)


def test_a_held_parameter_has_no_error_and_the_others_are_conditional():
    rng = np.random.default_rng(4)
    j, e = jacobians(rng), rng.normal(size=(R, 2, B * N))
    found = uncertainty(
        sums_of(j, e), np.ones((R, 2)), np.full((R, 2), B * N), SLOPES, VALUES, SPACE, (2,)
    )
    dense = (j / SLOPES).reshape(-1, 3)[:, :2]
    cov = np.linalg.inv(dense.T @ dense)
    assert np.isnan(found.standard_errors[2])
    assert found.standard_errors[:2] == pytest.approx(np.sqrt(np.diag(cov)), rel=0.1)
