"""Genetic algorithms of pymoo on a box-bounded problem with many errors per candidate."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from pymoo.algorithms.moo.nsga2 import NSGA2
from pymoo.algorithms.moo.nsga3 import NSGA3
from pymoo.algorithms.soo.nonconvex.ga import GA
from pymoo.core.problem import Problem
from pymoo.operators.crossover.pntx import SinglePointCrossover
from pymoo.operators.mutation.bitflip import BitflipMutation
from pymoo.operators.sampling.rnd import BinaryRandomSampling
from pymoo.util.ref_dirs import get_reference_directions

BITS = 16
"""Bits of a parameter in a binary chromosome: steps of 1.5e-5 of its range."""


class Found(NamedTuple):
    """The best norm of the errors over time, one entry a generation.

    Attributes:
        seconds: since the beginning.
        simulations: candidates simulated by then.
        loss: the lowest norm met so far.
        compile_seconds: of the simulator, beside it.
        best: place in the unit box.
    """

    seconds: np.ndarray
    simulations: np.ndarray
    loss: np.ndarray
    compile_seconds: float
    best: np.ndarray


def single_objective(
    errors: Callable[[np.ndarray], np.ndarray],
    n: int,
    population: int,
    generations: int,
    seed: int,
    binary: bool = False,
) -> Found:
    """A genetic algorithm on the norm of the errors.

    Args:
        errors: places in the unit box [candidates, n] -> errors [candidates, m].
        n: number of parameters.
        population: candidates per generation.
        generations: to run.
        seed: of the algorithm.
        binary: binary chromosomes, one-point crossover and bit flips; else real ones with
            pymoo's default operators.
    """
    operators = _binary_operators() if binary else {}
    return _run(GA(pop_size=population, **operators), errors, n, generations, seed, 1, binary)


def nearest_by_nsga(
    kind: int,
    errors: Callable[[np.ndarray], np.ndarray],
    n: int,
    population: int,
    generations: int,
    seed: int,
) -> Found:
    """NSGA-II or NSGA-III on all errors as objectives, then the point nearest to the origin.

    Args:
        kind: 2 or 3.
        errors, n, population, generations, seed: as in `single_objective`.
    """
    m = errors(np.full((population, n), 0.5)).shape[1]
    if kind == 2:
        algorithm = NSGA2(pop_size=population, **_binary_operators())
    else:
        directions = get_reference_directions("energy", m, population, seed=seed)
        algorithm = NSGA3(directions, pop_size=population, **_binary_operators())
    return _run(algorithm, errors, n, generations, seed, m, True)


def _binary_operators() -> dict[str, Any]:
    return {
        "sampling": BinaryRandomSampling(),
        "crossover": SinglePointCrossover(),
        "mutation": BitflipMutation(),
        "eliminate_duplicates": True,
    }


def _run(
    algorithm: Any, errors: Any, n: int, generations: int, seed: int, m: int, binary: bool
) -> Found:
    """Generation by generation; the simulator is compiled before the clock starts."""
    weights = 0.5 ** np.arange(1, BITS + 1) / (1.0 - 0.5**BITS)

    class Task(Problem):
        def __init__(self) -> None:
            size = n * BITS if binary else n
            kind = {"vtype": bool} if binary else {"xl": np.zeros(n), "xu": np.ones(n)}
            super().__init__(n_var=size, n_obj=m, **kind)

        def _evaluate(self, x: np.ndarray, out: dict, *args: Any, **options: Any) -> None:
            found = errors_of(x)
            norm = np.linalg.norm(found, axis=1)
            k = int(np.argmin(norm))
            if norm[k] < state["loss"]:
                state["loss"], state["best"] = float(norm[k]), places(x)[k]
            state["count"] += len(x)
            out["F"] = norm[:, None] if m == 1 else found

    def places(x: np.ndarray) -> np.ndarray:
        return x.reshape(len(x), n, BITS) @ weights if binary else x

    def errors_of(x: np.ndarray) -> np.ndarray:
        """Padded to a full population, so that the simulator is compiled for one shape."""
        at = places(x)
        size = max(algorithm.pop_size, len(at))
        padded = np.concatenate([at, np.repeat(at[-1:], size - len(at), axis=0)])
        return errors(padded)[: len(at)]

    state: dict[str, Any] = {"loss": np.inf, "best": np.full(n, np.nan), "count": 0}
    algorithm.setup(Task(), termination=("n_gen", generations), seed=seed, verbose=False)
    began = time.perf_counter()
    errors(np.full((algorithm.pop_size, n), 0.5))
    first = time.perf_counter() - began
    began = time.perf_counter()
    errors(np.full((algorithm.pop_size, n), 0.5))
    compiling = max(0.0, first - (time.perf_counter() - began))
    rows = []
    began = time.perf_counter()
    while algorithm.has_next():
        algorithm.next()
        rows.append((time.perf_counter() - began, state["count"], state["loss"]))
    seconds, simulations, loss = (np.array(c) for c in zip(*rows, strict=True))
    return Found(seconds, simulations, loss, compiling, state["best"])
