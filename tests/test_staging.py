"""Stages: real native functions where the platform has them, the same numbers everywhere."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from wheelhop import staging
from wheelhop.staging import native_jit, stage, staged_jit


def pendulum(x):
    step = stage(lambda angle, rate: (angle + 0.1 * rate, rate - 0.1 * jnp.sin(angle)))

    def body(carry, _):
        return step(*carry), carry[0]

    return jax.lax.scan(body, (x, jnp.zeros_like(x)), length=20)


def test_staged_and_plain_agree_in_value_and_gradient():
    x = jnp.linspace(0.1, 1.0, 32)
    for f in (pendulum, jax.grad(lambda x: pendulum(x)[1].sum())):
        for a, b in zip(
            jax.tree.leaves(staged_jit(f)(x)), jax.tree.leaves(jax.jit(f)(x)), strict=True
        ):
            np.testing.assert_allclose(a, b, rtol=1e-13)


@pytest.mark.skipif(jax.default_backend() != "cpu", reason="stages are a matter of XLA:CPU")
def test_on_this_machine_the_native_function_is_really_there():
    assert staging.available()
    text = staged_jit(pendulum).lower(jnp.ones(32)).compile().as_text()
    assert 'xla_cpu_small_call="true"' in text
    assert "small_call" not in jax.jit(pendulum).lower(jnp.ones(32)).compile().as_text()


def test_without_the_compilers_help_the_plain_path_serves(monkeypatch):
    monkeypatch.setattr(staging, "available", lambda: False)
    x = jnp.linspace(0.1, 1.0, 8)
    np.testing.assert_array_equal(staged_jit(pendulum)(x)[1], jax.jit(pendulum)(x)[1])


def test_constants_and_keywords_pass_through():
    double = stage(lambda x, factor, *, offset: factor * x + offset)
    assert float(staged_jit(lambda x: double(x, 2, offset=0.5))(jnp.ones(()))) == 2.5
    assert float(double(jnp.ones(()), 2, offset=0.5)) == 2.5


def test_one_native_function_or_as_many_as_the_compiler_allows():
    x = jnp.linspace(0.1, 1.0, 32)
    np.testing.assert_allclose(native_jit(pendulum)(x)[1], jax.jit(pendulum)(x)[1], rtol=1e-13)

    def with_library_call(x):
        return jnp.sort(pendulum(x)[0][0])

    fast = native_jit(with_library_call)
    for _ in range(2):
        np.testing.assert_allclose(fast(x), jax.jit(with_library_call)(x), rtol=1e-13)
