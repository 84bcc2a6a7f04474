"""The arctangent in lanes against NumPy's, over all magnitudes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from wheelhop.staging import staged_jit
from wheelhop.vehicle.arctangent import arctan


@pytest.mark.parametrize(("precision", "reach"), [("float32", 36), ("float64", 300)])
@pytest.mark.parametrize("staged", [False, True])
def test_every_magnitude_is_right_to_three_units_in_the_last_place(
    precision, reach, staged, stages_as_users_compile
):
    sizes = 10.0 ** np.random.default_rng(0).uniform(-reach, reach, 20_000)
    x = np.concatenate([np.linspace(-4.0, 4.0, 40_001), sizes, -sizes]).astype(precision)
    expected = np.arctan(x.astype(np.longdouble))
    with stages_as_users_compile() as options:
        function = staged_jit(arctan) if staged else jax.jit(arctan, compiler_options=options)
    error = np.abs(np.asarray(function(jnp.asarray(x))) - expected)
    assert np.max(error / np.spacing(np.abs(expected).astype(precision))) < 3.0


def test_ends_and_derivatives():
    ends = jnp.asarray([0.0, jnp.inf, -jnp.inf, jnp.nan])
    np.testing.assert_array_equal(arctan(ends), [0.0, np.pi / 2, -np.pi / 2, np.nan])
    x = jnp.asarray([-2.0, 0.0, 0.41421356, 0.5, 1.0, 3.0, 1e200])
    np.testing.assert_allclose(jax.vmap(jax.grad(arctan))(x), 1.0 / (1.0 + x * x), rtol=1e-15)
    assert float(jax.grad(jax.grad(arctan))(jnp.asarray(0.7))) == pytest.approx(-1.4 / 1.49**2)
