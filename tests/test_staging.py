"""Stages: real native functions where the platform has them, the same numbers everywhere."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from wheelhop import staging
from wheelhop.staging import native_jit, stage, staged_jit


@pytest.fixture(scope="module", autouse=True)
def _as_users_compile(stages_as_users_compile):
    with stages_as_users_compile():
        yield


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


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_lanes_that_fill_wide_vectors_get_the_right_arctangent(precision):
    x = jnp.linspace(-2.0, 3.0, 200, dtype=precision)
    angle = stage(lambda a: (jnp.arctan(a), jnp.arctan2(a, jnp.ones_like(a))))
    found = staged_jit(lambda x: jax.lax.scan(lambda c, _: (c, angle(c)), x, length=2)[1])(x)
    expected = np.arctan(np.asarray(x, float))
    for values in found:
        np.testing.assert_allclose(values, [expected, expected], rtol=0, atol=1e-6)


def test_every_probed_operation_has_the_name_that_jax_gives_it():
    for name, (ours, _) in staging._PROBED.items():
        assert name in staging._operations(jax.make_jaxpr(ours)(jnp.ones(3)).jaxpr)


def test_an_operation_that_wide_vectors_get_wrong_is_compiled_for_narrow_ones(monkeypatch):
    def with_tangent(x):
        grow = stage(lambda a: jax.lax.cond(a[0] > 0.0, jnp.tanh, jnp.sin, a))
        return jax.lax.scan(lambda c, _: (grow(c), None), x, length=3)[0]

    monkeypatch.setattr(staging, "available", lambda: True)
    monkeypatch.setattr(staging, "misfits", lambda: frozenset({"tanh"}))
    # an option that no compiler takes shows which of both ways is gone
    monkeypatch.setattr(staging, "_WIDE", {"xla_no_such_option": 512})
    x = jnp.linspace(0.1, 1.0, 32)
    compiled = staged_jit(with_tangent)
    for _ in range(2):
        np.testing.assert_allclose(compiled(x), np.tanh(np.tanh(np.tanh(x))), rtol=1e-13)
    assert "tanh" in staged_jit(with_tangent).lower(x).as_text()
    with pytest.raises(jax.errors.JaxRuntimeError, match="xla_no_such_option"):
        staged_jit(lambda x: jnp.cos(x))(x)


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
