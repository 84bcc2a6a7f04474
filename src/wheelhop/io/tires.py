"""Tyre property files (.tir) in: Magic Formula coefficients and the vertical law."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from wheelhop.errors import InputError
from wheelhop.io.tire_properties import Properties, read_properties
from wheelhop.vehicle import magic_formula_parameters, vertical_tire
from wheelhop.vehicle.magic_formula_parameters import COEFFICIENTS, MagicFormula
from wheelhop.vehicle.vertical_tire import VerticalTire, linear_coefficient

FORMATS = ("PAC2002", "MF_05")

_OTHER_NAMES = {
    "QFZ1": ("QFZ1", "Q_FZ1"),
    "QFZ2": ("QFZ2", "Q_FZ2"),
    "QV2": ("QV2", "Q_V2"),
    "PFZ1": ("PFZ1", "P_FZ1", "QPFZ1"),
    "INFLPRES": ("INFLPRES", "IP", "INFLATION_PRESSURE"),
    "NOMPRES": ("NOMPRES", "IP_NOM"),
    "LFZO": ("LFZO", "LFZ0"),
}
_NEEDED = ("pcx1", "pdx1", "pkx1", "pcy1", "pdy1", "pky1", "pky2")
_COMBINED = ("RBX1", "RBY1", "RCX1", "RCY1")
_OF_PRESSURE = ("PFZ1", "PPX1", "PPX2", "PPX3", "PPX4", "PPY1", "PPY2", "PPY3", "PPY4")
_ASSUMED_PRESSURE = 250e3


@dataclass(frozen=True)
class TireFile:
    """What a tyre property file says.

    Attributes:
        magic_formula: slip forces.
        vertical: vertical law.
        name: of the file, without its ending.
        format: PROPERTY_FILE_FORMAT.
        side: TYRESIDE, the side the tyre was measured for, or "UNKNOWN".
        inflation_pressure: p [Pa] of the measurement; None where the file does not say.
        load_range: smallest and largest load [N] the coefficients hold for; NaN where unsaid.
        warnings: what was assumed, a sentence each.
    """

    magic_formula: MagicFormula
    vertical: VerticalTire
    name: str
    format: str
    side: str
    inflation_pressure: float | None
    load_range: tuple[float, float]
    warnings: tuple[str, ...]


def read_tire(path: Path) -> TireFile:
    """Read a tyre property file of format PAC2002 or MF_05.

    Keys the models here do not use are passed over. A file without coefficients of combined
    slip, or with FE_METHOD = 'YES', gets the friction ellipse. A deflection-load curve
    takes the place of VERTICAL_STIFFNESS, as a quadratic fitted to it.

    Args:
        path: the file.

    Raises:
        InputError: naming the file and the key or line: no such file, not a property file,
            another format or unit, a needed key missing, no number, an unphysical value.
    """
    file = read_properties(Path(path))
    kind = file.text("PROPERTY_FILE_FORMAT", "").upper()
    if kind not in FORMATS:
        raise InputError(
            f"{file.name}: PROPERTY_FILE_FORMAT",
            f"{kind!r} is not read here" if kind else "it is missing",
            f"Give a file of format {' or '.join(FORMATS)}.",
        )
    warnings = list(file.warnings)
    load = file.number("FNOMIN") * file.force
    radius = file.number("UNLOADED_RADIUS") * file.length
    pressure, nominal = _pressures(file, warnings)
    magic = _magic_formula(file, load, radius, nominal, warnings)
    vertical = _vertical(file, load, radius, nominal, warnings)
    try:
        magic_formula_parameters.validate(magic)
        vertical_tire.validate(vertical)
    except InputError as error:
        raise InputError(
            f"{file.name}: {error.field}", error.problem, "Correct that value in the file."
        ) from error
    return TireFile(
        magic_formula=magic,
        vertical=vertical,
        name=Path(path).stem,
        format=kind,
        side=file.text("TYRESIDE", "UNKNOWN").upper(),
        inflation_pressure=pressure,
        load_range=(
            file.number("FZMIN", np.nan) * file.force,
            file.number("FZMAX", np.nan) * file.force,
        ),
        warnings=tuple(warnings),
    )


def _pressures(file: Properties, warnings: list[str]) -> tuple[float | None, float]:
    """Pressure of the measurement, and the nominal one of the pressure terms [Pa]."""
    key = file.present(*_OTHER_NAMES["INFLPRES"])
    pressure = None if key is None else file.number(key) * file.pressure
    if pressure is not None and "PRESSURE" not in file.units and 0.5 < pressure < 20.0:
        warnings.append(f"{key} = {pressure:g} without a unit of pressure is taken as bar")
        pressure *= 1e5
    key = file.present(*_OTHER_NAMES["NOMPRES"])
    if key is not None:
        return pressure, file.number(key) * file.pressure
    if pressure is not None:
        return pressure, pressure
    if any(_number(file, n, 0.0) != 0.0 for n in _OF_PRESSURE):
        raise InputError(
            f"{file.name}: NOMPRES",
            "it is missing although the file has pressure coefficients",
            "Add NOMPRES, the pressure [Pa] they refer to.",
        )
    warnings.append(f"no pressure is given; {_ASSUMED_PRESSURE / 1e3:g} kPa is assumed")
    return None, _ASSUMED_PRESSURE


def _magic_formula(
    file: Properties, load: float, radius: float, nominal: float, warnings: list[str]
) -> MagicFormula:
    values: dict[str, float] = {}
    for name in COEFFICIENTS:
        key = name.upper()
        if name in _NEEDED:
            values[name] = file.number(key)
        elif file.present(*_OTHER_NAMES.get(key, (key,))):
            values[name] = _number(file, key, 0.0)
    if values["pky1"] > 0.0:
        raise InputError(
            f"{file.name}: PKY1",
            f"{values['pky1']:g} is positive, so the file uses SAE axes",
            "Give a file in the ISO (W) axes of the wheel, where PKY1 is negative.",
        )
    if values.get("pty2", 1.0) == 0.0:
        del values["pty2"]
    if values.get("pty1", 0.0) == 0.0 or values.get("ptx1", 0.0) == 0.0:
        warnings.append("a relaxation length is missing (PTX1, PTY1); its floor of 0.1 m is used")
    ellipse = file.text("FE_METHOD", "").upper() == "YES"
    if not ellipse and all(_number(file, key, 0.0) == 0.0 for key in _COMBINED):
        ellipse = True
        warnings.append("no coefficients of combined slip; the friction ellipse is used")
    right = file.text("TYRESIDE", "").upper() == "RIGHT"
    mirrored = file.number("USE_MODE", 0.0) < 0.0
    if mirrored:
        warnings.append("USE_MODE is negative: the tyre is mirrored")
    tire = MagicFormula(
        rated_load=load,
        unloaded_radius=radius,
        nominal_pressure=nominal,
        friction_ellipse=ellipse,
        **values,
    )
    return replace(tire, measured_side=-1.0 if right != mirrored else 1.0)


def _vertical(
    file: Properties, load: float, radius: float, nominal: float, warnings: list[str]
) -> VerticalTire:
    q_fz1, q_fz2 = _number(file, "QFZ1", 0.0), _number(file, "QFZ2", 0.0)
    curve = file.tables.get("DEFLECTION_LOAD_CURVE", [])
    if len(curve) > 2 and q_fz1 == 0.0:
        q_fz1, q_fz2 = _fit_curve(file, curve, load, radius, warnings)
    elif q_fz1 == 0.0:
        stiffness = file.number("VERTICAL_STIFFNESS") * file.force / file.length
        q_fz1 = linear_coefficient(stiffness, q_fz2, radius, load)
    return VerticalTire(
        unloaded_radius=radius,
        rated_load=load,
        q_fz1=q_fz1,
        q_fz2=q_fz2,
        pressure_coefficient=_number(file, "PFZ1", 0.0),
        nominal_pressure=nominal,
        speed_coefficient=_number(file, "QV2", 0.0),
        reference_speed=file.number("LONGVL", 16.7 / file.length) * file.length,
        damping=file.number("VERTICAL_DAMPING", 0.0) * file.force / file.length,
        b_reff=file.number("BREFF", 8.0),
        d_reff=file.number("DREFF", 0.25),
        f_reff=file.number("FREFF", 0.01),
    )


def _fit_curve(
    file: Properties, curve: list[list[float]], load: float, radius: float, warnings: list[str]
) -> tuple[float, float]:
    """Coefficients of the quadratic law nearest to a deflection-load curve."""
    points = np.asarray(curve, float)
    strain = points[:, 0] * file.length / radius
    force = points[:, 1] * file.force / load
    basis = np.stack([strain, strain * strain], axis=1)
    found = np.linalg.lstsq(basis, force, rcond=None)[0]
    misfit = np.abs(basis @ found - force).max() / np.abs(force).max()
    if misfit > 0.02:
        warnings.append(
            f"the quadratic law misses the deflection-load curve by up to {misfit:.1%} of its "
            "largest load"
        )
    return float(found[0]), float(found[1])


def _number(file: Properties, key: str, default: float) -> float:
    name = file.present(*_OTHER_NAMES.get(key, (key,)))
    return default if name is None else file.number(name)
