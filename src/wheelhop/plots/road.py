"""Figure of a road: elevation and spectrum against the ISO 8608 classes."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from wheelhop.plots.style import ALERT, CLASS_COLOURS, ESTIMATE, MUTED, legend, new_figure
from wheelhop.vehicle.road import (
    CLASSES,
    Profile,
    RoadFit,
    Spectrum,
    class_level,
    displacement_psd_cycles,
)


def plot_road(profile: Profile, spectrum: Spectrum, fit: RoadFit | None, title: str = "") -> Figure:
    """Elevation over distance, and the PSD between the class lines with its fitted line.

    Args:
        profile: the road.
        spectrum: its displacement PSD.
        fit: level and waviness fitted to it, or None where the road is too short.
        title: headline of the figure.
    """
    figure, (top, bottom) = new_figure(2, height=3.4, height_ratios=[1, 1.8])
    small = np.ptp(profile.elevation) < 0.5
    top.plot(
        profile.distance,
        profile.elevation * (1e3 if small else 1.0),
        color=ESTIMATE,
        linewidth=0.8,
    )
    top.set_xlabel("distance [m]")
    top.set_ylabel("elevation [mm]" if small else "elevation [m]")
    top.set_title(title or "Road profile", loc="left", fontsize=11)

    n = np.array([spectrum.frequency[0], spectrum.frequency[-1]])
    for name in CLASSES:
        lower = displacement_psd_cycles(n, 0.5 * class_level(name))
        upper = displacement_psd_cycles(n, 2.0 * class_level(name))
        bottom.fill_between(n, lower, upper, color=CLASS_COLOURS[name], alpha=0.16, linewidth=0)
        place = n[1] / (n[1] / n[0]) ** 0.03
        bottom.text(
            place,
            displacement_psd_cycles(place, class_level(name)),
            name,
            ha="center",
            va="center",
            color=CLASS_COLOURS[name],
            fontweight="bold",
            clip_on=True,
        )
    bottom.loglog(spectrum.frequency, spectrum.density, color=MUTED, linewidth=0.7, label="PSD")
    low_limit, high_limit = spectrum.density.min(), spectrum.density.max()
    if fit is not None:
        bottom.loglog(
            fit.frequency, fit.density, "o", color=ESTIMATE, markersize=4, label="third octaves"
        )
        line = displacement_psd_cycles(np.asarray(fit.band), fit.level, fit.waviness)
        bottom.loglog(
            fit.band, line, color=ALERT, linewidth=2, label=f"fit, waviness {fit.waviness:.2f}"
        )
        low_limit = min(low_limit, line.min())
    bottom.set_xlim(*n)
    bottom.set_ylim(max(0.3 * low_limit, 1e-7 * high_limit), 5 * high_limit)
    bottom.set_xlabel("spatial frequency [cycles/m]")
    bottom.set_ylabel("displacement PSD [m³]")
    legend(bottom, loc="lower left")
    return figure
