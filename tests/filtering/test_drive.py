"""Drivers give what the bare recursion gives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from models import COV, MEAN, Sensors, Track, linear_model, sample

from wheelhop.filtering import drive, gaussian, unscented

FILTER = unscented(linear_model())


def prior():
    return gaussian(Track(*MEAN), jnp.asarray(COV))


def measurements(ys):
    return Sensors(jnp.asarray(ys[:, 0]), jnp.asarray(ys[:, 1]))


def scaled_by(params, factor):
    return params * factor


def test_run_equals_a_loop_of_steps():
    _, ys = sample(0, 12)
    trajectory = drive.run(FILTER, prior(), measurements(ys), 1.0)
    state = prior()
    for k in range(12):
        state, info = FILTER.step(state, Sensors(*jnp.asarray(ys[k])), 1.0)
        np.testing.assert_allclose(
            trajectory.state.mean.velocity[k], state.mean.velocity, atol=1e-14
        )
        np.testing.assert_allclose(trajectory.info.nis[k], info.nis, atol=1e-13)


@pytest.mark.parametrize("chunk", [1, 7, 20, 64])
def test_chunks_of_any_length_equal_one_run(chunk):
    _, ys = sample(1, 20)
    factors = np.linspace(0.5, 2.0, 20)
    options = {"inputs": factors, "bind": scaled_by}
    whole = drive.run(FILTER, prior(), measurements(ys), 1.0, **options)
    done, pieces = zip(
        *drive.run_in_chunks(FILTER, prior(), measurements(ys), 1.0, chunk=chunk, **options),
        strict=True,
    )
    assert done[-1] == 20
    joined = jax.tree.map(lambda *a: np.concatenate(a), *pieces)
    for found, expected in zip(jax.tree.leaves(joined), jax.tree.leaves(whole), strict=True):
        np.testing.assert_allclose(found, expected, atol=1e-13)


def test_the_compiled_run_equals_the_plain_one():
    _, ys = sample(3, 15)
    options = {"inputs": jnp.linspace(0.5, 2.0, 15), "bind": scaled_by}
    found = drive.run_compiled(FILTER, prior(), measurements(ys), jnp.asarray(1.0), **options)
    expected = drive.run(FILTER, prior(), measurements(ys), 1.0, **options)
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-13)


def test_an_empty_chunk_is_refused():
    _, ys = sample(1, 4)
    with pytest.raises(ValueError, match="chunk=0"):
        list(drive.run_in_chunks(FILTER, prior(), measurements(ys), 1.0, chunk=0))


def test_log_likelihood_is_the_sum_of_the_steps_and_so_is_its_gradient():
    _, ys = sample(2, 50)

    def by_sum(scale):
        return drive.run(FILTER, prior(), measurements(ys), scale).info.log_likelihood.sum()

    def by_driver(scale):
        return drive.log_likelihood(FILTER, prior(), measurements(ys), scale)

    value, slope = jax.jit(jax.value_and_grad(by_driver))(1.3)
    expected, expected_slope = jax.jit(jax.value_and_grad(by_sum))(1.3)
    assert float(value) == pytest.approx(float(expected), rel=1e-12)
    assert float(slope) == pytest.approx(float(expected_slope), rel=1e-10)


def test_keep_stores_only_what_is_asked_for():
    _, ys = sample(3, 6)
    kept = drive.run(
        FILTER, prior(), measurements(ys), 1.0, keep=lambda state, info: state.mean.bias
    )
    assert kept.shape == (6,)
