"""What the paper says of its estimators in the maneuvers of Fig. 5, 6 and 7, against our numbers.

Errors that follow from geometry or from the shaping filter are computed from the drive alone, so
that a finding's reason can be checked beside its number.
"""

from __future__ import annotations

import math

import numpy as np

from wheelhop.io.report import Finding
from wheelhop.studies.filipozzi.drives import (
    BRAKE,
    LANE_CHANGE,
    ROAD,
    SLOPE,
    SWEEP,
    Drive,
)
from wheelhop.studies.filipozzi.maneuvers import (
    ALGEBRAIC,
    CLOSE,
    SETTLED,
    Maneuvers,
    Score,
    scores,
)
from wheelhop.studies.filipozzi.maneuvers_claims_beyond import (
    bars_claim,
    derivative_claim,
    joint_claim,
    sum_claim,
    wheel_hop_claim,
    wheel_sensors_claim,
)
from wheelhop.studies.filipozzi.maneuvers_measures import (
    GOOD,
    OBSERVERS,
    PAPER_DRIVES,
    SIMILAR,
    body_frequency,
    distribution,
    inner,
    rms,
    short,
    static_part,
    steady,
    tilt_error,
    waves,
)
from wheelhop.studies.filipozzi.methods import UNBIASED, YOULA
from wheelhop.studies.frame import verdict_of
from wheelhop.vehicle.full_vehicle_state import STANDARD_GRAVITY

CONVERGENCE = 0.1
"""Time in which the paper's observers converge [s]."""

REPRODUCED = 0.05
"""Error of an amplitude, per that amplitude, up to which it counts as reproduced."""

CONSTANT = 0.25
"""Largest less smallest amplitude, per their mean, up to which they count as constant."""

BEYOND = 1.5
"""Frequencies from here on, per the body's own, lie beyond its resonance."""


def maneuvers_findings(result: Maneuvers) -> list[Finding]:
    """The paper's claims in its order, and what goes beyond."""
    found = scores(result)
    return [
        bars_claim(result, found),
        wheel_hop_claim(result, found),
        derivative_claim(result, found),
        _converges(result, found),
        _braking(found[BRAKE]),
        _steady_error(result),
        _lane_change(result, found[LANE_CHANGE]),
        _sweep(result, found[SWEEP]),
        _resonance(result),
        _slope(result, found[SLOPE]),
        _alike(result, found),
        sum_claim(result),
        joint_claim(result, found),
        wheel_sensors_claim(found),
    ]


def _converges(result: Maneuvers, found: dict[str, dict[str, Score]]) -> Finding:
    times = {m: [found[n][m].converged for n in PAPER_DRIVES] for m in OBSERVERS}
    start = result.drives[BRAKE].t <= SETTLED
    highest = {m: np.nanmax(result.loads[BRAKE][m][start]) / 1e3 for m in OBSERVERS}
    return Finding(
        "Section 6, Fig. 5a",
        "uninitialised, both observers converge in approximately 0.1 s",
        "; ".join(f"{m} within {max(v):.3f} s" for m, v in times.items())
        + f", to {CLOSE:.0%} of every load, in all drives of the paper",
        verdict_of([t <= CONVERGENCE for v in times.values() for t in v]),
        "They begin with wheels that hang from free springs. The first sample is then a jump of "
        "the deflection, which they differentiate twice: on their way they report up to "
        + " and ".join(f"{v:.0f} kN" for v in highest.values())
        + f" ({YOULA}, {UNBIASED}), so that nothing may use them until then. Begun from the first "
        "sample's deflection they would have nothing to converge from.",
    )


def _braking(found: dict[str, Score]) -> Finding:
    youla, unbiased, algebraic = (found[m].rmse for m in (*OBSERVERS, ALGEBRAIC))
    return Finding(
        "Section 6, Fig. 5a",
        "in braking both observers are better than the algebraic expression",
        f"rms error {youla:.0f} N (Youla), {unbiased:.0f} N (unbiased), {algebraic:.0f} N "
        f"(algebraic) of a change of {found[YOULA].change:.0f} N",
        verdict_of([youla < algebraic, unbiased < algebraic]),
        "The algebraic load follows the brake force at once; the true one follows as the body "
        "pitches, and overshoots.",
    )


