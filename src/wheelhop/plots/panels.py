"""Panels of comparisons: grids, colours of filters, one legend, and notes on what is cut off."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from wheelhop.plots.style import ALERT, ESTIMATE

_HUES = (
    (ALERT, "#eb9a7f"),
    (ESTIMATE, "#74b3e0"),
    ("#2e7d32", "#8bc34a"),
    ("#8e24aa", "#ce93d8"),
    ("#ef6c00", "#ffb74d"),
)
_LARGEST = 1e15


def reach(values: np.ndarray) -> float:
    """Largest magnitude of a curve, or of its calmer 95 % where the rest is far beyond them."""
    size = np.abs(values[np.isfinite(values)])
    if not size.size:
        return 0.0
    calm, most = float(np.quantile(size, 0.95)), float(size.max())
    return most if most < 2.0 * calm else 1.2 * calm


def tame(values: Any) -> np.ndarray:
    """The values as floats without infinities, which Matplotlib cannot place."""
    return np.asarray(np.clip(np.asarray(values, float), -_LARGEST, _LARGEST))


def number(value: float) -> str:
    """A figure in a label: whole, with digits where it is small, with an exponent where absurd."""
    if not np.isfinite(value):
        return "?"
    size = abs(value)
    if size >= 1e4:
        return f"{value:.0e}"
    return f"{value:.0f}" if size >= 9.95 or size == 0 else f"{value:.2g}"


def note_cut(
    ax: Any, curves: Mapping[str, np.ndarray], limits: tuple[float, float], unit: str
) -> None:
    """Write into a panel what of its curves lies beyond its limits, or is not a number.

    Args:
        ax: the panel.
        curves: by name, in the axis's unit, of any shape; a nameless one is not named.
        limits: of the axis.
        unit: of the axis.
    """
    finite = {name: v[np.isfinite(v)] for name, v in curves.items()}
    low = {name: float(v.min()) for name, v in finite.items() if v.size and v.min() < limits[0]}
    high = {name: float(v.max()) for name, v in finite.items() if v.size and v.max() > limits[1]}
    ends = [f"down to {number(min(low.values()))}"] if low else []
    ends += [f"up to {number(max(high.values()))}"] if high else []
    names = "; ".join(name for name in curves if name in low or name in high)
    lines = [f"cut off: {names}".rstrip(": "), f"({' and '.join(ends)} {unit})"] if ends else []
    unknown = [name for name, v in curves.items() if not np.isfinite(v).all()]
    lines += [f"not a number in places: {'; '.join(unknown)}".rstrip(": ")] if unknown else []
    if lines:
        ax.text(
            0.015,
            0.97 if high and not low else 0.03,
            "\n".join(lines),
            transform=ax.transAxes,
            fontsize=7,
            color=ALERT,
            va="top" if high and not low else "bottom",
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.6, "pad": 1.0},
            gid="cut",
            zorder=10,
        )


def filter_colours(names: Iterable[str]) -> dict[str, str]:
    """A colour for each filter; names alike up to a comma share a hue, dark and then light."""
    families: dict[str, list[str]] = {}
    for name in names:
        families.setdefault(name.split(",")[0], []).append(name)
    return {
        name: _HUES[k % len(_HUES)][min(i, 1)]
        for k, family in enumerate(families.values())
        for i, name in enumerate(family)
    }


def panel_grid(
    rows: int, columns: int, width: float = 9.0, height: float = 2.3, **options: Any
) -> tuple[Figure, np.ndarray]:
    """A figure and its panels [rows, columns], without any global Matplotlib state.

    Args:
        rows, columns: number of panels.
        width, height: inches; of the figure, and of a row.
        **options: for `Figure.subplots`.
    """
    figure = Figure(figsize=(width, rows * height + 0.8), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, **options)
    for ax in axes.flat:
        plain(ax)
    return figure, axes


def plain(ax: Any) -> None:
    """The look of every panel: a faint grid, no frame above and on the right."""
    ax.grid(True, alpha=0.25, linewidth=0.6)
    ax.spines[["top", "right"]].set_visible(False)


def legend_entries(axes: Iterable[Any]) -> tuple[list[Any], list[str]]:
    """Handles and labels of panels, each label once."""
    found: dict[str, Any] = {}
    for ax in axes:
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            found.setdefault(label, handle)
    return list(found.values()), list(found)


def legend_below(figure: Figure, axes: Iterable[Any], columns: int) -> None:
    """One legend for several panels, below them where it hides nothing."""
    options: dict[str, Any] = {"loc": "outside lower left", "fontsize": 8, "frameon": False}
    figure.legend(*legend_entries(axes), ncols=columns, **options)
