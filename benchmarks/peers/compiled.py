"""The compiled lower bound: the same filter as a C++ kernel over SIMD lanes, see immuf.cpp."""

from __future__ import annotations

import ctypes
import importlib.util
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.peers import problem
from benchmarks.peers.problem import Unavailable
from tests.oracles import quarter_car_numpy as car

SOURCE = Path(__file__).with_name("immuf.cpp")
FLAGS = ("-std=c++17", "-O3", "-march=native", "-ffast-math", "-fPIC", "-pthread")
# g++ leaves the small loops rolled otherwise; clang++ unrolls them and does not know the names
GNU_FLAGS = ("--param=max-completely-peeled-insns=2000", "--param=max-completely-peel-times=32")
_ALIGNMENT = 16


class Estimate(NamedTuple):
    """What the kernel returns.

    Attributes:
        mean: of the mixture, [runs, samples, 5]; the last is ln k_t.
        log_probabilities: of the modes, [runs, samples, 4].
        log_likelihood: log p(y | past) of the mixture, [runs, samples].
    """

    mean: np.ndarray
    log_probabilities: np.ndarray
    log_likelihood: np.ndarray


def build(dtype: str, threads: int = 1) -> Callable[[np.ndarray], Estimate]:
    """The kernel for records [runs, samples, 2] of a precision, on a number of threads.

    Raises:
        Unavailable: if there is no C++ compiler, or it fails.
    """
    function = getattr(library()[0], f"immuf_{dtype}")
    numbers = _numbers()

    def kernel(ys: np.ndarray) -> Estimate:
        ys = np.ascontiguousarray(ys, dtype)
        runs, samples, _ = ys.shape
        stride = -(-runs // _ALIGNMENT) * _ALIGNMENT
        out = _aligned((samples, 10, stride), dtype)
        function(
            numbers.ctypes,
            ys.ctypes,
            out.ctypes,
            *map(ctypes.c_int, (runs, samples, stride, threads)),
        )
        lanes = np.moveaxis(out[:, :, :runs], 2, 0)
        return Estimate(lanes[..., :5], lanes[..., 5:9], lanes[..., 9])

    return kernel


@lru_cache(maxsize=1)
def library() -> tuple[ctypes.CDLL, float]:
    """The kernel compiled for this machine, and the seconds that took."""
    compiler = find_compiler()
    version = subprocess.run([*compiler, "--version"], capture_output=True, text=True).stdout
    flags = FLAGS if "clang" in version else FLAGS + GNU_FLAGS  # on macOS g++ is clang
    start = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        unit, shared = Path(folder) / "immuf.o", Path(folder) / "immuf.so"
        # linked apart, because -ffast-math at the link makes the whole process flush denormals
        for arguments in (
            [*flags, "-c", str(SOURCE), "-o", str(unit)],
            ["-shared", "-pthread", str(unit), "-o", str(shared)],
        ):
            done = subprocess.run([*compiler, *arguments], capture_output=True, text=True)
            if done.returncode:
                raise Unavailable(f"{' '.join(compiler)} failed: {done.stderr.strip()[-500:]}")
        return ctypes.CDLL(str(shared)), time.perf_counter() - start


def find_compiler() -> list[str]:
    """Command of a C++ compiler: g++, clang++, or Zig's clang from PyPI.

    Raises:
        Unavailable: if there is none.
    """
    for name in ("g++", "clang++"):
        if path := shutil.which(name):
            return [path]
    if importlib.util.find_spec("ziglang"):
        return [sys.executable, "-m", "ziglang", "c++"]
    raise Unavailable(
        "no C++ compiler; install g++ or clang++, or pip install ziglang (slow at its first build)"
    )


def _numbers() -> np.ndarray:
    """The problem in the order of the kernel's `Problem`."""
    scalars = [car.M_S, car.M_U, car.K_S, car.K_NL, car.C_S, car.C_NL, car.DT, car.NOISE**2]
    walks = [car.STIFFNESS_WALK**2 * car.DT, car.VELOCITY_WALK**2 * car.DT]
    return np.concatenate(
        [
            scalars,
            walks,
            np.pi * problem.LEVELS * car.SPEED,
            problem.PRIOR_MEAN,
            problem.PRIOR_COV[np.tril_indices(5)],
            problem.TRANSITION.ravel(),
            problem.INITIAL,
        ]
    )


def _aligned(shape: tuple[int, ...], dtype: str) -> np.ndarray:
    """Uninitialised array that starts on a cache line, as the kernel's stores need."""
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    memory = np.empty(size + 64, np.uint8)
    start = -memory.ctypes.data % 64
    return memory[start : start + size].view(dtype).reshape(shape)
