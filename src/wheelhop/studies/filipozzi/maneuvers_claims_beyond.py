"""Claims of the maneuvers beyond the paper's figures: bars, wheel hop, sums, the joint filter."""

from __future__ import annotations

import numpy as np

from wheelhop.estimators.youla_design import shaping_transfer
from wheelhop.io.report import Finding
from wheelhop.studies.filipozzi.drives import (
    LANE_CHANGE,
    LANE_CHANGE_BARRED,
    ROAD,
)
from wheelhop.studies.filipozzi.maneuvers import (
    ALGEBRAIC,
    JOINT,
    JOINT_WHEEL,
    Maneuvers,
    Score,
    total_error,
)
from wheelhop.studies.filipozzi.maneuvers_measures import (
    GOOD,
    OBSERVERS,
    PAPER_DRIVES,
    SIMILAR,
    delay_in_words,
    inner,
    missed_body,
    rms,
    shaped,
    short,
    tilt_error,
)
from wheelhop.studies.filipozzi.methods import DERIVATIVE, HALF_CAR, YOULA
from wheelhop.studies.frame import verdict_of

WHOLE = 0.02
"""Rms error of the sum of the loads, per that sum, that counts as close."""


def bars_claim(result: Maneuvers, found: dict[str, dict[str, Score]]) -> Finding:
    """Anti-roll bars need a half car."""
    barred, free = found[LANE_CHANGE_BARRED], found[LANE_CHANGE]
    quarter, half = barred[YOULA], barred[HALF_CAR]
    return Finding(
        "Section 2, Section 7",
        "with anti-roll bars the quarter car cannot be used; a half car is needed",
        f"lane change with the SUV's bars: rms error {quarter.rmse:.0f} N by quarter cars, "
        f"{half.rmse:.0f} N by half cars, {barred[ALGEBRAIC].rmse:.0f} N by the algebraic "
        f"expression, of a change of {half.change:.0f} N; without bars quarter cars "
        f"{free[YOULA].rmse:.0f} N",
        verdict_of([quarter.rmse > GOOD * quarter.change, half.rmse <= GOOD * half.change]),
        "In a corner left and right struts carry (k + 2 k_b) q and the quarter car knows k q. The "
        "half car needs the bars' stiffness and nothing else: mean and difference of an axle's "
        "wheels are two quarter cars. In braking the bars do nothing, and both agree.",
    )


def wheel_hop_claim(result: Maneuvers, found: dict[str, dict[str, Score]]) -> Finding:
    """A bandwidth of 30 Hz captures wheel hop."""
    drive, bandwidth = result.drives[ROAD], result.settings.bandwidth
    youla, unbiased = (found[ROAD][m] for m in OBSERVERS)
    within = inner(drive)
    believed = shaped(drive, bandwidth)
    alone = rms((believed - drive.load)[within])
    left = rms((result.loads[ROAD][YOULA] - believed)[within])
    missed = abs(1.0 - shaping_transfer(np.array([20j * np.pi]), bandwidth)[0])
    return Finding(
        "Section 3, below Eq. 8",
        f"a bandwidth of {bandwidth:g} Hz is faster than wheel hop at 10 Hz and captures the "
        "response of the tyre's force",
        f"class C road at 80 km/h: rms error {youla.rmse:.0f} N (Youla), {unbiased.rmse:.0f} N "
        f"(unbiased) of a change of {youla.change:.0f} N; moved ahead by {1e3 * youla.delay:.0f} "
        f"and {1e3 * unbiased.delay:.0f} ms, {youla.aligned:.0f} and {unbiased.aligned:.0f} N",
        verdict_of([s.rmse <= GOOD * s.change for s in (youla, unbiased)]),
        "The shaping filter is slow in phase before it is in gain: |1 - W| at 10 Hz is "
        f"{missed:.2f}. The filter alone, on the true load, is off by {alone:.0f} N; "
        f"the observer differs from that by {left:.0f} N. So amplitudes are "
        "captured, their time is not; whoever may wait for the delay takes it out, a "
        "controller cannot.",
    )