def _steady_error(result: Maneuvers) -> Finding:
    drive, d = result.drives[BRAKE], distribution()
    ours, theirs = (steady(result, BRAKE, m) for m in (ALGEBRAIC, YOULA))
    end = drive.t >= drive.t[-1] - 0.5
    tilt = float(tilt_error(drive)[end].mean())
    arm = float(d.mass) * STANDARD_GRAVITY * float(d.height) / (2.0 * float(d.wheelbase))
    seen = arm * float(np.sin(drive.pitch[end]).mean())
    return Finding(
        "Section 6, Fig. 5a",
        "the algebraic expression suffers from a steady-state error beside which the observers are "
        "better",
        f"at the end of braking the algebraic loads are off by {ours[0]:+.0f} N in front and "
        f"{ours[2]:+.0f} N behind, the observers' by {theirs[0]:+.0f} and {theirs[2]:+.0f} N",
        verdict_of([rms(theirs) < rms(ours)]),
        f"The observers' sum is off by {theirs.sum():+.0f} N, and F_x sin(pitch) with the cosine's "
        f"part makes {tilt:+.0f} N: their accelerometers and struts stand along an axis that leans "
        "into the brake force. The algebraic load takes gravity seen by the pitched body's "
        f"accelerometer for deceleration, m g h sin(pitch) / (2 L) = {seen:.0f} N a wheel, some of "
        "which the moved centre of mass gives back. How large the paper's error is its text does "
        "not tell.",
    )


def _lane_change(result: Maneuvers, found: dict[str, Score]) -> Finding:
    drive, loads = result.drives[LANE_CHANGE], result.loads[LANE_CHANGE]
    youla, unbiased, algebraic = (found[m] for m in (*OBSERVERS, ALGEBRAIC))
    static, transient = static_part(drive, loads[ALGEBRAIC])
    late = inner(drive)
    total = (loads[YOULA] - drive.load).sum(1)[late]
    return Finding(
        "Section 6, Fig. 5b",
        "in the double lane change both observers are good, and the algebraic expression does not "
        "capture the transient",
        f"rms error {youla.rmse:.0f} N (Youla), {unbiased.rmse:.0f} N (unbiased), "
        f"{algebraic.rmse:.0f} N (algebraic) of a change of {youla.change:.0f} N; of the algebraic "
        f"error a fixed map of the accelerations explains {static:.0f} N, and {transient:.0f} N is "
        "transient",
        verdict_of(
            [
                max(youla.rmse, unbiased.rmse) <= GOOD * youla.change,
                max(youla.rmse, unbiased.rmse) < algebraic.rmse,
                transient > static,
            ]
        ),
        "What a fixed map explains is the share of each axle in the sideways transfer, by weight "
        f"instead of by springs: {_share(static, transient):.0%} of the algebraic error's square; "
        "how much is left to the transient is up to how fast the lane change is for the body's "
        f"roll. The sum of the Youla observer's loads is off by {rms(total):.0f} N rms; the lean "
        "of its axis, F_y sin(roll), taken away, by "
        f"{rms(total - tilt_error(drive)[late]):.0f} N.",
    )


def _sweep(result: Maneuvers, found: dict[str, Score]) -> Finding:
    drive, loads = result.drives[SWEEP], result.loads[SWEEP]
    ratio = {m: _amplitude_ratios(drive, loads[m]) for m in (*OBSERVERS, ALGEBRAIC)}
    worst = {m: float(np.abs(r - 1.0).max()) for m, r in ratio.items()}
    youla, algebraic = found[YOULA], found[ALGEBRAIC]
    return Finding(
        "Section 6, Fig. 6",
        "in the bounce sine sweep both observers reproduce the response of the suspension; the "
        "algebraic expression cannot",
        f"amplitudes wave by wave within {worst[YOULA]:.1%} (Youla) and {worst[UNBIASED]:.1%} "
        f"(unbiased); the algebraic ones are {ratio[ALGEBRAIC].min():.0%} to "
        f"{ratio[ALGEBRAIC].max():.0%} of the true ones; rms error {youla.rmse:.0f}, "
        f"{found[UNBIASED].rmse:.0f} and {algebraic.rmse:.0f} N of {youla.change:.0f} N",
        verdict_of(
            [
                worst[YOULA] <= REPRODUCED,
                worst[UNBIASED] <= REPRODUCED,
                worst[ALGEBRAIC] > REPRODUCED,
            ]
        ),
        f"What is left is the delay: moved ahead by {1e3 * youla.delay:.0f} ms the Youla observer "
        f"is off by {youla.aligned:.1f} N. The algebraic loads see only what the body's pitch "
        "shows the forward accelerometer.",
    )


