"""Alarms as a list of events that a person can read, and as figures of merit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import numpy as np
from jaxtyping import Bool, Float

from wheelhop.errors import InputError
from wheelhop.estimators.alarms import LEVELS, AlarmOutput
from wheelhop.estimators.four_corners import WHEELS

_RULES = {0.15: "early level", 0.20: "UN R64/R141", 0.25: "FMVSS 138"}
_NAMES = {"FL": "front left", "FR": "front right", "RL": "rear left", "RR": "rear right"}
_BEFORE, _AFTER = 60.0, 30.0
_PUNCTURE, _LEAK = 0.9, 0.3


@dataclass(frozen=True)
class AlarmEvent:
    """One alarm of one wheel.

    Attributes:
        wheel: its name.
        index: its place among the wheels.
        time: at which the alarm came on [s].
        end: at which it went off [s]; NaN if it was still on.
        loss, loss_sd: under placard when it came on, relative [-].
        worst: largest loss while it was on [-].
        level: highest of `LEVELS` that the worst loss passed; 0 if none.
        kind: "puncture", "slow leak" or "unclear".
        rate, rate_sd: of the pressure [Pa/s], where `kind` was decided.
        words: the event for a person.
    """

    wheel: str
    index: int
    time: float
    end: float
    loss: float
    loss_sd: float
    worst: float
    level: float
    kind: str
    rate: float
    rate_sd: float
    words: str


def alarm_events(
    t: Float[np.ndarray, " time"], output: AlarmOutput, wheels: tuple[str, ...] | None = None
) -> list[AlarmEvent]:
    """Events of one drive in order of time.

    A puncture is a pressure that, with 90 % probability, fell faster than the settings' rate at
    some instant from 60 s before the alarm to 30 s after it; a slow leak one that with 70 %
    probability falls slower at the end of that time. The rate's standard deviation, about
    10 kPa/min, allows no more. A tyre that was low before the drive is a slow leak by this rule.

    Args:
        t: time [s].
        output: of `run_alarms`, [time, wheels].
        wheels: their names; those of a car, front left first, if left out.

    Raises:
        InputError: if there are not as many times or names as the output has.
    """
    alarm = np.asarray(output.alarm)
    names = wheels or (WHEELS if alarm.shape[1] == 4 else tuple(f"{i}" for i in range(4)))
    names = names if wheels else names[: alarm.shape[1]]
    if alarm.shape != (len(t), len(names)):
        raise InputError(
            "alarms",
            f"{len(t)} times and {len(names)} names for alarms of shape {alarm.shape}",
            "Give the times and the names of the wheels of that drive.",
        )
    arrays: AlarmOutput = jax.tree.map(np.asarray, output)
    found = []
    for index, name in enumerate(names):
        edges = np.diff(alarm[:, index].astype(int), prepend=0)
        ends = np.flatnonzero(edges < 0)
        for start in np.flatnonzero(edges > 0):
            later = ends[ends > start]
            stop = int(later[0]) if later.size else len(t)
            found.append(_event(t, arrays, index, name, int(start), stop))
    return sorted(found, key=lambda event: (event.time, event.index))


def detection_times(
    t: Float[np.ndarray, " time"], alarm: Bool[np.ndarray, "*drives time wheels"], begin: float
) -> Float[np.ndarray, "*drives wheels"]:
    """Time [s] from `begin` to the first alarm at or after it; inf where none comes."""
    after = np.asarray(alarm)[..., t >= begin, :]
    first = t[t >= begin][np.argmax(after, axis=-2)] - begin
    return np.where(after.any(axis=-2), first, np.inf)


def alarm_count(alarm: Bool[np.ndarray, "*drives time wheels"]) -> int:
    """How many times an alarm came on, over all drives and wheels."""
    on = np.asarray(alarm)
    return int(on[..., 0, :].sum() + (on[..., 1:, :] & ~on[..., :-1, :]).sum())


def _event(
    t: np.ndarray, output: AlarmOutput, index: int, name: str, start: int, stop: int
) -> AlarmEvent:
    about = np.flatnonzero((t >= t[start] - _BEFORE) & (t <= t[start] + _AFTER))
    about = about[output.valid[about, index]]
    about = about if about.size else np.array([start])
    puncture = output.puncture[about, index]
    fastest = int(about[np.argmax(puncture)])
    last = int(about[-1])
    if puncture.max() > _PUNCTURE:
        kind, at = "puncture", fastest
    else:
        kind, at = ("slow leak" if puncture[-1] < _LEAK else "unclear"), last
    worst = float(output.loss[start:stop, index].max())
    level = max((level for level in LEVELS if worst >= level), default=0.0)
    numbers: dict[str, Any] = {
        "time": float(t[start]),
        "loss": float(output.loss[start, index]),
        "loss_sd": float(output.loss_sd[start, index]),
        "rate": float(output.rate[at, index]),
        "rate_sd": float(output.rate_sd[at, index]),
    }
    return AlarmEvent(
        wheel=name,
        index=index,
        end=float(t[stop]) if stop < len(t) else float("nan"),
        worst=worst,
        level=level,
        kind=kind,
        words=_words(_NAMES.get(name, f"wheel {name}"), kind, worst, level, **numbers),
        **numbers,
    )


def _words(
    name: str,
    kind: str,
    worst: float,
    level: float,
    *,
    time: float,
    loss: float,
    loss_sd: float,
    rate: float,
    rate_sd: float,
) -> str:
    what = {"puncture": "puncture", "slow leak": "slow leak", "unclear": "loss of pressure"}[kind]
    per_minute = f"{60e-3 * rate:+.0f} ± {60e-3 * rate_sd:.0f} kPa/min"
    passed = f"; passed {100 * level:.0f} % ({_RULES[level]})" if level else ""
    return (
        f"{name}: {what} found at {time:.0f} s, {100 * loss:.0f} ± {100 * loss_sd:.0f} % under "
        f"placard then, {100 * worst:.0f} % at worst{passed}; {per_minute}"
    )
