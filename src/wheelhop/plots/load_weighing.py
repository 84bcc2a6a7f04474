"""Errors of mass and centre of mass from deflections at rest."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from wheelhop.plots.panels import panel_grid
from wheelhop.plots.style import ALERT, ESTIMATE, legend

_LABELS = ("error of mass [%]", "error of $l_F$ [mm]", "error of height [mm]")
_COLOURS = (ESTIMATE, ALERT)


def plot_weighing(
    stands: Sequence[str], errors: Mapping[str, np.ndarray], told: Mapping[str, np.ndarray]
) -> Figure:
    """Errors of total mass, distance to the front axle and height, by stand and method.

    Args:
        stands: names.
        errors: by method, [stands, 3]: relative mass [%], l_F [mm], h [mm].
        told: by method, whether the stands tell the height, [stands]; else its bar is hollow.
    """
    figure, panels = panel_grid(1, 3, width=10.0, height=3.0, sharey=True)
    places = np.arange(len(stands))[::-1]
    for column, (ax, label) in enumerate(zip(np.ravel(panels), _LABELS, strict=True)):
        for k, (method, values) in enumerate(errors.items()):
            hollow = column == 2
            faces = [
                _COLOURS[k] if not hollow or known else "none" for known in told[method].tolist()
            ]
            ax.barh(
                places + 0.18 - 0.36 * k,
                values[:, column],
                0.32,
                color=faces,
                edgecolor=_COLOURS[k],
                label=method,
            )
        ax.axvline(0.0, color="#111111", linewidth=0.8)
        ax.set_xlabel(label)
        ax.set_yticks(places, stands)
    np.ravel(panels)[2].set_title(
        "hollow: kept at its prior, not told", loc="left", fontsize=8, color="#7f8c8d"
    )
    legend(np.ravel(panels)[0])
    return figure
