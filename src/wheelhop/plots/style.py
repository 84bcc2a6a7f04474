"""One look for every figure: colours by meaning, units on every axis."""

from __future__ import annotations

from typing import Any

from matplotlib.figure import Figure

ESTIMATE = "#1f5fa8"
TRUTH = "#111111"
BAND = "#9dc3e6"
ALERT = "#c0392b"
MUTED = "#7f8c8d"

CLASS_COLOURS = {
    "A": "#2e7d32",
    "B": "#8bc34a",
    "C": "#fbc02d",
    "D": "#ef6c00",
    "E": "#c62828",
    "F": "#8e24aa",
    "G": "#4527a0",
    "H": "#212121",
}

CORNER_COLOURS = {"FL": "#1f5fa8", "FR": "#c0392b", "RL": "#74b3e0", "RR": "#eb9a7f"}
"""Left is blue, right is red, rear is lighter."""


def new_figure(rows: int, width: float = 8.0, height: float = 2.6, **options: Any) -> tuple:
    """A figure of stacked panels, without any global Matplotlib state.

    Args:
        rows: number of panels.
        width, height: inches, the height per panel.
        **options: for `Figure.subplots`.

    Returns:
        The figure and a list of its axes.
    """
    figure = Figure(figsize=(width, rows * height), layout="constrained")
    axes = figure.subplots(rows, 1, squeeze=False, **options)[:, 0]
    for ax in axes:
        ax.grid(True, alpha=0.25, linewidth=0.6)
        ax.spines[["top", "right"]].set_visible(False)
    return figure, list(axes)


def legend(ax: Any, **options: Any) -> None:
    """A small legend that does not hide the data."""
    ax.legend(fontsize=8, framealpha=0.85, **options)
