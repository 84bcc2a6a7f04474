"""Figures of the roads of Brancati & Tufano 2022: their Eq. 5-7, and Fig. 12."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullFormatter, ScalarFormatter

from wheelhop.plots.style import ALERT, CLASS_COLOURS, ESTIMATE, MUTED, TRUTH, legend, new_figure
from wheelhop.vehicle.road import (
    CLASSES,
    Profile,
    RoadFit,
    class_level,
    class_of_level,
    displacement_psd,
)

_WAVES = (0.12, 62.8)
_LOOKS = (
    {"marker": "o", "color": ESTIMATE},
    {"marker": "o", "color": ESTIMATE, "markerfacecolor": "white"},
    {"marker": "s", "color": ALERT},
    {"marker": "s", "color": ALERT, "markerfacecolor": "white"},
)


class RoadLine(NamedTuple):
    """Spectrum of the roads of one class.

    Attributes:
        road_class: ISO 8608 class they are meant to be.
        wavenumber: W [rad/m], [waves].
        density: their mean PSD [m^3/rad], [waves].
        law: the PSD they were made for [m^3/rad], [waves].
        nearest: class they turn out to be.
    """

    road_class: str
    wavenumber: np.ndarray
    density: np.ndarray
    law: np.ndarray
    nearest: str


class Indices(NamedTuple):
    """Roughness of the roads of one class.

    Attributes:
        road_class: ISO 8608 class they are meant to be.
        iri: roughness index of every road [m/km], [roads].
        line: of the class's exact line [m/km].
    """

    road_class: str
    iri: np.ndarray
    line: float


def plot_road_classes(
    panels: Mapping[str, Sequence[RoadLine]],
    indices: Mapping[str, Sequence[Indices]],
    band: tuple[float, float] | None = None,
    title: str = "",
) -> Figure:
    """Spectra of random roads between the ISO 8608 classes, and their roughness index.

    Spectra are multiplied by (W / W0)^2, so that a class is a level strip and a road is read
    against it directly.

    Args:
        panels: by headline, the spectra of each class.
        indices: by label, the roughness of each class.
        band: wavenumbers [rad/m] in which levels were compared, marked where given.
        title: headline of the figure.
    """
    figure = Figure(figsize=(9.0, 7.4), layout="constrained")
    grid = figure.add_gridspec(2, len(panels), height_ratios=[1.35, 1])
    axes = [figure.add_subplot(grid[0, 0])]
    for k in range(1, len(panels)):
        axes.append(figure.add_subplot(grid[0, k], sharey=axes[0]))
        axes[k].tick_params(labelleft=False)
    for ax, (headline, lines) in zip(axes, panels.items(), strict=True):
        _class_strips(ax, lines)
        if band is not None:
            ax.axvspan(*band, ymax=0.018, color=MUTED, linewidth=0)
        ax.set_title(headline, loc="left", fontsize=10)
        ax.set_xlabel("wavenumber Ω [rad/m]")
        _tidy(ax)
    axes[0].set_ylabel("PSD × (Ω / Ω₀)² [m³/rad]")
    handles = [
        axes[0].plot([], [], color=MUTED, linewidth=1.5, label="mean of the roads")[0],
        axes[0].plot([], [], color=TRUTH, linestyle=":", label="Eq. 5")[0],
        axes[0].plot([], [], color=TRUTH, linestyle="--", linewidth=0.8, label="class line")[0],
    ]
    if band is not None:
        handles += axes[0].plot([], [], color=MUTED, linewidth=5, label="levels compared")
    legend(axes[0], handles=handles, loc="lower right", ncols=2, bbox_to_anchor=(1.0, 0.025))
    _roughness(figure.add_subplot(grid[1, :]), indices)
    figure.suptitle(title, x=0.01, ha="left", fontsize=12)
    return figure


def _class_strips(ax: Any, lines: Sequence[RoadLine]) -> None:
    """Classes as level strips, from one below the smoothest to the roughest, with the spectra."""
    names = [line.road_class for line in lines]
    centres = np.array([class_level(n) for n in names])
    for name in names:
        centre, colour = class_level(name), CLASS_COLOURS[name]
        # class A has no lower bound
        low = 0.01 * centre if name == CLASSES[0] else 0.5 * centre
        ax.axhspan(low, 2 * centre, color=colour, alpha=0.16, linewidth=0)
        ax.axhline(centre, color=colour, linestyle="--", linewidth=0.9)
        ax.text(
            0.985,
            0.54 * centre,
            f"class {name}",
            transform=ax.get_yaxis_transform(),
            ha="right",
            va="bottom",
            fontsize=8,
            fontweight="bold",
            color=colour,
        )
    for line in lines:
        w = line.wavenumber
        colour = CLASS_COLOURS[line.road_class]
        ax.plot(w, line.density * w**2, color=colour, linewidth=1.2)
        ax.plot(w, line.law * w**2, color=TRUTH, linewidth=1.2, linestyle=":")
        k = int(np.argmin(np.abs(w - 1.0)))
        ax.annotate(
            f"made as {line.road_class}, is {line.nearest}",
            (w[k], line.law[k] * w[k] ** 2),
            (0, 5),
            textcoords="offset points",
            ha="center",
            fontsize=8,
            fontweight="bold",
            bbox={"boxstyle": "round,pad=0.15", "facecolor": "white", "alpha": 0.8, "linewidth": 0},
        )
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.set_xlim(*_WAVES)
    ax.set_ylim(0.1 * centres.min(), 3.0 * centres.max())


def _roughness(ax: Any, indices: Mapping[str, Sequence[Indices]]) -> None:
    step = 0.64 / max(len(indices) - 1, 1)
    every: list[float] = []
    for k, (label, rows) in enumerate(indices.items()):
        for place, row in enumerate(rows):
            x = place + (k - 0.5 * (len(indices) - 1)) * step
            mean, spread = float(row.iri.mean()), float(row.iri.std(ddof=1))
            look = _LOOKS[k % len(_LOOKS)]
            name = "" if place else label
            ax.errorbar(x, mean, spread, capsize=3, markersize=6, linewidth=1, label=name, **look)
            ax.annotate(
                f"{mean:.3g}",
                (x, mean + spread),
                (0, 4),
                textcoords="offset points",
                ha="center",
                fontsize=7,
            )
            every += [mean - spread, mean + spread]
    first = next(iter(indices.values()))
    for place, row in enumerate(first):
        label = "" if place else "exact line of the class"
        colour = CLASS_COLOURS[row.road_class]
        ax.plot([place - 0.46, place + 0.46], [row.line] * 2, color=TRUTH, linewidth=1, label=label)
        ax.axvspan(place - 0.47, place + 0.47, color=colour, alpha=0.08, linewidth=0)
        ax.text(
            place + 0.46,
            row.line * 1.04,
            f"{row.line:.3g}",
            ha="right",
            va="bottom",
            fontsize=8,
            fontweight="bold",
        )
        every.append(row.line)
    ax.set_yscale("log")
    ax.set_ylim(0.75 * min(every), 1.6 * max(every))
    ax.yaxis.set_major_locator(FixedLocator([0.5, 1, 2, 5, 10, 20, 50, 100, 200]))
    ax.yaxis.set_major_formatter(ScalarFormatter())
    ax.yaxis.set_minor_formatter(NullFormatter())
    ax.set_xticks(range(len(first)), [f"class {row.road_class}" for row in first])
    ax.set_xlim(-0.55, len(first) - 0.45)
    ax.set_ylabel("IRI [m/km]")
    ax.set_title("Roughness index: mean and spread of the roads", loc="left", fontsize=10)
    _tidy(ax)
    legend(ax, loc="upper left")


def plot_measured_road(
    profile: Profile, wavenumber: np.ndarray, density: np.ndarray, fit: RoadFit, title: str = ""
) -> Figure:
    """PSD of a measured road between the class lines, and below it the road: their Fig. 12.

    Args:
        profile: the road.
        wavenumber: W [rad/m], [waves].
        density: its PSD [m^3/rad], [waves].
        fit: line through it.
        title: headline of the figure.
    """
    figure, (top, bottom) = new_figure(2, height=3.5, height_ratios=[2.2, 1])
    ends = np.array([wavenumber[0], wavenumber[-1]])
    for name in CLASSES:
        centre, colour = class_level(name), CLASS_COLOURS[name]
        low, high = displacement_psd(ends, 0.5 * centre), displacement_psd(ends, 2 * centre)
        top.fill_between(ends, low, high, color=colour, alpha=0.16, linewidth=0)
        top.plot(ends, displacement_psd(ends, centre), color=colour, linestyle="--", linewidth=0.8)
        at = ends[1] * (ends[0] / ends[1]) ** 0.03
        top.text(
            at,
            displacement_psd(at, centre),
            name,
            ha="center",
            va="center",
            color=colour,
            fontweight="bold",
            clip_on=True,
            bbox={"boxstyle": "round,pad=0.1", "facecolor": "white", "alpha": 0.7, "linewidth": 0},
        )
    top.loglog(wavenumber, density, color=MUTED, linewidth=0.8, label="measured road")
    full = 2 * math.pi
    top.plot(
        full * fit.frequency,
        fit.density / full,
        "o",
        color=ESTIMATE,
        markersize=4.5,
        label="third octaves",
    )
    band = full * np.asarray(fit.band)
    line = displacement_psd(band, fit.level, fit.waviness)
    top.plot(
        band,
        line,
        color=ALERT,
        linewidth=2,
        label=f"fit: {_power(fit.level)} m³/rad at 1 rad/m, waviness {fit.waviness:.2f}",
    )
    iso = displacement_psd(band, fit.iso_level)
    top.plot(
        band,
        iso,
        color=TRUTH,
        linewidth=1.3,
        linestyle="-.",
        label=f"fit of waviness 2: {_power(fit.iso_level)} m³/rad, "
        f"class {class_of_level(fit.iso_level)}",
    )
    top.set_xlim(*ends)
    shown = np.concatenate([line, iso, fit.density / full])
    top.set_ylim(max(0.2 * shown.min(), 1e-7 * density.max()), 6 * density.max())
    top.set_xlabel("wavenumber Ω [rad/m]")
    top.set_ylabel("displacement PSD [m³/rad]")
    top.set_title(title or "Measured road", loc="left", fontsize=11)
    legend(top, loc="lower left")

    bottom.plot(
        profile.distance, profile.elevation - profile.elevation[0], color=ESTIMATE, linewidth=0.9
    )
    bottom.set_xlabel("distance [m]")
    bottom.set_ylabel("elevation over\nits start [m]")
    bottom.margins(x=0)
    return figure


def _power(value: float) -> str:
    exponent = math.floor(math.log10(value))
    sign = str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return f"{value / 10.0**exponent:.2f}·10{sign}"


def _tidy(ax: Any) -> None:
    ax.grid(True, alpha=0.25, linewidth=0.6)
    ax.spines[["top", "right"]].set_visible(False)
