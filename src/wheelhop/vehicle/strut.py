"""Spring, damper, stops and anti-roll bar of a full vehicle's corners."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp

from wheelhop.errors import InputError, require_in_range
from wheelhop.vehicle.curve import Curve, curve, value

_SMOOTH_SPEED = 1e-3


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Damper:
    """Digressive damper, stiffer in extension, optionally linear or signed-quadratic.

    Attributes:
        damping: c [Ns/m], slope at rest.
        asymmetry: a [-], |a| <= 0.8 so that the force rises with speed everywhere;
            extension : compression = (1 + a) : (1 - a).
        knee: w_b [m/s], width of the passage from one to the other.
        digression: d [s/m]; 0 for a damper that does not fade with speed.
        quadratic: c_2 [Ns^2/m^2] of a signed-quadratic part.
    """

    damping: Any
    asymmetry: Any = 0.0
    knee: Any = 0.1
    digression: Any = 0.0
    quadratic: Any = 0.0


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Strut:
    """Suspension of the corners, [4] each (or [] where all are alike).

    Attributes:
        preload: force [N] at zero compression.
        stiffness: k [N/m].
        cubic_stiffness: k_3 [N/m^3].
        damper: the damper's law.
        bump_clearance: compression [m] at which the bump stop is met.
        rebound_clearance: extension [m] at which the rebound stop is met.
        stop: force [N] of a stop over its penetration [m].
        spring_map: further spring force [N] over compression [m], or None.
        damper_map: further damper force [N] over compression speed [m/s], or None.
    """

    preload: Any
    stiffness: Any
    cubic_stiffness: Any
    damper: Damper
    bump_clearance: Any
    rebound_clearance: Any
    stop: Curve
    spring_map: Curve | None = None
    damper_map: Curve | None = None


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class AntiRollBars:
    """Stiffness [N/m] of each axle's bar: force per difference of the two compressions."""

    front: Any = 0.0
    rear: Any = 0.0


def default_stop() -> Curve:
    """A rubber stop: 100 N/mm to 10 mm, 12.5 kN at 50 mm, then nearly rigid; no kink at contact."""
    millimetres = (0.0, 2.0, 4.0, 6.0, 8.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0)
    newtons = (0.0, 200.0, 400.0, 600.0, 800.0, 1e3, 2.5e3, 4.5e3, 7.5e3, 12.5e3, 125e3)
    return curve([1e-3 * p for p in millimetres], newtons, (0.0, None))


def spring_force(compression: Any, strut: Strut) -> Any:
    """Force [N] of spring and stops that pushes the body up, at compression s [m].

    S = S_0 + k s + k_3 s^3 + stop(s - s_bump) - stop(-s - s_rebound).
    """
    s = compression
    force = strut.preload + strut.stiffness * s + strut.cubic_stiffness * s * s * s
    force = force + value(strut.stop, s - strut.bump_clearance)
    force = force - value(strut.stop, -s - strut.rebound_clearance)
    return force if strut.spring_map is None else force + value(strut.spring_map, s)


def damper_force(speed: Any, strut: Strut) -> Any:
    """Force [N] of the damper that pushes the body up, at compression speed w = s' [m/s].

    c w (1 - a tanh(w / w_b)) / (1 + d |w|) + c_2 w|w|, |w| smoothed within 1 mm/s.
    """
    d, w = strut.damper, speed
    fading = 1.0 + d.digression * jnp.sqrt(w * w + _SMOOTH_SPEED**2)
    force = d.damping * w * (1.0 - d.asymmetry * jnp.tanh(w / d.knee)) / fading
    force = force + d.quadratic * w * jnp.abs(w)
    return force if strut.damper_map is None else force + value(strut.damper_map, w)


def anti_roll_force(compression: Any, bars: AntiRollBars) -> Any:
    """Force [N] of the anti-roll bars that pushes the body up, at compressions [4, ...] [m]."""
    s = compression
    front, rear = bars.front * (s[0] - s[1]), bars.rear * (s[2] - s[3])
    return jnp.stack([front, -front, rear, -rear])


def validate(strut: Strut, bars: AntiRollBars) -> None:
    """Check what a suspension can have.

    Raises:
        InputError: naming the parameter that is out of physical range.
    """
    fields = (
        ("preload", 0.0, 2e5, "N"),
        ("stiffness", 1e3, 1e6, "N/m"),
        ("cubic_stiffness", 0.0, 1e9, "N/m^3"),
        ("bump_clearance", 1e-3, 1.0, "m"),
        ("rebound_clearance", 1e-3, 1.0, "m"),
    )
    for name, low, high, unit in fields:
        _require_all(f"strut.{name}", getattr(strut, name), low, high, unit)
    damper = (
        ("damping", 0.0, 1e5, "Ns/m"),
        ("asymmetry", -0.8, 0.8, "(no unit)"),
        ("knee", 1e-3, 10.0, "m/s"),
        ("digression", 0.0, 100.0, "s/m"),
        ("quadratic", 0.0, 1e5, "Ns^2/m^2"),
    )
    for name, low, high, unit in damper:
        _require_all(f"damper.{name}", getattr(strut.damper, name), low, high, unit)
    for name in ("front", "rear"):
        _require_all(f"anti_roll.{name}", getattr(bars, name), 0.0, 1e6, "N/m")
    if float(strut.stop.y[0]) != 0.0 or float(strut.stop.x[0]) != 0.0:
        raise InputError("strut.stop", "it does not begin at (0, 0)", "Begin it there.")
    if float(strut.stop.slope[0]) != 0.0:
        raise InputError("strut.stop", "it pulls before contact", "Give it zero slope at (0, 0).")


def _require_all(name: str, values: Any, low: float, high: float, unit: str) -> None:
    for number in jnp.ravel(jnp.asarray(values)).tolist():
        require_in_range(name, number, low, high, unit)
