"""A drive as an animation: the car over its road, seen from the side and from behind."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from PIL import Image

from wheelhop.errors import require_in_range
from wheelhop.plots.motion import Motion, motion_of
from wheelhop.plots.motion_views import (
    LoadView,
    PlanView,
    RearView,
    SideView,
    TraceView,
    View,
)
from wheelhop.vehicle.full_vehicle import FullVehicle
from wheelhop.vehicle.vehicle_record import VehicleRecord

FRAME_RATE = 20
"""Frames per second."""

_DPI = 80
_COLOURS = 64
_SIDEWAYS = 0.7


def write_animation(
    path: Path,
    record: VehicleRecord,
    vehicle: FullVehicle,
    title: str = "",
    frame_rate: int = FRAME_RATE,
    on_progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Write a drive as an animated GIF in real time.

    Args:
        path: file to write.
        record: the log.
        vehicle: the one that drove.
        title: headline.
        frame_rate: frames per second, 5 to 50.
        on_progress: called with frames done and frames in all.

    Raises:
        InputError: for another frame rate.
    """
    require_in_range("frame_rate", frame_rate, 5, 50, "1/s")
    images: list[Image.Image] = []
    palette = None
    count = frame_count(record, frame_rate)
    for pixels in animation_frames(record, vehicle, title, frame_rate):
        image = Image.fromarray(pixels)
        if palette is None:
            palette = image.quantize(_COLOURS, method=Image.Quantize.MEDIANCUT)
        images.append(image.quantize(palette=palette, dither=Image.Dither.NONE))
        if on_progress is not None:
            on_progress(len(images), count)
    images[0].save(
        path,
        format="GIF",
        save_all=True,
        append_images=images[1:],
        duration=round(1000 / frame_rate),
        loop=0,
        optimize=True,
    )
    return Path(path)


def frame_count(record: VehicleRecord, frame_rate: int = FRAME_RATE) -> int:
    """Number of frames of a record."""
    return max(1, round(len(record.t) * record.dt * frame_rate))


def animation_frames(
    record: VehicleRecord, vehicle: FullVehicle, title: str = "", frame_rate: int = FRAME_RATE
) -> Iterator[np.ndarray]:
    """The frames of a drive as pixels, [height, width, 3]; arguments as `write_animation`."""
    motion = motion_of(record, vehicle)
    figure, views, line = _stage(motion, record, title)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    # the layout holds still from here on
    figure.set_layout_engine("none")
    backdrop = canvas.copy_from_bbox(figure.bbox)
    instants = np.arange(frame_count(record, frame_rate)) / frame_rate
    for now in instants:
        k = min(round(float(now) / record.dt), len(record.t) - 1)
        canvas.restore_region(backdrop)
        for view in views:
            view.show(k)
            for artist in view.moving:
                view.ax.draw_artist(artist)
        line.set_text(_status(record, k))
        figure.draw_artist(line)
        yield np.asarray(canvas.buffer_rgba())[..., :3].copy()


def _stage(motion: Motion, record: VehicleRecord, title: str) -> tuple[Figure, list[View], Any]:
    layout = ConstrainedLayoutEngine(rect=(0.0, 0.0, 1.0, 0.93))
    figure = Figure(figsize=(10.0, 6.4), dpi=_DPI, layout=layout)
    grid = figure.add_gridspec(3, 2, height_ratios=[2.3, 1.0, 2.1], width_ratios=[1.0, 1.25])
    middle = figure.add_subplot(grid[1, :])
    sideways = np.ptp(record.truth.y) > _SIDEWAYS
    views: list[View] = [
        SideView(figure.add_subplot(grid[0, :]), motion, record),
        PlanView(middle, motion, record) if sideways else TraceView(middle, record),
        RearView(figure.add_subplot(grid[2, 0]), motion, record),
        LoadView(figure.add_subplot(grid[2, 1]), record),
    ]
    figure.text(0.012, 0.965, title or "Full vehicle", va="center", fontsize=13)
    line = figure.text(
        0.988, 0.965, "", va="center", ha="right", fontsize=10, family="monospace", animated=True
    )
    return figure, views, line


def _status(record: VehicleRecord, k: int) -> str:
    truth = record.truth
    return (
        f"t {record.t[k]:5.2f} s   {3.6 * truth.speed[k]:5.1f} km/h   "
        f"ahead {truth.a_x[k]:+5.1f} m/s²   left {truth.a_y[k]:+5.1f} m/s²"
    )
