"""Figures of how a fitted quarter car follows its records: over time and over frequency."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from scipy.signal import welch

from wheelhop.identification.replay import Replay
from wheelhop.plots.style import ALERT, ESTIMATE, MUTED

WINDOW = 2.0
"""Length [s] of the stretch that the overlay shows."""

SIGNALS = (("a_u", "wheel $a_u$"), ("a_s", "body $a_s$"))

_LOOKS: dict[str, dict[str, Any]] = {
    "measured": {"color": "#b8bfc0", "linewidth": 3.0},
    "measured less fit": {"color": MUTED, "linewidth": 1.1},
    "start": {"color": ALERT, "linewidth": 0.9, "linestyle": "--"},
    "fit": {"color": ESTIMATE, "linewidth": 1.1},
}
_SEGMENT = 2.0
_SHOWN = (0.5, 40.0)


def shown_records(replays: Sequence[Replay]) -> tuple[int, ...]:
    """Records that stand for all: lowest and highest pressure next to the middle speed.

    Args:
        replays: one a record.
    """
    speed = np.array([np.mean(r.record.v) for r in replays])
    pressure = np.array([_mean_pressure(r) for r in replays])
    away = np.abs(speed - np.median(speed))
    middle = np.flatnonzero(away <= away.min() + 0.02 * np.median(speed))
    low = int(middle[np.argmin(pressure[middle])])
    high = int(middle[np.argmax(pressure[middle])])
    return (low,) if low == high else (low, high)


def plot_fit_overlay(replays: Sequence[Replay], title: str = "") -> Figure:
    """Wheel and body accelerations over 2 s: measured, before the fit and fitted.

    The comparison of Brancati & Tufano 2022, Fig. 5, with the body and the start beside it.

    Args:
        replays: one a record; `shown_records` chooses up to two.
        title: headline of the figure.
    """
    chosen = [replays[k] for k in shown_records(replays)]
    figure, axes = _panels(len(chosen), title or "The fitted quarter car over time")
    for column, one in enumerate(chosen):
        t, inside = _window(one)
        for row, (signal, label) in enumerate(SIGNALS):
            ax = axes[row, column]
            measured = getattr(one.record, signal)
            start, fit = getattr(one.start, signal), getattr(one.fit, signal)
            for name, values in (("measured", measured), ("start", start), ("fit", fit)):
                ax.plot(t[inside], values[inside], **_LOOKS[name])
            _limits(ax, measured[inside], fit[inside])
            errors = [_rms(values - measured, one, measured) for values in (start, fit)]
            ax.text(
                0.01,
                0.98,
                f"rms error: start {errors[0]:.2f}, fit {errors[1]:.2f}; "
                f"measured rms {_rms(measured, one, measured):.2f}",
                transform=ax.transAxes,
                va="top",
                fontsize=8,
                bbox={"facecolor": "white", "alpha": 0.8, "edgecolor": "none", "pad": 1.5},
            )
            if column == 0:
                ax.set_ylabel(f"{label} [m/s²]")
        axes[0, column].set_title(_heading(one), fontsize=10)
        axes[1, column].set_xlabel("time [s]")
    _legend(figure, ("measured", "start", "fit"))
    return figure


def plot_fit_spectra(replays: Sequence[Replay], title: str = "") -> Figure:
    """Power spectra of both accelerations: measured, start, fit, and measured less fit.

    Where the residual lies far below the measured spectrum, the quarter car explains the motion;
    a flat residual is sensor noise. Welch's method with Hann windows of 2 s.

    Args:
        replays: one a record; `shown_records` chooses up to two.
        title: headline of the figure.
    """
    chosen = [replays[k] for k in shown_records(replays)]
    figure, axes = _panels(len(chosen), title or "The fitted quarter car over frequency")
    for column, one in enumerate(chosen):
        for row, (signal, label) in enumerate(SIGNALS):
            ax = axes[row, column]
            measured = _bridged(getattr(one.record, signal))
            start, fit = getattr(one.start, signal), getattr(one.fit, signal)
            f, density = _spectrum(measured, one)
            ax.loglog(f, density, **_LOOKS["measured"])
            f, residual = _spectrum(measured - fit, one)
            ax.loglog(f, residual, **_LOOKS["measured less fit"])
            ax.fill_between(f, residual, 1e-12, color=MUTED, alpha=0.15, linewidth=0)
            bottom = 0.3 * min(float(density.min()), float(residual.min()))
            ax.set_ylim(max(bottom, 1e-7 * float(density.max())), 5 * float(density.max()))
            for name, values in (("start", start), ("fit", fit)):
                if np.isfinite(values).all():
                    ax.loglog(*_spectrum(values, one), **_LOOKS[name])
            if column == 0:
                ax.set_ylabel(f"PSD of the {label}\n[(m/s²)²/Hz]")
        axes[0, column].set_title(_heading(one), fontsize=10)
        axes[1, column].set_xlabel("frequency [Hz]")
    for ax in axes.flat:
        ax.set_xlim(*_SHOWN)
        ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        ax.xaxis.set_minor_formatter(NullFormatter())
    _legend(figure, ("measured", "start", "fit", "measured less fit"))
    return figure


def _panels(columns: int, title: str) -> tuple[Figure, Any]:
    figure = Figure(figsize=(11.0 if columns > 1 else 8.0, 6.4), layout="constrained")
    axes = figure.subplots(2, columns, squeeze=False, sharex="col")
    for ax in axes.flat:
        ax.grid(True, alpha=0.25, linewidth=0.6)
        ax.spines[["top", "right"]].set_visible(False)
    figure.suptitle(title, fontsize=11)
    return figure, axes


def _legend(figure: Figure, names: Sequence[str]) -> None:
    """One legend below all panels, where it hides nothing."""
    lines = [figure.axes[0].plot([], [], label=name, **_LOOKS[name])[0] for name in names]
    figure.legend(handles=lines, loc="outside lower center", ncols=len(lines), fontsize=9)


def _window(one: Replay) -> tuple[np.ndarray, np.ndarray]:
    """Time [s], and where it lies in the middle of what was judged."""
    t = one.record.t
    judged = t[one.judged]
    begin = max(judged[0], 0.5 * (judged[0] + judged[-1] - WINDOW))
    return t, (t >= begin) & (t <= begin + WINDOW)


def _limits(ax: Any, measured: np.ndarray, fit: np.ndarray) -> None:
    """The measured and the fitted series fill the panel; a start far off is cut."""
    size = 1.35 * float(np.nanmax(np.abs(np.concatenate([measured, fit]))))
    if np.isfinite(size) and size > 0:
        ax.set_ylim(-size, size)


def _heading(one: Replay) -> str:
    kpa, kmh = _mean_pressure(one) / 1e3, 3.6 * float(np.mean(one.record.v))
    return f"{one.name}: {kpa:.0f} kPa, {kmh:.0f} km/h"


def _mean_pressure(one: Replay) -> float:
    assert one.record.pressure is not None
    return float(np.nanmean(one.record.pressure))


def _rms(error: np.ndarray, one: Replay, measured: np.ndarray) -> float:
    """Over judged samples that were measured; not finite where a simulation ran away."""
    with np.errstate(all="ignore"):
        return float(np.sqrt(np.mean(np.square(error[one.judged & np.isfinite(measured)]))))


def _bridged(values: np.ndarray) -> np.ndarray:
    """Missing samples filled by straight lines: a spectrum needs them all."""
    known = np.isfinite(values)
    place = np.arange(len(values))
    return np.interp(place, place[known], values[known])


def _spectrum(values: np.ndarray, one: Replay) -> tuple[np.ndarray, np.ndarray]:
    judged = values[one.judged]
    points = min(round(_SEGMENT / one.record.dt), len(judged))
    f, density = welch(
        judged,
        fs=1.0 / one.record.dt,
        nperseg=points,
        noverlap=3 * points // 4,
        nfft=4 * points,
    )
    inside = (f >= 0.999 * _SHOWN[0]) & (f <= 1.001 * _SHOWN[1])
    return f[inside], density[inside]
