"""Figures of a full vehicle's record: the drive at a glance, and its resonances."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from scipy.signal import welch

from wheelhop.errors import InputError
from wheelhop.plots.style import ALERT, CORNER_COLOURS, ESTIMATE, MUTED, TRUTH, legend
from wheelhop.vehicle.vehicle_record import VehicleRecord

HEAVE_BAND = (1.0, 2.0)
"""Frequencies [Hz] in which the body of a passenger car bounces on its springs."""

WHEEL_HOP_BAND = (9.0, 13.0)
"""Frequencies [Hz] in which its wheels hop on their tyres."""

_SHOWN = (0.5, 40.0)
_SEGMENT = 4.0


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
    axes[0, 1].legend(fontsize=8, ncols=4, loc="lower right", bbox_to_anchor=(1, 1))
    _corners(axes[1, 1], t, 1e3 * truth.compression)
    axes[1, 1].set_ylabel("compression [mm]")
    for name, colour, width in (("a_u", ALERT, 0.5), ("a_s", ESTIMATE, 0.7)):
        label = f"{'wheel' if name == 'a_u' else 'body'} FL, measured"
        axes[2, 1].plot(t, record.measured[f"{name}_FL"], color=colour, lw=width, label=label)
    axes[2, 1].set_ylabel("vertical\nacceleration [m/s²]")
    legend(axes[2, 1], ncols=2, loc="upper right")
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


def plot_corner_spectrum(record: VehicleRecord, title: str = "") -> Figure:
    """Power spectra of the measured body and wheel accelerations of the four corners.

    The bands of heave and wheel hop are shaded; a tick marks each wheel's strongest frequency
    between 6 and 18 Hz.

    Args:
        record: the log, 4 s or longer on a rough road.
        title: headline of the figure.

    Raises:
        InputError: for a record shorter than 4 s.
    """
    figure = Figure(figsize=(8.5, 7.0), layout="constrained")
    top, bottom = figure.subplots(2, 1, sharex=True)
    parts = ((top, "a_s", "body"), (bottom, "a_u", "wheel"))
    for ax, column, part in parts:
        _clean(ax)
        for band, name in ((HEAVE_BAND, "heave"), (WHEEL_HOP_BAND, "wheel hop")):
            ax.axvspan(*band, color=MUTED, alpha=0.15, linewidth=0)
            middle = float(np.sqrt(band[0] * band[1]))
            place = ax.get_xaxis_transform()
            ax.text(middle, 0.98, name, transform=place, ha="center", va="top", fontsize=8)
        for k, (corner, colour) in enumerate(CORNER_COLOURS.items()):
            f, density = corner_spectrum(record, f"{column}_{corner}")
            label = f"{corner}, {np.mean(record.truth.pressure[:, k]) / 1e3:.0f} kPa"
            if column == "a_u":
                hop = strongest_frequency(f, density, (6.0, 18.0))
                label += f": {hop:.1f} Hz"
                ax.axvline(hop, ymax=0.07, color=colour, linewidth=2.5)
            ax.loglog(f, density, color=colour, linewidth=1.2, label=label)
        ax.set_ylabel(f"PSD of the {part} acceleration\n[(m/s²)²/Hz]")
        legend(ax, loc="lower center" if column == "a_u" else "lower left")
    bottom.set_xlim(*_SHOWN)
    bottom.set_xlabel("frequency [Hz]")
    bottom.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    bottom.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    bottom.xaxis.set_minor_formatter(NullFormatter())
    top.set_title(title or "Resonances of the four corners", loc="left", fontsize=11)
    return figure


def corner_spectrum(record: VehicleRecord, column: str) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies [Hz] and one-sided PSD of a measured column, inside 0.5 to 40 Hz.

    Welch's method with Hann windows of 4 s that overlap by three quarters.

    Args:
        record: the log.
        column: name of a measured column.

    Raises:
        InputError: for a record shorter than 4 s.
    """
    points = round(_SEGMENT / record.dt)
    if len(record.t) < points:
        raise InputError(
            "record",
            f"its {len(record.t) * record.dt:.3g} s are too short for a spectrum",
            f"Drive for {_SEGMENT:g} s or longer.",
        )
    signal = record.measured[column]
    f, density = welch(
        np.where(np.isfinite(signal), signal, 0.0),
        fs=1.0 / record.dt,
        nperseg=points,
        noverlap=3 * points // 4,
        nfft=2 * points,
    )
    inside = (f >= _SHOWN[0]) & (f <= _SHOWN[1])
    return f[inside], density[inside]


def strongest_frequency(
    frequency: np.ndarray, density: np.ndarray, band: tuple[float, float]
) -> float:
    """Centre [Hz] of a spectrum's peak in a band: mean frequency of what exceeds half of it.

    The spectrum is averaged over 1 Hz first, so that single lines of a random road do not win.
    """
    width = max(1, round(1.0 / (frequency[1] - frequency[0])))
    smooth = np.convolve(density, np.full(width, 1.0 / width), mode="same")
    inside = (frequency >= band[0]) & (frequency <= band[1])
    f, s = frequency[inside], smooth[inside]
    high = s > 0.5 * s.max()
    return float(np.sum(f[high] * s[high]) / np.sum(s[high]))


def _plot_speed_and_steering(ax: Any, record: VehicleRecord) -> None:
    t, truth = record.t, record.truth
    ax.plot(t, 3.6 * truth.speed, color=TRUTH, linewidth=1.5, label="speed")
    least, most = 3.6 * truth.speed.min(), 3.6 * truth.speed.max()
    ax.set_ylim(max(0.0, least - 5.0) if most - least < 10 else 0.0, most + 5.0)
    ax.set_ylabel("speed [km/h]")
    other = ax.twinx()
    other.spines[["top"]].set_visible(False)
    angle = np.rad2deg(record.measured["steering_wheel"])
    other.plot(t, angle, color=ESTIMATE, linewidth=0.6, label="steering wheel, measured")
    reach = max(5.0, 1.15 * np.nanmax(np.abs(angle)))
    other.set_ylim(-reach, reach)
    other.set_ylabel("steering wheel [°]", color=ESTIMATE)
    other.tick_params(axis="y", colors=ESTIMATE)
    handles = [*ax.lines, *other.lines]
    ax.legend(handles=handles, fontsize=8, ncols=2, loc="lower right", bbox_to_anchor=(1, 1))


def _lines(ax: Any, t: np.ndarray, *named: tuple[str, np.ndarray]) -> None:
    for (name, values), colour in zip(named, (TRUTH, ALERT), strict=False):
        ax.plot(t, values, color=colour, linewidth=1.0, label=name)
    if len(named) > 1:
        legend(ax, ncols=2, loc="upper right")


def _corners(ax: Any, t: np.ndarray, values: np.ndarray) -> None:
    for k, (corner, colour) in enumerate(CORNER_COLOURS.items()):
        ax.plot(t, values[:, k], color=colour, linewidth=1.0, label=corner)


def _clean(ax: Any) -> None:
    ax.grid(True, alpha=0.25, linewidth=0.6)
    ax.spines[["top", "right"]].set_visible(False)