def _resonance(result: Maneuvers) -> Finding:
    drive = result.drives[SWEEP]
    parts, passed = [], []
    for corner, place in ((0, "front"), (2, "rear")):
        wave, own = waves(drive, drive.load, corner), body_frequency(corner)
        top = int(np.argmax(wave.load))
        spread = _spread(wave.load[wave.frequency >= BEYOND * own])
        per_road = _spread((wave.load / wave.road)[wave.frequency >= BEYOND * own])
        passed += [abs(wave.frequency[top] / own - 1.0) <= 0.25, spread <= CONSTANT]
        parts.append(
            f"{place} {wave.load[top]:.0f} N at {wave.frequency[top]:.2f} Hz and "
            f"{wave.time[top]:.1f} s (body on its springs {own:.2f} Hz), beyond {BEYOND:g} times "
            f"that apart by {spread:.0%} of their mean (per amplitude of the road "
            f"{per_road:.0%})"
        )
    return Finding(
        "Section 6, Fig. 6",
        "the load's amplitude is largest near the suspension's frequency (1 Hz, at about 13 s) and "
        "constant from there towards wheel hop",
        "; ".join(parts),
        verdict_of(passed),
        "The time is the sweep's, whose law the paper does not print. Our excitation rises "
        "linearly in time and passes 1 Hz near 5 s; a wavelength that falls linearly from about "
        "13 m to 1.6 m would be at 1 Hz at 13 s. Whether the load's amplitude stays constant is up "
        "to how the road's falls, here in proportion to the wavelength; judged by a quarter of the "
        "mean. Near is taken as within a quarter of the body's own frequency.",
    )


def _slope(result: Maneuvers, found: dict[str, Score]) -> Finding:
    youla, unbiased, algebraic = (found[m] for m in (*OBSERVERS, ALGEBRAIC))
    end = steady(result, SLOPE, ALGEBRAIC)
    drive = result.drives[SLOPE]
    still = drive.t >= drive.t[-1] - 0.5
    tilt = float(tilt_error(drive)[still].mean())
    return Finding(
        "Section 6, Fig. 7",
        "on the 20 % slope both observers capture the transfer, in the transient too",
        f"rms error {youla.rmse:.0f} N (Youla), {unbiased.rmse:.0f} N (unbiased), "
        f"{algebraic.rmse:.0f} N (algebraic) of a change of {youla.change:.0f} N; at the end "
        f"{steady(result, SLOPE, YOULA).sum():+.0f} N in the sum of the observers' loads",
        verdict_of([s.rmse <= GOOD * s.change for s in (youla, unbiased)]),
        f"The lean against the road makes {tilt:+.0f} N of that sum. The algebraic loads miss the "
        "vertical acceleration in the curve, and on the slope sum to m g instead of m g cos: off "
        f"by {end.sum():+.0f} N.",
    )


def _alike(result: Maneuvers, found: dict[str, dict[str, Score]]) -> Finding:
    apart = {
        n: rms((result.loads[n][UNBIASED] - result.loads[n][YOULA])[d.t >= SETTLED])
        for n, d in result.drives.items()
    }
    listed = "; ".join(
        f"{short(n)} {found[n][YOULA].rmse:.0f} and {found[n][UNBIASED].rmse:.0f} N, apart by "
        f"{apart[n]:.0f} N"
        for n in PAPER_DRIVES
    )
    return Finding(
        "Section 7",
        "the Youla observer and the unbiased filter perform similarly",
        f"rms errors {listed}",
        verdict_of([apart[n] <= SIMILAR * found[n][YOULA].change for n in PAPER_DRIVES]),
        "Both invert the same quarter car, and both are set to -3 dB at "
        f"{result.settings.bandwidth:g} Hz. What differs is the delay: "
        f"{1e3 * found[SWEEP][YOULA].delay:.0f} and {1e3 * found[SWEEP][UNBIASED].delay:.0f} ms in "
        f"the sweep (the unbiased filter's load of one sample ago is put where it belongs), which "
        f"on the class C road sets them {apart[ROAD]:.0f} N apart.",
    )


def _amplitude_ratios(drive: Drive, load: np.ndarray) -> np.ndarray:
    return np.concatenate(
        [waves(drive, load, c).load / waves(drive, drive.load, c).load for c in range(4)]
    )


def _share(one: float, other: float) -> float:
    """Share of the first in the mean square of two uncorrelated parts, from their rms."""
    whole = one**2 + other**2
    return one**2 / whole if whole else math.nan


def _spread(values: np.ndarray) -> float:
    """Largest less smallest, per the mean; NaN of nothing."""
    return float(np.ptp(values) / values.mean()) if values.size else math.nan
