"""The road surface under four wheels: smooth elevation and slopes anywhere."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from wheelhop.errors import InputError
from wheelhop.vehicle.road.envelope import Envelope, effective_road
from wheelhop.vehicle.road.spline import PAD, gathers, prefilter, slices, spline_weights

_POINT = Envelope("point")


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class RoadSurface:
    """Cubic B-splines along x, one per half-length of the contact patch and row.

    A surface for each of several lanes has a trailing axis on its arrays.

    Attributes:
        coefficients: of the elevation [m], [lengths, rows, points + 8]: four more at each end,
            which let the road run out flat.
        slope_coefficients: of the forward slope [-], the same shape, where it is not the
            derivative of the elevation (tandem cam); else None.
        spacing: of the points [m].
        start: x of the first point [m].
        half_lengths: half-lengths of the contact patch [m], increasing, [lengths].
        lateral_start: y of the first row [m].
        lateral_spacing: of the rows [m].
        follows: wheel i reads row i wherever it is, so there are four rows; otherwise rows
            lie at lateral positions, linear in between and constant beyond.
    """

    coefficients: Any
    slope_coefficients: Any
    spacing: Any
    start: Any
    half_lengths: Any
    lateral_start: Any
    lateral_spacing: Any
    follows: bool = field(default=True, metadata={"static": True})


class RoadUnderWheels(NamedTuple):
    """The road under the wheels for every half-length of the contact patch, [lengths, 4]."""

    elevation: Any
    slope_x: Any
    slope_y: Any


class Contact(NamedTuple):
    """Effective plane of the contact patches: elevation [m] and slopes [-], each [4]."""

    elevation: Any
    slope_x: Any
    slope_y: Any


def flat_surface(elevation: float = 0.0, dtype: Any = None) -> RoadSurface:
    """An endless flat road at an elevation [m]."""
    level = jnp.full((1, 1, 2 * PAD + 2), elevation, dtype)
    return _assemble(level, None, 1.0, 0.0, (0.0,), (0.0, 1.0), follows=False)


def surface_from_tracks(
    tracks: Float[Array | np.ndarray, "tracks points"],
    spacing: float,
    start: float = 0.0,
    envelope: Envelope = _POINT,
) -> RoadSurface:
    """A surface of four tracks bound to the wheels FL, FR, RL, RR.

    Pure in the tracks, so that it maps over random roads.

    Args:
        tracks: elevation [m].
        spacing: of the points [m].
        start: x of the first point [m].
        envelope: what the contact patch makes of them.

    Raises:
        InputError: for another number of tracks, fewer than two points, a spacing that is not
            positive, or an unknown envelope.
    """
    z = jnp.asarray(tracks)
    if z.shape[0] != 4:
        raise InputError(
            "tracks", f"there are {z.shape[0]}", "Give four, for the wheels FL, FR, RL and RR."
        )
    return _from_rows(z, spacing, start, (0.0, 1.0), envelope, follows=True)


def surface_from_grid(
    elevation: Float[Array | np.ndarray, "rows points"],
    spacing: float,
    start: float,
    lateral_start: float,
    lateral_spacing: float,
    envelope: Envelope = _POINT,
) -> RoadSurface:
    """A surface of rows along x at equal lateral distances, y increasing to the left.

    Args:
        elevation: z [m].
        spacing: of the points along a row [m].
        start: x of the first point [m].
        lateral_start: y of the first row [m].
        lateral_spacing: of the rows [m].
        envelope: what the contact patch makes of every row.

    Raises:
        InputError: for fewer than two points, a spacing that is not positive, or an unknown
            envelope.
    """
    if not lateral_spacing > 0:
        raise InputError(
            "lateral_spacing", f"{lateral_spacing:g} m is not positive", "Order rows by rising y."
        )
    lateral = (lateral_start, lateral_spacing)
    return _from_rows(jnp.asarray(elevation), spacing, start, lateral, envelope, follows=False)


def road_under(surface: RoadSurface, x: Any, y: Any) -> RoadUnderWheels:
    """Elevation and slopes of the road at four places, for every half-length of the bank.

    Beyond its ends the road continues flat at its end elevation, beyond its sides unchanged.

    Args:
        surface: the road, shared or one per lane.
        x, y: places of the wheels FL, FR, RL, RR [m], [4] or [4, lanes].

    Returns:
        Arrays [lengths, 4] or [lengths, 4, lanes]; the lateral slope is zero on a road that
        follows its wheels.
    """
    x, y = jnp.asarray(x), jnp.asarray(y)
    if x.ndim == 1:
        return _under_one(surface, x, y, slices)
    lookup = partial(_under_one, take=gathers)
    return jax.vmap(lookup, in_axes=(_lane_axes(surface), -1, -1), out_axes=-1)(surface, x, y)


def enveloped(under: RoadUnderWheels, half_length: Any, surface: RoadSurface) -> Contact:
    """The road under contact patches of given half-lengths, by interpolation in the bank.

    The polynomial through all half-lengths of the bank: quadratic for three, constant for one.

    Args:
        under: what `road_under` found.
        half_length: a of the contact patch [m], [4] or [4, lanes], clipped to the bank.
        surface: the same road.
    """
    a = jnp.asarray(half_length)
    bank = surface.half_lengths
    nodes = bank.reshape((bank.shape[0], 1) + (bank.shape[1:] or (1,) * (a.ndim - 1)))
    a = jnp.clip(a, nodes[0], nodes[-1])
    count = bank.shape[0]
    weights = []
    for i in range(count):
        weight = jnp.ones_like(a)
        for j in range(count):
            if j != i:
                weight = weight * (a - nodes[j]) / (nodes[i] - nodes[j])
        weights.append(weight)

    def mix(values: Any) -> Any:
        return sum(weight * value for weight, value in zip(weights, values, strict=True))

    return Contact(mix(under.elevation), mix(under.slope_x), mix(under.slope_y))


def _from_rows(
    z: Any, spacing: float, start: float, lateral: Any, envelope: Envelope, follows: bool
) -> RoadSurface:
    if not spacing > 0:
        raise InputError("spacing", f"{spacing:g} m is not positive", "Give a positive spacing.")
    if z.shape[-1] < 2:
        raise InputError("road", f"it has {z.shape[-1]} points", "Give at least two points.")
    elevation, slope, halves = effective_road(z, spacing, envelope)
    return _assemble(
        prefilter(elevation),
        None if slope is None else prefilter(slope),
        spacing,
        start,
        halves,
        lateral,
        follows,
    )


def _assemble(
    coefficients: Any,
    slope: Any,
    spacing: Any,
    start: Any,
    halves: Any,
    lateral: Any,
    follows: bool,
) -> RoadSurface:
    def number(value: Any) -> Any:
        return jnp.asarray(value, coefficients.dtype)

    return RoadSurface(
        coefficients,
        slope,
        number(spacing),
        number(start),
        number(halves),
        number(lateral[0]),
        number(lateral[1]),
        follows,
    )


def _under_one(surface: RoadSurface, x: Any, y: Any, take: Any) -> RoadUnderWheels:
    """`road_under` of one run, x and y [4]; `take` fetches the coefficients."""
    bank = surface.coefficients
    _, rows, points = bank.shape
    u = jnp.clip((x - surface.start) / surface.spacing, 1.0 - PAD, points - 2.0 * PAD + 1.0)
    cell = jnp.floor(u)
    part = u - cell
    first = cell.astype(jnp.int32) + (PAD - 1)
    value, rate = spline_weights(part)
    rate = rate / surface.spacing

    across = 1 if surface.follows or rows == 1 else 2
    if surface.follows:
        row = jnp.arange(4, dtype=jnp.int32)
    elif rows == 1:
        row = jnp.zeros(4, jnp.int32)
    else:
        v = (y - surface.lateral_start) / surface.lateral_spacing
        w = jnp.clip(v, 0.0, rows - 1.0)
        row = jnp.clip(jnp.floor(w), 0.0, rows - 2.0).astype(jnp.int32)

    def along(taps: Any, weights: Any) -> Any:
        """Elevation or slope of the rows around every wheel, [lengths, 4, across]."""
        return sum(tap * weights[None, :, None, k] for k, tap in enumerate(taps))

    taps = take(bank, row, first, across)
    elevation = along(taps, value)
    if surface.slope_coefficients is None:
        slope = along(taps, rate)
    else:
        slope = along(take(surface.slope_coefficients, row, first, across), value)
    if across == 1:
        flat = jnp.zeros_like(elevation[..., 0])
        return RoadUnderWheels(elevation[..., 0], slope[..., 0], flat)
    left = (w - row.astype(w.dtype))[None]
    inside = ((v >= 0.0) & (v <= rows - 1.0))[None]
    rise = elevation[..., 1] - elevation[..., 0]
    return RoadUnderWheels(
        elevation[..., 0] + left * rise,
        slope[..., 0] + left * (slope[..., 1] - slope[..., 0]),
        jnp.where(inside, rise / surface.lateral_spacing, 0.0),
    )


def _lane_axes(surface: RoadSurface) -> RoadSurface:
    """Axis of the lanes of every array: the last, where it has one."""

    def axis(value: Any, rank: int) -> int | None:
        return -1 if value is not None and jnp.ndim(value) > rank else None

    return RoadSurface(
        axis(surface.coefficients, 3),
        axis(surface.slope_coefficients, 3),
        axis(surface.spacing, 0),
        axis(surface.start, 0),
        axis(surface.half_lengths, 1),
        axis(surface.lateral_start, 0),
        axis(surface.lateral_spacing, 0),
        surface.follows,
    )
