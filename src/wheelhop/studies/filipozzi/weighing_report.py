"""Chapter of the mass at rest: claims, table, figure, numbers."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from wheelhop.estimators.mass_at_rest import RestEstimate
from wheelhop.io.report import FAILS, HOLDS, IN_PART, DataTable, Finding
from wheelhop.plots.load_weighing import plot_weighing
from wheelhop.studies.filipozzi.settings import FilipozziSettings
from wheelhop.studies.filipozzi.weighing import (
    ABOVE,
    BEHIND,
    EQUILIBRIUM,
    PAYLOAD,
    PRINTED,
    STANDS,
    Weighing,
)
from wheelhop.studies.frame import StudyFigure

_GOOD = 0.01
_WORDS = {EQUILIBRIUM: "equilibrium of the body", PRINTED: "Eq. 35 as printed"}


def weighing_in_words(settings: FilipozziSettings) -> tuple[str, ...]:
    """What was done."""
    del settings
    return (
        f"Our SUV with {PAYLOAD:g} kg that move the body's centre of mass {100 * BEHIND:g} cm back "
        f"and {100 * ABOVE:g} cm up stands still; sensors are exact. Eq. 35 sets k q of a corner "
        "against the algebraic load; the other method sets up heave, pitch and roll of the body on "
        "its four spring forces, on the slope that the accelerometers show.",
    )


def errors(result: Weighing, estimate: RestEstimate) -> np.ndarray:
    """Of mass [%], l_F [mm] and h [mm], [3]."""
    true, found = result.true, estimate.distribution
    return np.array(
        [
            100.0 * (float(found.mass) / float(true.mass) - 1.0),
            1e3 * (float(found.front_distance) - float(true.front_distance)),
            1e3 * (float(found.height) - float(true.height)),
        ]
    )


def weighing_findings(result: Weighing) -> list[Finding]:
    """What the paper says of the mass, against what is."""
    level = result.estimates["level"]
    slope = result.estimates["20 % slope"]
    both = result.estimates["20 % slope and 0.1 rad bank"]
    ranks = {name: found[PRINTED].rank for name, found in result.estimates.items()}
    one_stand = [name for name, slopes in STANDS.items() if len(slopes) == 1]
    enough = [name for name in one_stand if ranks[name] == 4]
    mass_off = max(abs(errors(result, found[PRINTED])[0]) for found in (level, slope)) / 100.0
    ratio = result.stiffness[1.5] / result.stiffness[1.0]
    two = result.estimates["level, then 20 % slope"][EQUILIBRIUM]
    return [
        Finding(
            "Section 5, Eq. 35",
            "The four deflections give mass and place of the centre of mass, height included: four "
            "equations, four unknowns.",
            "Rank of the printed equations: "
            + ", ".join(f"{name} {ranks[name]}" for name in one_stand)
            + f"; condition number {both[PRINTED].condition:.0f} where it is 4.",
            HOLDS if len(enough) == len(one_stand) else IN_PART if enough else FAILS,
            "On level ground the height does not occur, on a slope one way it trades with l_F; a "
            "slope both ways tells it by h^2 a_x a_y alone, which is not what warps a real car's "
            "springs. Two stands of different slope tell it: to "
            f"{abs(errors(result, two)[2]):.1f} mm by the equilibrium of the body.",
        ),
        Finding(
            "Section 5",
            "The vehicle's mass is found when it stands, on a slope too.",
            f"Mass off by {errors(result, level[PRINTED])[0]:+.2f} % on level ground and "
            f"{errors(result, slope[PRINTED])[0]:+.2f} % on the slope as printed; "
            f"{errors(result, slope[EQUILIBRIUM])[0]:+.3f} % by equilibrium.",
            HOLDS if mass_off < _GOOD else IN_PART if mass_off < 5 * _GOOD else FAILS,
            "Eq. 32 has g where the slope leaves g cos(angle) on the springs.",
        ),
        Finding(
            "Section 6, Fig. 8",
            "A wrong stiffness of the springs spoils the mass.",
            f"Springs 1.5 times as stiff as believed weigh {ratio:.3f} of the body's mass.",
            HOLDS if abs(ratio * 1.5 - 1.0) < 0.05 else FAILS,
            "k q is proportional to k where deflections count from the free spring; counted from "
            "rest with a known mass there is no such error.",
        ),
    ]


def weighing_tables(result: Weighing) -> list[DataTable]:
    """Errors of every stand and method."""
    rows = [(s, m, e) for s, found in result.estimates.items() for m, e in found.items()]
    off = [errors(result, e) for _, _, e in rows]
    return [
        DataTable(
            "Mass and centre of mass from deflections at rest",
            {
                "stand": [s for s, _, _ in rows],
                "method": [_WORDS[m] for _, m, _ in rows],
                "mass [%]": [f"{o[0]:+.2f}" for o in off],
                "l_F [mm]": [f"{o[1]:+.1f}" for o in off],
                "h [mm]": [
                    "not told" if e.kept else f"{o[2]:+.1f}"
                    for o, (_, _, e) in zip(off, rows, strict=True)
                ],
                "rank": [e.rank for _, _, e in rows],
                "condition": [
                    f"{e.condition:.0f}" if np.isfinite(e.condition) else "infinite"
                    for _, _, e in rows
                ],
                "sigma of mass [kg]": [float(e.sigma[0]) for _, _, e in rows],
            },
            "Errors with exact sensors; sigma for mean deflections known to 0.05 mm. A height that "
            "is not told keeps that of the empty vehicle, and l_F bears a part of its error.",
        )
    ]


def weighing_figures(result: Weighing) -> Iterator[StudyFigure]:
    """Errors of every stand and method."""
    found = {
        _WORDS[m]: np.array([errors(result, e[m]) for e in result.estimates.values()])
        for m in (EQUILIBRIUM, PRINTED)
    }
    told = {
        _WORDS[m]: np.array([not e[m].kept for e in result.estimates.values()])
        for m in (EQUILIBRIUM, PRINTED)
    }
    columns: dict[str, Any] = {"stand": list(result.estimates)}
    for m, values in zip((EQUILIBRIUM, PRINTED), found.values(), strict=True):
        for k, name in enumerate(("mass", "front_distance", "height")):
            columns[f"{m}_{name}_error"] = values[:, k]
    units = {n: "%" if "mass" in n else "mm" for n in columns if n != "stand"}
    yield StudyFigure(
        "mass_at_rest",
        plot_weighing(list(result.estimates), found, told),
        columns,
        units,
        "Mass and centre of mass of a laden vehicle at rest, by the equilibrium of the body and by "
        "Eq. 35, on level ground and on a slope.",
    )


def weighing_numbers(result: Weighing) -> dict[str, Any]:
    """Every figure; SI units."""
    return {
        "true": {k: float(v) for k, v in result.true._asdict().items()},
        "estimates": {
            s: {
                m: {
                    **{k: float(v) for k, v in e.distribution._asdict().items()},
                    "body_mass": e.body_mass,
                    "sigma": e.sigma.tolist(),
                    "kept": list(e.kept),
                    "rank": e.rank,
                    "singular_values": e.singular_values.tolist(),
                }
                for m, e in found.items()
            }
            for s, found in result.estimates.items()
        },
        "body_mass_by_stiffness_factor": {f"{f:g}": m for f, m in result.stiffness.items()},
    }
