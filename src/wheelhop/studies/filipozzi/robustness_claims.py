"""What the paper says of wrong springs and dampers, against what was measured."""

from __future__ import annotations

import numpy as np

from wheelhop.io.report import Finding
from wheelhop.studies.filipozzi.drives import BRAKE, BRAKE_DIGRESSIVE
from wheelhop.studies.filipozzi.methods import YOULA
from wheelhop.studies.filipozzi.robustness import (
    FREE,
    METHODS,
    REST,
    TRANSIENT,
    Robustness,
    transfer,
)
from wheelhop.studies.filipozzi.robustness_claims_beyond import (
    MUCH,
    SMALL,
    WRONG,
    robustness_findings_beyond,
)
from wheelhop.studies.filipozzi.robustness_measures import (
    apart,
    damping_swing,
    damping_transfer,
    digressive_swing,
    static_offset,
    stiffness_transfer,
)
from wheelhop.studies.filipozzi.settings import FACTORS
from wheelhop.studies.frame import verdict_of

PAPER_TRANSFER, PAPER_STIFF_TRANSFER = 700.0, 450.0
"""Load transfer that the paper's observers find with the right springs, and with springs 50 %
stiffer than they believe [N]."""

SAME = 0.01
"""Difference per the load transfer that counts as none between two estimates."""


def robustness_findings(result: Robustness) -> list[Finding]:
    """The paper's claims on Fig. 8 and 9, and what lies beyond them."""
    return [
        _offset(result),
        _cause(result),
        _correct(result),
        _transfer(result),
        _damping(result),
        _same(result),
        _digressive(result),
        *robustness_findings_beyond(result),
    ]


def _offset(result: Robustness) -> Finding:
    found = {f: stiffness_transfer(result, FREE, f, YOULA).offset for f in FACTORS}
    static = float(result.drives[BRAKE].load[0, 0])
    return Finding(
        "Section 6, Fig. 8",
        "uncertain stiffness results in an offset between true and estimated load",
        "before braking "
        + ", ".join(f"{round(off):+d} N (springs x {f:g})" for f, off in found.items())
        + f", of a load of {static:.0f} N",
        verdict_of(
            [abs(found[f]) > SMALL * static for f in WRONG] + [abs(found[1.0]) <= SMALL * static]
        ),
        f"Deflections counted from the free spring, as in Eq. 35. More than {SMALL:.0%} of the "
        "load counts as an offset.",
    )


def _cause(result: Robustness) -> Finding:
    free, rest = (
        {f: stiffness_transfer(result, counted, f, YOULA) for f in WRONG}
        for counted in (FREE, REST)
    )
    expected = {f: static_offset(result, f) for f in WRONG}
    passed = []
    for f in WRONG:
        passed += [
            abs(rest[f].offset) <= SMALL * abs(free[f].offset),
            abs(free[f].offset - expected[f]) <= SMALL * abs(expected[f]),
            abs(rest[f].steady - free[f].steady) <= SMALL * abs(free[f].steady),
        ]
    return Finding(
        "Section 6, Fig. 8",
        "the offset comes from the mass estimate that the wrong springs calibrate",
        "; ".join(
            f"springs x {f:g}: {free[f].offset:+.0f} N counted from the free spring (computed "
            f"{expected[f]:+.0f} N), {rest[f].offset:+.0f} N counted from rest, transfer off by "
            f"{free[f].steady:+.0f} N and {rest[f].steady:+.0f} N"
            for f in WRONG
        ),
        verdict_of(passed),
        "k q of the believed spring is taken for the body's weight: m_s g (1 / f - 1). A sensor "
        "that is zeroed with the vehicle at rest on level ground, its mass known, has no such "
        "offset; the error of the load transfer stays as it is.",
    )


def _correct(result: Robustness) -> Finding:
    found = [stiffness_transfer(result, REST, 1.0, method) for method in METHODS]
    return Finding(
        "Section 6, Fig. 8",
        "without uncertainty both observers yield a correct load transfer",
        "; ".join(
            f"{method} {one.estimated:.0f} N of {one.true:.0f} N "
            f"({one.estimated / one.true - 1.0:+.1%})"
            for method, one in zip(METHODS, found, strict=True)
        ),
        verdict_of([abs(one.estimated - one.true) <= SMALL * one.true for one in found]),
        f"Judged by {SMALL:.0%}. Springs, dampers and masses are those of the plant; the first "
        "finding beyond the paper says where the rest is.",
    )


