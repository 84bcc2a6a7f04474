"""Figure of the road under four wheels: tracks, their spectra, their coherence."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Array, Float
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from scipy.signal import csd, welch

from wheelhop.errors import InputError
from wheelhop.plots.style import (
    ALERT,
    BAND,
    CLASS_COLOURS,
    ESTIMATE,
    MUTED,
    TRUTH,
    legend,
    new_figure,
)
from wheelhop.vehicle.road import (
    CLASSES,
    Profile,
    class_level,
    displacement_psd_cycles,
    profile_psd,
)
from wheelhop.vehicle.road.isotropic import two_track_coherence

WHEELS = ("front left", "front right", "rear left", "rear right")
_LOOKS: tuple[dict[str, Any], ...] = (
    {"color": ESTIMATE, "linewidth": 1.0},
    {"color": ALERT, "linewidth": 1.0},
    {"color": TRUTH, "linewidth": 0.9, "linestyle": (0, (2, 3))},
    {"color": MUTED, "linewidth": 0.9, "linestyle": (0, (2, 3))},
)
_SEGMENTS = 16
_BANDS_PER_OCTAVE = 12


def plot_surface(
    tracks: Float[Array | np.ndarray, "4 points"],
    spacing: float,
    start: float = 0.0,
    track_width: float = 1.606,
    waviness: float = 2.0,
    title: str = "",
) -> Figure:
    """Elevation of the four tracks, their PSD between the ISO classes, and their coherence.

    Args:
        tracks: elevation under FL, FR, RL, RR [m].
        spacing: of the points [m].
        start: x of the first point [m].
        track_width: distance of the left and right track [m], for the isotropic law.
        waviness: w of that law [-].
        title: headline of the figure.

    Raises:
        InputError: for fewer than 64 points.
    """
    z = np.asarray(tracks, float)
    if z.shape[1] < 64:
        raise InputError("tracks", f"they have {z.shape[1]} points", "Give 64 or more to plot.")
    figure, (top, middle, bottom) = new_figure(3, height=3.0, height_ratios=[1, 1.5, 1])
    _plot_tracks(top, z, start + spacing * np.arange(z.shape[1]))
    top.set_title(title or "Road under four wheels", loc="left", fontsize=11)
    _plot_spectra(middle, z, spacing)
    _plot_coherence(bottom, z, spacing, track_width, waviness)
    return figure


def _plot_tracks(ax: Any, z: np.ndarray, x: np.ndarray) -> None:
    small = np.ptp(z) < 0.5
    for k in _distinct(z):
        ax.plot(x, z[k] * (1e3 if small else 1.0), label=_name(z, k), **_LOOKS[k])
    ax.set_xlim(x[0], x[-1])
    ax.set_xlabel("distance [m]")
    ax.set_ylabel("elevation [mm]" if small else "elevation [m]")
    legend(ax, ncols=4, loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2)


def _plot_spectra(ax: Any, z: np.ndarray, spacing: float) -> None:
    ax.set_xlabel("spatial frequency [cycles/m]")
    ax.set_ylabel("displacement PSD [m³]")
    rough = [k for k in _distinct(z) if np.ptp(z[k]) > 0]
    if not rough:
        ax.text(0.5, 0.5, "flat road", transform=ax.transAxes, ha="center", color=MUTED)
        return
    segment = min(100.0, 0.5 * spacing * z.shape[1])
    peak, least = 0.0, np.inf
    for k in rough:
        spectrum = profile_psd(Profile(spacing, z[k]), segment)
        n, density = _bands(spectrum.frequency, spectrum.frequency, spectrum.density)
        ax.loglog(n, density, label=_name(z, k), **_LOOKS[k])
        peak, least = max(peak, float(density.max())), min(least, float(density.min()))
    ax.set_xlim(n[0], n[-1])
    ax.set_ylim(max(0.3 * least, 1e-9 * peak), 5 * peak)
    _draw_classes(ax, n[[0, -1]])
    _label_decades(ax)
    legend(ax, loc="lower left")


def _draw_classes(ax: Any, n: np.ndarray) -> None:
    """Class bands, named at the right edge."""
    low, high = ax.get_ylim()
    for name in CLASSES:
        center, colour = class_level(name), CLASS_COLOURS[name]
        lower, upper = (displacement_psd_cycles(n, f * center) for f in (0.5, 2.0))
        ax.fill_between(n, lower, upper, color=colour, alpha=0.16, linewidth=0)
        place = displacement_psd_cycles(n[1], center)
        if low < place < high:
            edge = ax.get_yaxis_transform()
            ax.text(1.01, place, name, transform=edge, va="center", color=colour, weight="bold")


def _plot_coherence(
    ax: Any, z: np.ndarray, spacing: float, track_width: float, waviness: float
) -> None:
    points = max(32, 2 * z.shape[1] // (_SEGMENTS + 1))
    options = {"fs": 1 / spacing, "nperseg": points, "detrend": "linear"}
    ax.set_xlabel("spatial frequency [cycles/m]")
    ax.set_ylabel("coherence left/right [-]")
    ax.set_ylim(-0.03, 1.05)
    n = np.fft.rfftfreq(points, spacing)[1:]
    for left, axle in ((0, "front"), (2, "rear")):
        both = z[left : left + 2]
        if np.any(np.ptp(both, axis=1) == 0) or (left == 2 and not _differ(z[:2], both)):
            continue
        cross = csd(*both, **options)[1][1:]
        power = welch(both, **options)[1][:, 1:]
        middle, *parts = _bands(n, n, cross.real, cross.imag, *power)
        found = (parts[0] ** 2 + parts[1] ** 2) / (parts[2] * parts[3])
        ax.semilogx(middle, found, label=f"{axle} axle, measured", **_LOOKS[left])
    fine = np.geomspace(n[0], n[-1], 200)
    law = two_track_coherence(fine, track_width, waviness) ** 2
    label = f"isotropic surface: {track_width:.2f} m apart, waviness {waviness:g}"
    ax.semilogx(fine, law, color=BAND, linewidth=3.0, zorder=1, label=label)
    ax.set_xlim(n[0], min(n[-1], 5.0))
    _label_decades(ax)
    legend(ax, loc="upper right")


def _distinct(z: np.ndarray) -> list[int]:
    """Wheels to draw: the rear ones only where they see another track than the front ones."""
    return [0, 1, 2, 3] if _differ(z[:2], z[2:]) else [0, 1]


def _differ(front: np.ndarray, rear: np.ndarray) -> bool:
    return bool(np.any(np.abs(front - rear) > 0.2 * max(np.std(front), 1e-9)))


def _name(z: np.ndarray, wheel: int) -> str:
    side = ("left", "right")[wheel % 2]
    return WHEELS[wheel] if len(_distinct(z)) == 4 else f"{side}, front and rear"


def _bands(n: np.ndarray, *values: np.ndarray) -> list[np.ndarray]:
    """Means of the values over twelfth-octave bands of the frequencies n."""
    index = np.round(_BANDS_PER_OCTAVE * np.log2(n / n[0])).astype(int)
    _, group = np.unique(index, return_inverse=True)
    count = np.bincount(group)
    return [np.bincount(group, weights=v) / count for v in values]


def _label_decades(ax: Any) -> None:
    ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    ax.xaxis.set_minor_formatter(NullFormatter())
