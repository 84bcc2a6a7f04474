"""Loads by estimators that believe in wrong springs or dampers, Filipozzi et al. 2021, Fig. 8-9."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from wheelhop.errors import InputError
from wheelhop.plots.panels import panel_grid, plain
from wheelhop.plots.style import ALERT, ESTIMATE, MUTED, TRUTH, legend

_COLOURS = (ESTIMATE, TRUTH, ALERT, "#2e7d32")
_KILO = 1e-3


class LoadPair(NamedTuple):
    """A load and its estimate [N], [time]."""

    true: np.ndarray
    estimated: np.ndarray


def plot_stiffness_robustness(
    time: np.ndarray,
    panels: Mapping[str, Mapping[str, LoadPair]],
    begin: float,
    window: tuple[float, float],
    title: str = "",
) -> Figure:
    """One panel for each way in which deflections are counted: truth solid, estimate dashed.

    Args:
        time: [s], [time].
        panels: by headline, loads by the springs' name; the same names in every panel.
        begin: of braking [s], marked.
        window: begin and end of what is drawn [s].
        title: headline of the figure.

    Raises:
        InputError: if there is no panel, names or lengths differ, or the window is empty.
    """
    names, drawn = _names(time, panels), _drawn(time, window)
    figure, grid = panel_grid(len(panels), 1, width=8.8, height=2.75, sharex=True)
    axes = list(grid[:, 0])
    for ax, (headline, loads) in zip(axes, panels.items(), strict=True):
        for colour, name in zip(_COLOURS, names, strict=False):
            _draw(ax, time[drawn], _cut(loads[name], drawn), colour)
        _mark(ax, begin)
        ax.set_title(headline, loc="left", fontsize=10)
        ax.set_ylabel("load, front left [kN]")
    axes[-1].set_xlabel("time [s]")
    axes[-1].set_xlim(*window)
    _legend(figure, axes[0], names)
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    return figure


def plot_damping_robustness(
    time: np.ndarray,
    damping: Mapping[str, LoadPair],
    true: np.ndarray,
    digressive: Mapping[str, np.ndarray],
    speed: np.ndarray,
    maps: Mapping[str, np.ndarray],
    begin: float,
    window: tuple[float, float],
    title: str = "",
) -> Figure:
    """Loads above wrong and nonlinear dampers, the errors beside them, and the dampers' maps.

    Args:
        time: [s], [time].
        damping: loads by the damper's name.
        true: load with the nonlinear damper [N], [time].
        digressive: estimates with it by the estimator's name [N], [time].
        speed: of compression [m/s], [speeds].
        maps: force that pushes the body up by the damper's name [N], [speeds].
        begin: of braking [s], marked.
        window: begin and end of what is drawn [s].
        title: headline of the figure.

    Raises:
        InputError: if there is no damper, lengths differ, or the window is empty.
    """
    names, drawn = _names(time, {"damping": damping}), _drawn(time, window)
    _lengths("digressive", time, {"true": true, **digressive})
    _lengths("maps", speed, maps)
    figure = Figure(figsize=(9.6, 7.0), layout="constrained")
    grid = figure.add_gridspec(2, 2, width_ratios=(1.45, 1.0))
    above = figure.add_subplot(grid[0, 0])
    below = figure.add_subplot(grid[1, 0], sharex=above)
    beside = figure.add_subplot(grid[0, 1], sharex=above)
    law = figure.add_subplot(grid[1, 1])
    for ax in (above, below, beside, law):
        plain(ax)
    for colour, name in zip(_COLOURS, names, strict=False):
        pair = _cut(damping[name], drawn)
        _draw(above, time[drawn], pair, colour)
        off = pair.estimated - pair.true
        beside.plot(time[drawn], off, color=colour, linewidth=1.3, label=name)
    above.legend(handles=_keys(names), fontsize=8, framealpha=0.85, loc="lower right")
    above.set_title("9a: linear dampers of another strength", loc="left", fontsize=10)
    beside.set_title("error", loc="left", fontsize=10)
    beside.set_ylabel("estimate less truth [N]")
    below.plot(time[drawn], _KILO * true[drawn], color=TRUTH, linewidth=1.6, label="truth")
    for k, (name, load) in enumerate(digressive.items()):
        colour = (ESTIMATE, "#2e7d32", "#ef6c00", MUTED)[k % 4]
        style: dict[str, Any] = {"color": colour, "linestyle": "--", "linewidth": 1.4}
        below.plot(time[drawn], _KILO * load[drawn], label=name, **style)
    legend(below, loc="lower right")
    below.set_title("9a: nonlinear damper", loc="left", fontsize=10)
    for k, (name, force) in enumerate(maps.items()):
        style = {"color": (TRUTH, ALERT)[k % 2], "linestyle": ("-", "--")[k % 2]}
        law.plot(speed, _KILO * force, linewidth=1.6, label=name, **style)
    legend(law, loc="upper left")
    law.set_title("9b: the dampers", loc="left", fontsize=10)
    law.set_xlabel("compression speed [m/s]")
    law.set_ylabel("damper force [kN]")
    for ax in (above, below):
        ax.set_ylabel("load, front left [kN]")
    for ax in (above, below, beside):
        _mark(ax, begin)
        ax.set_xlabel("time [s]")
    above.set_xlim(*window)
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    return figure


def _names(time: np.ndarray, panels: Mapping[str, Mapping[str, LoadPair]]) -> list[str]:
    if not panels or not all(panels.values()):
        raise InputError("panels", "there is no load to draw", "Give one or more.")
    names = list(next(iter(panels.values())))
    for headline, loads in panels.items():
        if list(loads) != names:
            raise InputError("panels", f"{headline!r} has {list(loads)}", f"Give {names}.")
        for name, pair in loads.items():
            _lengths(name, time, pair._asdict())
    return names


def _lengths(field: str, over: np.ndarray, curves: Mapping[str, np.ndarray]) -> None:
    for name, curve in curves.items():
        if np.shape(curve) != np.shape(over):
            raise InputError(
                field, f"{name!r} is {np.shape(curve)}", f"Give {np.shape(over)}, as its abscissa."
            )


def _drawn(time: np.ndarray, window: tuple[float, float]) -> np.ndarray:
    drawn = (time >= window[0]) & (time <= window[1])
    if drawn.sum() < 2:
        raise InputError("window", f"{window} holds no samples", "Choose it within the record.")
    return drawn


def _cut(pair: LoadPair, drawn: np.ndarray) -> LoadPair:
    """Without what is not drawn, so that the axes fit the rest."""
    return LoadPair(pair.true[drawn], pair.estimated[drawn])


def _draw(ax: Any, time: np.ndarray, pair: LoadPair, colour: str) -> None:
    ax.plot(time, _KILO * pair.true, color=colour, linewidth=1.2, label="_")
    ax.plot(time, _KILO * pair.estimated, color=colour, linestyle="--", linewidth=1.6, label="_")


def _mark(ax: Any, begin: float) -> None:
    ax.axvline(begin, color=MUTED, linestyle=":", linewidth=0.9)


def _keys(names: list[str]) -> list[Line2D]:
    """Colours of the names, and what solid and dashed mean."""
    keys = [Line2D([], [], color=c, label=n) for c, n in zip(_COLOURS, names, strict=False)]
    keys.append(Line2D([], [], color=MUTED, label="solid: truth"))
    return [*keys, Line2D([], [], color=MUTED, linestyle="--", label="dashed: estimate")]


def _legend(figure: Figure, ax: Any, names: list[str]) -> None:
    keys = _keys(names)
    figure.legend(handles=keys, loc="outside lower left", fontsize=8, frameon=False, ncols=3)
