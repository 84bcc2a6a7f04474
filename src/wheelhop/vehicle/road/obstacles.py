"""Obstacles on a road: smooth functions of the distance, for one side or both."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from wheelhop.errors import InputError

SIDES = ("left", "right", "both")


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Bump:
    """One cosine wave, height / 2 (1 - cos(2 pi s / length)): continuous slope.

    Attributes:
        start: x where it begins [m].
        length: [m].
        height: [m], negative for a dip.
        side: "left", "right" or "both".
    """

    start: Any
    length: Any
    height: Any
    side: str = field(default="both", metadata={"static": True})

    def elevation(self, x: Any) -> Any:
        """z [m] at x [m]."""
        s = jnp.clip((x - self.start) / self.length, 0.0, 1.0)
        return 0.5 * self.height * (1.0 - jnp.cos(2.0 * math.pi * s))


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Step:
    """A change of level, ramped with continuous curvature.

    Attributes:
        start: x where it begins [m].
        length: of the ramp [m].
        height: [m], negative for a step down.
        side: "left", "right" or "both".
    """

    start: Any
    length: Any
    height: Any
    side: str = field(default="both", metadata={"static": True})

    def elevation(self, x: Any) -> Any:
        """z [m] at x [m]."""
        return self.height * smoothstep((x - self.start) / self.length)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class SineSweep:
    """Bounce sine sweep: waves whose length and height fall together along the road.

    The spatial frequency rises linearly, so that at constant speed the excitation frequency
    rises linearly in time; the amplitude stays in proportion to the wavelength. It fades in over
    half the longest wave and out over the two last waves with continuous curvature. With the
    shortest wave of 1.6 m a car at 20 km/h meets 3.5 Hz at its end, as in Filipozzi et al. 2021,
    who leave the law of the sweep open.

    Attributes:
        start: x where it begins [m].
        length: [m].
        amplitude: of the longest wave [m].
        longest, shortest: wavelengths at the start and the end [m].
        side: "left", "right" or "both".
    """

    start: Any
    length: Any
    amplitude: Any
    longest: Any = 25.0
    shortest: Any = 1.6
    side: str = field(default="both", metadata={"static": True})

    def wavelength(self, x: Any) -> Any:
        """Local wavelength [m] at x [m]."""
        s = jnp.clip(x - self.start, 0.0, self.length)
        return 1.0 / (1.0 / self.longest + self._chirp() * s)

    def elevation(self, x: Any) -> Any:
        """z [m] at x [m]."""
        s = jnp.clip(x - self.start, 0.0, self.length)
        phase = 2.0 * math.pi * (s / self.longest + 0.5 * self._chirp() * s * s)
        fade_in = smoothstep(s / (0.5 * self.longest))
        fade_out = smoothstep((self.length - s) / (2.0 * self.shortest))
        amplitude = self.amplitude * self.wavelength(x) / self.longest
        return amplitude * fade_in * fade_out * jnp.sin(phase)

    def _chirp(self) -> Any:
        return (1.0 / self.shortest - 1.0 / self.longest) / self.length


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Slope:
    """A change of gradient over a transition of continuous curvature, and back if it ends.

    Attributes:
        start: x where the transition begins [m].
        gradient: dz/dx [-], 0.2 for 20 %.
        transition: length of a transition [m].
        end: x where the transition back to level begins [m]; infinite for an endless slope.
        side: "left", "right" or "both".
    """

    start: Any
    gradient: Any
    transition: Any = 10.0
    end: Any = math.inf
    side: str = field(default="both", metadata={"static": True})

    def elevation(self, x: Any) -> Any:
        """z [m] at x [m]."""
        up = _smooth_ramp((x - self.start) / self.transition)
        down = _smooth_ramp((x - self.end) / self.transition)
        return self.gradient * self.transition * (up - down)


Obstacle = Bump | Step | SineSweep | Slope


def smoothstep(s: Any) -> Any:
    """0 below s = 0, 1 above s = 1, 6 s^5 - 15 s^4 + 10 s^3 between: twice differentiable."""
    s = jnp.clip(s, 0.0, 1.0)
    return s * s * s * (s * (6.0 * s - 15.0) + 10.0)


def elevation_of(obstacles: Sequence[Obstacle], x: Any, side: str) -> Any:
    """Sum of the obstacles under one side of the car [m].

    Args:
        obstacles: any number.
        x: distance [m], any shape.
        side: "left" or "right".

    Raises:
        InputError: for another side.
    """
    if side not in ("left", "right"):
        raise InputError("side", f"{side!r} is no side of a car", "Use 'left' or 'right'.")
    x = jnp.asarray(x)
    total = jnp.zeros_like(x)
    for obstacle in obstacles:
        if obstacle.side in (side, "both"):
            total = total + obstacle.elevation(x)
    return total


def obstacle_tracks(
    obstacles: Sequence[Obstacle], x: Float[Array, " points"]
) -> Float[Array, "4 points"]:
    """Sum of the obstacles [m] along the tracks of the wheels FL, FR, RL, RR at x [m]."""
    left = elevation_of(obstacles, x, "left")
    right = elevation_of(obstacles, x, "right")
    return jnp.stack([left, right, left, right])


def validate(obstacle: Obstacle) -> Obstacle:
    """The same obstacle, checked.

    Raises:
        InputError: naming the length that is not positive, or the unknown side.
    """
    name = type(obstacle).__name__
    if obstacle.side not in SIDES:
        raise InputError(f"{name}.side", f"{obstacle.side!r} is unknown", f"Use one of {SIDES}.")
    for quantity in ("length", "transition", "longest", "shortest"):
        value = getattr(obstacle, quantity, None)
        if value is not None and not float(value) > 0:
            raise InputError(
                f"{name}.{quantity}", f"{float(value):g} m is not positive", "Give a length in m."
            )
    return obstacle


def _smooth_ramp(s: Any) -> Any:
    """Integral of the smoothstep from -inf to s."""
    inside = jnp.clip(s, 0.0, 1.0)
    curve = inside**4 * (inside * (inside - 3.0) + 2.5)
    return curve + jnp.maximum(s - 1.0, 0.0)
