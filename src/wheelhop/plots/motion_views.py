"""Panels of an animation: each draws its still parts once and moves the rest."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

import numpy as np
from matplotlib.patches import Polygon
from matplotlib.patheffects import Normal, Stroke

from wheelhop.plots.car_outline import (
    TIRE_WIDTH,
    plan_outline,
    rear_outline,
    side_details,
    side_outline,
    spring_line,
    tire_outline,
)
from wheelhop.plots.motion import Motion
from wheelhop.plots.style import ALERT, CORNER_COLOURS, ESTIMATE, MUTED, TRUTH
from wheelhop.vehicle.vehicle_record import VehicleRecord

_BODY = "#dfe5ea"
_EDGE = "#46525c"
_GLASS = "#b7cbd9"
_GROUND = "#cfc8bb"
_TIRE = "#2d3338"
_ARCH = "#7c8790"
_LAMP = "#fff3c4"
_RED = "#ff2a1f"
_DARK_RED = "#8e2f2a"
_ANCHOR = 1.0
_REACH = 5.4
_COLOURS = list(CORNER_COLOURS.values())


@runtime_checkable
class View(Protocol):
    """A panel: its axes, the artists that move, and a way to show sample k."""

    ax: Any
    moving: list[Any]

    def show(self, k: int) -> None: ...


class SideView:
    """The car from its right side over the right track, motions exaggerated."""

    def __init__(self, ax: Any, motion: Motion, record: VehicleRecord) -> None:
        self.ax, self.motion = ax, motion
        self.braking = record.truth.brake.sum(axis=1) > 1.0
        self.offset = np.linspace(-_REACH, _REACH, 500)
        self.arm = np.array([motion.front, motion.front, motion.rear, motion.rear])
        _still(ax, (-_REACH, _REACH), (-0.45, 2.05), "height [m]")
        ax.set_aspect("equal")
        ax.set_xticks([])
        note = f"from the right; road and motions ×{motion.scale:g} vertically"
        ax.text(0.01, 0.97, note, transform=ax.transAxes, va="top", fontsize=8, color=MUTED)
        body, windows = side_outline(motion.front, motion.rear)
        details = side_details(motion.front, motion.rear)
        self.light = _polygon(ax, _DARK_RED, _EDGE)
        self.parts = [
            (_polygon(ax, _BODY, _EDGE), body),
            (_polygon(ax, _GLASS, _EDGE), windows),
            (_polygon(ax, _BODY, _BODY), details["pillar"]),
            (_polygon(ax, _LAMP, _EDGE), details["headlight"]),
            (self.light, details["taillight"]),
        ]
        self.parts += [
            (_polygon(ax, _ARCH, _ARCH), np.array([x, 0.36]) + tire_outline(0.43, 0.06))
            for x in (motion.front, motion.rear)
        ]
        self.tires = {k: _polygon(ax, _TIRE, _TIRE) for k in (1, 3)}
        self.rims = {k: _polygon(ax, _COLOURS[k], "white") for k in (1, 3)}
        self.springs = {k: _spring(ax, _COLOURS[k]) for k in (1, 3)}
        self.ground = _polygon(ax, _GROUND, _EDGE)
        self.posts = [ax.text(0, 0, "", fontsize=7, ha="center", animated=True) for _ in range(4)]
        self.moving = [self.ground, *(patch for patch, _ in self.parts), *self.tires.values()]
        self.moving += [*self.springs.values(), *self.rims.values(), *self.posts]

    def show(self, k: int) -> None:
        m = self.motion
        lean = m.slope[k] - m.pitch[k]
        for patch, outline in self.parts:
            patch.set_xy(_leaning(outline, m.heave[k], lean))
        self.light.set_facecolor(_RED if self.braking[k] else _DARK_RED)
        for i in self.tires:
            hub = np.array([self.arm[i], m.hub[k, i] + m.slope[k] * self.arm[i]])
            self.tires[i].set_xy(hub + tire_outline(m.radius[i], m.hub[k, i] - m.below[k, i]))
            rim = 0.55 * m.radius[i]
            self.rims[i].set_xy(hub + tire_outline(rim, rim))
            top = _ANCHOR + m.heave[k] + self.arm[i] * lean
            self.springs[i].set_data(*spring_line(hub, np.array([self.arm[i], top])))
        z = m.road_around(k, self.offset, 1) + m.slope[k] * self.offset
        ends = [[self.offset[-1], -3.0], [self.offset[0], -3.0]]
        self.ground.set_xy(np.concatenate([np.stack([self.offset, z], axis=1), ends]))
        first = np.ceil((m.x[k] - _REACH) / 5.0) * 5.0
        for j, text in enumerate(self.posts):
            place = first + 5.0 * j - m.x[k]
            text.set_visible(bool(abs(place) < _REACH - 0.3))
            text.set_position((place, -0.39))
            text.set_text(f"{first + 5.0 * j:.0f} m")


class RearView:
    """The car from behind: roll, rear wheels and both tracks, motions exaggerated."""

    def __init__(self, ax: Any, motion: Motion, record: VehicleRecord) -> None:
        self.ax, self.motion = ax, motion
        self.braking = record.truth.brake.sum(axis=1) > 1.0
        self.body, self.window = rear_outline(float(2 * motion.side[2] + TIRE_WIDTH))
        _still(ax, (-2.1, 2.1), (-0.35, 1.95), "height [m]")
        ax.set_aspect("equal")
        ax.set_xticks([])
        note = f"from behind, ×{motion.scale:g}"
        ax.text(0.02, 0.97, note, transform=ax.transAxes, va="top", fontsize=8, color=MUTED)
        self.car = _polygon(ax, _BODY, _EDGE)
        self.glass = _polygon(ax, _GLASS, _EDGE)
        self.lights = {side: _polygon(ax, _DARK_RED, _EDGE) for side in (-1.0, 1.0)}
        self.tires = {k: _polygon(ax, _TIRE, _COLOURS[k]) for k in (2, 3)}
        self.springs = {k: _spring(ax, _COLOURS[k]) for k in (2, 3)}
        self.ground = _polygon(ax, _GROUND, _EDGE)
        self.moving = [*self.tires.values(), self.car, self.glass, *self.lights.values()]
        self.moving += [*self.springs.values(), self.ground]

    def show(self, k: int) -> None:
        m = self.motion
        # the rear axle hangs below the body where the pitch has lifted it
        lift = m.heave[k] - m.rear * m.pitch[k]
        for patch, outline in ((self.car, self.body), (self.glass, self.window)):
            patch.set_xy(_leaning(outline, lift, -m.roll[k]))
        half = -m.side[3]
        for side, light in self.lights.items():
            box = np.array([(0.80, 0.86), (1.0, 0.86), (1.0, 1.08), (0.80, 1.08)])
            box[:, 0] *= side * half
            light.set_xy(_leaning(box, lift, -m.roll[k]))
            light.set_facecolor(_RED if self.braking[k] else _DARK_RED)
        for i in self.tires:
            right = -m.side[i]
            low, hub = m.below[k, i], m.hub[k, i]
            w, top = 0.5 * TIRE_WIDTH, hub + m.radius[i]
            self.tires[i].set_xy(
                [(right - w, low), (right + w, low), (right + w, top), (right - w, top)]
            )
            inner = 0.72 * right
            ends = np.array([inner, hub]), np.array([inner, _ANCHOR + lift - m.roll[k] * inner])
            self.springs[i].set_data(*spring_line(*ends, width=0.06))
        left, right = m.below[k, 2], m.below[k, 3]
        road = [(-5, left), (-0.3, left), (0.3, right), (5, right), (5, -3), (-5, -3)]
        self.ground.set_xy(np.array(road))


class PlanView:
    """The path from above, to scale."""

    def __init__(self, ax: Any, motion: Motion, record: VehicleRecord) -> None:
        self.ax, self.motion = ax, motion
        width = float(2 * motion.side[2] + TIRE_WIDTH)
        self.outline = plan_outline(motion.front, motion.rear, width)
        low, high = float(np.min(motion.y)), float(np.max(motion.y))
        _still(ax, (-30.0, 60.0), (low - 2.0, high + 2.0), "to the left [m]")
        ax.set_aspect("equal")
        ax.set_xlabel("ahead of the car [m]", fontsize=8)
        self.path = ax.plot([], [], color=MUTED, lw=1.0, ls="--", animated=True)[0]
        self.gone = ax.plot([], [], color=ESTIMATE, lw=1.6, animated=True)[0]
        self.car = _polygon(ax, _BODY, _EDGE)
        self.moving = [self.path, self.gone, self.car]

    def show(self, k: int) -> None:
        m = self.motion
        self.path.set_data(m.x[k:] - m.x[k], m.y[k:])
        self.gone.set_data(m.x[: k + 1] - m.x[k], m.y[: k + 1])
        c, s = np.cos(m.yaw[k]), np.sin(m.yaw[k])
        self.car.set_xy(self.outline @ np.array([[c, s], [-s, c]]) + [0.0, m.y[k]])


class TraceView:
    """Speed and wheel acceleration over time, with a cursor."""

    def __init__(self, ax: Any, record: VehicleRecord) -> None:
        self.ax, self.t = ax, record.t
        t, truth = record.t, record.truth
        _still(ax, (0.0, t[-1]), None, "speed [km/h]")
        ax.plot(t, 3.6 * truth.speed, color=TRUTH, linewidth=1.5)
        ax.set_ylim(0, 1.15 * 3.6 * truth.speed.max())
        ax.set_xlabel("time [s]", fontsize=8)
        other = ax.twinx()
        rough = np.std(truth.wheel_acceleration[:, 1]) > 0.5
        shown = truth.wheel_acceleration[:, 1] if rough else truth.a_x
        colour = _COLOURS[1] if rough else ESTIMATE
        other.plot(t, shown, color=colour, linewidth=0.5 if rough else 1.2, alpha=0.8)
        other.set_ylabel("wheel FR [m/s²]" if rough else "$a_x$ [m/s²]", fontsize=8, color=colour)
        other.tick_params(labelsize=7, colors=colour)
        other.spines[["top"]].set_visible(False)
        self.cursor = ax.axvline(0.0, color=ALERT, linewidth=1.5, animated=True)
        self.moving = [self.cursor]

    def show(self, k: int) -> None:
        self.cursor.set_xdata([self.t[k], self.t[k]])


class LoadView:
    """Bars of the four tyre loads, their static values, and the pressures."""

    def __init__(self, ax: Any, record: VehicleRecord) -> None:
        self.ax, self.record = ax, record
        most = 1.25 * float(record.truth.load.max()) / 1e3
        _still(ax, (-0.6, 3.6), (0.0, most), "tyre load [kN]")
        ax.set_xticks(range(4), CORNER_COLOURS)
        ax.grid(False, axis="x")
        self.bars = ax.bar(range(4), np.ones(4), 0.62, color=_COLOURS, animated=True)
        static = record.truth.load[0] / 1e3
        marks = ax.hlines(static, np.arange(4) - 0.38, np.arange(4) + 0.38, TRUTH, lw=1.2)
        marks.set_animated(True)
        note = {"va": "top", "ha": "right", "fontsize": 8, "color": MUTED}
        ax.text(0.99, 0.99, "line: at rest", transform=ax.transAxes, **note)
        look = {"ha": "center", "va": "bottom", "fontsize": 9, "weight": "bold"}
        self.labels = [
            ax.text(k, 0.03 * most, "", animated=True, color="white" if k < 2 else TRUTH, **look)
            for k in range(4)
        ]
        self.moving = [*self.bars, marks, *self.labels]

    def show(self, k: int) -> None:
        load = self.record.truth.load[k] / 1e3
        pressure = self.record.truth.pressure[k] / 1e3
        for bar, text, height, kpa in zip(self.bars, self.labels, load, pressure, strict=True):
            bar.set_height(height)
            text.set_text(f"{height:.1f} kN\n{kpa:.0f} kPa")


def _still(ax: Any, x: tuple, y: tuple | None, label: str) -> None:
    ax.set_xlim(*x)
    if y is not None:
        ax.set_ylim(*y)
    ax.set_ylabel(label, fontsize=8)
    ax.tick_params(labelsize=7)
    ax.grid(True, alpha=0.2, linewidth=0.6)
    ax.spines[["top", "right"]].set_visible(False)


def _polygon(ax: Any, face: str, edge: str) -> Polygon:
    patch = Polygon(np.zeros((3, 2)), closed=True, facecolor=face, edgecolor=edge, linewidth=1.2)
    patch.set_animated(True)
    ax.add_patch(patch)
    return patch


def _spring(ax: Any, colour: str) -> Any:
    outline = [Stroke(linewidth=3.6, foreground="white"), Normal()]
    return ax.plot([], [], color=colour, lw=2.0, animated=True, path_effects=outline)[0]


def _leaning(outline: np.ndarray, lift: float, slope: float) -> np.ndarray:
    """An outline raised by a height and sheared by a slope along its first axis."""
    return np.stack([outline[:, 0], outline[:, 1] + lift + slope * outline[:, 0]], axis=1)
