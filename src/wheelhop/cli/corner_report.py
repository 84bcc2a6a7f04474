"""What the simulation of a single corner prints and writes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from wheelhop.cli.session import console
from wheelhop.io.logs import write_log
from wheelhop.io.results import output_directory, write_figure, write_json
from wheelhop.plots import plot_log
from wheelhop.vehicle.record import CornerRecord


def report_corner(
    log: Path, out: Path, record: CornerRecord, title: str, made_by: dict[str, Any]
) -> None:
    """Write the log, its figure and its summary, and say so.

    Args:
        log: file to write.
        out: what --out named; the log or its directory.
        record: the log.
        title: of the figure.
        made_by: what made it, for the summary.
    """
    directory = output_directory(log.parent)
    write_log(log, record)
    write_figure(log.with_suffix(".png"), plot_log(record, title))
    seconds = len(record.t) * record.dt
    results = {
        "duration_s": seconds,
        "samples": len(record.t),
        "distance_m": float(np.sum(record.v) * record.dt),
        "rms_a_s_m_per_s2": float(np.sqrt(np.nanmean(record.a_s**2))),
        "rms_a_u_m_per_s2": float(np.sqrt(np.nanmean(record.a_u**2))),
    }
    summary = directory / ("summary.json" if log.parent == out else f"{log.stem}.summary.json")
    write_json(summary, {**made_by, "results": results})
    console.print(
        f"{len(record.t)} samples over {seconds:.2f} s and {results['distance_m']:.1f} m; rms "
        f"body {results['rms_a_s_m_per_s2']:.2f} m/s^2, wheel "
        f"{results['rms_a_u_m_per_s2']:.2f} m/s^2"
    )
    console.print(f"wrote {log}, {log.with_suffix('.png').name} and {summary.name}", soft_wrap=True)
