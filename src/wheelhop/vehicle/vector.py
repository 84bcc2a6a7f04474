"""Vectors in space as three named components, elementwise over whatever shape they have."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax.numpy as jnp


class Vector(NamedTuple):
    """Components along x, y and z, arrays of one shape."""

    x: Any
    y: Any
    z: Any


class Frame(NamedTuple):
    """Axes of a frame, each a unit vector in the parent frame (columns of a rotation matrix)."""

    x: Vector
    y: Vector
    z: Vector


def add(*vectors: Vector) -> Vector:
    """Sum of vectors."""
    return Vector(*(sum(parts[1:], parts[0]) for parts in zip(*vectors, strict=True)))


def subtract(a: Vector, b: Vector) -> Vector:
    """a - b."""
    return Vector(a.x - b.x, a.y - b.y, a.z - b.z)


def scale(factor: Any, a: Vector) -> Vector:
    """factor a."""
    return Vector(factor * a.x, factor * a.y, factor * a.z)


def dot(a: Vector, b: Vector) -> Any:
    """a . b."""
    return a.x * b.x + a.y * b.y + a.z * b.z


def cross(a: Vector, b: Vector) -> Vector:
    """a x b."""
    return Vector(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x)


def normalise(a: Vector) -> Vector:
    """a / |a|; a must not be zero."""
    return scale(1.0 / jnp.sqrt(dot(a, a)), a)


def lift(a: Vector) -> Vector:
    """A vector of the body with the leading axis of the corners: [] -> [1], [runs] -> [1, runs]."""
    return Vector(a.x[None], a.y[None], a.z[None])


def per_corner(value: Any, like: Any) -> Any:
    """A number for all corners with the leading axis that `like`, of the corners, has."""
    return value[None] if jnp.ndim(value) < jnp.ndim(like) else value


def over_corners(a: Vector) -> Vector:
    """Sum over the leading axis of the corners."""
    return Vector(jnp.sum(a.x, 0), jnp.sum(a.y, 0), jnp.sum(a.z, 0))


def body_frame(roll: Any, pitch: Any, yaw: Any) -> Frame:
    """Axes of the body in the world: R = Rz(yaw) Ry(pitch) Rx(roll), angles in rad.

    ISO 8855: x forward, y left, z up, so that positive pitch is nose down.
    """
    sr, cr = jnp.sin(roll), jnp.cos(roll)
    sp, cp = jnp.sin(pitch), jnp.cos(pitch)
    sy, cy = jnp.sin(yaw), jnp.cos(yaw)
    return Frame(
        Vector(cy * cp, sy * cp, -sp),
        Vector(cy * sp * sr - sy * cr, sy * sp * sr + cy * cr, cp * sr),
        Vector(cy * sp * cr + sy * sr, sy * sp * cr - cy * sr, cp * cr),
    )


def to_world(frame: Frame, a: Vector) -> Vector:
    """A vector given in the frame, in the parent's components."""
    return add(scale(a.x, frame.x), scale(a.y, frame.y), scale(a.z, frame.z))


def to_body(frame: Frame, a: Vector) -> Vector:
    """A vector given in the parent's components, in the frame's."""
    return Vector(dot(frame.x, a), dot(frame.y, a), dot(frame.z, a))


def lift_frame(frame: Frame) -> Frame:
    """A frame with the leading axis of the corners."""
    return Frame(lift(frame.x), lift(frame.y), lift(frame.z))


def solve_symmetric(diagonal: Vector, xy: Any, xz: Any, yz: Any, right: Vector) -> Vector:
    """Solution of a symmetric positive definite 3 x 3 system, by its adjugate.

    Args:
        diagonal: entries (x, x), (y, y), (z, z).
        xy, xz, yz: entries off the diagonal.
        right: right-hand side.
    """
    a, b, c = diagonal
    xx_, yy_, zz_ = b * c - yz * yz, a * c - xz * xz, a * b - xy * xy
    xy_, xz_, yz_ = xz * yz - xy * c, xy * yz - xz * b, xy * xz - a * yz
    inverse = 1.0 / (a * xx_ + xy * xy_ + xz * xz_)
    return Vector(
        inverse * (xx_ * right.x + xy_ * right.y + xz_ * right.z),
        inverse * (xy_ * right.x + yy_ * right.y + yz_ * right.z),
        inverse * (xz_ * right.x + yz_ * right.y + zz_ * right.z),
    )
