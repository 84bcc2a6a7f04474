"""One drive in several cases, as Brancati & Tufano 2022 draw loads in Fig. 11."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from wheelhop.errors import InputError
from wheelhop.evaluation.courses import Course
from wheelhop.plots.panels import legend_below, note_cut, number, panel_grid, tame
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
from wheelhop.plots.style import MUTED, TRUTH

_CASE_COLOURS = ("#74b3e0", "#1f5fa8", "#8e24aa", "#ef6c00", "#2e7d32")

Case = tuple[np.ndarray, Mapping[str, Course]]
"""True pressure [Pa], [time], and the course of each filter by name."""


def plot_cases(t: np.ndarray, cases: Mapping[str, Case], title: str = "") -> Figure:
    """Estimates and errors of each filter in several cases, such as loads; a column a filter.

    Args:
        t: time [s], [time].
        cases: truth and courses by the name of the case; the filters are the same in all.
        title: headline of the figure.

    Raises:
        InputError: without a case or a filter, or if the cases differ in their filters.
    """
    names = [tuple(courses) for _, courses in cases.values()]
    if not names or not names[0] or any(n != names[0] for n in names):
        raise InputError("cases", "they differ in their filters or have none", "Give all the same.")
    columns = len(names[0])
    width = max(9.0, 2.6 * columns)
    figure, axes = panel_grid(2, columns, width, 2.6, sharex=True, sharey="row")
    truths = {case: tame(truth) / 1e3 for case, (truth, _) in cases.items()}
    same = all(np.array_equal(v, next(iter(truths.values()))) for v in truths.values())
    lines = {
        name: {case: tame(c[name].pressure) / 1e3 for case, (_, c) in cases.items()}
        for name in names[0]
    }
    errors = {
        name: {case: line - truths[case] for case, line in by_case.items()}
        for name, by_case in lines.items()
    }
    limits = pressure_limits(all_curves(lines), list(truths.values()))
    bounds = error_limits(all_curves(errors))
    for (top, bottom), name in zip(axes.T, names[0], strict=True):
        bottom.axhspan(
            -TOLERATED_KPA,
            TOLERATED_KPA,
            color=MUTED,
            alpha=0.2,
            linewidth=0,
            label=TOLERATED_LABEL,
        )
        bottom.axhline(0, color=TRUTH, linewidth=0.5)
        for k, (case, true) in enumerate(truths.items()):
            colour = _CASE_COLOURS[k % len(_CASE_COLOURS)]
            if not (same and k):
                look = {"color": TRUTH if same else colour, "linestyle": "--", "linewidth": 1.3}
                top.plot(t, true, label="true" if same else f"true, {case}", **look)
            shown = within(lines[name][case], limits)
            top.plot(t, shown, color=colour, linewidth=1.3, label=case)
            shown = within(errors[name][case], bounds)
            bottom.plot(t, shown, color=colour, linewidth=1.3)
            share = _mean_share(t, errors[name][case], true)
            place = {"transform": bottom.transAxes, "va": "bottom", "weight": "bold"}
            bottom.text(k / len(cases), 1.03, share, color=colour, fontsize=8, **place)
        top.set_title(name, loc="left", fontsize=9)
        bottom.set_title(f"mean error after {SETTLING:g} s:\n ", loc="left", fontsize=8)
        bottom.set_xlabel("time [s]")
        note_cut(top, {"": np.stack(list(lines[name].values()))}, limits, "kPa")
        note_cut(bottom, {"": np.stack(list(errors[name].values()))}, bounds, "kPa")
    axes[0, 0].set_ylim(limits)
    axes[1, 0].set_ylim(bounds)
    axes[0, 0].set_xlim(0, t[-1])
    axes[0, 0].set_ylabel("tyre pressure [kPa]")
    axes[1, 0].set_ylabel(ERROR_LABEL)
    legend_below(figure, axes.flat, 5)
    return titled(figure, title or "Tyre pressure in several cases")


def _mean_share(t: np.ndarray, error: np.ndarray, true: np.ndarray) -> str:
    """Mean error relative to the mean truth, as a signed percentage."""
    kept, base = late(t, error), late(t, true)
    if not (kept.size and base.size):
        return "?"
    share = 100.0 * float(kept.mean() / base.mean())
    return f"{'+' if share >= 0 else ''}{number(share)} %"
