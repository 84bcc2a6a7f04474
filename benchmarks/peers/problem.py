"""The problem that all peers solve: the frozen one of filterpy's oracle."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tests.oracles import quarter_car_numpy as car

ORACLE = json.loads((Path(__file__).parents[2] / "tests" / "oracles" / "filterpy.json").read_text())
LEVELS = np.array(ORACLE["levels"])
PRIOR_MEAN = np.array(ORACLE["prior_mean"])
PRIOR_COV = np.array(ORACLE["prior_cov"])
TRANSITION = np.array(ORACLE["transition_matrix"])
INITIAL = np.array(ORACLE["initial"])
DTYPES = ("float32", "float64")


class Unavailable(Exception):
    """A peer that cannot run here; the message is the reason, and the remedy if there is one."""


class Peer(NamedTuple):
    """A compiled peer.

    Attributes:
        call: `call(ys)` filters every run and returns when the result is there.
        ys: the records it was compiled for, [runs, samples, 2].
        compile_seconds: what compiling took, tracing included.
    """

    call: Callable[[Any], Any]
    ys: Any
    compile_seconds: float


def records(runs: int, samples: int, dtype: str) -> np.ndarray:
    """Noisy copies of one simulated record [runs, samples, 2], in m/s^2."""
    rng = np.random.default_rng(0)
    record = car.simulate(rng, 4e-6, samples, np.log(200e3), substeps=1)
    return (record + rng.normal(size=(runs, samples, 2)) * car.NOISE).astype(dtype)
