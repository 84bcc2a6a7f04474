"""Tyre pressures over time: held, leaking, punctured, warming up."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp

from wheelhop.errors import InputError, require_in_range
from wheelhop.vehicle.vector import per_corner


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class PressureCourse:
    """Gauge pressure of four tyres over time.

    Attributes:
        start: p_1 at the beginning [Pa], [4].
        end: p_2 after the loss [Pa], [4].
        begin: time at which the loss begins [s], [4] or [].
        duration: of a leak that falls evenly [s], [4] or []; a puncture has none.
        decay: time constant of a puncture [s], whose loss slows down as the pressure does; 0
            for an even leak.
        warming: rise by warm-up [Pa], [4] or [].
        warming_time: time constant of the warm-up [s].
    """

    start: Any
    end: Any
    begin: Any = 0.0
    duration: Any = 1.0
    decay: Any = 0.0
    warming: Any = 0.0
    warming_time: Any = 600.0


def held(pressure: Any) -> PressureCourse:
    """Tyres that keep their pressures [Pa], [4]."""
    return PressureCourse(pressure, pressure)


def pressure_at(course: PressureCourse, t: Any) -> Any:
    """Pressures [Pa] at a time [s], [4].

    Even leak: linear from p_1 to p_2. Puncture: p_2 + (p_1 - p_2) exp(-(t - t_0) / tau). Warm-up:
    + dp (1 - exp(-t / tau_w)).
    """
    c = course
    begin, duration, decay, warming, warming_time, now = (
        per_corner(jnp.asarray(number), c.start)
        for number in (c.begin, c.duration, c.decay, c.warming, c.warming_time, t)
    )
    since = jnp.maximum(now - begin, 0.0)
    even = jnp.clip(since / duration, 0.0, 1.0)
    sudden = -jnp.expm1(-since / jnp.where(decay > 0, decay, 1.0))
    lost = jnp.where(decay > 0, sudden, even)
    return c.start + (c.end - c.start) * lost + warming * -jnp.expm1(-now / warming_time)


def validate(course: PressureCourse) -> PressureCourse:
    """The same course, checked.

    Raises:
        InputError: naming the wheel or the time that is out of range.
    """
    for name in ("start", "end"):
        numbers = jnp.ravel(jnp.asarray(getattr(course, name))).tolist()
        if len(numbers) != 4:
            raise InputError(
                f"pressure.{name}", f"{len(numbers)} values", "Give four: FL, FR, RL, RR."
            )
        for wheel, number in zip(("FL", "FR", "RL", "RR"), numbers, strict=True):
            require_in_range(f"pressure.{name} {wheel}", number, 20e3, 1.5e6, "Pa")
    for number in jnp.ravel(jnp.asarray(course.warming)).tolist():
        require_in_range("pressure.warming", number, -500e3, 500e3, "Pa")
    for name, low in (("duration", 1e-6), ("warming_time", 1e-6), ("begin", 0.0), ("decay", 0.0)):
        for number in jnp.ravel(jnp.asarray(getattr(course, name))).tolist():
            if not (math.isfinite(number) and number >= low):
                raise InputError(f"pressure.{name}", f"{number:g} s", f"Give at least {low:g} s.")
    return course