def derivative_claim(result: Maneuvers, found: dict[str, dict[str, Score]]) -> Finding:
    """Eq. 16 is similar to Eq. 15."""
    pairs = {n: missed_body(result, n) for n in PAPER_DRIVES}
    rmse = "; ".join(
        f"{short(n)} {found[n][DERIVATIVE].rmse:.0f} N (Eq. 15: {found[n][YOULA].rmse:.0f} N)"
        for n in PAPER_DRIVES
    )
    left = ", ".join(f"{short(n)} {a:.0f} to {b:.0f} N" for n, (_, a, b) in pairs.items())
    road = found[ROAD]
    return Finding(
        "Section 3, Eq. 15 and 16",
        "derivative filters without accelerometers (Eq. 16) are similar to the Youla observer",
        f"rms error {rmse}; the two estimates differ by "
        + ", ".join(f"{difference:.0f}" for difference, _, _ in pairs.values())
        + " N",
        verdict_of(
            [pairs[n][0] <= SIMILAR * found[n][YOULA].change for n in PAPER_DRIVES],
        ),
        f"Similar: up to {SIMILAR:.0%} of the load's own change. Eq. 16 leaves out m_u a_s of "
        "the body's acceleration; with that added the difference of the aligned estimates shrinks: "
        f"{left}. It filters the derivatives only and not k q, and so lags less: "
        f"on the class C road {road[DERIVATIVE].rmse:.0f} N against {road[YOULA].rmse:.0f} N.",
    )


def sum_claim(result: Maneuvers) -> Finding:
    """The estimated loads sum to the vertical force."""
    share, left = {}, {}
    for name in PAPER_DRIVES:
        drive, load = result.drives[name], result.loads[name][YOULA]
        late = inner(drive)
        total = (load - drive.load).sum(1)
        share[name] = total_error(drive, load) / float(drive.load.sum(1).mean())
        left[name] = (rms(total[late]), rms((total - tilt_error(drive))[late]))
    return Finding(
        "beyond the paper",
        "the sum of the estimated loads is the vertical force on the vehicle",
        "rms error of the sum, Youla: "
        + ", ".join(f"{short(n)} {s:.1%}" for n, s in share.items())
        + f"; class C road {total_error(result.drives[ROAD], result.loads[ROAD][YOULA]):.0f} N",
        verdict_of([s <= WHOLE for s in share.values()]),
        f"Judged by {WHOLE:.0%}. The lean of the body, computed from pitch, roll and accelerations "
        "of the drive, leaves "
        + ", ".join(f"{short(n)} {b:.0f} of {a:.0f} N" for n, (a, b) in left.items())
        + "; in the sweep and on the rough road it is the delay. Pitch and roll follow from the "
        "four deflections, so that this error can be taken away.",
    )


def joint_claim(result: Maneuvers, found: dict[str, dict[str, Score]]) -> Finding:
    """One filter of all corners is better than one for each."""
    lean = total_error(result.drives[LANE_CHANGE], result.loads[LANE_CHANGE][JOINT])
    better = [s[JOINT].rmse < min(s[YOULA].rmse, s[HALF_CAR].rmse) for s in found.values()]
    listed = "; ".join(
        f"{short(n)} {s[JOINT].rmse:.0f} and {s[JOINT_WHEEL].rmse:.0f} N (half car "
        f"{s[HALF_CAR].rmse:.0f} N)"
        for n, s in found.items()
    )
    return Finding(
        "beyond the paper",
        "one filter of all four corners is better than an observer for each",
        f"rms error with the paper's sensors and with accelerometers on the wheels: {listed}",
        verdict_of(better),
        "It takes the body's lean out (sum of the loads in the lane change off by "
        f"{lean:.0f} N) and knows the bars. In the lane change it is late by "
        f"{delay_in_words(found[LANE_CHANGE][JOINT])} ms without accelerometers on the wheels, by "
        f"{delay_in_words(found[LANE_CHANGE][JOINT_WHEEL])} ms with them; all estimators believe "
        "in sensors that are nearly perfect, as these are. The joint filter calls the strut laws "
        "of the simulated vehicle itself, with exact parameters; the chapter on wrong springs and "
        "dampers says what it does without them.",
    )


def wheel_sensors_claim(found: dict[str, dict[str, Score]]) -> Finding:
    """Accelerometers on the wheels are worth more than any method without."""
    others = {n: min(s[m].rmse for m in s if m != JOINT_WHEEL) for n, s in found.items()}
    road = found[ROAD]
    return Finding(
        "beyond the paper",
        "with accelerometers on the wheels the joint filter is better than every method without",
        f"class C road: rms error {road[JOINT_WHEEL].rmse:.0f} N, delay "
        f"{delay_in_words(road[JOINT_WHEEL])} ms; the best of the others {others[ROAD]:.0f} N. "
        "Elsewhere "
        + "; ".join(
            f"{short(n)} {s[JOINT_WHEEL].rmse:.0f} against {others[n]:.0f} N"
            for n, s in found.items()
            if n != ROAD
        ),
        verdict_of([found[n][JOINT_WHEEL].rmse < best for n, best in others.items()]),
        "F = S + m_u (g + a_u) then needs no deflection differentiated twice, and so no shaping "
        "filter that is slow at wheel hop. The sensors are without noise here.",
    )