def _transfer(result: Robustness) -> Finding:
    found = {f: stiffness_transfer(result, FREE, f, YOULA) for f in FACTORS}
    ratio = {f: one.estimated / found[1.0].estimated for f, one in found.items()}
    theirs = PAPER_STIFF_TRANSFER / PAPER_TRANSFER
    ours = found[1.5].estimated / found[1.5].true
    return Finding(
        "Section 6, Fig. 8",
        "springs 50 % stiffer than believed make the estimated load transfer 450 N in place of "
        "700 N",
        "; ".join(
            f"springs x {f:g}: {found[f].estimated:.0f} N of {found[f].true:.0f} N, "
            f"{ratio[f]:.3f} of that with the right ones (1 / {f:g} is {1 / f:.3f})"
            for f in WRONG
        )
        + f"; per true transfer {ours:.3f} (springs x 1.5), paper {theirs:.3f}",
        verdict_of(
            [abs(ratio[f] * f - 1.0) <= SMALL for f in WRONG] + [abs(ours / theirs - 1.0) <= SMALL]
        ),
        "The springs carry the transfer; one that is f times as stiff gives way 1 / f as far, and "
        "the estimator multiplies by its own stiffness. Judged by "
        f"{SMALL:.0%}: 1 / f for the estimate per that with the right springs, the paper's 450 per "
        "700 N for the estimate per true transfer.",
    )


def _damping(result: Robustness) -> Finding:
    own = damping_swing(result, 1.0, YOULA)
    swings = {f: damping_swing(result, f, YOULA) for f in WRONG}
    steady = {f: damping_transfer(result, f, YOULA).steady for f in FACTORS}
    true = damping_transfer(result, 1.0, YOULA).true
    return Finding(
        "Section 6, Fig. 9a above",
        "the estimate is not robust against the damping in the transient, but its steady state is",
        "rms error while the brakes come on "
        + ", ".join(f"{value:.0f} N (dampers x {f:g})" for f, value in swings.items())
        + f" in place of {own:.0f} N; steady error of the transfer "
        + ", ".join(f"{value:+.1f} N (x {f:g})" for f, value in steady.items()),
        verdict_of(
            [value >= MUCH * own for value in swings.values()]
            + [abs(steady[f] - steady[1.0]) <= SAME * true for f in WRONG]
        ),
        f"Errors in the first {TRANSIENT:g} s about their steady value; {MUCH:g} times as large "
        f"counts, and {SAME:.0%} of the transfer in the steady state. A damper at rest pushes "
        "with nothing.",
    )


def _same(result: Robustness) -> Finding:
    rms, largest = apart(result)
    true = damping_transfer(result, 1.0, YOULA).true
    return Finding(
        "Section 6, Fig. 9a",
        "the Youla observer and the unbiased filter provide the same estimate",
        f"in all {len(result.drives)} brakings they differ by {rms:.1f} N rms at most, "
        f"{rms / true:.2%} of the transfer, and never by more than {largest:.0f} N",
        verdict_of([rms <= SAME * true]),
        f"Sensors without noise, equal -3 dB bandwidth; judged by {SAME:.0%} of the transfer. "
        "The largest difference is at the brakes' onset, where their low-passes differ.",
    )


def _digressive(result: Robustness) -> Finding:
    own = {m: damping_swing(result, 1.0, m) for m in METHODS}
    found = {m: digressive_swing(result, m) for m in METHODS}
    drive, nominal = result.drives[BRAKE_DIGRESSIVE], damping_transfer(result, 1.0, YOULA)
    steady = {m: transfer(drive, result.digressive[m]).steady for m in METHODS}
    most = float(np.abs(drive.compression_rate[:, 0]).max())
    return Finding(
        "Section 6, Fig. 9a below",
        "nonlinearities of the damper's map affect the transient of the estimate",
        "; ".join(
            f"{m} {found[m]:.0f} N rms while the brakes come on in place of {own[m]:.0f} N, "
            f"steady {steady[m]:+.1f} N"
            for m in METHODS
        ),
        verdict_of(
            [found[m] >= MUCH * own[m] for m in METHODS]
            + [abs(steady[m] - nominal.steady) <= SAME * nominal.true for m in METHODS]
        ),
        f"The SUV's own dampers resist extension more and fade; braking compresses the front left "
        f"strut by up to {most:.2f} m/s. The believed damper has their slope at rest.",
    )
