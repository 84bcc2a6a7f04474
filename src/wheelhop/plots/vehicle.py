"""Figure of a full vehicle's record: the drive at a glance."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from wheelhop.plots.style import ALERT, CORNER_COLOURS, ESTIMATE, TRUTH
from wheelhop.vehicle.vehicle_record import VehicleRecord


def plot_vehicle_record(record: VehicleRecord, title: str = "") -> Figure:
    """The drive at a glance: motion on the left, what the four corners do on the right.

    Lines are the truth; what a sensor reports is drawn for the accelerations of one corner.

    Args:
        record: the log.
        title: headline of the figure.
    """
    figure = Figure(figsize=(12.5, 10.0), layout="constrained")
    axes = figure.subplots(4, 2, sharex=True)
    for ax in axes.flat:
        _clean(ax)
    t, truth = record.t, record.truth
    _plot_speed_and_steering(axes[0, 0], record)
    _lines(axes[1, 0], t, ("ahead $a_x$", truth.a_x), ("to the left $a_y$", truth.a_y))
    axes[1, 0].set_ylabel("acceleration [m/s²]")
    _lines(axes[2, 0], t, ("yaw rate", np.rad2deg(truth.yaw_rate)))
    axes[2, 0].set_ylabel("yaw rate [°/s]")
    reach = max(1.0, 1.1 * float(np.rad2deg(np.abs(truth.yaw_rate).max())))
    axes[2, 0].set_ylim(-reach, reach)
    _lines(
        axes[3, 0],
        t,
        ("roll, to the right", np.rad2deg(truth.roll)),
        ("pitch, nose down", np.rad2deg(truth.pitch)),
    )
    axes[3, 0].set_ylabel("attitude [°]")
    _corners(axes[0, 1], t, truth.load / 1e3)
    axes[0, 1].set_ylabel("tyre load [kN]")
    axes[0, 1].set_ylim(bottom=0)
    _legend_above(axes[0, 1], ncols=4)
    _corners(axes[1, 1], t, 1e3 * truth.compression)
    axes[1, 1].set_ylabel("compression [mm]")
    for name, colour, width in (("a_u", ALERT, 0.5), ("a_s", ESTIMATE, 0.7)):
        label = f"{'wheel' if name == 'a_u' else 'body'} FL, measured"
        axes[2, 1].plot(t, record.measured[f"{name}_FL"], color=colour, lw=width, label=label)
    axes[2, 1].set_ylabel("vertical\nacceleration [m/s²]")
    _legend_above(axes[2, 1], ncols=2)
    _corners(axes[3, 1], t, truth.pressure / 1e3)
    low, high = truth.pressure.min() / 1e3, truth.pressure.max() / 1e3
    margin = max(10.0, 0.15 * (high - low))
    axes[3, 1].set_ylim(low - margin, high + margin)
    axes[3, 1].set_ylabel("tyre pressure [kPa]")
    for ax in axes[3]:
        ax.set_xlabel("time [s]")
        ax.set_xlim(0, t[-1])
    figure.suptitle(title or "Full vehicle", x=0.01, ha="left", fontsize=12)
    return figure


def _plot_speed_and_steering(ax: Any, record: VehicleRecord) -> None:
    t, truth = record.t, record.truth
    ax.plot(t, 3.6 * truth.speed, color=TRUTH, linewidth=1.5, label="speed")
    least, most = 3.6 * truth.speed.min(), 3.6 * truth.speed.max()
    ax.set_ylim(max(0.0, least - 5.0) if most - least < 10 else 0.0, most + 5.0)
    ax.set_ylabel("speed [km/h]")
    other = ax.twinx()
    # the speed in front, which noise would hide
    ax.set_zorder(other.get_zorder() + 1)
    ax.patch.set_visible(False)
    other.spines[["top"]].set_visible(False)
    angle = np.rad2deg(record.measured["steering_wheel"])
    other.plot(t, angle, color=ESTIMATE, linewidth=0.6, label="steering wheel, measured")
    reach = max(10.0, 1.15 * np.nanmax(np.abs(angle)))
    other.set_ylim(-reach, reach)
    other.set_ylabel("steering wheel [°]", color=ESTIMATE)
    other.tick_params(axis="y", colors=ESTIMATE)
    _legend_above(ax, ncols=2, handles=[*ax.lines, *other.lines])


def _lines(ax: Any, t: np.ndarray, *named: tuple[str, np.ndarray]) -> None:
    for (name, values), colour in zip(named, (TRUTH, ALERT), strict=False):
        ax.plot(t, values, color=colour, linewidth=1.0, label=name)
    if len(named) > 1:
        _legend_above(ax, ncols=2)


def _corners(ax: Any, t: np.ndarray, values: np.ndarray) -> None:
    for k, (corner, colour) in enumerate(CORNER_COLOURS.items()):
        ax.plot(t, values[:, k], color=colour, linewidth=1.0, label=corner)


def _clean(ax: Any) -> None:
    ax.grid(True, alpha=0.25, linewidth=0.6)
    ax.spines[["top", "right"]].set_visible(False)


def _legend_above(ax: Any, **options: Any) -> None:
    place = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "borderaxespad": 0.2}
    ax.legend(fontsize=8, frameon=False, **place, **options)
