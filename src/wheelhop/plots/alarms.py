"""Figure of tyre pressures and their alarms."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from wheelhop.errors import InputError
from wheelhop.estimators.alarm_events import AlarmEvent
from wheelhop.estimators.four_corners import WHEELS
from wheelhop.plots.style import ALERT, BAND, ESTIMATE, MUTED, TRUTH

_NAMES = {"FL": "front left", "FR": "front right", "RL": "rear left", "RR": "rear right"}
_RULES = {0.20: "20 %: UN R64/R141", 0.25: "25 %: FMVSS 138"}


def plot_alarms(
    t: Float[np.ndarray, " time"],
    pressure: Float[np.ndarray, "time wheels"],
    sigma: Float[np.ndarray, "time wheels"],
    placard: Any,
    events: Sequence[AlarmEvent] = (),
    *,
    truth: Float[np.ndarray, "time wheels"] | None = None,
    wheels: tuple[str, ...] = WHEELS,
    title: str = "",
) -> Figure:
    """Pressure of each wheel with 2 sigma, placard, warning levels and alarms.

    Args:
        t: time [s].
        pressure: estimate [Pa].
        sigma: its standard deviation [Pa].
        placard: recommended pressure [Pa], [] or [wheels].
        events: alarms, marked where they come on.
        truth: true pressure [Pa], if known.
        wheels: names of the wheels; four are laid out as on the car.
        title: headline.

    Raises:
        InputError: if there are not as many names as wheels.
    """
    count = pressure.shape[1]
    if len(wheels) != count:
        raise InputError("wheels", f"{len(wheels)} names for {count} wheels", "Name each wheel.")
    recommended = np.broadcast_to(np.asarray(placard, float), (count,)) / 1e3
    figure = Figure(figsize=(9.0, 2.9 * -(-count // 2) + 0.5), layout="constrained")
    axes = figure.subplots(-(-count // 2), min(count, 2), sharex=True, sharey=True, squeeze=False)
    low, high = _limits(pressure / 1e3, sigma / 1e3, recommended)
    for index, ax in enumerate(axes.ravel()):
        if index >= count:
            ax.set_visible(False)
            continue
        ax.spines[["top", "right"]].set_visible(False)
        ax.grid(True, alpha=0.25, linewidth=0.6)
        _levels(ax, recommended[index], t, low, labelled=index == 0)
        kpa, sd = pressure[:, index] / 1e3, sigma[:, index] / 1e3
        ax.fill_between(
            t, kpa - 2 * sd, kpa + 2 * sd, color=BAND, alpha=0.75, linewidth=0, label="2 sigma"
        )
        ax.plot(t, kpa, color=ESTIMATE, linewidth=1.5, label="estimate")
        if truth is not None:
            ax.plot(t, truth[:, index] / 1e3, color=TRUTH, linestyle="--", label="true")
        mine = [event for event in events if event.index == index]
        for event in mine:
            _mark(ax, event, float(np.interp(event.time, t, kpa)), t, low, high)
        name = _NAMES.get(wheels[index], f"wheel {wheels[index]}")
        ax.set_title(
            f"{name}: {'alarm' if mine else 'no alarm'}",
            loc="left",
            fontsize=10,
            color=ALERT if mine else TRUTH,
        )
        ax.set(xlim=(t[0], t[-1]), ylim=(low, high))
    for ax in axes[:, 0]:
        ax.set_ylabel("tyre pressure [kPa]")
    for ax in axes[-1]:
        ax.set_xlabel("time [s]")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), fontsize=9)
    figure.suptitle(title or _headline(events), x=0.02, ha="left", fontsize=12)
    return figure


def _headline(events: Sequence[AlarmEvent]) -> str:
    if not events:
        return "No tyre is low"
    names = list(dict.fromkeys(_NAMES.get(e.wheel, f"wheel {e.wheel}") for e in events))
    return f"Alarm: {', '.join(names)}"


def _limits(kpa: np.ndarray, sigma: np.ndarray, placard: np.ndarray) -> tuple[float, float]:
    """Room for what is settled, the levels and a label, not for a first wide band."""
    band = np.concatenate([kpa - 2 * sigma, kpa + 2 * sigma])
    seen = band[np.isfinite(band)]
    inner = np.quantile(seen, [0.02, 0.98]) if seen.size else placard
    low = min(float(inner.min()), 0.68 * float(placard.min()))
    high = max(float(inner.max()), 1.1 * float(placard.max()))
    return low, high + 0.04 * (high - low)


def _levels(ax: Any, placard: float, t: np.ndarray, low: float, *, labelled: bool) -> None:
    ax.axhline(placard, color=MUTED, linewidth=1.2, label="placard")
    edges = [(1.0 - level) * placard for level in _RULES]
    ax.axhspan(edges[1], edges[0], color=ALERT, alpha=0.10, linewidth=0)
    ax.axhspan(low, edges[1], color=ALERT, alpha=0.22, linewidth=0)
    if labelled:
        for edge, words in zip(edges, _RULES.values(), strict=True):
            ax.annotate(
                words, (t[0], edge), (4, -3), textcoords="offset points", va="top", fontsize=8
            )


def _mark(ax: Any, event: AlarmEvent, kpa: float, t: np.ndarray, low: float, high: float) -> None:
    ax.axvline(event.time, color=ALERT, linewidth=1.2)
    ax.plot([event.time], [kpa], "o", color=ALERT, markersize=6, zorder=5)
    right = event.time < 0.5 * (t[0] + t[-1])
    level = f"\npassed {100 * event.level:.0f} % under placard" if event.level else ""
    ax.annotate(
        f"alarm at {event.time:.0f} s\n{event.kind}, {60e-3 * event.rate:+.0f} kPa/min{level}",
        (event.time, high),
        (6 if right else -6, -4),
        textcoords="offset points",
        ha="left" if right else "right",
        va="top",
        fontsize=8,
        color=ALERT,
        bbox={"facecolor": "white", "alpha": 0.8, "edgecolor": "none", "pad": 1.5},
    )
