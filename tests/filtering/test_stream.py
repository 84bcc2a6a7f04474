"""A packed step is the filter's step."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from models import COV, MEAN, Sensors, Track, linear_model, sample

from wheelhop.filtering import InteractingParams, drive, gaussian, interacting, unscented
from wheelhop.filtering.stream import packed

IMM = interacting(unscented(linear_model()))


def params(scale):
    return InteractingParams(
        scale * jnp.array([0.5, 2.0]), jnp.array([[0.9, 0.1], [0.2, 0.8]]), jnp.array([0.5, 0.5])
    )


def test_streaming_equals_the_scan_and_new_parameters_do_not_recompile():
    _, ys = sample(0, 10)
    ys[3, 1] = np.nan
    start = IMM.init(gaussian(Track(*MEAN), jnp.asarray(COV)), params(1.0))
    stream = packed(IMM, start, params(1.0), Sensors)
    for scale in (1.0, 1.7):
        whole = drive.run(IMM, start, Sensors(*jnp.asarray(ys.T)), params(scale))
        vector, p = stream.state, stream.pack_params(params(scale))
        for k, y in enumerate(ys):
            vector, result = stream.step(vector, y, p)
            found = stream.unpack_result(result)
            for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(whole), strict=True):
                np.testing.assert_allclose(a, np.asarray(b[k], float), atol=1e-11)
        last = jax.tree.map(lambda a: a[-1], whole.state)
        for a, b in zip(
            jax.tree.leaves(stream.unpack_state(vector)), jax.tree.leaves(last), strict=True
        ):
            np.testing.assert_allclose(a, b, atol=1e-11)
    assert stream.step._cache_size() == 1


def test_a_state_of_integers_is_refused():
    with pytest.raises(ValueError, match="one floating type"):
        packed(IMM, (jnp.ones((), int),), params(1.0), Sensors)
