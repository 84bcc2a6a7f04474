"""Figure of relative gains: which tyre load compresses which suspension."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from wheelhop.errors import InputError
from wheelhop.plots.style import TRUTH

_CORNERS = ("FL", "FR", "RL", "RR")
_COLUMNS = 3


def plot_load_coupling(arrays: Mapping[str, np.ndarray], title: str = "") -> Figure:
    """Relative gain arrays as heat maps with their numbers in the cells, three in a row.

    Args:
        arrays: relative gains [-] by headline, [4, 4] each: compressions down, tyre loads across.
        title: headline of the figure.

    Raises:
        InputError: if there is none, or one is not [4, 4].
    """
    if not arrays:
        raise InputError("arrays", "there is none", "Give one or more.")
    for name, gains in arrays.items():
        if np.shape(gains) != (4, 4):
            raise InputError("arrays", f"{name!r} is {np.shape(gains)}", "Give [4, 4].")
    columns = min(_COLUMNS, len(arrays))
    rows = -(-len(arrays) // columns)
    figure = Figure(figsize=(2.95 * columns + 0.5, 3.05 * rows + 0.4), layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False)
    for ax in grid.ravel()[len(arrays) :]:
        ax.set_visible(False)
    image = None
    for ax, (name, gains) in zip(grid.ravel(), arrays.items(), strict=False):
        # coupling is what is off the identity, so that is what the colour shows
        image = ax.imshow(gains - np.eye(4), cmap="RdBu_r", vmin=-0.35, vmax=0.35)
        for (row, column), gain in np.ndenumerate(gains):
            strong = abs(gain - (row == column)) > 0.18
            ax.text(
                column,
                row,
                f"{round(gain, 3) + 0.0:.3f}".replace("-", "\N{MINUS SIGN}"),
                ha="center",
                va="center",
                fontsize=8.5,
                color="white" if strong else TRUTH,
            )
        ax.set_xticks(range(4), _CORNERS)
        ax.set_yticks(range(4), _CORNERS)
        ax.axhline(1.5, color=TRUTH, linewidth=0.8)
        ax.axvline(1.5, color=TRUTH, linewidth=0.8)
        ax.tick_params(which="both", length=0, labelsize=8)
        ax.spines[:].set_visible(False)
        ax.set_title(name, loc="left", fontsize=9)
    for ax in grid[:, 0]:
        ax.set_ylabel("compression", fontsize=9)
    for ax in grid[-1]:
        ax.set_xlabel("tyre load", fontsize=9)
    if image is not None:
        bar = figure.colorbar(image, ax=grid, shrink=0.7, pad=0.01, aspect=30)
        bar.set_label("relative gain less that of uncoupled wheels [-]", fontsize=8)
        bar.ax.tick_params(labelsize=8)
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    return figure
