"""The peers of the speed benchmark solve the same problem: filterpy's frozen IMM, in float64."""

import importlib.util
import shutil
import sys

import numpy as np
import pytest

from benchmarks.peers import compiled, dynamax_ukf, idiomatic, problem, smcx_ukf
from benchmarks.peers.problem import Unavailable

EXPECTED = problem.ORACLE["imm"]["cubature"]
RECORD = np.array(problem.ORACLE["measurements"])
SAMPLES = len(RECORD)


def kernel(dtype, threads=1):
    try:
        return compiled.build(dtype, threads)
    except Unavailable as reason:
        pytest.skip(str(reason))


def batch(runs):
    """The frozen record last, behind others that must not leak into it."""
    others = problem.records(runs - 1, SAMPLES, "float64")
    return np.concatenate([others, RECORD[None]])


def assert_same_estimate(estimate, tolerance):
    mean, log_probabilities, log_likelihood = (np.asarray(e, float)[-1] for e in estimate)
    sigma = np.sqrt(np.array(EXPECTED["cov"])[:, [0, 2, 5, 9, 14]])
    np.testing.assert_allclose(mean / sigma, EXPECTED["mean"] / sigma, atol=tolerance, rtol=0)
    np.testing.assert_allclose(
        np.exp(log_probabilities), EXPECTED["probabilities"], atol=tolerance, rtol=0
    )
    np.testing.assert_allclose(log_likelihood, EXPECTED["log_likelihood"], atol=tolerance, rtol=0)


@pytest.mark.parametrize("runs", [2, 16, 21])
def test_compiled_kernel_equals_filterpy_to_1e_11(runs):
    assert_same_estimate(kernel("float64")(batch(runs)), 1e-11)


def test_compiled_kernel_in_float32_stays_within_a_thousandth_of_a_sigma():
    for runs in (2, 21):
        assert_same_estimate(kernel("float32")(batch(runs)), 1e-3)


def test_threads_do_not_change_a_bit():
    ys = batch(40)
    for alone, shared in zip(kernel("float64")(ys), kernel("float64", 2)(ys), strict=True):
        np.testing.assert_array_equal(alone, shared)


def test_idiomatic_jax_equals_filterpy_to_1e_11():
    peer = idiomatic.build(2, SAMPLES, "float64")
    assert_same_estimate(peer.call(batch(2)), 1e-11)


@pytest.mark.parametrize("library", [dynamax_ukf, smcx_ukf])
def test_a_missing_library_is_told_with_its_remedy(library, monkeypatch):
    name = library.__name__.rpartition(".")[2].removesuffix("_ukf")
    for module in (name, f"{name}.nonlinear_gaussian_ssm"):
        monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(Unavailable, match=f"pip install {name}"):
        library.build(1, 1, "float32")


def test_a_missing_compiler_is_told_with_its_remedy(monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda name: None)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(Unavailable, match="install g"):
        compiled.find_compiler()
