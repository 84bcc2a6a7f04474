"""Quarter-car parameters in and out, as TOML."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from wheelhop.errors import InputError
from wheelhop.io.results import write_atomically
from wheelhop.io.settings import read_toml
from wheelhop.vehicle.parameters import QuarterCar, validate
from wheelhop.vehicle.suspension import Suspension
from wheelhop.vehicle.tire import Tire

_SECTIONS = {
    "quarter_car": {"sprung_mass": "kg", "unsprung_mass": "kg"},
    "suspension": {
        "stiffness": "N/m",
        "cubic_stiffness": "N/m^3",
        "damping": "Ns/m",
        "quadratic_damping": "Ns^2/m^2",
    },
    "tire": {
        "stiffness": "N/m at the nominal pressure",
        "nominal_pressure": "Pa",
        "pressure_coefficient": "p_Fz1, relative stiffness per relative pressure",
        "damping": "Ns/m",
    },
}
_DEFAULTS = {("tire", "damping"): 0.0}


def read_vehicle(path: Path) -> QuarterCar:
    """Read and check a quarter car.

    Raises:
        InputError: naming the section and key that is missing, unknown, not a number or out of
            physical range.
    """
    content = read_toml(Path(path))
    values = {section: _section(Path(path), content, section) for section in _SECTIONS}
    for section in content:
        if section not in _SECTIONS:
            raise InputError(
                f"{path} [{section}]", "this section is unknown", f"Use {list(_SECTIONS)}."
            )
    return validate(
        QuarterCar(
            **values["quarter_car"],
            suspension=Suspension(**values["suspension"]),
            tire=Tire(**values["tire"]),
        )
    )


def write_vehicle(
    path: Path, car: QuarterCar, comment: str = "", notes: Mapping[str, str] | None = None
) -> Path:
    """Write a quarter car as TOML that `read_vehicle` reads, every line with its unit.

    Args:
        path: of the file.
        car: parameters.
        comment: lines above the first section.
        notes: to put behind the unit of a parameter, by its name (`suspension.damping`).
    """
    notes = {} if notes is None else notes
    parts: dict[str, Any] = {"quarter_car": car, "suspension": car.suspension, "tire": car.tire}
    lines = [f"# {line}" for line in comment.splitlines()]
    for section, keys in _SECTIONS.items():
        lines += ["", f"[{section}]"]
        for key, unit in keys.items():
            note = notes.get(f"{section}.{key}", "")
            number = float(getattr(parts[section], key))
            lines.append(f"{key} = {number!r}  # {unit}{'; ' if note else ''}{note}")
    text = "\n".join(lines).lstrip() + "\n"
    return write_atomically(Path(path), lambda p: p.write_text(text, encoding="utf-8"))


def _section(path: Path, content: dict[str, Any], section: str) -> dict[str, float]:
    found = content.get(section)
    if not isinstance(found, dict):
        raise InputError(f"{path} [{section}]", "this section is missing", "Add it.")
    expected = _SECTIONS[section]
    for key in found:
        if key not in expected:
            raise InputError(
                f"{path} [{section}]", f"{key!r} is unknown", f"Use {', '.join(expected)}."
            )
    found = {k: v for (s, k), v in _DEFAULTS.items() if s == section} | found
    for key, unit in expected.items():
        if key not in found:
            raise InputError(f"{section}.{key}", f"{path} lacks it", f"Add it in {unit}.")
        if isinstance(found[key], bool) or not isinstance(found[key], (int, float)):
            raise InputError(
                f"{section}.{key}", f"{found[key]!r} is not a number", f"Give it in {unit}."
            )
    return {k: float(found[k]) for k in expected}
