"""What roads by Brancati & Tufano 2022, Eq. 5-7, are made of: settings, sampling, noise."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from wheelhop.errors import InputError, require_in_range
from wheelhop.studies.brancati.road_statistics import FlatTable, decibels
from wheelhop.vehicle.road import (
    CLASSES,
    shape_filter_psd,
    stationary_variance,
)
from wheelhop.vehicle.road.shape_filter import CONVENTIONS, CUTOFF
from wheelhop.vehicle.road.synthesis import HIGHEST_FREQUENCY, LOWEST_FREQUENCY


@dataclass(frozen=True)
class RoadSettings:
    """What a study of random roads drives over.

    Attributes:
        classes: ISO 8608 classes.
        conventions: of the level, as `stationary_variance` names them.
        roads: realisations of each.
        length: of a road [m].
        speed: v [m/s] at which Eq. 6 is sampled.
        dt: its sampling time [s].
        seed: of the roads; conventions share them, classes do not.
        band: wavenumbers [rad/m] in which levels are compared.
    """

    classes: tuple[str, ...] = ("A", "B", "C", "D")
    conventions: tuple[str, ...] = CONVENTIONS
    roads: int = 64
    length: float = 1000.0
    speed: float = 60.0 / 3.6
    dt: float = 1.5e-3
    seed: int = 0
    band: tuple[float, float] = (0.5, 15.0)


QUICK = RoadSettings(roads=8, length=300.0)


def validate_roads(settings: RoadSettings) -> None:
    """Refuse settings that the paper's rules or this study cannot use.

    Raises:
        InputError: for an unknown class or convention, too few roads, a road shorter than
            1 / Omega_L, a sampling time beyond 1 / (2 Omega_U v), or a band outside them.
    """
    if not settings.classes or not settings.conventions:
        raise InputError("classes", "no class or convention is given", "Give at least one.")
    for name in settings.classes:
        if name not in tuple(CLASSES):
            raise InputError("classes", f"{name!r} is no class", "Use capital letters A to H.")
    for name in settings.conventions:
        stationary_variance(1.0, name)
    require_in_range("roads", settings.roads, 2, 10_000, "roads")
    require_in_range("speed", settings.speed, 1.0, 100.0, "m/s")
    require_in_range("length", settings.length, 1.0 / LOWEST_FREQUENCY, 1e5, "m")
    longest = 1.0 / (2.0 * HIGHEST_FREQUENCY * settings.speed)
    require_in_range("dt", settings.dt, 1e-5, longest * (1 + 1e-9), "s")
    low, high = settings.band
    lowest, highest = 2 * math.pi * LOWEST_FREQUENCY, 2 * math.pi * HIGHEST_FREQUENCY
    if not (2.5 * lowest <= low and 1.3 * low <= high <= highest):
        raise InputError(
            "band",
            f"{low:g} to {high:g} rad/m is no band of these roads",
            f"Use at least a factor 1.3 between {2.5 * lowest:.3g} and {highest:.3g} rad/m.",
        )


def folded_psd(wavenumber: Any, variance: Any, spacing: float, cutoff: float = CUTOFF) -> Any:
    """One-sided PSD [m^3/rad] of the shape filter's output sampled every `spacing` metres.

    The sum of Eq. 5 over all wavenumbers that sampling folds onto one; above pi / spacing it
    means nothing.

    Args:
        wavenumber: W [rad/m].
        variance: sigma^2 [m^2].
        spacing: v dt [m].
        cutoff: alpha [rad/m].
    """
    a = math.exp(-cutoff * spacing)
    bend = 1.0 - 2.0 * a * np.cos(np.asarray(wavenumber) * spacing) + a * a
    return variance * spacing / math.pi * (1.0 - a * a) / bend


def sampling_rules(settings: RoadSettings) -> FlatTable:
    """The paper's L >= 1 / Omega_L and dt <= 1 / (2 Omega_U v): here, at their limit, and the cost.

    For the length, the cost is the relative standard deviation sqrt(2 / (alpha L)) of one
    road's own variance; for the sampling time, how far folding lifts the PSD at Omega_U [dB].
    """
    limits = np.array([1.0 / LOWEST_FREQUENCY, 1.0 / (2 * HIGHEST_FREQUENCY * settings.speed)])
    used = np.array([settings.length, settings.dt])
    top = 2 * math.pi * HIGHEST_FREQUENCY

    def cost(length: float, dt: float) -> list[float]:
        lift = folded_psd(top, 1.0, settings.speed * dt) / shape_filter_psd(top, 1.0)
        return [math.sqrt(2.0 / (CUTOFF * length)), decibels(lift)]

    return FlatTable(
        {
            "rule": np.array(["road length [m]", "sampling time [s]"]),
            "limit": limits,
            "used": used,
            "kept": np.array([used[0] >= limits[0], used[1] <= limits[1] * (1 + 1e-9)]),
            "cost": np.array(["relative spread of the variance [-]", "folding at Omega_U [dB]"]),
            "cost_at_limit": np.array(cost(*limits)),
            "cost_here": np.array(cost(*used)),
        },
        {},
    )


def noise_readings() -> FlatTable:
    """The printed noise "one-side PSD 2 pi alpha v sigma^2" against what Eq. 5 and 6 need.

    A white eta with E[eta(t) eta(t + tau)] = q delta(tau) gives Eq. 6 the variance
    q / (2 alpha v), so that Eq. 5 needs q = 2 alpha v sigma^2. As a density that is q two-sided
    per hertz, 2 q one-sided per hertz, q / pi one-sided per rad/s (the unit of Eq. 5). Whichever
    was meant, the road's variance is off by the printed factor; `level` adds the printed
    sigma^2 = 4 Gd(W0) and says how far PSD(W0) then lies from the class [dB]. Read two-sided per
    hertz, the two misprints undo each other: 8 alpha = 1 + alpha^2 to 1e-4 at alpha = 0.127.
    """
    needed = np.array([2.0 / math.pi, 4.0, 2.0])
    factor = 2.0 * math.pi / needed
    label = shape_filter_psd(1.0, stationary_variance(1.0, "brancati2022"))
    return FlatTable(
        {
            "reading": np.array(
                ["one-sided per rad/s, as Eq. 5", "one-sided per Hz", "two-sided per Hz"]
            ),
            "printed": np.full(3, 2.0 * math.pi),
            "needed": needed,
            "factor": factor,
            "error": decibels(factor),
            "level": decibels(factor * label),
        },
        {
            "printed": "alpha v sigma^2",
            "needed": "alpha v sigma^2",
            "error": "dB",
            "level": "dB",
        },
    )
