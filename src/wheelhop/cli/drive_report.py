"""What a drive of the full vehicle prints and writes."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from wheelhop.cli.session import console, headed_table, progress_bar, say_files
from wheelhop.io.results import write_atomically, write_figure, write_json
from wheelhop.io.vehicle_logs import write_vehicle_log
from wheelhop.plots.animation import write_animation
from wheelhop.plots.resonances import peak_of_wheel_hop
from wheelhop.plots.vehicle import plot_vehicle_record
from wheelhop.vehicle.full_vehicle import FullVehicle
from wheelhop.vehicle.full_vehicle_parameters import CORNERS
from wheelhop.vehicle.vehicle_record import VehicleRecord


def drive_summary(record: VehicleRecord) -> dict[str, Any]:
    """Figures of a drive, units in their names; per corner where it says corners."""
    truth = record.truth
    travel = np.hypot(np.diff(truth.x), np.diff(truth.y)).sum()
    corners = {}
    for k, name in enumerate(CORNERS):
        a_s, a_u = record.measured[f"a_s_{name}"], record.measured[f"a_u_{name}"]
        corners[name] = {
            "pressure_Pa": [truth.pressure[0, k], truth.pressure[-1, k]],
            "smallest_load_N": truth.load[:, k].min(),
            "mean_load_N": truth.load[:, k].mean(),
            "largest_load_N": truth.load[:, k].max(),
            "smallest_compression_m": truth.compression[:, k].min(),
            "largest_compression_m": truth.compression[:, k].max(),
            "rms_a_s_m_per_s2": np.sqrt(np.nanmean(a_s**2)),
            "rms_a_u_m_per_s2": np.sqrt(np.nanmean(a_u**2)),
            "wheel_hop_Hz": peak_of_wheel_hop(record, name),
        }
    return {
        "duration_s": len(record.t) * record.dt,
        "samples": len(record.t),
        "distance_m": float(travel),
        "initial_speed_m_per_s": truth.speed[0],
        "final_speed_m_per_s": truth.speed[-1],
        "largest_a_x_m_per_s2": np.abs(truth.a_x).max(),
        "largest_a_y_m_per_s2": np.abs(truth.a_y).max(),
        "largest_yaw_rate_rad_per_s": np.abs(truth.yaw_rate).max(),
        "largest_roll_rad": np.abs(truth.roll).max(),
        "largest_pitch_rad": np.abs(truth.pitch).max(),
        "largest_lateral_offset_m": np.abs(truth.y).max(),
        "corners": corners,
    }


def print_drive(results: dict[str, Any]) -> None:
    """Print the figures of `drive_summary`."""
    table = headed_table(
        "corner",
        "pressure [kPa]",
        "load [kN]",
        "compression [mm]",
        "rms a_u [m/s^2]",
        "true hop [Hz]",
    )
    for column in table.columns[1:]:
        column.justify = "right"
    for name, c in results["corners"].items():
        first, last = (p / 1e3 for p in c["pressure_Pa"])
        hop = c["wheel_hop_Hz"]
        table.add_row(
            name,
            f"{first:.0f}" if first == last else f"{first:.0f} to {last:.0f}",
            f"{c['smallest_load_N'] / 1e3:.1f} to {c['largest_load_N'] / 1e3:.1f}",
            f"{1e3 * c['smallest_compression_m']:+.0f} to {1e3 * c['largest_compression_m']:+.0f}",
            f"{c['rms_a_u_m_per_s2']:.2f}",
            "-" if hop is None else f"{hop:.1f}",
        )
    console.print(table)
    console.print(
        f"{results['distance_m']:.1f} m, {3.6 * results['initial_speed_m_per_s']:.1f} to "
        f"{3.6 * results['final_speed_m_per_s']:.1f} km/h; largest a_x "
        f"{results['largest_a_x_m_per_s2']:.2f} m/s^2, a_y "
        f"{results['largest_a_y_m_per_s2']:.2f} m/s^2, roll "
        f"{math.degrees(results['largest_roll_rad']):.2f} deg, pitch "
        f"{math.degrees(results['largest_pitch_rad']):.2f} deg",
        soft_wrap=True,
    )


def write_drive(
    directory: Path,
    record: VehicleRecord,
    vehicle: FullVehicle,
    title: str,
    summary: dict[str, Any],
    animate: bool,
) -> None:
    """Write log, figure and summary of a drive, and its animation if asked; say so.

    Args:
        directory: that holds the files.
        record: the log.
        vehicle: the one that drove.
        title: of the pictures.
        summary: content of summary.json.
        animate: draw animation.gif as well.
    """
    files = ["log.parquet", "vehicle.png", "summary.json"]
    write_vehicle_log(directory / files[0], record)
    write_figure(directory / files[1], plot_vehicle_record(record, title))
    write_json(directory / files[2], summary)
    if animate:
        files.append("animation.gif")
        with progress_bar("drawing", "frames") as advance:
            write_atomically(
                directory / files[3],
                lambda path: write_animation(path, record, vehicle, title, on_progress=advance),
            )
    say_files(directory, *files)
