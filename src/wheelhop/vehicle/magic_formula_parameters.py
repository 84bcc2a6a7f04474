"""Coefficients of the Magic Formula, and a generic passenger-car set."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any

import jax

from wheelhop.errors import InputError, require_in_range


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class MagicFormula:
    """Slip-force coefficients of a tyre, named like the keys of tyre property files.

    Each entry is a number, or an array that broadcasts against the slips. Coefficients act in
    the ISO axis system of the wheel: a usual tyre has pky1 < 0.

    Attributes:
        rated_load: Fz0 [N], key FNOMIN.
        unloaded_radius: R0 [m].
        nominal_pressure: p0 [Pa], gauge.
        side: side of the vehicle the tyre is mounted on: +1 left, -1 right.
        measured_side: side it was measured for; a tyre on the other side is its mirror image.
        minimum_relaxation: floor of both relaxation lengths [m].
        friction_ellipse: combine the slips by the friction ellipse, for a tyre measured at pure
            slip only, instead of the weighting functions rbx1 to rvy6.
        pcx1..pvx2: pure longitudinal slip. pcy1..pvy4: pure lateral slip.
        rbx1..rhx1, rby1..rvy6: combined slip. ppx1..ppx4, ppy1..ppy4: inflation pressure.
        ptx1..ptx3, pty1, pty2: relaxation lengths. lfzo..lsgal: scaling factors.
    """

    rated_load: Any
    unloaded_radius: Any
    pcx1: Any
    pdx1: Any
    pkx1: Any
    pcy1: Any
    pdy1: Any
    pky1: Any
    pky2: Any
    nominal_pressure: Any = 250e3
    side: Any = 1.0
    measured_side: Any = 1.0
    minimum_relaxation: Any = 0.1

    pdx2: Any = 0.0
    pdx3: Any = 0.0
    pex1: Any = 0.0
    pex2: Any = 0.0
    pex3: Any = 0.0
    pex4: Any = 0.0
    pkx2: Any = 0.0
    pkx3: Any = 0.0
    phx1: Any = 0.0
    phx2: Any = 0.0
    pvx1: Any = 0.0
    pvx2: Any = 0.0
    rbx1: Any = 0.0
    rbx2: Any = 0.0
    rbx3: Any = 0.0
    rcx1: Any = 0.0
    rex1: Any = 0.0
    rex2: Any = 0.0
    rhx1: Any = 0.0
    ppx1: Any = 0.0
    ppx2: Any = 0.0
    ppx3: Any = 0.0
    ppx4: Any = 0.0
    ptx1: Any = 0.0
    ptx2: Any = 0.0
    ptx3: Any = 0.0

    pdy2: Any = 0.0
    pdy3: Any = 0.0
    pey1: Any = 0.0
    pey2: Any = 0.0
    pey3: Any = 0.0
    pey4: Any = 0.0
    pky3: Any = 0.0
    pky4: Any = 2.0
    pky5: Any = 0.0
    phy1: Any = 0.0
    phy2: Any = 0.0
    phy3: Any = 0.0
    pvy1: Any = 0.0
    pvy2: Any = 0.0
    pvy3: Any = 0.0
    pvy4: Any = 0.0
    rby1: Any = 0.0
    rby2: Any = 0.0
    rby3: Any = 0.0
    rby4: Any = 0.0
    rcy1: Any = 0.0
    rey1: Any = 0.0
    rey2: Any = 0.0
    rhy1: Any = 0.0
    rhy2: Any = 0.0
    rvy1: Any = 0.0
    rvy2: Any = 0.0
    rvy3: Any = 0.0
    rvy4: Any = 0.0
    rvy5: Any = 0.0
    rvy6: Any = 0.0
    ppy1: Any = 0.0
    ppy2: Any = 0.0
    ppy3: Any = 0.0
    ppy4: Any = 0.0
    pty1: Any = 0.0
    pty2: Any = 1.0

    lfzo: Any = 1.0
    lcx: Any = 1.0
    lmux: Any = 1.0
    lex: Any = 1.0
    lkx: Any = 1.0
    lhx: Any = 1.0
    lvx: Any = 1.0
    lgax: Any = 1.0
    lxal: Any = 1.0
    lsgkp: Any = 1.0
    lcy: Any = 1.0
    lmuy: Any = 1.0
    ley: Any = 1.0
    lky: Any = 1.0
    lhy: Any = 1.0
    lvy: Any = 1.0
    lgay: Any = 1.0
    lyka: Any = 1.0
    lvyka: Any = 1.0
    lsgal: Any = 1.0
    friction_ellipse: bool = field(default=False, metadata={"static": True})


_OF_THE_WHEEL = (
    "rated_load",
    "unloaded_radius",
    "nominal_pressure",
    "side",
    "measured_side",
    "minimum_relaxation",
    "friction_ellipse",
)

COEFFICIENTS = tuple(f.name for f in fields(MagicFormula) if f.name not in _OF_THE_WHEEL)
"""The fields of `MagicFormula` that are keys of a tyre property file, in lower case."""


def generic_passenger_tire(
    rated_load: float = 5000.0,
    unloaded_radius: float = 0.36,
    nominal_pressure: float = 250e3,
    **others: Any,
) -> MagicFormula:
    """A symmetric passenger-car tyre of round numbers; chosen here, measured nowhere.

    At the rated load: peak friction 1.1 longitudinal and 1.0 lateral, slip stiffness 22 Fz0,
    cornering stiffness 16 Fz0 per radian, relaxation lengths 0.70 R0 longitudinal and 1.12 R0
    lateral (0.25 and 0.40 m at R0 = 0.36 m). Friction and cornering stiffness per load fall as
    the load grows. Pressure changes nothing unless ppx1..ppx4, ppy1..ppy4 are given.

    Args:
        rated_load: Fz0 [N].
        unloaded_radius: R0 [m].
        nominal_pressure: p0 [Pa].
        **others: further fields of `MagicFormula`, in place of the values here.
    """
    values: dict[str, Any] = {
        "pcx1": 1.6,
        "pdx1": 1.1,
        "pdx2": -0.1,
        "pex1": 0.3,
        "pkx1": 22.0,
        "pkx3": 0.2,
        "rbx1": 13.0,
        "rbx2": -8.0,
        "rcx1": 1.0,
        "ptx1": 0.7,
        "pcy1": 1.4,
        "pdy1": 1.0,
        "pdy2": -0.15,
        "pey1": -0.5,
        "pky1": -20.0,
        "pky2": 2.0,
        "phy3": 0.03,
        "pvy3": -0.3,
        "rby1": 11.0,
        "rby2": 6.0,
        "rcy1": 1.0,
        "pty1": 1.4,
        "pty2": 2.0,
    }
    return MagicFormula(
        rated_load=rated_load,
        unloaded_radius=unloaded_radius,
        nominal_pressure=nominal_pressure,
        **{**values, **others},
    )


def validate(tire: MagicFormula) -> MagicFormula:
    """The same coefficients, checked; for a tyre of plain numbers on one wheel.

    Raises:
        InputError: naming the coefficient that is out of range.
    """
    require_in_range("magic_formula.rated_load", tire.rated_load, 100.0, 2e5, "N")
    require_in_range("magic_formula.unloaded_radius", tire.unloaded_radius, 0.1, 2.0, "m")
    require_in_range("magic_formula.nominal_pressure", tire.nominal_pressure, 5e4, 1.5e6, "Pa")
    require_in_range("magic_formula.minimum_relaxation", tire.minimum_relaxation, 0.01, 2.0, "m")
    for name in ("pcx1", "pcy1"):
        require_in_range(f"magic_formula.{name}", getattr(tire, name), 0.1, 3.0, "(no unit)")
    for name in ("pdx1", "pdy1"):
        size = abs(float(getattr(tire, name)))
        require_in_range(f"magic_formula.{name}", size, 0.01, 5.0, "(no unit)")
    require_in_range("magic_formula.pkx1", tire.pkx1, 0.1, 200.0, "(no unit)")
    require_in_range("magic_formula.pky1", tire.pky1, -1e4, -0.1, "(no unit)")
    require_in_range("magic_formula.pky2", tire.pky2, 0.01, 1e4, "(no unit)")
    for name in ("side", "measured_side"):
        value = float(getattr(tire, name))
        if value not in (-1.0, 1.0):
            raise InputError(
                f"magic_formula.{name}", f"{value:g} is no side", "Use +1 for left, -1 for right."
            )
    return tire
