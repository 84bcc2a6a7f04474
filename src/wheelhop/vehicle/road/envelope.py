"""What the contact patch sees of a finely sampled track: its envelope."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from wheelhop.errors import InputError

KINDS = ("point", "moving_average", "tandem_cam")
HALF_LENGTHS = (0.05, 0.09, 0.14)
"""Half-lengths of the contact patch [m] of a passenger-car tyre, from lightly loaded (2 kN at
250 kPa) to soft (12 kN at 130 kPa)."""


@dataclass(frozen=True)
class Cam:
    """Elliptical cam |x/a|^c + |z/b|^c = 1 and the distance between two of them.

    The form is that of Schmeitz 2004 and Pacejka 2012, chapter 10; the defaults are typical
    ratios for a passenger-car tyre on a free radius of 0.36 m, not a measured set.

    Attributes:
        half_length: a [m], 1.05 R0.
        half_height: b [m], 1.1 R0.
        exponent: c [-].
        shift: distance between the cams per length of the contact patch [-].
    """

    half_length: float = 1.05 * 0.36
    half_height: float = 1.1 * 0.36
    exponent: float = 1.8
    shift: float = 0.8


@dataclass(frozen=True)
class Envelope:
    """How a track becomes the effective road under a tyre.

    Attributes:
        kind: "point" (the track itself), "moving_average" (mean over the contact patch) or
            "tandem_cam" (two elliptical cams).
        half_lengths: half-lengths of the contact patch [m] to prepare, increasing; one for a
            patch of fixed length, three to interpolate between; not used by "point".
        cam: size of the cams.
    """

    kind: str = "moving_average"
    half_lengths: tuple[float, ...] = HALF_LENGTHS
    cam: Cam = Cam()


def point_contact(z: Float[Array, "*tracks points"]) -> Float[Array, "*tracks points"]:
    """The track itself: a tyre that touches the road in one point."""
    return z


def moving_average(
    z: Float[Array, "*tracks points"], spacing: float, half_length: float
) -> Float[Array, "*tracks points"]:
    """Mean elevation over the contact patch, (1 / 2a) integral of z from x - a to x + a.

    Exact for the piecewise linear road through the points, at any half-length.

    Args:
        z: elevation of the tracks [m]; the road continues at its end elevation.
        spacing: of the points [m].
        half_length: a [m]; zero returns the track.
    """
    if half_length == 0:
        return z
    ratio = half_length / spacing
    reach = math.ceil(ratio)
    offset = np.arange(-reach, reach + 1)
    weights = (_hat_integral(ratio - offset) - _hat_integral(-ratio - offset)) / (2 * ratio)
    padded = _continue(z, reach)

    def add(total: Any, tap: Any) -> tuple[Any, None]:
        weight, k = tap
        return total + weight * jax.lax.dynamic_slice_in_dim(padded, k, z.shape[-1], -1), None

    taps = (jnp.asarray(weights, z.dtype), jnp.asarray(offset + reach))
    return jax.lax.scan(add, jnp.zeros_like(z), taps)[0]


def tandem_cam(
    z: Float[Array, "*tracks points"], spacing: float, half_length: float, cam: Cam = Cam()
) -> tuple[Float[Array, "*tracks points"], Float[Array, "*tracks points"]]:
    """Effective height [m] and forward slope [-] under two elliptical cams.

    Each cam slides vertically on the road; the height is the mean of both, the slope their
    difference over the distance l_s = shift * 2a between them. Schmeitz 2004; Pacejka 2012,
    chapter 10.

    Args:
        z: elevation of the tracks [m]; the road continues at its end elevation.
        spacing: of the points [m].
        half_length: a of the contact patch [m], above zero.
        cam: shape and distance of the cams.
    """
    height = _cam_height(z, spacing, cam)
    apart = cam.shift * 2.0 * half_length
    front = _shifted(height, 0.5 * apart / spacing)
    rear = _shifted(height, -0.5 * apart / spacing)
    return 0.5 * (front + rear), (front - rear) / apart


def effective_road(
    z: Float[Array, "*tracks points"], spacing: float, envelope: Envelope
) -> tuple[Float[Array, "lengths *tracks points"], Any, tuple[float, ...]]:
    """The tracks as seen by patches of every half-length of an envelope.

    Args:
        z: elevation of the tracks [m].
        spacing: of the points [m].
        envelope: kind and half-lengths.

    Returns:
        Effective elevation [m]; effective slope [-] of the same shape where it is more than
        the derivative of the elevation (tandem cam), else None; the half-lengths [m].

    Raises:
        InputError: for an unknown kind, or half-lengths that are not positive and increasing.
    """
    _check(envelope)
    if envelope.kind == "point":
        return point_contact(z)[None], None, (0.0,)
    halves = envelope.half_lengths
    if envelope.kind == "moving_average":
        return jnp.stack([moving_average(z, spacing, a) for a in halves]), None, halves
    height, slope = zip(*(tandem_cam(z, spacing, a, envelope.cam) for a in halves), strict=True)
    return jnp.stack(height), jnp.stack(slope), halves


def _hat_integral(t: np.ndarray) -> np.ndarray:
    """Integral of the hat function max(0, 1 - |s|) from -inf to t."""
    s = np.clip(t, -1.0, 1.0)
    return np.where(s < 0, 0.5 * (1 + s) ** 2, 1 - 0.5 * (1 - s) ** 2)


def _cam_height(z: Array, spacing: float, cam: Cam) -> Array:
    """Height of the lowest point of a cam that rests on the road: max of z(x + t) - rise(t)."""
    reach = math.floor(cam.half_length / spacing)
    offset = np.arange(-reach, reach + 1)
    u = np.abs(offset * spacing / cam.half_length)
    rise = cam.half_height * (1.0 - (1.0 - u**cam.exponent) ** (1.0 / cam.exponent))
    padded = _continue(z, reach)

    def touch(highest: Any, tap: Any) -> tuple[Any, None]:
        up, k = tap
        road = jax.lax.dynamic_slice_in_dim(padded, k, z.shape[-1], -1)
        return jnp.maximum(highest, road - up), None

    taps = (jnp.asarray(rise, z.dtype), jnp.asarray(offset + reach))
    return jax.lax.scan(touch, z, taps)[0]


def _shifted(z: Array, points: float) -> Array:
    """z read a real number of points further on, linear in between."""
    whole = math.floor(points)
    part = points - whole
    reach = abs(whole) + 1
    padded = _continue(z, reach)
    near = jax.lax.slice_in_dim(padded, reach + whole, reach + whole + z.shape[-1], axis=-1)
    if part == 0:
        return near
    far = jax.lax.slice_in_dim(padded, reach + whole + 1, reach + whole + 1 + z.shape[-1], axis=-1)
    return (1.0 - part) * near + part * far


def _continue(z: Array, points: int) -> Array:
    return jnp.pad(z, [(0, 0)] * (z.ndim - 1) + [(points, points)], mode="edge")


def _check(envelope: Envelope) -> None:
    if envelope.kind not in KINDS:
        raise InputError("envelope", f"{envelope.kind!r} is unknown", f"Use one of {KINDS}.")
    halves = envelope.half_lengths
    increasing = all(a < b for a, b in pairwise(halves))
    if envelope.kind != "point" and not (halves and halves[0] > 0 and increasing):
        raise InputError(
            "envelope.half_lengths",
            f"{halves} are not positive and increasing",
            "Give one half-length [m], or three in increasing order.",
        )
