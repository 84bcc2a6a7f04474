"""Singular values of the Youla observer's design, and what its bandwidth costs at wheel hop."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from wheelhop.plots.panels import panel_grid
from wheelhop.plots.style import ALERT, ESTIMATE, MUTED, legend, new_figure

_PANELS = (
    ("Closed loop", ("closed", "sensitivity", "loop"), "singular values [-]"),
    ("From measurement to load", ("youla", "controller"), "singular values [SI]"),
    ("From load to measurement", ("plant",), "singular values [SI]"),
)
_WORDS = {
    "closed": ("$T_u$, estimate per load", ESTIMATE),
    "sensitivity": ("$S_u$, error per load", ALERT),
    "loop": ("$L_u$, return ratio", MUTED),
    "youla": ("$Y$, noise to estimate", ESTIMATE),
    "controller": ("$G_c$, controller", ALERT),
    "plant": ("$G_p$, corner", ESTIMATE),
}


def plot_singular_values(
    frequency: np.ndarray, values: Mapping[str, np.ndarray], bandwidth: float, hop: float
) -> Figure:
    """Fig. 4 of Filipozzi et al. 2021: singular values of every transfer matrix.

    Args:
        frequency: [Hz], [frequencies].
        values: by name, as the fields of `LoopTransfers`, [frequencies, 2].
        bandwidth: of the design [Hz].
        hop: frequency of wheel hop [Hz].
    """
    figure, panels = panel_grid(1, 3, width=11.0, height=3.8)
    for ax, (title, names, label) in zip(np.ravel(panels), _PANELS, strict=True):
        for name in names:
            word, colour = _WORDS[name]
            ax.loglog(frequency, values[name][:, 0], color=colour, label=word)
            ax.loglog(frequency, values[name][:, 1], color=colour, linestyle="--", linewidth=1.0)
        for at, text in ((bandwidth, "bandwidth"), (hop, "wheel hop")):
            ax.axvline(at, color=MUTED, linewidth=0.8, linestyle=":")
            ax.text(
                at, 0.99, f" {text}", transform=ax.get_xaxis_transform(), fontsize=7, rotation=90,
                va="top", ha="right", color=MUTED,
            )  # fmt: skip
        ax.set_title(title, loc="left", fontsize=9)
        ax.set_xlabel("frequency [Hz]")
        ax.set_ylabel(label)
        ax.set_xlim(frequency[0], frequency[-1])
        legend(ax, loc="lower left")
    return figure


def plot_hop_error(bandwidths: np.ndarray, error: np.ndarray, chosen: float, hop: float) -> Figure:
    """Error of a load that swings at wheel hop, over the design's bandwidth.

    Args:
        bandwidths: of designs [Hz], [designs].
        error: |1 - M_T| at `hop` [-], [designs].
        chosen: bandwidth of the paper [Hz].
        hop: frequency of wheel hop [Hz].
    """
    figure, (ax,) = new_figure(1, height=3.2)
    ax.semilogx(bandwidths, 100.0 * error, color=ESTIMATE)
    at = float(np.interp(chosen, bandwidths, error))
    ax.plot(chosen, 100.0 * at, "o", color=ALERT)
    ax.annotate(
        f"{chosen:g} Hz, the paper's: {100.0 * at:.0f} %",
        (chosen, 100.0 * at),
        textcoords="offset points",
        xytext=(8, 6),
        color=ALERT,
        fontsize=9,
    )
    ax.set_ylim(0.0, None)
    ax.set_xlabel("bandwidth of the design [Hz]")
    ax.set_ylabel("error of the load's swing [%]")
    ticks = [t for t in (10, 20, 30, 50, 100, 200, 400) if bandwidths[0] <= t <= bandwidths[-1]]
    ax.set_xticks(ticks, [str(t) for t in ticks])
    ax.minorticks_off()
    ax.set_title(
        f"Error of a load that swings at {hop:g} Hz, in size and phase",
        loc="left", fontsize=10,
    )  # fmt: skip
    return figure
