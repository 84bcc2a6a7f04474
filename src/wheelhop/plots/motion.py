"""A drive as positions to draw, with its small vertical motions exaggerated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from wheelhop.vehicle.full_vehicle import FullVehicle
from wheelhop.vehicle.vehicle_record import VehicleRecord

_SCALES = (1, 2, 3, 5, 10, 20)
_WANTED = 0.14
_ROAD_SPACING = 0.05
_SMOOTHING = 6.0
_AHEAD = 60.0


@dataclass(frozen=True)
class Motion:
    """Positions over time; heights are relative to the mean slope of the road at the car.

    A height is drawn as its value at rest plus `scale` times its departure from it. Corners are
    FL, FR, RL, RR.

    Attributes:
        scale: vertical exaggeration [-].
        front, rear: x of the axles from the centre of mass [m].
        side: y of the wheels [m], [4].
        radius: of the free tyres [m], [4].
        x, y, yaw: of the centre of mass [m], [rad], [time].
        slope: mean slope of the road at the car [-], [time].
        heave: of the centre of mass from its height at rest [m], exaggerated, [time].
        pitch, roll: exaggerated slopes of the body, nose down and to the right [-], [time].
        hub: heights of the wheel centres above the mean slope [m], exaggerated, [time, 4].
        below: of the road under them [m], [time, 4].
        road_x: x [m] of the points of the road, [points].
        road: elevation of the left and right track [m], [2, points].
        mean_road: their mean, smoothed [m], [points].
    """

    scale: float
    front: float
    rear: float
    side: np.ndarray
    radius: np.ndarray
    x: np.ndarray
    y: np.ndarray
    yaw: np.ndarray
    slope: np.ndarray
    heave: np.ndarray
    pitch: np.ndarray
    roll: np.ndarray
    hub: np.ndarray
    below: np.ndarray
    road_x: np.ndarray
    road: np.ndarray
    mean_road: np.ndarray

    def road_around(self, k: int, offset: np.ndarray, side: int) -> np.ndarray:
        """Height [m], exaggerated, of the left (0) or right (1) track at x + offset."""
        x = self.x[k] + offset
        level = np.interp(self.x[k], self.road_x, self.mean_road)
        z = np.interp(x, self.road_x, self.road[side]) - level - self.slope[k] * offset
        return self.scale * z


def motion_of(record: VehicleRecord, vehicle: FullVehicle) -> Motion:
    """What to draw of a record.

    Args:
        record: the log.
        vehicle: the one that drove.
    """
    c, truth = vehicle.chassis, record.truth
    front, rear = float(c.front_arm), -float(c.rear_arm)
    arm = np.array([front, front, rear, rear])
    half = 0.5 * np.array([float(c.front_track)] * 2 + [float(c.rear_track)] * 2)
    side = half * [1.0, -1.0, 1.0, -1.0]
    radius = np.asarray(vehicle.tire.vertical.unloaded_radius, float)
    road_x, road = _road(record, front)
    smooth = gaussian_filter1d(road.mean(axis=0), _SMOOTHING / _ROAD_SPACING, mode="nearest")
    level = np.interp(truth.x, road_x, smooth)
    slope = np.interp(truth.x, road_x, np.gradient(smooth, _ROAD_SPACING))

    loaded = radius - truth.tire_deflection
    rest = loaded[0]
    ground = level[:, None] + slope[:, None] * arm
    bump = truth.elevation - ground
    hub = bump + loaded - rest
    height = float(np.mean(np.asarray(c.hub_drop) + rest))
    heave = truth.z - level - height
    pitch, roll = truth.pitch + np.arctan(slope), truth.roll
    spans = (bump, hub, heave, pitch * front, roll * half[0])
    span = max(float(np.percentile(np.abs(s), 99)) for s in spans)
    scale = float(max((s for s in _SCALES if s * span <= _WANTED), default=1))
    return Motion(
        scale=scale,
        front=front,
        rear=rear,
        side=side,
        radius=radius,
        x=truth.x,
        y=truth.y,
        yaw=truth.yaw,
        slope=slope,
        heave=scale * heave,
        pitch=scale * pitch,
        roll=scale * roll,
        hub=rest + scale * hub,
        below=scale * bump,
        road_x=road_x,
        road=road,
        mean_road=smooth,
    )


def _road(record: VehicleRecord, front: float) -> tuple[np.ndarray, np.ndarray]:
    """The road the front tyres felt, on an even grid, level before and beyond."""
    truth = record.truth
    felt = truth.x + front
    x = np.arange(felt[0] - _AHEAD, felt.max() + _AHEAD, _ROAD_SPACING)
    forward = np.concatenate([[True], np.diff(np.maximum.accumulate(felt)) > 0])
    tracks = [np.interp(x, felt[forward], truth.elevation[forward, k]) for k in (0, 1)]
    return x, np.stack(tracks)
