"""Units a log may declare, and their factors to SI."""

from __future__ import annotations

import math

from wheelhop.errors import InputError

STANDARD_GRAVITY = 9.80665

UNITS: dict[str, dict[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0},
    "acceleration": {
        "m/s^2": 1.0,
        "g": STANDARD_GRAVITY,
        "mg": 1e-3 * STANDARD_GRAVITY,
        "mm/s^2": 1e-3,
    },
    "speed": {"m/s": 1.0, "km/h": 1.0 / 3.6, "mph": 0.44704, "kn": 1852.0 / 3600.0},
    "pressure": {"Pa": 1.0, "kPa": 1e3, "bar": 1e5, "psi": 6894.757293168},
    "length": {"m": 1.0, "km": 1e3, "mm": 1e-3, "cm": 1e-2, "ft": 0.3048, "in": 0.0254},
    "force": {"N": 1.0, "kN": 1e3, "lbf": 4.4482216152605},
    "angle": {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180.0},
    "angular speed": {"rad/s": 1.0, "mrad/s": 1e-3, "deg/s": math.pi / 180.0},
}

_SPELLINGS = {
    "m/s2": "m/s^2",
    "m/s²": "m/s^2",
    "m/s**2": "m/s^2",
    "kph": "km/h",
    "kmh": "km/h",
    "°": "deg",
    "°/s": "deg/s",
}


def to_si(field: str, quantity: str, unit: str) -> float:
    """Factor from a unit to SI.

    Args:
        field: column the unit belongs to, for the message.
        quantity: a key of `UNITS`.
        unit: as declared.

    Raises:
        InputError: if the unit is not one of the quantity's.
    """
    name = _SPELLINGS.get(unit.strip(), unit.strip())
    known = UNITS[quantity]
    if name not in known:
        raise InputError(
            field, f"{unit!r} is not a unit of {quantity}", f"Declare one of {', '.join(known)}."
        )
    return known[name]
