"""Figure of a full vehicle's resonances: spectra of the corners and what the road does to them."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from scipy.signal import csd, welch

from wheelhop.errors import InputError
from wheelhop.plots.style import CORNER_COLOURS, MUTED, legend
from wheelhop.vehicle.vehicle_record import VehicleRecord

HEAVE_BAND = (1.0, 2.0)
"""Frequencies [Hz] in which the body of a passenger car bounces on its springs."""

WHEEL_HOP_BAND = (9.0, 13.0)
"""Frequencies [Hz] in which its wheels hop on their tyres."""

_SHOWN = (0.5, 40.0)
_SEGMENT = 2.0
_HOP_SEARCH = (7.0, 16.0)


def plot_corner_spectrum(record: VehicleRecord, title: str = "") -> Figure:
    """Power spectra of body and wheel accelerations per corner, and the wheels' response.

    The two upper panels need measured signals alone; the response, wheel acceleration per
    velocity of the true road under the wheel, shows the wheel hop free of the road's chance.

    Args:
        record: the log of a drive over a rough road.
        title: headline of the figure.

    Raises:
        InputError: for a record shorter than 4 s.
    """
    figure = Figure(figsize=(8.5, 9.0), layout="constrained")
    axes = figure.subplots(3, 1, sharex=True)
    for ax in axes:
        ax.grid(True, alpha=0.25, linewidth=0.6)
        ax.spines[["top", "right"]].set_visible(False)
        for band, name in ((HEAVE_BAND, "heave"), (WHEEL_HOP_BAND, "wheel hop")):
            ax.axvspan(*band, color=MUTED, alpha=0.15, linewidth=0)
            middle = float(np.sqrt(band[0] * band[1]))
            place = ax.get_xaxis_transform()
            ax.text(middle, 1.0, name, transform=place, ha="center", va="bottom", fontsize=8)
    for k, (corner, colour) in enumerate(CORNER_COLOURS.items()):
        label = f"{corner}, {np.mean(record.truth.pressure[:, k]) / 1e3:.0f} kPa"
        for ax, column in ((axes[0], "a_s"), (axes[1], "a_u")):
            f, density = corner_spectrum(record, f"{column}_{corner}")
            ax.loglog(f, density, color=colour, linewidth=1.2, label=label)
        hop = peak_of_wheel_hop(record, corner)
        if hop is None:
            continue
        f, response = wheel_response(record, corner)
        axes[2].semilogx(f, response, color=colour, linewidth=1.2, label=f"{label}: {hop:.1f} Hz")
        axes[2].axvline(hop, ymax=0.08, color=colour, linewidth=2.5)
    if not axes[2].lines:
        note = "the road does not excite the wheel hop"
        axes[2].text(0.5, 0.5, note, transform=axes[2].transAxes, ha="center", color=MUTED)
    else:
        legend(axes[2], loc="upper left")
    legend(axes[0], loc="lower left")
    axes[0].set_ylabel("PSD of the body\nacceleration [(m/s²)²/Hz]")
    axes[1].set_ylabel("PSD of the wheel\nacceleration [(m/s²)²/Hz]")
    axes[2].set_ylabel("wheel acceleration per\nroad velocity [1/s]")
    axes[2].set_ylim(bottom=0)
    axes[2].set_xlim(*_SHOWN)
    axes[2].set_xlabel("frequency [Hz]")
    axes[2].xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes[2].xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes[2].xaxis.set_minor_formatter(NullFormatter())
    axes[0].set_title(title or "Resonances of the four corners", loc="left", fontsize=11, pad=14)
    return figure


def corner_spectrum(record: VehicleRecord, column: str) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies [Hz] and one-sided PSD of a measured column, from 0.5 to 40 Hz.

    Welch's method with Hann windows of 2 s that overlap by three quarters.

    Args:
        record: the log.
        column: name of a measured column.

    Raises:
        InputError: for a record shorter than 4 s.
    """
    signal = record.measured[column]
    options = _options(record)
    f, density = welch(np.where(np.isfinite(signal), signal, 0.0), **options)
    return _inside(f, density)


def wheel_response(record: VehicleRecord, corner: str) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies [Hz] and |wheel acceleration / road velocity| [1/s] of a corner.

    The cross spectrum over the road's spectrum, both of the truth; NaN where the road has less
    than a 10,000th of its strongest velocity spectrum.

    Args:
        record: the log.
        corner: FL, FR, RL or RR.

    Raises:
        InputError: for a record shorter than 4 s.
    """
    k = list(CORNER_COLOURS).index(corner)
    options = _options(record)
    velocity = np.gradient(record.truth.elevation[:, k], record.dt)
    f, cross = csd(velocity, record.truth.wheel_acceleration[:, k], **options)
    road = welch(velocity, **options)[1]
    felt = road > max(1e-4 * road.max(), 1e-15)
    response = np.divide(np.abs(cross), road, out=np.full_like(road, np.nan), where=felt)
    return _inside(f, response)


def peak_frequency(frequency: np.ndarray, response: np.ndarray, band: tuple[float, float]) -> float:
    """Frequency [Hz] of a resonance in a band: centre of what exceeds 80 % of its peak.

    The response is averaged over 1 Hz first: single lines of a random road must not win.
    """
    width = max(1, round(1.0 / (frequency[1] - frequency[0])))
    known = np.nan_to_num(response)
    smooth = np.convolve(known, np.full(width, 1.0 / width), mode="same")
    inside = (frequency >= band[0]) & (frequency <= band[1])
    f, s = frequency[inside], smooth[inside]
    high = s > 0.8 * s.max()
    return float(np.sum(f[high] * s[high]) / np.sum(s[high]))


def peak_of_wheel_hop(record: VehicleRecord, corner: str) -> float | None:
    """Frequency [Hz] of a corner's wheel hop; None in under 4 s or where no road excites it."""
    if len(record.t) * record.dt < 2.0 * _SEGMENT * (1.0 - 1e-9):
        return None
    f, response = wheel_response(record, corner)
    felt = np.isfinite(response[(f >= _HOP_SEARCH[0]) & (f <= _HOP_SEARCH[1])])
    return peak_frequency(f, response, _HOP_SEARCH) if felt.all() else None


def _options(record: VehicleRecord) -> dict[str, Any]:
    points = round(_SEGMENT / record.dt)
    if len(record.t) < 2 * points:
        raise InputError(
            "record",
            f"its {len(record.t) * record.dt:.3g} s are too short for a spectrum",
            f"Drive for {2 * _SEGMENT:g} s or longer.",
        )
    lap = 3 * points // 4
    return {"fs": 1.0 / record.dt, "nperseg": points, "noverlap": lap, "nfft": 4 * points}


def _inside(f: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    inside = (f >= _SHOWN[0]) & (f <= _SHOWN[1])
    return f[inside], values[inside]
