"""What the relative gain arrays say: words, claims, tables and figure."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from wheelhop.io.report import OPEN, DataTable, Finding
from wheelhop.plots.load_coupling import plot_load_coupling
from wheelhop.studies.filipozzi.coupling import (
    BOTH,
    FREE,
    PAPER_FREE,
    PAPER_REAR,
    REAR,
    STRONG,
    Coupled,
    Coupling,
)
from wheelhop.studies.filipozzi.settings import CORNERING, SPEED, FilipozziSettings
from wheelhop.studies.frame import StudyFigure, verdict_of
from wheelhop.vehicle.full_vehicle_parameters import CORNERS

NEGLIGIBLE = 0.06
"""Distance from uncoupled wheels that the paper calls almost none: its own is 0.054."""

SAME = 0.01
"""Difference of relative gains that counts as none between two places or vehicles."""


def coupling_in_words(settings: FilipozziSettings) -> tuple[str, ...]:
    """What was done."""
    del settings
    return (
        "Relative gain arrays from the four tyre loads to the four compressions, "
        "(G(0)^-1)^T x G(0) entry by entry: one on the diagonal and zero elsewhere means that a "
        "corner can be estimated by itself. G(0) is the gain of the vehicle whose body the loads "
        "accelerate steadily: the compressions at which no wheel moves relative to the body.",
        f"As in the paper it is taken about steady cornering at {3.6 * SPEED:g} km/h and "
        f"{CORNERING:.2f} m/s^2 (0.4 g), and beside that at rest. The paper's parameters are not "
        "printed; the vehicle is our SUV with linear dampers, without bars, with its rear bar, "
        "with a rear bar as strong as the paper's, and with both of its own.",
    )


def distance(gains: np.ndarray) -> float:
    """Largest distance of an entry from uncoupled wheels [-].

    Args:
        gains: relative gains, [4, 4].
    """
    return float(np.abs(gains - np.eye(4)).max())


def between_axles(gains: np.ndarray) -> float:
    """Largest entry that couples the axles [-].

    Args:
        gains: relative gains, [4, 4].
    """
    return float(max(np.abs(gains[:2, 2:]).max(), np.abs(gains[2:, :2]).max()))


def missed_in_roll(vehicle: Coupled) -> np.ndarray:
    """Share of the struts' load transfer in pure roll that a quarter car misses, [2] by axle.

    Left and right move oppositely: S = (k + 2 k_b) q, of which the quarter car knows k q.

    Args:
        vehicle: with its bars.
    """
    return 2.0 * vehicle.bars / (vehicle.springs + 2.0 * vehicle.bars)


def coupling_findings(result: Coupling) -> list[Finding]:
    """Whether Eq. 1 holds for another vehicle, and what follows for quarter cars."""
    return [_free(result), _axles(result), _couples(result), _as_much(result), *_beyond(result)]


def _free(result: Coupling) -> Finding:
    gains = result[FREE].cornering
    off, theirs = (g - np.diag(np.diag(g)) for g in (gains, PAPER_FREE))
    return Finding(
        "Section 2, Eq. 1",
        "without an anti-roll bar the relative gains are almost an identity matrix: the corners "
        "do not couple",
        f"diagonal {np.diag(gains).min():.4f} to {np.diag(gains).max():.4f}, the rest at most "
        f"{np.abs(off).max():.4f}; paper {np.diag(PAPER_FREE).min():.4f} to "
        f"{np.diag(PAPER_FREE).max():.4f} and {np.abs(theirs).max():.4f}",
        verdict_of([distance(gains) <= NEGLIGIBLE]),
        f"Judged by {NEGLIGIBLE:g}; the paper's own entries lie up to {distance(PAPER_FREE):.3f} "
        "away. Its diagonal is below one. At rest that cannot be for a body on four uncoupled "
        "struts: scaled by the wheels' masses the gain is symmetric and positive, and the diagonal "
        "of such an array is one or more (Fiedler 1961). So the paper's plant holds something "
        "that its text does not tell.",
    )


def _axles(result: Coupling) -> Finding:
    gains, free = result[REAR].cornering, result[FREE].cornering
    strong = result[STRONG].cornering
    moved = max(float(np.abs(g[:2, :2] - free[:2, :2]).max()) for g in (gains, strong))
    return Finding(
        "Section 2, Eq. 1",
        "with an anti-roll bar on the rear axle the two axles stay decoupled",
        f"entries between the axles at most {between_axles(gains):.4f}, with a strong bar "
        f"{between_axles(strong):.4f} (paper {between_axles(PAPER_REAR):.4f}); the front "
        f"wheels' own change by {moved:.1e}",
        verdict_of([between_axles(g) <= NEGLIGIBLE for g in (gains, strong)] + [moved <= SAME]),
        "The bar's force acts on both wheels of its axle and, through them, on the body, which "
        "is heavy.",
    )


def _couples(result: Coupling) -> Finding:
    gains, free = result[REAR].cornering, result[FREE].cornering
    off = min(abs(gains[2, 3]), abs(gains[3, 2]))
    share = result[REAR].bars[1] / result[REAR].springs[1]
    return Finding(
        "Section 2, Eq. 1",
        "the rear bar couples the left and the right rear wheel: 1.21 and -0.31 in place of 0.95 "
        "and -0.04",
        f"SUV's own rear bar: {gains[2, 2]:.3f} and {gains[2, 3]:.3f} in place of "
        f"{free[2, 2]:.3f} and {free[2, 3]:.4f}",
        verdict_of([off > 5.0 * abs(free[2, 3]), off > NEGLIGIBLE]),
        f"The coupling is there, but weak by the measure of Eq. 1: this bar has {share:.2f} of "
        f"the spring's stiffness. Judged: five times the entry without a bar, and more than "
        f"{NEGLIGIBLE:g}.",
    )


def _as_much(result: Coupling) -> Finding:
    strong, free = result[STRONG].cornering, result[FREE].cornering
    ours = strong[2:, 2:] - free[2:, 2:]
    bar, spring = result[STRONG].bars[1], result[STRONG].springs[1]
    return Finding(
        "Section 2, Eq. 1",
        "a rear bar raises the rear wheels' diagonal by 0.26 and lowers the entries beside it as "
        "far",
        f"it takes a bar of {1e-3 * bar:.1f} kN/m, {bar / spring:.2f} of the spring's stiffness "
        f"and {bar / result[REAR].bars[1]:.1f} times the SUV's; it changes the four entries by "
        + ", ".join(f"{v:+.3f}" for v in ours.ravel()),
        OPEN,
        "The paper prints neither its bar nor its springs; this bar is chosen so that the diagonal "
        "agrees, and the entries beside it follow, as every row and column sums to one.",
    )


def _beyond(result: Coupling) -> list[Finding]:
    moved = {n: float(np.abs(c.cornering - c.at_rest).max()) for n, c in result.items()}
    roll = {n: np.degrees(float(c.roll)) for n, c in result.items()}
    both, missed = result[BOTH].cornering, missed_in_roll(result[BOTH])
    diagonal = max(both[0, 0], both[2, 2]) - 1.0
    return [
        Finding(
            "beyond the paper",
            "the arrays taken about steady cornering hold at rest as well",
            f"no entry moves by more than {max(moved.values()):.1e}, at rolls of "
            f"{min(roll.values()):.1f} to {max(roll.values()):.1f} degrees",
            verdict_of([m <= SAME for m in moved.values()]),
            "Linear springs without stops: what remains is that loads act along the rolled body "
            "and that the lateral forces' arms change with the compressions.",
        ),
        Finding(
            "beyond the paper",
            "a relative gain near one says that a quarter car will do",
            f"both bars: diagonal at most {diagonal:.2f} above one, yet in pure roll a quarter "
            f"car misses {missed[0]:.0%} (front) and {missed[1]:.0%} (rear) of what the struts "
            "transfer",
            verdict_of([m <= diagonal for m in missed]),
            "A relative gain compares one load alone with the others held; in a corner left and "
            "right act together, and the struts transfer (k + 2 k_b) q where the quarter car "
            "knows k q. Cars with bars need the half car.",
        ),
    ]


def coupling_tables(result: Coupling) -> list[DataTable]:
    """The vehicles side by side, and our arrays entry by entry."""
    vehicles: dict[str, Any] = {
        "vehicle": ["paper, no bar", "paper, rear bar", *result],
        "bars front, rear [kN/m]": [
            "0, 0",
            "0, not printed",
            *(f"{1e-3 * c.bars[0]:.3g}, {1e-3 * c.bars[1]:.3g}" for c in result.values()),
        ],
        "roll [deg]": [None, None, *(float(np.degrees(c.roll)) for c in result.values())],
    }
    arrays = (PAPER_FREE, PAPER_REAR, *(c.cornering for c in result.values()))
    entries = {"FL-FL": (0, 0), "FL-FR": (0, 1), "RL-RL": (2, 2), "RL-RR": (2, 3)}
    for name, place in entries.items():
        vehicles[name] = [f"{gains[place]:.4f}" for gains in arrays]
    vehicles["largest between axles"] = [f"{between_axles(gains):.4f}" for gains in arrays]
    vehicles["missed in roll front, rear [%]"] = [
        None,
        None,
        *(", ".join(f"{100 * m:.0f}" for m in missed_in_roll(c)) for c in result.values()),
    ]
    note = (
        "About steady cornering at 90 km/h and 0.4 g. Missed in roll: share of the struts' load "
        "transfer that a quarter car does not know of when left and right move oppositely."
    )
    full: dict[str, Any] = {
        "vehicle": [name for name in result for _ in CORNERS],
        "compression": [corner for _ in result for corner in CORNERS],
    }
    for k, corner in enumerate(CORNERS):
        full[f"load {corner}"] = [
            f"{value:.4f}" for c in result.values() for value in c.cornering[:, k]
        ]
    return [
        DataTable("Relative gains beside the paper's", vehicles, note),
        DataTable("Relative gains of every corner", full),
    ]


def coupling_figures(result: Coupling) -> Iterator[StudyFigure]:
    """The paper's arrays and ours."""
    arrays = {
        "paper, no bar": PAPER_FREE,
        "paper, rear bar": PAPER_REAR,
        "ours, both bars": result[BOTH].cornering,
        "ours, no bar": result[FREE].cornering,
        "ours, rear bar": result[REAR].cornering,
        "ours, rear bar as strong as the paper's": result[STRONG].cornering,
    }
    columns: dict[str, Any] = {"compression": np.repeat(CORNERS, 4), "load": np.tile(CORNERS, 4)}
    keys = {name: name.replace(",", "").replace("'", "").replace(" ", "_") for name in arrays}
    columns |= {keys[name]: gains.ravel() for name, gains in arrays.items()}
    yield StudyFigure(
        "coupling",
        plot_load_coupling(arrays, "Which load compresses which suspension: relative gains"),
        columns,
        {keys[name]: "1" for name in arrays},
        "Relative gains from tyre loads to compressions about steady cornering at 90 km/h and "
        "0.4 g: the paper's Eq. 1 and our vehicle's. Colour: distance from uncoupled wheels.",
    )


def coupling_numbers(result: Coupling) -> dict[str, Any]:
    """For results.json; SI units."""
    return {
        name: {
            "bars": c.bars.tolist(),
            "springs": c.springs.tolist(),
            "roll": float(c.roll),
            "compression": c.compression.tolist(),
            "relative_gains_at_rest": c.at_rest.tolist(),
            "relative_gains_cornering": c.cornering.tolist(),
            "missed_in_roll": missed_in_roll(c).tolist(),
        }
        for name, c in result.items()
    } | {"paper": {"no bar": PAPER_FREE.tolist(), "rear bar": PAPER_REAR.tolist()}}
