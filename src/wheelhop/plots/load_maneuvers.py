"""Figures of wheel loads in maneuvers: estimates beside the truth, and what is left of errors."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from wheelhop.errors import InputError
from wheelhop.plots.panels import legend_below, note_cut, panel_grid, plain
from wheelhop.plots.style import ALERT, ESTIMATE, MUTED, TRUTH

_CORNERS = ("FL", "FR", "RL", "RR")
_STYLES = {
    "Youla": (ESTIMATE, "-"),
    "unbiased": ("#ef6c00", (0, (4, 2))),
    "algebraic": (ALERT, "-"),
    "joint": ("#2e7d32", "-"),
    "half car": ("#8e24aa", (0, (5, 1, 1, 1))),
    "derivative filters": ("#b8860b", (0, (2, 1))),
}
_MOST = 5


def plot_load_maneuver(
    t: Any,
    truth: Any,
    loads: Mapping[str, Any],
    title: str = "",
    corners: Sequence[int] = (0, 2),
    start: float = 0.2,
    close: float = 0.05,
    road: Any = None,
) -> Figure:
    """Wheel loads, the uninitialised start enlarged, errors, and the road below where it is given.

    Args:
        t: [s], [time].
        truth: loads [N], [time, 4].
        loads: estimates [N] by name, [time, 4] each, one to five; NaN where there is none.
        title: headline of the figure.
        corners: to show, numbers of FL, FR, RL, RR.
        start: length of the enlarged start [s], where errors are on a logarithmic scale; after
            it they are scaled for all methods but the worst.
        close: error, per the first load, that is marked in the start [-].
        road: elevation under the corners [m], [time, 4].

    Raises:
        InputError: if there is no estimate, more than five, or one has another shape.
    """
    t, truth = np.asarray(t), np.asarray(truth)
    _require(t, truth, loads)
    rows = 2 * len(corners) + (road is not None)
    figure, axes = panel_grid(rows, 2, height=1.75, width_ratios=(4.2, 1.0))
    early, late = t <= start, t > start
    for row, corner in enumerate(corners):
        place = _CORNERS[corner]
        _loads(axes[row], t, truth[:, corner], {n: a[:, corner] for n, a in loads.items()}, early)
        axes[row, 0].set_ylabel(f"load {place} [kN]")
        errors = {n: np.asarray(a)[:, corner] - truth[:, corner] for n, a in loads.items()}
        below = axes[len(corners) + row]
        _errors(below, t, errors, late)
        below[1].axhline(close * truth[0, corner], color=TRUTH, lw=0.8, linestyle=":")
        below[0].set_ylabel(f"error {place} [N]")
    if road is not None:
        for corner, dash in zip(corners, ("-", "--", "-.", ":"), strict=False):
            label = f"road under {_CORNERS[corner]}"
            axes[-1, 0].plot(t, np.asarray(road)[:, corner], dash, color=MUTED, lw=1, label=label)
        axes[-1, 0].set_ylabel("road [m]")
        axes[-1, 1].set_visible(False)
        axes[-2, 1].set_xlabel("time [s]")
    for wide, near in axes:
        wide.set_xlim(0.0, t[-1])
        near.set_xlim(0.0, start)
    for ax in axes[-1]:
        ax.set_xlabel("time [s]")
    axes[0, 0].set_title(title, loc="left", fontsize=11)
    axes[0, 1].set_title(f"the first {start:g} s", loc="left", fontsize=9)
    legend_below(figure, axes[:, 0], 8)
    return figure


def plot_load_errors(
    errors: Mapping[str, Mapping[str, float]], change: Mapping[str, float], title: str = ""
) -> Figure:
    """Rms errors as a heat map, coloured by their part of the load's own change.

    Args:
        errors: rms error [N] by drive (across) and method (down); every drive has the same methods.
        change: rms of the load's own change [N] by drive.
        title: headline of the figure.

    Raises:
        InputError: if there is no drive, or methods or changes are missing.
    """
    if not errors:
        raise InputError("errors", "there is none", "Give one drive or more.")
    methods = list(next(iter(errors.values())))
    for drive, found in errors.items():
        if list(found) != methods or drive not in change:
            raise InputError("errors", f"{drive!r} lacks entries", "Give every drive the same.")
    value = np.array([[found[m] for found in errors.values()] for m in methods])
    share = value / np.array([change[d] for d in errors])
    figure = Figure(figsize=(9.0, 0.42 * len(methods) + 1.75), layout="constrained")
    ax = figure.subplots()
    image = ax.imshow(
        np.log10(np.clip(share, 1e-3, 10.0)), cmap="RdYlGn_r", vmin=-2.0, vmax=0.3, aspect="auto"
    )
    for (row, column), newton in np.ndenumerate(value):
        ax.text(column, row, f"{newton:.0f}", ha="center", va="center", fontsize=9)
    heads = [f"{textwrap.fill(d, 12)}\n({change[d]:.0f} N)" for d in errors]
    ax.set_xticks(range(len(errors)), heads, fontsize=8)
    ax.set_yticks(range(len(methods)), methods, fontsize=9)
    ax.xaxis.tick_top()
    ax.tick_params(length=0)
    ax.spines[:].set_visible(False)
    bar = figure.colorbar(image, ax=ax, pad=0.01, aspect=12)
    ticks = (0.01, 0.03, 0.1, 0.3, 1.0)
    bar.set_ticks(np.log10(ticks).tolist(), labels=[f"{100 * s:g} %" for s in ticks])
    bar.ax.tick_params(labelsize=8)
    bar.set_label("of the load's own change", fontsize=8)
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    return figure


def plot_load_delay(
    t: Any,
    truth: Any,
    loads: Mapping[str, Any],
    shift: Any,
    errors: Mapping[str, Any],
    title: str = "",
    corner: int = 0,
) -> Figure:
    """A stretch of one wheel's load, and the rms error as the estimate is moved ahead in time.

    Args:
        t: of the stretch [s], [time].
        truth: loads [N], [time, 4].
        loads: estimates [N] by name, [time, 4], one to five.
        shift: by which the estimates are moved ahead [s], [shifts].
        errors: rms error at each shift [N] by the names of `loads`, [shifts] each.
        title: headline of the figure.
        corner: to show.

    Raises:
        InputError: if there is no estimate, more than five, or one has another shape.
    """
    t, truth = np.asarray(t), np.asarray(truth)
    _require(t, truth, loads)
    figure, axes = panel_grid(1, 2, height=3.0, width_ratios=(2.2, 1.0))
    left, right = axes[0]
    left.plot(t, truth[:, corner] / 1e3, color=TRUTH, lw=2.0, label="true")
    for name, (colour, dash) in _styles(loads).items():
        curve = np.asarray(loads[name])[:, corner] / 1e3
        left.plot(t, curve, color=colour, linestyle=dash, lw=1.2, label=name)
        right.plot(1e3 * np.asarray(shift), errors[name], color=colour, linestyle=dash, lw=1.4)
    left.set_xlabel("time [s]")
    left.set_ylabel(f"load {_CORNERS[corner]} [kN]")
    left.set_xlim(t[0], t[-1])
    right.set_xlabel("moved ahead by [ms]")
    right.set_ylabel("rms error [N]")
    right.set_ylim(bottom=0.0)
    left.set_title(title, loc="left", fontsize=11)
    legend_below(figure, [left], 5)
    return figure


def plot_load_amplitude(
    frequency: Any, road: Any, amplitudes: Mapping[str, Any], natural: float, title: str = ""
) -> Figure:
    """Amplitude of a load, and per amplitude of the road, by the frequency of a sine sweep.

    Args:
        frequency: of every wave [Hz], [waves].
        road: its amplitude [m], [waves].
        amplitudes: of the load [N] by name, the truth first, [waves] each.
        natural: frequency of the body on its springs [Hz].
        title: headline of the figure.

    Raises:
        InputError: if there is no amplitude, or more than six.
    """
    if not 1 <= len(amplitudes) <= 1 + _MOST:
        raise InputError("amplitudes", f"there are {len(amplitudes)}", "Give one to six.")
    figure, axes = panel_grid(1, 2, height=2.9)
    styles = {next(iter(amplitudes)): (TRUTH, "-")} | _styles(list(amplitudes)[1:])
    for name, (colour, dash) in styles.items():
        values, width = amplitudes[name], 2.4 if colour == TRUTH else 1.3
        options: dict[str, Any] = {"color": colour, "linestyle": dash, "lw": width, "label": name}
        axes[0, 0].plot(frequency, values, **options)
        axes[0, 1].plot(frequency, 1e-3 * np.asarray(values) / np.asarray(road), **options)
    for ax in axes[0]:
        ax.axvline(natural, color=MUTED, lw=1.0, linestyle=":", label="body on its springs")
        ax.set_xlabel("frequency of the road [Hz]")
        ax.set_ylim(bottom=0.0)
    axes[0, 0].set_ylabel("amplitude of the load [N]")
    axes[0, 1].set_ylabel("per amplitude of the road [N/mm]")
    axes[0, 0].set_title(title, loc="left", fontsize=11)
    legend_below(figure, axes[0], 5)
    return figure


def plot_load_sum(curves: Mapping[str, tuple[Any, Any, Any]], title: str = "") -> Figure:
    """Error of the sum of four loads beside what explains it, one panel a drive.

    Args:
        curves: by drive: time [s], error [N] and what is computed for it [N], [time] each.
        title: headline of the figure.

    Raises:
        InputError: if there is none.
    """
    if not curves:
        raise InputError("curves", "there is none", "Give one drive or more.")
    figure, axes = panel_grid(1, len(curves), height=2.5)
    for ax, (name, (t, error, expected)) in zip(axes[0], curves.items(), strict=True):
        ax.plot(t, error, color=ESTIMATE, lw=2.0, label="error of the sum of the loads")
        ax.plot(t, expected, color=ALERT, lw=1.2, linestyle="--", label="computed from the tilt")
        ax.set_title(name, loc="left", fontsize=9)
        ax.set_xlabel("time [s]")
        ax.tick_params(labelsize=8)
    axes[0, 0].set_ylabel("error [N]")
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    legend_below(figure, axes[0], 2)
    return figure


def _loads(
    panels: Any, t: np.ndarray, truth: np.ndarray, found: Mapping[str, np.ndarray], early: Any
) -> None:
    """One corner's loads in kN, in whole and at the start, on the scale of the true load."""
    for ax, part in zip(panels, (t >= 0.0, early), strict=True):
        plain(ax)
        ax.plot(t[part], truth[part] / 1e3, color=TRUTH, lw=2.4, label="true")
        for name, (colour, dash) in _styles(found).items():
            curve = found[name][part] / 1e3
            ax.plot(t[part], curve, color=colour, linestyle=dash, lw=1.2, label=name)
    low, high = float(truth.min()) / 1e3, float(truth.max()) / 1e3
    room = 0.25 * (high - low) + 0.2
    for ax in panels:
        ax.set_ylim(low - room, high + room)


