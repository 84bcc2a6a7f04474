"""The lateral benchmark runs, and its NumPy peer believes what the switched bank believes."""

import json
import subprocess
import sys
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from benchmarks.peers import switched_numpy
from wheelhop.estimators.failure_modes import stacked_tires
from wheelhop.estimators.lateral import STEADY_TUNING, LateralSample, SwitchedParams, switched
from wheelhop.vehicle.lateral_tire import NOMINAL_TIRE, SOFT_TIRE
from wheelhop.vehicle.two_track import SOLMAZ_CAR


@pytest.mark.parametrize("gate", [0.0, 0.3])
def test_the_numpy_loop_selects_what_the_switched_bank_selects(gate):
    rng, time = np.random.default_rng(0), 0.01 * np.arange(1500)
    steer = 0.015 * np.sin(2 * np.pi * time / 2.5)
    ys = LateralSample(
        steer,
        np.full(time.shape, 22.0),
        190 * steer + 0.3 * rng.normal(size=time.shape),
        8 * steer + 0.01 * rng.normal(size=time.shape),
    )
    car = replace(SOLMAZ_CAR, roll_gain=0.1, front_transfer=0.6)
    tuning = replace(STEADY_TUNING, gate=gate)
    params = SwitchedParams(car, stacked_tires((SOFT_TIRE, NOMINAL_TIRE)), 0.01, tuning)
    bank = switched()

    @jax.jit
    def run(ys, params):
        def step(state, y):
            state, info = bank.step(state, y, params)
            return state, info.selected

        return jax.lax.scan(step, bank.init(params), ys)[1]

    found = np.asarray(run(jax.tree.map(jnp.asarray, ys), params))
    assert np.count_nonzero(np.diff(found)) > 3
    np.testing.assert_array_equal(switched_numpy.build(params)(ys), found)


def test_the_benchmark_runs(tmp_path):
    file = tmp_path / "lateral.json"
    command = [sys.executable, "-m", "benchmarks.lateral", "--quick", "--json", str(file)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    rows = json.loads(file.read_text())["float32"]
    assert rows["NumPy loop, 16"]["peer_ratio"] == 1.0
    assert any(name.startswith("Bayesian") for name in rows)
    for row in rows.values():
        assert row["model_steps_per_s"] > 0.0
        assert row["peer_ratio"] > 0.0
    assert "Bayesian, 16" in done.stdout
