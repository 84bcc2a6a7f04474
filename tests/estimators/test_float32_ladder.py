"""The quarter-car IMM in float32 over ever longer records, against itself in float64."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from wheelhop.estimators.immuf import Tuning, immuf, immuf_params, prior
from wheelhop.filtering import drive
from wheelhop.filtering.smallmat import to_dense
from wheelhop.vehicle.parameters import brancati_suv
from wheelhop.vehicle.quarter_car import Accelerations, RelativeState, simulate
from wheelhop.vehicle.road import class_level, road_velocity_intensity

DT, SPEED = 0.002, 60 / 3.6


def record(steps):
    """A corner on a class B road that is white in velocity; sensor noise 0.5 m/s^2."""
    keys = jax.random.split(jax.random.key(3), 2)
    intensity = road_velocity_intensity(class_level("B"), SPEED)
    rise = jnp.sqrt(intensity * DT / 2) * jax.random.normal(keys[0], (steps, 2))
    start = RelativeState(*jnp.zeros((4,)))
    truth = jax.jit(simulate)(start, jnp.asarray(230e3), rise, DT, brancati_suv())
    noise = 0.5 * jax.random.normal(keys[1], (2, steps))
    return [np.asarray(a + n) for a, n in zip(truth.accelerations, noise, strict=True)]


def keep(state, info):
    return (
        state.combined.mean.ln_k_t,
        state.log_probabilities,
        state.combined.cov,
        info.flags.guarded,
        info.flags.nonfinite,
    )


def filtered(ys, x64):
    with jax.enable_x64(x64):
        car = brancati_suv()
        filter = immuf(DT)
        params = immuf_params(car, SPEED, DT, Tuning())
        dtype = np.float64 if x64 else np.float32
        pieces = drive.run_in_chunks(
            filter,
            filter.init(prior(car), params),
            Accelerations(*(y.astype(dtype) for y in ys)),
            params,
            chunk=5000,
            keep=keep,
        )
        parts = [kept for _, kept in pieces]
        return jax.tree.map(lambda *a: np.concatenate(a), *parts)


@pytest.mark.parametrize(
    "steps", [10_000, pytest.param(1_000_000, marks=pytest.mark.slow)], ids=["1e4", "1e6"]
)
def test_float32_keeps_definite_and_near_float64(steps):
    """Measured: 0.016 sigma rms over 1e4 steps, 0.036 (worst 0.055) over 1e6; no guard acted."""
    ys = record(steps)
    single, double = filtered(ys, False), filtered(ys, True)
    assert single[0].dtype == np.float32
    assert not single[4].any()
    cov = np.asarray(to_dense(jax.tree.map(jnp.asarray, single[2])), np.float64)
    scale = np.sqrt(np.einsum("tii->ti", cov))
    correlation = cov / (scale[:, :, None] * scale[:, None, :])
    smallest = np.linalg.eigvalsh(correlation)[:, 0].min()
    sigma = np.sqrt(np.asarray(double[2][4][4]))
    error = np.abs(single[0].astype(float) - double[0]) / sigma
    probability = np.abs(np.exp(single[1].astype(float)) - np.exp(double[1]))
    print(
        f"{steps} steps: rms {np.sqrt(np.mean(error**2)):.2e}, worst {error.max():.2e} sigma; "
        f"mode probability worst {probability.max():.2e}; smallest eigenvalue of the correlation "
        f"{smallest:.2e} (float64 {smallest_of(double):.2e}); guard acted {single[3].mean():.1e}"
    )
    assert smallest > 0
    assert np.sqrt(np.mean(error**2)) < 0.05
    assert error.max() < 0.1


def smallest_of(kept):
    cov = np.asarray(to_dense(jax.tree.map(jnp.asarray, kept[2])))
    scale = np.sqrt(np.einsum("tii->ti", cov))
    return np.linalg.eigvalsh(cov / (scale[:, :, None] * scale[:, None, :]))[:, 0].min()
