"""Findings, table and figure of the alarms."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import scipy.stats
from matplotlib.figure import Figure

from wheelhop.io.report import OPEN, DataTable, Finding
from wheelhop.plots.panels import panel_grid
from wheelhop.plots.style import ALERT, ESTIMATE, MUTED, TRUTH
from wheelhop.studies.frame import StudyFigure, verdict_of
from wheelhop.studies.stiffness.alarm_drives import IN_TIME, LOSSES, AlarmDrives, hours

_COLOURS = (ESTIMATE, "#00838f", "#8e24aa", MUTED, ALERT)


def shares(result: AlarmDrives) -> dict[str, float]:
    """Share of drives in which the loss was found in time, by loss."""
    return {name: float(np.mean(found <= IN_TIME)) for name, found in result.found.items()}


def rate_bound(count: int, time: float) -> float:
    """Upper 95 % confidence bound of a Poisson rate per 100 h, from a count in a time [h]."""
    return float(50.0 * scipy.stats.chi2.ppf(0.95, 2 * count + 2) / time)


def alarm_findings(result: AlarmDrives) -> list[Finding]:
    """What the alarms must do."""
    found = shares(result)
    words = "; ".join(f"{name}: {share:.3f}" for name, share in found.items())
    count, time = int(result.false.sum() + result.early.sum()), hours(result)
    bound = rate_bound(count, time)
    verdict = verdict_of([True]) if bound < 1 else OPEN if 100 * count / time < 1 else None
    return [
        Finding(
            "alarms",
            "20 % lost in one or in four tyres, and 15 % in one to three, are found within 60 s",
            f"share of {len(next(iter(result.found.values())))} drives each: {words}",
            verdict_of(share >= 1.0 for share in found.values()),
            "four tyres have no sound one to compare with, and the drift since the calibration is "
            "common to them",
        ),
        Finding(
            "alarms",
            "fewer than one false alarm in 100 h",
            f"{count} drives with a false alarm in {time:.1f} h without a loss; the rate is below "
            f"{bound:.0f} in 100 h with 95 % confidence",
            verdict if verdict is not None else verdict_of([False]),
            "No alarm in so few hours cannot show a rate below one in 100 h.",
        ),
    ]


def _quantile(found: np.ndarray, share: float) -> float | None:
    """Time by which a share of the drives was found [s]; None where fewer were."""
    time = float(np.quantile(found, share, method="inverted_cdf"))
    return time if np.isfinite(time) else None


def _seconds(time: float | None) -> str:
    return "not found" if time is None else f"{time:.1f}"


def alarm_tables(result: AlarmDrives) -> list[DataTable]:
    """Detection by loss."""
    columns: dict[str, list[Any]] = {
        "loss": list(LOSSES),
        "found within 60 s": [f"{s:.3f}" for s in shares(result).values()],
        "median time [s]": [_seconds(_quantile(f, 0.5)) for f in result.found.values()],
        "slowest 5 % [s]": [_seconds(_quantile(f, 0.95)) for f in result.found.values()],
        "drives that accused a sound tyre": [f"{a.mean():.3f}" for a in result.accused.values()],
    }
    note = (
        "Times from the beginning of a loss that takes 10 s to the alarm of the last wheel that "
        "lost pressure. Beliefs of the four-corner filter at 250 Hz, to which every drive adds a "
        "drift since the calibration of 1.5 % common to the wheels and 0.5 % of each. NEES of the "
        f"four ln k_t at the end of the sound drives: {np.mean(result.spread):.2f} (4 expected)."
    )
    return [DataTable("Alarms", columns, note)]


def alarm_numbers(result: AlarmDrives) -> dict[str, Any]:
    """For results.json."""
    return {
        "share_found_in_60_s": shares(result),
        "median_time_s": {name: _quantile(f, 0.5) for name, f in result.found.items()},
        "accused": {name: float(a.mean()) for name, a in result.accused.items()},
        "false_alarm_drives": int(result.false.sum() + result.early.sum()),
        "sound_hours": hours(result),
        "nees_of_sound_drives": float(np.mean(result.spread)),
    }


def alarm_figures(result: AlarmDrives) -> Iterator[StudyFigure]:
    """Share found over time."""
    names = list(result.found)
    each = len(result.found[names[0]])
    columns = {
        "loss": np.repeat(names, each),
        "found_after": np.concatenate([result.found[name] for name in names]),
    }
    yield StudyFigure(
        "alarms",
        draw_alarms(result),
        columns,
        {"found_after": "s"},
        "Share of drives in which every tyre that lost pressure had its alarm, over time.",
    )


def draw_alarms(result: AlarmDrives) -> Figure:
    """Share of drives found, over the time since the loss began."""
    figure, axes = panel_grid(1, 1, height=3.6)
    (ax,) = axes[0]
    longest = float(result.time[-1])
    for colour, (name, found) in zip(_COLOURS, result.found.items(), strict=True):
        t = np.sort(found)
        share = np.arange(1, len(t) + 1) / len(t)
        finite = np.isfinite(t)
        ax.step(
            np.concatenate([[0.0], t[finite]]),
            np.concatenate([[0.0], share[finite]]),
            where="post",
            color=colour,
            linewidth=1.6,
            label=name,
        )
    ax.axvline(IN_TIME, color=TRUTH, linestyle="--", linewidth=1.0, label="60 s")
    ax.set(xlim=(0.0, min(1.2 * IN_TIME, longest)), ylim=(0.0, 1.02))
    ax.set_xlabel("time since the loss began [s]")
    ax.set_ylabel("share of drives found [-]")
    ax.set_title("How soon lost pressure raises an alarm", loc="left", fontsize=11)
    ax.legend(loc="lower right", fontsize=9)
    return figure
