"""Runs in lanes give what one run at a time gives, staged or not, on one device or two."""

import os
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from models import COV, MEAN, Sensors, Track, linear_model, sample

from wheelhop.filtering import InteractingParams, drive, gaussian, interacting, unscented
from wheelhop.filtering.batch import log_likelihood_batch, run_batch

IMM = interacting(unscented(linear_model()))


def params(scale=1.0):
    return InteractingParams(
        scale * jnp.array([0.5, 2.0]), jnp.array([[0.9, 0.1], [0.2, 0.8]]), jnp.array([0.5, 0.5])
    )


def records(runs, steps=12):
    ys = np.stack([sample(k, steps)[1] for k in range(runs)])
    ys[0, 3] = np.nan
    return Sensors(jnp.asarray(ys[..., 0]), jnp.asarray(ys[..., 1]))


def start():
    return IMM.init(gaussian(Track(*MEAN), jnp.asarray(COV)), params())


def assert_trees_close(found, expected, atol=1e-12):
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        assert a.shape == b.shape
        np.testing.assert_allclose(a, b, atol=atol, rtol=1e-12)


@pytest.mark.parametrize("lanes", [2, 5, 64])
def test_lanes_equal_vmap_whatever_the_chunk(lanes):
    ys = records(5)
    found = run_batch(IMM, start(), ys, params(), lanes=lanes)
    expected = jax.vmap(lambda y: drive.run(IMM, start(), y, params()))(ys)
    assert_trees_close(found, expected)


def test_every_argument_may_have_a_run_axis():
    ys, scales = records(3), jnp.array([0.5, 1.0, 2.0])
    factors = jnp.linspace(0.5, 2.0, 36).reshape(3, 12)
    many = jax.vmap(params)(scales)
    states = jax.vmap(lambda p: IMM.init(gaussian(Track(*MEAN), jnp.asarray(COV)), p))(many)

    def bind(p, u):
        return InteractingParams(p.members * jnp.asarray(u)[None], p.transition, p.initial)

    found = run_batch(IMM, states, ys, many, inputs=factors, bind=bind, in_axes=(0, 0, 0, 0))

    def one(s, y, p, u):
        return drive.run(IMM, s, y, p, inputs=u, bind=bind)

    assert_trees_close(found, jax.jit(jax.vmap(one))(states, ys, many, factors))


def test_parameters_alone_may_vary():
    y = jax.tree.map(lambda a: a[1], records(2))
    many = jax.vmap(params)(jnp.array([0.5, 1.0, 2.0]))
    found = log_likelihood_batch(IMM, start(), y, many, in_axes=(None, None, 0, None))
    one = jax.jit(lambda scale: drive.log_likelihood(IMM, start(), y, params(scale)))
    expected = [one(scale) for scale in (0.5, 1.0, 2.0)]
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_log_likelihood_and_its_gradient_equal_vmap():
    ys = records(5)

    def fast(scale):
        return log_likelihood_batch(IMM, start(), ys, params(scale), lanes=2, segment=5).sum()

    def plain(scale):
        one = jax.vmap(lambda y: drive.log_likelihood(IMM, start(), y, params(scale)))
        return one(ys).sum()

    found, slope = jax.jit(jax.value_and_grad(fast))(1.3)
    expected, expected_slope = jax.jit(jax.value_and_grad(plain))(1.3)
    assert float(fast(1.3)) == pytest.approx(float(expected), rel=1e-12)
    assert float(found) == pytest.approx(float(expected), rel=1e-12)
    assert float(slope) == pytest.approx(float(expected_slope), rel=1e-9)


def test_what_to_keep_is_the_callers():
    found = run_batch(IMM, start(), records(3), params(), keep=lambda s, i: i.nis)
    assert found.shape == (3, 12)


def test_wrong_use_is_named():
    with pytest.raises(ValueError, match="lanes=0"):
        run_batch(IMM, start(), records(2), params(), lanes=0)
    with pytest.raises(ValueError, match=r"run axes of length \[2, 3\]"):
        run_batch(
            IMM, start(), records(2), params(), inputs=jnp.ones((3, 12)), in_axes=(None, 0, None, 0)
        )
    with pytest.raises(ValueError, match="each entry is 0 or None"):
        run_batch(IMM, start(), records(2), params(), in_axes=(None, 1, None, 0))
    with pytest.raises(ValueError, match="does not have the runs last"):
        run_batch(IMM, start(), records(2), params(), keep=lambda s, i: jnp.zeros(()))


TWO_DEVICES = """
import jax, numpy as np
jax.config.update("jax_enable_x64", True)
assert len(jax.devices()) == 2
import test_batch as t
found = t.run_batch(t.IMM, t.start(), t.records(5), t.params(), lanes=2)
expected = jax.vmap(lambda y: t.drive.run(t.IMM, t.start(), y, t.params()))(t.records(5))
t.assert_trees_close(found, expected)
print("same on two devices")
"""


def test_two_devices_share_the_chunks():
    environment = dict(
        os.environ,
        XLA_FLAGS="--xla_force_host_platform_device_count=2",
        JAX_PLATFORMS="cpu",
        PYTHONPATH=os.path.dirname(__file__),
    )
    done = subprocess.run(
        [sys.executable, "-c", TWO_DEVICES], env=environment, capture_output=True, text=True
    )
    assert "same on two devices" in done.stdout, done.stderr[-2000:]
