"""What the full vehicle shows of the method, in plain words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from wheelhop.estimators.lateral_vehicle import CORNERING, HELD, SURE
from wheelhop.io.report import FAILS, HOLDS, Finding
from wheelhop.studies.frame import verdict_of
from wheelhop.studies.solmaz.full_vehicle import BANK, SWITCHED, FullVehicleResult
from wheelhop.studies.solmaz.full_vehicle_measures import (
    RIGHT,
    false_names,
    sure_and_wrong,
    tally,
    times,
    works_from,
)
from wheelhop.studies.solmaz.full_vehicle_tables import lost_stiffness
from wheelhop.studies.solmaz.vehicle_conditions import (
    MAIN,
    NO_EFFECT,
    OPPOSITE,
    OPPOSITE_KNOWN,
    STRAIGHT,
    STRAIGHT_ROUGH,
)

RARE = 0.02
"""Share of runs in which something wrong is told, up to which that is called rare."""

SOON = 3.0
"""Time after the onset of steering [s] by which a detection is called early."""

_PLACE = "14-degree-of-freedom vehicle"


def full_vehicle_findings(result: FullVehicleResult) -> list[Finding]:
    """In the order of the chapter; a quick study has no conditions."""
    found = [_main(result), _trust(result), _time(result), _observer(result), _straight(result)]
    names = result.conditions
    roads = [n for n in names if n.startswith("friction")]
    if roads:
        found.append(_robust(result, roads, "a slippery road is not called a soft tyre"))
    loads = [n for n in names if n.endswith("load")]
    if loads:
        found.append(_robust(result, loads, "the load may differ by 20 %, unknown"))
    others = [
        n for n in ("open-loop steering", "three times the offsets", "road class B") if n in names
    ]
    if others:
        found.append(
            _robust(result, others, "open-loop steering, large offsets and a rough road do no harm")
        )
    pressures = [n for n in names if n.startswith("soft tyres of")]
    if pressures:
        found.append(_robust(result, pressures, "the soft tyres need not be as soft as believed"))
    if OPPOSITE in names:
        found += [_opposite(result), _no_effect(result)]
    return found


def _main(result: FullVehicleResult) -> Finding:
    outcome = result.outcomes[MAIN]
    t, edge = tally(outcome), works_from(outcome)
    where = f"from {edge:g} m/s^2 on" if np.isfinite(edge) else "nowhere"
    where = where if edge else "at every strength tried"
    return Finding(
        _PLACE,
        f"all four tyres are told right in at least {RIGHT:.0%} of the lane changes",
        f"{t.right.value:.1%} of {t.runs} runs ({t.right.low:.1%} to {t.right.high:.1%}); as "
        f"often as claimed {where}",
        verdict_of([t.right.value >= RIGHT]),
        f"Most probable combination at the end. {t.lost} further runs lost control.",
    )


def _trust(result: FullVehicleResult) -> Finding:
    t = tally(result.outcomes[MAIN])
    return Finding(
        _PLACE,
        "what is told can be trusted",
        f"told in {t.told:.1%} of the runs; at the end a sound tyre is called soft in "
        f"{t.outcomes[4]:.1%} of all, a soft one missed in {t.outcomes[3]:.1%}; at some time "
        f"something wrong is told in {t.ever:.1%}",
        verdict_of([t.outcomes[4] <= RARE, t.outcomes[3] <= RARE, t.ever <= RARE]),
        f"Told means a probability of {SURE:g} for {HELD:g} s, once the lateral acceleration over "
        f"half a second has reached {CORNERING:g} m/s^2.",
    )


def _time(result: FullVehicleResult) -> Finding:
    found = times(result, BANK)
    median, most = (float(np.quantile(found, q, method="inverted_cdf")) for q in (0.5, 0.9))
    return Finding(
        _PLACE,
        f"the soft tyre is named within {SOON:g} s of the onset of steering",
        f"for good after {median:.1f} s (median), {most:.1f} s (nine of ten runs)",
        verdict_of([median <= SOON, most <= SOON]),
        "Runs that are wrong at the end count as never.",
    )


def _observer(result: FullVehicleResult) -> Finding:
    t = tally(result.outcomes[MAIN])
    return Finding(
        _PLACE,
        "the switched models with an observer do as well on the same records",
        f"{t.switched.value:.1%} of the runs are right at the end, by the bank {t.right.value:.1%}",
        HOLDS if t.switched.high >= t.right.low else FAILS,
        "They know neither offsets of the sensors nor friction nor what their model leaves out.",
    )


def _straight(result: FullVehicleResult) -> Finding:
    names = [n for n in (STRAIGHT, STRAIGHT_ROUGH) if n in result.outcomes]
    tallies = [tally(result.outcomes[n]) for n in names]
    said = "; ".join(
        f"{n}: something is told in {t.told:.1%} of {t.runs} runs (sure but silent and wrong in "
        f"{sure_and_wrong(result.outcomes[n]):.1%}), the switched models call a sound tyre soft in "
        f"{false_names(result.outcomes[n], SWITCHED):.1%}"
        for n, t in zip(names, tallies, strict=True)
    )
    return Finding(
        _PLACE,
        "nothing is told while driving straight ahead",
        said,
        verdict_of(t.told == 0.0 for t in tallies),
        "Straight ahead a soft tyre cannot be seen: all combinations move alike.",
    )


def _robust(result: FullVehicleResult, names: Sequence[str], claim: str) -> Finding:
    tallies = [tally(result.outcomes[n]) for n in names]
    said = "; ".join(
        f"{n}: {t.right.value:.0%} right, {t.wrong:.0%} told wrong"
        + (f", {t.lost} of {t.lost + t.runs} lost control" if t.lost else "")
        for n, t in zip(names, tallies, strict=True)
    )
    good = [t.right.value >= RIGHT for t in tallies]
    honest = [t.wrong <= RARE for t in tallies]
    return Finding(
        _PLACE,
        claim,
        said,
        verdict_of(good + honest),
        f"Half of the tests: {RIGHT:.0%} right; the other half: told wrong in at most {RARE:.0%}.",
    )


def _opposite(result: FullVehicleResult) -> Finding:
    unknown, known = (tally(result.outcomes[n]) for n in (OPPOSITE, OPPOSITE_KNOWN))
    gain = -lost_stiffness("published")
    return Finding(
        _PLACE,
        "the method needs the sign of the pressure's effect on the cornering stiffness",
        f"tyres that gain {gain:.0%} of stiffness as they lose pressure, judged as if they lost "
        f"{lost_stiffness('falling'):.0%}: {unknown.right.value:.0%} right, in "
        f"{unknown.outcomes[4]:.0%} a sound tyre is called soft; judged as what they are: "
        f"{known.right.value:.0%} right, {known.wrong:.0%} told wrong",
        verdict_of([unknown.right.value < RIGHT, known.right.value > unknown.right.value]),
        "Tyres of both kinds are published; which kind a car has must be known beforehand.",
    )


def _no_effect(result: FullVehicleResult) -> Finding:
    t = tally(result.outcomes[NO_EFFECT])
    return Finding(
        _PLACE,
        "where pressure has no effect on the lateral force, nothing wrong is told",
        f"a sound tyre is called soft in {t.outcomes[4]:.0%} of the runs; that there is no soft "
        f"tyre, or fewer than there are, is told in {t.outcomes[3]:.0%}",
        verdict_of([t.outcomes[4] <= RARE, t.outcomes[3] <= RARE]),
        "A soft tyre that corners as a sound one is told to be sound: what is told is the loss of "
        "cornering stiffness, not the pressure.",
    )
