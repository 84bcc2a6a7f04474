"""Outlines of a car, to scale with a vehicle's arms and tracks, for drawings of its motion."""

from __future__ import annotations

import numpy as np

TIRE_WIDTH = 0.23
_TIRE_POINTS = 48


def side_outline(front: float, rear: float) -> tuple[np.ndarray, np.ndarray]:
    """Body and windows seen from the right, [points, 2]: x ahead, height above the road [m].

    Args:
        front: x of the front axle [m].
        rear: x of the rear axle [m].
    """
    body = [
        (rear - 0.78, 0.42),
        (rear - 0.86, 0.55),
        (rear - 0.86, 0.95),
        (rear - 0.72, 1.30),
        (rear - 0.50, 1.62),
        (rear - 0.15, 1.68),
        (rear + 0.75, 1.72),
        (front - 1.42, 1.69),
        (front - 1.10, 1.54),
        (front - 0.55, 1.16),
        (front + 0.30, 1.06),
        (front + 0.68, 0.94),
        (front + 0.84, 0.72),
        (front + 0.84, 0.45),
        (front + 0.70, 0.34),
        (rear - 0.55, 0.34),
    ]
    windows = [
        (rear - 0.48, 1.20),
        (rear - 0.26, 1.55),
        (rear + 0.75, 1.60),
        (front - 1.48, 1.57),
        (front - 1.20, 1.46),
        (front - 0.78, 1.17),
    ]
    return _rounded(np.array(body), 3), _rounded(np.array(windows), 2)


def side_details(front: float, rear: float) -> dict[str, np.ndarray]:
    """Lights, pillar and door of that side as outlines by name, [points, 2] [m]."""
    return {
        "headlight": np.array(
            [(front + 0.46, 0.84), (front + 0.73, 0.74), (front + 0.72, 0.86), (front + 0.50, 0.93)]
        ),
        "taillight": np.array(
            [(rear - 0.85, 0.88), (rear - 0.68, 0.88), (rear - 0.64, 1.12), (rear - 0.76, 1.14)]
        ),
        "pillar": np.array(
            [(rear + 1.00, 1.16), (rear + 1.09, 1.16), (rear + 1.05, 1.62), (rear + 0.98, 1.62)]
        ),
    }


def rear_outline(width: float) -> tuple[np.ndarray, np.ndarray]:
    """Body and window seen from behind, [points, 2]: to the right, height above the road [m].

    Args:
        width: of the body [m].
    """
    w = 0.5 * width
    body = [
        (-0.94 * w, 0.40),
        (-w, 0.55),
        (-w, 1.0),
        (-0.93 * w, 1.15),
        (-0.72 * w, 1.64),
        (-0.5 * w, 1.71),
    ]
    window = [(-0.78 * w, 1.17), (-0.62 * w, 1.56)]
    return _rounded(_mirrored(body), 3), _rounded(_mirrored(window), 2)


def plan_outline(front: float, rear: float, width: float) -> np.ndarray:
    """Body seen from above, [points, 2]: x ahead, y to the left [m]; arguments as above."""
    w = 0.5 * width
    corners = [(rear - 0.86, -w), (front + 0.84, -w), (front + 0.84, w), (rear - 0.86, w)]
    return _rounded(np.array(corners), 3)


def tire_outline(radius: float, below: float) -> np.ndarray:
    """A tyre around its hub, [points, 2]: round above, pressed to a height `below` it [m]."""
    angle = np.linspace(0.0, 2.0 * np.pi, _TIRE_POINTS)
    x, z = radius * np.cos(angle), radius * np.sin(angle)
    if below < radius:
        return np.stack([x, np.maximum(z, -below)], axis=1)
    return np.stack([x, np.where(z < 0, z * below / radius, z)], axis=1)


def spring_line(low: np.ndarray, high: np.ndarray, width: float = 0.10, turns: int = 6) -> tuple:
    """A coil spring between two points, as x and z of a line."""
    along = np.linspace(0.0, 1.0, 4 * turns + 1)
    swing = width * np.sin(2.0 * np.pi * turns * along)
    return low[0] + (high[0] - low[0]) * along + swing, low[1] + (high[1] - low[1]) * along


def _mirrored(left: list[tuple[float, float]]) -> np.ndarray:
    half = np.array(left)
    return np.concatenate([half, half[::-1] * [-1.0, 1.0]])


def _rounded(points: np.ndarray, times: int) -> np.ndarray:
    """Corners cut twice or more (Chaikin 1974), which rounds a closed outline."""
    for _ in range(times):
        following = np.roll(points, -1, axis=0)
        near, far = 0.8 * points + 0.2 * following, 0.2 * points + 0.8 * following
        points = np.stack([near, far], axis=1).reshape(-1, 2)
    return points
