"""Claims on noise, and on whether stated deviations are true, against what was measured."""

from __future__ import annotations

import numpy as np

from wheelhop.io.report import Finding
from wheelhop.studies.filipozzi.maneuvers import JOINT, JOINT_WHEEL
from wheelhop.studies.filipozzi.methods import DERIVATIVE, QUARTER_CARS, UNBIASED, YOULA
from wheelhop.studies.filipozzi.noise import CASES, Noise, Noisy
from wheelhop.studies.filipozzi.settings import CORRELATION_TIME
from wheelhop.studies.frame import verdict_of

HELD, WHITE = CASES
"""The two cases: noise held for its correlation time, and noise white at the rate of the record."""

TWO_SIGMA = 0.9545
"""Share of a Gaussian within two standard deviations."""

HONEST_SHARE = 0.03
"""Distance from `TWO_SIGMA` that counts as none."""

HONEST_RATIO = 0.1
"""Distance from one, of the stated standard deviation per the spread, that counts as none."""


def measured(one: Noisy, name: str) -> float:
    """A figure of one estimator in one case, a field of `Noisy`."""
    return float(getattr(one, name))


def noise_findings(result: Noise) -> list[Finding]:
    """The paper's claim on Fig. 10, what makes it so, and whether stated deviations are true."""
    return [
        _rejects(result),
        _low_pass(result),
        _white(result),
        _held(result),
        _unseen(result),
        _joint(result),
        _joint_honest(result),
    ]


def _rejects(result: Noise) -> Finding:
    spread = {case: _entries(result, case, "spread") for case in CASES}
    return Finding(
        "Section 6, Fig. 10",
        "the Youla observer offers better noise rejection than the unbiased filter",
        "; ".join(
            f"{case}: {of[YOULA]:.0f} N and {of[UNBIASED]:.0f} N of noise in the load"
            for case, of in spread.items()
        ),
        verdict_of(of[YOULA] < of[UNBIASED] for of in spread.values()),
        "Standard deviations about the run without noise, at equal -3 dB bandwidth; see the next "
        "finding for where the difference comes from.",
    )


def _low_pass(result: Noise) -> Finding:
    spread = {case: _entries(result, case, "spread") for case in CASES}
    return Finding(
        "Section 6, Fig. 10; Section 3, Eq. 16",
        "it is the Youla method that rejects the noise",
        "the same equation behind the unbiased filter's low-pass (Eq. 16) has "
        + "; ".join(
            f"{of[DERIVATIVE]:.0f} N where the unbiased filter has {of[UNBIASED]:.0f} N ({case})"
            for case, of in spread.items()
        ),
        verdict_of(of[DERIVATIVE] < of[UNBIASED] for of in spread.values()),
        "m_u q'' behind two poles passes noise of every frequency with m_u w_d^2; the four poles "
        "of Eq. 8 end it. So the gap is one of low-passes, and its size that of the "
        "differentiator, which the paper does not state. Eq. 16 lacks m_u times the body's "
        "acceleration, whose noise is small beside that.",
    )


def _white(result: Noise) -> Finding:
    ratio = {m: _ratio(result.found[WHITE][m]) for m in QUARTER_CARS}
    return Finding(
        "beyond the paper: uncertainty",
        "where the noise is white the standard deviation stated is the noise in the estimate",
        "stated per measured, " + _listed(ratio),
        verdict_of(abs(r - 1.0) <= HONEST_RATIO for r in ratio.values()),
        f"Judged by {HONEST_RATIO:.0%}, {WHITE}. The Youla observer and Eq. 16 propagate the "
        "covariance through their low-pass. The unbiased filter weighs signals that its "
        "differentiator has made hang together as if they were white, but states what the two "
        "sensors make of them.",
    )


def _held(result: Noise) -> Finding:
    ratio = {m: _ratio(result.found[HELD][m]) for m in QUARTER_CARS}
    return Finding(
        "beyond the paper: uncertainty",
        "the standard deviation stated is that of the estimate with the paper's noise too",
        "stated per measured, " + _listed(ratio),
        verdict_of(abs(r - 1.0) <= HONEST_RATIO for r in ratio.values()),
        f"Judged by {HONEST_RATIO:.0%}. Noise held for {1e3 * CORRELATION_TIME:g} ms has more of "
        "its power at low frequencies and less at high ones than white noise of the same size: "
        "what passes much of the high ones states too much, what passes few states too little.",
    )


def _unseen(result: Noise) -> Finding:
    found = {m: result.found[WHITE][m] for m in QUARTER_CARS}
    inside = {m: measured(one, "inside") for m, one in found.items()}
    # the noise of the runs is independent of what the run without noise is off by
    rest = {m: measured(o, "rmse") ** 2 - measured(o, "spread") ** 2 for m, o in found.items()}
    return Finding(
        "beyond the paper: uncertainty",
        "on a rough road the standard deviation that a quarter car states is that of its error",
        f"share of the loads within two of them ({TWO_SIGMA:.1%} expected): "
        + ", ".join(f"{m} {share:.1%}" for m, share in inside.items()),
        verdict_of(abs(share - TWO_SIGMA) <= HONEST_SHARE for share in inside.values()),
        "They count the sensors' noise alone; what the low-pass cuts off and delays comes on top: "
        + ", ".join(f"{m} {np.sqrt(max(rest[m], 0.0)):.0f} N rms" for m in found)
        + f". Judged by {HONEST_SHARE:.0%}.",
    )


def _joint(result: Noise) -> Finding:
    rmse = _entries(result, WHITE, "rmse")
    best = min(QUARTER_CARS, key=rmse.__getitem__)
    return Finding(
        "beyond the paper: joint filter",
        "on a class C road with datasheet sensors a filter of the whole vehicle is better than "
        "every quarter car, with and without accelerometers on the wheel carriers",
        f"rms error {rmse[JOINT]:.0f} N with the paper's sensors and {rmse[JOINT_WHEEL]:.0f} N "
        f"with wheel accelerometers; best quarter car ({best}) {rmse[best]:.0f} N",
        verdict_of(rmse[m] < rmse[best] for m in (JOINT, JOINT_WHEEL)),
        "It weighs noise against how fast loads change on this road, where a quarter car has one "
        "bandwidth for every road and every sensor.",
    )


def _joint_honest(result: Noise) -> Finding:
    inside = {
        (case, m): measured(result.found[case][m], "inside")
        for case in CASES
        for m in (JOINT, JOINT_WHEEL)
    }
    return Finding(
        "beyond the paper: joint filter",
        "the joint filter's standard deviations are true",
        "share of the loads within two of them: "
        + "; ".join(f"{case}, {m} {share:.1%}" for (case, m), share in inside.items()),
        verdict_of(abs(share - TWO_SIGMA) <= HONEST_SHARE for share in inside.values()),
        f"{TWO_SIGMA:.1%} expected, judged by {HONEST_SHARE:.0%}. It believes in white noise; the "
        "paper's is held.",
    )


def _entries(result: Noise, case: str, name: str) -> dict[str, float]:
    return {method: measured(one, name) for method, one in result.found[case].items()}


def _ratio(one: Noisy) -> float:
    return measured(one, "stated") / measured(one, "spread")


def _listed(ratio: dict[str, float]) -> str:
    return ", ".join(f"{method} {r:.2f}" for method, r in ratio.items())
