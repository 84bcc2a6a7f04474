"""The Youla observer's design by frequency, Fig. 4, and which sensors determine the load."""

from __future__ import annotations

from itertools import combinations
from typing import Any, NamedTuple

import jax
import numpy as np

from wheelhop.estimators.load_observability import (
    SIGNALS,
    LoadObservability,
    load_observability,
)
from wheelhop.estimators.youla_design import (
    LoopTransfers,
    discretisation_error,
    loop_transfers,
    shaping_transfer,
    singular_values,
)
from wheelhop.estimators.youla_load import FASTEST, default_lag, youla_params
from wheelhop.studies.filipozzi.settings import FilipozziSettings
from wheelhop.studies.filipozzi.vehicles import paper_vehicle
from wheelhop.studies.frame import Advance, Store
from wheelhop.vehicle.corner_suspension import CornerSuspension, corner_suspensions

FREQUENCIES = np.geomspace(0.1, 300.0, 241)
"""Of Fig. 4 [Hz]."""

MARKS = (0.1, 1.0, 3.0, 10.0, 30.0)
"""Frequencies of the tables [Hz]."""

INTERVALS = (1e-3, 2e-3, 4e-3, 8e-3)
"""Sampling intervals whose discretisation is judged [s]."""

HOP = 10.0
"""Frequency of wheel hop that the paper names [Hz]."""

BANDWIDTHS = np.geomspace(10.0, 400.0, 161)
"""At which the error at `HOP` is looked at [Hz]."""


class Design(NamedTuple):
    """Results.

    Attributes:
        settings: that made them.
        corner: front corner of the paper's vehicle.
        transfers: at `FREQUENCIES`.
        values: singular values of each of them, by name, [frequencies, 2].
        marked: largest singular value of T_u and S_u at `MARKS`, by name.
        discrete: by method, largest relative error of Y, [intervals, marks]; NaN beyond half the
            sampling rate.
        hop_error: |1 - M_T| at `HOP` for `BANDWIDTHS`.
        sensors: what subsets of `SIGNALS` determine, by their names.
    """

    settings: FilipozziSettings
    corner: CornerSuspension
    transfers: LoopTransfers
    values: dict[str, np.ndarray]
    marked: dict[str, np.ndarray]
    discrete: dict[str, np.ndarray]
    hop_error: np.ndarray
    sensors: dict[tuple[str, ...], LoadObservability]


def design(settings: FilipozziSettings, store: Store, advance: Advance) -> Design:
    """Compute the design's frequency responses, and judge every set of two or more sensors.

    Args:
        settings: bandwidth and rate.
        store: not used: all of it takes a second.
        advance: told of the steps.
    """
    del store
    corner = jax.tree.map(lambda leaf: leaf[0], corner_suspensions(paper_vehicle()))
    transfers = loop_transfers(corner, FREQUENCIES, settings.bandwidth)
    values = {n: singular_values(m) for n, m in transfers._asdict().items()}
    at = loop_transfers(corner, MARKS, settings.bandwidth)
    marked = {n: singular_values(getattr(at, n))[:, 0] for n in ("closed", "sensitivity")}
    advance(1, 3)
    discrete = {
        method: np.array([_error(corner, dt, method, settings.bandwidth) for dt in INTERVALS])
        for method in ("exact", "bilinear")
    }
    advance(2, 3)
    s = np.asarray(2j * np.pi * HOP)
    hop_error = np.array([abs(1.0 - shaping_transfer(s, b)) for b in BANDWIDTHS])
    sets = [c for k in (2, 3) for c in combinations(SIGNALS, k)]
    sensors = {c: load_observability(corner, 1.0 / settings.rate, c) for c in sets}
    advance(3, 3)
    return Design(settings, corner, transfers, values, marked, discrete, hop_error, sensors)


def needed_bandwidth(result: Design, error: float) -> float:
    """Smallest of `BANDWIDTHS` at which a sine at `HOP` has at most that relative error [Hz]."""
    enough = np.flatnonzero(result.hop_error <= error)
    return float(BANDWIDTHS[enough[0]]) if enough.size else float("nan")


def corner_frequency(result: Design) -> float:
    """Where the largest singular value of T_u falls below -3 dB [Hz]."""
    below = np.flatnonzero(result.values["closed"][:, 0] < np.sqrt(0.5))
    return float(FREQUENCIES[below[0]]) if below.size else float("nan")


def _error(corner: CornerSuspension, dt: float, method: Any, bandwidth: float) -> np.ndarray:
    found = np.full(len(MARKS), np.nan)
    usable = np.asarray(MARKS) < 0.45 / dt
    if bandwidth <= FASTEST / dt:
        lag = default_lag(bandwidth, dt)
        params = youla_params(corner, dt, bandwidth, lag=lag, method=method)
        marks = np.asarray(MARKS)[usable]
        found[usable] = discretisation_error(params, marks, bandwidth=bandwidth, lag=lag)
    return found