def _errors(panels: Any, t: np.ndarray, errors: Mapping[str, np.ndarray], late: Any) -> None:
    """One corner's errors: on a scale for all methods but the worst, and at the start."""
    wide, near = panels
    size = {name: float(np.nanmax(np.abs(off[late]))) for name, off in errors.items()}
    ranked = sorted(size, key=lambda name: -size[name])
    for name, (colour, dash) in _styles(errors).items():
        options: dict[str, Any] = {"color": colour, "linestyle": dash, "lw": 1.2, "label": name}
        # the worst lies below, so that it hides none of the others
        options["zorder"] = 2.0 + 0.1 * ranked.index(name)
        wide.plot(t[late], errors[name][late], **options)
        near.semilogy(t[~late], np.maximum(np.abs(errors[name][~late]), 1e-3), **options)
    wide.axhline(0.0, color=TRUTH, lw=0.6)
    limit = 1.4 * size[ranked[min(1, len(ranked) - 1)]] + 1.0
    wide.set_ylim(-limit, limit)
    inside = {name: off[late] for name, off in errors.items()}
    note_cut(wide, {n: off[np.isfinite(off)] for n, off in inside.items()}, (-limit, limit), "N")
    near.set_ylim(bottom=1.0)
    near.set_ylabel("magnitude [N]", fontsize=8)


def _styles(names: Iterable[str]) -> dict[str, tuple[str, Any]]:
    """Colour and dashes by name: a known method's own, else one that is free."""
    names = list(names)
    free = [style for known, style in _STYLES.items() if known not in names]
    return {name: _STYLES[name] if name in _STYLES else free.pop(0) for name in names}


def _require(t: np.ndarray, truth: np.ndarray, loads: Mapping[str, Any]) -> None:
    if not 1 <= len(loads) <= _MOST:
        raise InputError("loads", f"there are {len(loads)}", f"Give one to {_MOST}.")
    for name, load in {"truth": truth, **loads}.items():
        if np.shape(load) != (len(t), 4):
            raise InputError("loads", f"{name!r} is {np.shape(load)}", f"Give {(len(t), 4)}.")
