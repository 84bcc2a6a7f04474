"""Gradient of the log-likelihood through long records: time and memory of this process.

    python -m benchmarks.memory SAMPLES RUNS

Prints one line of JSON. The log-likelihood rematerialises by segments, so memory grows with the
square root of the length.
"""

from __future__ import annotations

import json
import os
import sys

if "XLA_FLAGS" not in os.environ:
    os.environ["XLA_FLAGS"] = f"--xla_force_host_platform_device_count={os.cpu_count() or 1}"

import resource
import time

import jax
import numpy as np

from benchmarks import work


def main() -> None:
    samples, runs = int(sys.argv[1]), int(sys.argv[2])
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    peer = work.build_likelihood(runs, samples, "float32", True)
    start = time.perf_counter()
    result = peer.call(work.knobs())
    seconds = time.perf_counter() - start
    if not all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(result)):
        raise RuntimeError("the gradient through the long record is not finite")
    content = {
        "samples": samples,
        "runs": runs,
        "seconds": seconds,
        "compile_seconds": peer.compile_seconds,
        "temporary_MiB": peer.call.memory / 2**20,  # type: ignore[attr-defined]
        "process_MiB_before": before,
        "peak_process_MiB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }
    print(json.dumps(content))


if __name__ == "__main__":
    main()
