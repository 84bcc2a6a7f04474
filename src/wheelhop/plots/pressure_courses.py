"""Pressure over time beside the truth, as Brancati & Tufano 2022 draw it in Fig. 7-11 and 13."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from wheelhop.errors import InputError
from wheelhop.evaluation.courses import WINDOW, Course
from wheelhop.plots.panels import (
    filter_colours,
    legend_below,
    legend_entries,
    note_cut,
    number,
    panel_grid,
    tame,
)
from wheelhop.plots.pressure_axes import (
    ERROR_LABEL,
    SETTLING,
    TOLERATED_KPA,
    TOLERATED_LABEL,
    all_curves,
    error_limits,
    late,
    pressure_limits,
    titled,
    within,
)
from wheelhop.plots.style import ALERT, BAND, CLASS_COLOURS, ESTIMATE, MUTED, TRUTH

_ROWS = ("pressure", "error")
_REPEATED = "10 to 90 % of repetitions"


def plot_modes(
    t: np.ndarray,
    truth: np.ndarray,
    courses: Mapping[str, Course],
    event: tuple[float, str] | None = None,
    title: str = "",
    prior: float | None = 180e3,
) -> Figure:
    """Estimate, estimates of the modes and their probabilities; a column for each filter.

    Args:
        t: time [s], [time].
        truth: true pressure [Pa], [time].
        courses: of the filters by name.
        event: time [s] of a change, and what changes.
        title: headline of the figure.
        prior: constant pressure that a filter must beat [Pa].

    Raises:
        InputError: without a course.
    """
    _require(courses)
    true = tame(truth) / 1e3
    columns = len(courses)
    width = max(9.0, 3.2 * columns)
    figure, axes = panel_grid(3, columns, width, 2.2, sharex=True, sharey="row")
    tops = {name: _top_curves(course) for name, course in courses.items()}
    modes = {name: _mode_curves(course) for name, course in courses.items()}
    first = pressure_limits(all_curves(tops), _kept(true, prior))
    second = pressure_limits(all_curves(modes), _kept(true, prior))
    for (top, middle, bottom), (name, course) in zip(axes.T, courses.items(), strict=True):
        shown = {label: within(values, first) for label, values in tops[name].items()}
        top.fill_between(
            t, *shown["repetitions"], color=MUTED, alpha=0.3, linewidth=0, label=_REPEATED
        )
        top.fill_between(
            t, *shown["sigma"], color=BAND, alpha=0.75, linewidth=0, label="stated sigma"
        )
        top.plot(t, shown["estimate"], color=ESTIMATE, linewidth=1.3, label="estimate")
        note_cut(top, tops[name], first, "kPa")
        for mode, values in modes[name].items():
            look = {"color": _mode_colour(mode), "label": _mode_label(mode)}
            middle.plot(t, within(values, second), linewidth=1.3, **look)
        note_cut(middle, {_mode_label(m): v for m, v in modes[name].items()}, second, "kPa")
        for ax in (top, middle):
            _references(ax, t, true, prior)
        share = np.nan_to_num(np.clip(course.probabilities, 0.0, 1.0)).T
        colours = [_mode_colour(mode) for mode in course.modes]
        labels = [_mode_label(mode) for mode in course.modes]
        bottom.stackplot(t, *share, colors=colours, labels=labels, alpha=0.85, linewidth=0)
        bottom.set_xlabel("time [s]")
        top.set_title(name, loc="left", fontsize=9)
        _mark(event, (top, middle, bottom))
    axes[0, 0].set_ylim(first)
    axes[1, 0].set_ylim(second)
    axes[2, 0].set_ylim(0, 1)
    axes[0, 0].set_xlim(0, t[-1])
    axes[0, 0].set_ylabel("tyre pressure [kPa]")
    axes[1, 0].set_ylabel(f"of each mode [kPa]\n(mean over {WINDOW:g} s)")
    axes[2, 0].set_ylabel(f"mode probability [-]\n(mean over {WINDOW:g} s)")
    for row in axes:
        _legend_beside(row)
    return titled(figure, title or "Tyre pressure, and how the modes share in it")


def plot_tracking(
    t: np.ndarray,
    truth: np.ndarray,
    courses: Mapping[str, Course],
    rows: Sequence[str] = _ROWS,
    title: str = "",
    *,
    event: tuple[float, str] | None = None,
    prior: float | None = 180e3,
) -> Figure:
    """Estimates of all filters in one panel, and their errors in another.

    Args:
        t: time [s], [time].
        truth: true pressure [Pa], [time].
        courses: of the filters by name.
        rows: panels from top to bottom, of "pressure" and "error".
        title: headline of the figure.
        event: time [s] of a change, and what changes.
        prior: constant pressure that a filter must beat [Pa].

    Raises:
        InputError: without a course, or for rows that are unknown.
    """
    _require(courses)
    if not rows or any(row not in _ROWS for row in rows):
        raise InputError("rows", f"{tuple(rows)!r}", f"Use some of {_ROWS}.")
    figure, axes = panel_grid(len(rows), 1, height=2.8, sharex=True)
    colours = filter_colours(courses)
    true = tame(truth) / 1e3
    lines = {name: tame(course.pressure) / 1e3 for name, course in courses.items()}
    errors = {name: line - true for name, line in lines.items()}
    for ax, row in zip(axes[:, 0], rows, strict=True):
        if row == "pressure":
            limits = pressure_limits(lines.values(), _kept(true, prior))
            shift = np.zeros_like(true)
        else:
            limits = error_limits(errors.values())
            shift = true
        for name, course in courses.items():
            low, high = (within(tame(q) / 1e3 - shift, limits) for q in (course.low, course.high))
            ax.fill_between(t, low, high, color=colours[name], alpha=0.13, linewidth=0)
        drawn = lines if row == "pressure" else errors
        for name, values in drawn.items():
            label = f"{name}: {number(_rms(t, errors[name]))} kPa rms after {SETTLING:g} s"
            ax.plot(t, within(values, limits), color=colours[name], linewidth=1.3, label=label)
        if row == "pressure":
            _references(ax, t, true, prior)
        else:
            _error_references(ax, t, true, prior)
        ax.set_ylim(limits)
        ax.set_ylabel("tyre pressure [kPa]" if row == "pressure" else ERROR_LABEL)
        note_cut(ax, drawn, limits, "kPa")
    axes[0, 0].set_xlim(0, t[-1])
    _mark(event, axes[:, 0])
    axes[-1, 0].set_xlabel("time [s]")
    axes[0, 0].fill_between(
        [], [], color=MUTED, alpha=0.3, linewidth=0, label=_REPEATED + ", in each colour"
    )
    legend_below(figure, axes.flat, 2)
    return titled(figure, title or "Tyre pressure by all filters")


def _require(courses: Mapping[str, Course]) -> None:
    if not courses:
        raise InputError("courses", "there are none", "Give at least one filter.")


def _top_curves(course: Course) -> dict[str, np.ndarray]:
    """What the panel of the estimate shows [kPa], by name."""
    pressure, sigma = tame(course.pressure) / 1e3, tame(course.sigma) / 1e3
    return {
        "estimate": pressure,
        "sigma": np.stack([pressure - sigma, pressure + sigma]),
        "repetitions": np.stack([tame(course.low), tame(course.high)]) / 1e3,
    }


def _mode_curves(course: Course) -> dict[str, np.ndarray]:
    """Moving average of each mode's estimate [kPa], by name of the mode."""
    return dict(zip(course.modes, (tame(course.mode_pressure) / 1e3).T, strict=True))


def _kept(true: np.ndarray, prior: float | None) -> list[np.ndarray]:
    return [true] if prior is None else [true, np.array([prior / 1e3])]


def _references(ax: Any, t: np.ndarray, true: np.ndarray, prior: float | None) -> None:
    ax.plot(t, true, color=TRUTH, linestyle="--", linewidth=1.3, label="true")
    if prior is not None:
        ax.axhline(prior / 1e3, color=MUTED, linestyle=":", linewidth=1.3, label="prior, constant")


def _error_references(ax: Any, t: np.ndarray, true: np.ndarray, prior: float | None) -> None:
    ax.axhspan(
        -TOLERATED_KPA, TOLERATED_KPA, color=MUTED, alpha=0.2, linewidth=0, label=TOLERATED_LABEL
    )
    ax.axhline(0, color=TRUTH, linestyle="--", linewidth=1.0)
    if prior is not None:
        ax.plot(t, prior / 1e3 - true, color=MUTED, linestyle=":", linewidth=1.3)


def _rms(t: np.ndarray, error: np.ndarray) -> float:
    kept = late(t, error)
    return float(np.sqrt(np.mean(kept**2))) if kept.size else float("nan")


def _mark(event: tuple[float, str] | None, axes: Iterable[Any]) -> None:
    """A line at the time of a change through all panels, named in the first."""
    if event is None:
        return
    when, what = event
    for k, ax in enumerate(axes):
        ax.axvline(when, color=ALERT, linestyle="-.", linewidth=1.0)
        if k == 0:
            ax.annotate(
                what,
                (when, 1.0),
                (4, -3),
                xycoords=("data", "axes fraction"),
                textcoords="offset points",
                va="top",
                fontsize=8,
                color=ALERT,
            )


def _mode_colour(mode: str) -> str:
    return CLASS_COLOURS.get(mode, MUTED)


def _mode_label(mode: str) -> str:
    return f"class {mode}" if mode in CLASS_COLOURS else mode


def _legend_beside(row: np.ndarray) -> None:
    """What any panel of a row shows, to the right of it where it hides nothing."""
    row[-1].legend(*legend_entries(row), loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8)
