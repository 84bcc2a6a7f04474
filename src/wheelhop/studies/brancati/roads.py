"""Random and measured roads of Brancati & Tufano 2022: Eq. 5-7 and Fig. 12 against ISO 8608."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.linalg import expm
from scipy.stats import chi2

from wheelhop.errors import InputError, require_in_range
from wheelhop.io.roads import read_road
from wheelhop.plots.brancati_road import Indices, RoadLine
from wheelhop.vehicle.full_vehicle_parameters import suv
from wheelhop.vehicle.road import (
    Profile,
    RoadFit,
    class_level,
    class_of_level,
    displacement_psd,
    elevations,
    fit_iso8608,
    iri,
    iri_segments,
    profile_from_samples,
    profile_psd,
    shape_filter_psd,
    stationary_variance,
)
from wheelhop.vehicle.road.build import SPACING, lines_of
from wheelhop.vehicle.road.isotropic import draw_tracks, prepare_isotropic
from wheelhop.vehicle.road.roughness_index import SPEED, golden_car
from wheelhop.vehicle.road.shape_filter import CONVENTIONS, CUTOFF
from wheelhop.vehicle.road.synthesis import HIGHEST_FREQUENCY, LOWEST_FREQUENCY

FILTER, PLANT = "shape filter", "plant"
"""Where roads come from: Eq. 6, or the isotropic surface under the full vehicle."""

_HANN_LOSS = 19.0 / 18.0
_THIRD_OCTAVE = 2.0 ** (1.0 / 6.0)
_CONFIDENCE = 0.95
_BASE_LENGTH = 0.25


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


class FlatTable(NamedTuple):
    """Columns of equal length, and the unit of each that has one; as `write_table` takes them."""

    columns: dict[str, np.ndarray]
    units: dict[str, str]


class Interval(NamedTuple):
    """A value and its 95 % confidence interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class ClassRoads:
    """Roads of one class in one convention, from one source.

    Attributes:
        road_class, convention, source: which roads these are.
        wavenumber: W [rad/m], [waves].
        density: mean one-sided PSD of the roads [m^3/rad], [waves].
        law: the spectrum they were made for, Eq. 5 or the line of waviness 2, [waves].
        sampled_law: the same as sampling folds it, [waves].
        law_error: level of the roads over `sampled_law` in the band [dB].
        class_error: level of the roads over the class's line in the band [dB].
        nearest: class that holds this level.
        reference_law: `law` at W0 = 1 rad/m [m^3/rad].
        reference: PSD of the roads in the third octave round W0 [m^3/rad].
        law_variance: of Eq. 6 in the stationary state [m^2]; NaN for the plant's roads.
        variance: mean square of the elevation of all roads [m^2].
        iri: roughness index of every road [m/km], [roads].
        iri_line: of the class's exact line of waviness 2 [m/km].
    """

    road_class: str
    convention: str
    source: str
    wavenumber: np.ndarray
    density: np.ndarray
    law: np.ndarray
    sampled_law: np.ndarray
    law_error: Interval
    class_error: Interval
    nearest: str
    reference_law: float
    reference: Interval
    law_variance: float
    variance: float
    iri: np.ndarray
    iri_line: float

    @property
    def line(self) -> RoadLine:
        """For `plot_road_classes`."""
        return RoadLine(self.road_class, self.wavenumber, self.density, self.law, self.nearest)


@dataclass(frozen=True)
class RoadStudy:
    """Random roads against their law and the ISO 8608 classes.

    Attributes:
        settings: of the study.
        roads: one entry a class, convention and source.
        sampling: the paper's rules of length and sampling time, by `sampling_rules`.
        noise: the printed intensity of the driving noise, by `noise_readings`.
    """

    settings: RoadSettings
    roads: tuple[ClassRoads, ...]
    sampling: FlatTable
    noise: FlatTable

    def of(self, road_class: str, convention: str, source: str = FILTER) -> ClassRoads:
        """The entry of a class, convention and source.

        Raises:
            InputError: if the study has no such roads.
        """
        wanted = (road_class, convention, source)
        for r in self.roads:
            if (r.road_class, r.convention, r.source) == wanted:
                return r
        raise InputError("roads", f"the study has none of {wanted}", "Choose among its settings.")

    @property
    def panels(self) -> dict[str, list[RoadLine]]:
        """Spectra of the shape filter by convention, for `plot_road_classes`."""
        s = self.settings
        return {c: [self.of(k, c).line for k in s.classes] for c in s.conventions}

    @property
    def indices(self) -> dict[str, list[Indices]]:
        """Roughness indices by convention and source, for `plot_road_classes`."""
        s = self.settings
        return {
            f"{c}, {source}": [
                Indices(k, self.of(k, c, source).iri, self.of(k, c, source).iri_line)
                for k in s.classes
            ]
            for c in s.conventions
            for source in (FILTER, PLANT)
        }

    def tables(self) -> dict[str, FlatTable]:
        """Flat tables: "spectra", a row a wavenumber; "levels", a row an entry; the two rules."""
        return {
            "spectra": _spectra(self.roads),
            "levels": _levels(self.roads),
            "sampling": self.sampling,
            "noise": self.noise,
        }


@dataclass(frozen=True)
class MeasuredRoadStudy:
    """A measured road as in Fig. 12.

    Attributes:
        name: of the column or file it was read from.
        profile: its elevation.
        wavenumber: W [rad/m], [waves].
        density: one-sided PSD [m^3/rad], [waves].
        fit: level and waviness over the band it names.
        level: of the best line of waviness 2 [m^3/rad], with the interval of its chi-square.
        waviness: of the free line [-], likewise.
        iri: roughness index [m/km] of the whole road.
        iri_segments: of every 20 m [m/km], [segments].
        iri_level: Gd(W0) [m^3/rad] of the line of waviness 2 with the segments' mean index.
    """

    name: str
    profile: Profile
    wavenumber: np.ndarray
    density: np.ndarray
    fit: RoadFit
    level: Interval
    waviness: Interval
    iri: float
    iri_segments: np.ndarray
    iri_level: float

    @property
    def iri_class(self) -> str:
        """ISO 8608 class whose line has about this roughness index."""
        return class_of_level(self.iri_level)

    def tables(self) -> dict[str, FlatTable]:
        """Flat tables: "spectrum", "bands" (third octaves), "profile", "segments", "summary"."""
        f = self.fit
        psd = "m^3/rad"
        line = displacement_psd(self.wavenumber, f.level, f.waviness)
        summary = {
            "level": (f.level, psd),
            "waviness": (self.waviness.value, ""),
            "waviness_low": (self.waviness.low, ""),
            "waviness_high": (self.waviness.high, ""),
            "iso_level": (self.level.value, psd),
            "iso_level_low": (self.level.low, psd),
            "iso_level_high": (self.level.high, psd),
            "band_low": (2 * math.pi * f.band[0], "rad/m"),
            "band_high": (2 * math.pi * f.band[1], "rad/m"),
            "iri": (self.iri, "m/km"),
            "iri_segments_mean": (float(self.iri_segments.mean()), "m/km"),
            "iri_level": (self.iri_level, psd),
        }
        columns = {name: np.array([value]) for name, (value, _) in summary.items()}
        columns |= {"iso_class": np.array([f.iso_class]), "iri_class": np.array([self.iri_class])}
        return {
            "spectrum": FlatTable(
                {"wavenumber": self.wavenumber, "density": self.density, "fit": line},
                {"wavenumber": "rad/m", "density": psd, "fit": psd},
            ),
            "bands": FlatTable(
                {
                    "wavenumber": 2 * math.pi * f.frequency,
                    "density": f.density / (2 * math.pi),
                },
                {"wavenumber": "rad/m", "density": psd},
            ),
            "profile": FlatTable(
                {"distance": self.profile.distance, "elevation": self.profile.elevation},
                {"distance": "m", "elevation": "m"},
            ),
            "segments": FlatTable(
                {
                    "start": 20.0 * np.arange(len(self.iri_segments)),
                    "iri": self.iri_segments,
                },
                {"start": "m", "iri": "m/km"},
            ),
            "summary": FlatTable(columns, {n: u for n, (_, u) in summary.items() if u}),
        }


def validate_roads(settings: RoadSettings) -> None:
    """Refuse settings that the paper's rules or this study cannot use.

    Raises:
        InputError: for an unknown class or convention, too few roads, a road shorter than
            1 / Omega_L, a sampling time beyond 1 / (2 Omega_U v), or a band outside them.
    """
    if not settings.classes or not settings.conventions:
        raise InputError("classes", "no class or convention is given", "Give at least one.")
    for name in settings.classes:
        class_level(name)
    for name in settings.conventions:
        stationary_variance(1.0, name)
    require_in_range("--roads", settings.roads, 2, 10_000, "roads")
    require_in_range("--speed", settings.speed, 1.0, 100.0, "m/s")
    require_in_range("--length", settings.length, 1.0 / LOWEST_FREQUENCY, 1e5, "m")
    longest = 1.0 / (2.0 * HIGHEST_FREQUENCY * settings.speed)
    require_in_range("--dt", settings.dt, 1e-5, longest * (1 + 1e-9), "s")
    low, high = settings.band
    lowest, highest = 2 * math.pi * LOWEST_FREQUENCY, 2 * math.pi * HIGHEST_FREQUENCY
    if not (2.5 * lowest <= low and 1.3 * low <= high <= highest):
        raise InputError(
            "band",
            f"{low:g} to {high:g} rad/m is no band of these roads",
            f"Use at least a factor 1.3 between {2.5 * lowest:.3g} and {highest:.3g} rad/m.",
        )


def road_study(
    settings: RoadSettings = QUICK, on_progress: Callable[[int, int], None] | None = None
) -> RoadStudy:
    """Draw roads of every class and convention, and measure their spectra and roughness.

    Brancati & Tufano 2022, Eq. 5-7; Eq. 6 is sampled exactly at constant speed.

    Args:
        settings: of the study.
        on_progress: called with entries done and in all.

    Raises:
        InputError: as `validate_roads`.
    """
    validate_roads(settings)
    cases = [(c, k) for c in settings.classes for k in settings.conventions]
    found: list[ClassRoads] = []
    for number, (name, convention) in enumerate(cases):
        key = jax.random.fold_in(jax.random.key(settings.seed), "ABCDEFGH".index(name))
        for use, (source, draw) in enumerate(((FILTER, _filtered), (PLANT, _driven))):
            keys = jax.random.split(jax.random.fold_in(key, use), settings.roads)
            z, spacing = draw(keys, settings, stationary_variance(class_level(name), convention))
            found.append(_judged(z, spacing, settings, name, convention, source))
            if on_progress is not None:
                on_progress(2 * number + use + 1, 2 * len(cases))
    return RoadStudy(settings, tuple(found), sampling_rules(settings), noise_readings())


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
        return [math.sqrt(2.0 / (CUTOFF * length)), _decibels(lift)]

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
    sigma^2 = 4 Gd(W0) and says how far PSD(W0) then lies from the class [dB].
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
            "error": _decibels(factor),
            "level": _decibels(factor * label),
        },
        {
            "printed": "alpha v sigma^2",
            "needed": "alpha v sigma^2",
            "error": "dB",
            "level": "dB",
        },
    )


def measured_road(file: Path | str, track: str | None = None) -> MeasuredRoadStudy:
    """Spectrum, ISO 8608 fit and roughness of a measured road: Brancati & Tufano 2022, Fig. 12.

    Args:
        file: a road as `read_road` takes it, or a .txt of two columns, distance and elevation
            [m], without a header.
        track: elevation column, where there are several.

    Raises:
        InputError: as `read_road`, `fit_iso8608` and `iri` do, or for a .txt that is no such
            table.
    """
    path = Path(file)
    if path.suffix.lower() == ".txt":
        profile, name = _two_columns(path), path.name
    else:
        profile, name = read_road(path, track)
    spectrum = profile_psd(profile)
    fit = fit_iso8608(spectrum)
    segments = iri_segments(profile)
    level, waviness = _fit_intervals(fit, profile.length)
    return MeasuredRoadStudy(
        name=name,
        profile=profile,
        wavenumber=2 * math.pi * spectrum.frequency,
        density=spectrum.density / (2 * math.pi),
        fit=fit,
        level=level,
        waviness=waviness,
        iri=iri(profile),
        iri_segments=segments,
        iri_level=(float(segments.mean()) / line_iri(1.0)) ** 2,
    )


def line_iri(level: float) -> float:
    """Expected roughness index [m/km] of a Gaussian road with the line of waviness 2.

    The golden car's rectified velocity is the modulus of a Gaussian, of mean sqrt(2 / pi) times
    its standard deviation, which is an integral over the spectrum of the slope, here white.

    Args:
        level: Gd(W0) [m^3/rad].
    """
    return float(math.sqrt(level) * _unit_iri())


@lru_cache(maxsize=1)
def _unit_iri() -> float:
    a, b = golden_car()
    wave = 2 * math.pi * np.geomspace(1e-3, HIGHEST_FREQUENCY, 4000)
    system = 1j * SPEED * wave[:, None, None] * np.eye(4) - a
    response = np.linalg.solve(system, np.broadcast_to(b[:, None], (len(wave), 4, 1)))[..., 0]
    gain = np.abs(response[:, 0] - response[:, 2]) ** 2
    gain *= np.sinc(_BASE_LENGTH * wave / (2 * math.pi)) ** 2
    return 1e3 * math.sqrt(2.0 / math.pi * np.trapezoid(gain, wave))


@lru_cache(maxsize=2)
def _compiled_filter(steps: int) -> Any:
    def one(key: Any, variance: Any, travel: Any) -> Any:
        return elevations(key, variance, jnp.full((steps,), travel))

    return jax.jit(jax.vmap(one, in_axes=(0, None, None)))


def _filtered(keys: Any, settings: RoadSettings, variance: float) -> tuple[np.ndarray, float]:
    """Roads of Eq. 6, [roads, points], and their spacing [m]."""
    travel = settings.speed * settings.dt
    draw = _compiled_filter(round(settings.length / travel))
    z = draw(keys, jnp.asarray(variance, float), jnp.asarray(travel, float))
    return np.asarray(z, float), travel


@lru_cache(maxsize=2)
def _prepared(length: float) -> Any:
    road = prepare_isotropic(length, SPACING, 2.0, lines_of(suv()))
    # one road at a time, so that memory holds the tracks of all of them but not their spectra
    return jax.jit(lambda keys, level: jax.lax.map(lambda k: draw_tracks(k, road, level)[0], keys))


def _driven(keys: Any, settings: RoadSettings, variance: float) -> tuple[np.ndarray, float]:
    """Front-left tracks of the plant's roads at the level that Eq. 5 has, [roads, points]."""
    level = variance / stationary_variance(1.0)
    z = _prepared(settings.length)(keys, jnp.asarray(level, float))
    return np.asarray(z, float), SPACING


def _judged(
    z: Float[np.ndarray, "roads points"],
    spacing: float,
    settings: RoadSettings,
    road_class: str,
    convention: str,
    source: str,
) -> ClassRoads:
    spectra = [profile_psd(Profile(spacing, row)) for row in z]
    kept = spectra[0].frequency <= HIGHEST_FREQUENCY
    wave = 2 * math.pi * spectra[0].frequency[kept]
    density = np.mean([s.density for s in spectra], axis=0)[kept] / (2 * math.pi)
    nominal = class_level(road_class)
    sigma2 = stationary_variance(nominal, convention)
    if source == FILTER:
        law, sampled = shape_filter_psd(wave, sigma2), folded_psd(wave, sigma2, spacing)
        reference_law = float(shape_filter_psd(1.0, sigma2))
    else:
        reference_law = sigma2 / stationary_variance(1.0)
        law = sampled = displacement_psd(wave, reference_law)
    extent = len(z) * spacing * z.shape[1]
    line = displacement_psd(wave, nominal)
    band, third = settings.band, (1.0 / _THIRD_OCTAVE, _THIRD_OCTAVE)
    over_class = _ratio(wave, density / line, band, extent)
    over_law = _ratio(wave, density / law, third, extent)
    return ClassRoads(
        road_class=road_class,
        convention=convention,
        source=source,
        wavenumber=wave,
        density=density,
        law=law,
        sampled_law=sampled,
        law_error=Interval(*map(_decibels, _ratio(wave, density / sampled, band, extent))),
        class_error=Interval(*map(_decibels, over_class)),
        nearest=class_of_level(nominal * over_class.value),
        reference_law=reference_law,
        reference=Interval(*(reference_law * v for v in over_law)),
        law_variance=sigma2 if source == FILTER else math.nan,
        variance=float(np.mean(z**2)),
        iri=_roughness_indices(z, spacing),
        iri_line=line_iri(nominal),
    )


def _ratio(
    wave: np.ndarray, ratio: np.ndarray, band: tuple[float, float], extent: float
) -> Interval:
    """Mean ratio of a Welch estimate to its law over a band, from roads of a total extent [m]."""
    inside = (wave >= band[0]) & (wave <= band[1])
    value = float(np.mean(ratio[inside]))
    dof = degrees_of_freedom((wave[1] - wave[0]) * np.count_nonzero(inside), extent)
    tail = 0.5 * (1.0 - _CONFIDENCE)
    low, high = chi2.ppf([1.0 - tail, tail], dof)
    return Interval(value, float(value * dof / low), float(value * dof / high))


def degrees_of_freedom(width: Any, extent: float) -> Any:
    """Chi-square degrees of freedom of the mean of a Welch spectrum over a band.

    Two per independent wave, width times extent / (2 pi), less the 1 / 18 that Hann windows of
    half overlap lose by weighing the road unevenly: Welch 1967, for a band wider than the
    window's.

    Args:
        width: of the band [rad/m].
        extent: length of road in all [m].
    """
    return 2.0 * width * extent / (2.0 * math.pi) / _HANN_LOSS


def _fit_intervals(fit: RoadFit, length: float) -> tuple[Interval, Interval]:
    """Level at waviness 2 [m^3/rad] and free waviness, by the bands' chi-square to first order."""
    width = 2 * math.pi * fit.frequency * (_THIRD_OCTAVE - 1.0 / _THIRD_OCTAVE)
    variance = 2.0 / degrees_of_freedom(width, length)
    x = np.log(fit.frequency) - np.mean(np.log(fit.frequency))
    normal = 1.959964
    level = normal * math.sqrt(float(np.sum(variance))) / len(x)
    slope = normal * math.sqrt(float(np.sum(x**2 * variance))) / float(np.sum(x**2))
    return (
        Interval(fit.iso_level, fit.iso_level * math.exp(-level), fit.iso_level * math.exp(level)),
        Interval(fit.waviness, fit.waviness - slope, fit.waviness + slope),
    )


def _roughness_indices(z: Float[np.ndarray, "roads points"], spacing: float) -> np.ndarray:
    """`iri` [m/km] of many roads of one spacing, all at once."""
    width = round(_BASE_LENGTH / spacing)
    if width > 1:
        padded = np.pad(z, ((0, 0), (width // 2, (width - 1) // 2)), mode="edge")
        total = np.cumsum(np.pad(padded, ((0, 0), (1, 0))), axis=1)
        z = (total[:, width:] - total[:, :-width]) / width
    slope = np.ascontiguousarray(np.diff(z, axis=1).T) / spacing
    a, b = golden_car()
    augmented = np.zeros((5, 5))
    augmented[:4, :4], augmented[:4, 4] = a, b
    step = expm(augmented * spacing / SPEED)
    transition, drive = step[:4, :4], step[:4, 4:]
    lead = slope[: max(1, round(11.0 / spacing))].mean(axis=0)
    x = np.stack([lead, np.zeros_like(lead), lead, np.zeros_like(lead)])
    total = np.zeros_like(lead)
    for s in slope:
        x = transition @ x + drive * s
        total += np.abs(x[0] - x[2])
    return 1e3 * total / len(slope)


def _two_columns(path: Path) -> Profile:
    try:
        rows = np.loadtxt(path, ndmin=2)
    except (OSError, ValueError) as error:
        raise InputError(
            str(path), f"it is no table of numbers ({error})", "Give two columns: x, z [m]."
        ) from error
    if rows.shape[1] != 2:
        raise InputError(
            str(path), f"it has {rows.shape[1]} columns", "Give two: distance and elevation [m]."
        )
    return profile_from_samples(rows[:, 0], rows[:, 1])


def _decibels(ratio: Any) -> Any:
    return 10.0 * np.log10(ratio)


def _spectra(roads: tuple[ClassRoads, ...]) -> FlatTable:
    names = ("road_class", "convention", "source")
    columns = {n: np.repeat([getattr(r, n) for r in roads], _sizes(roads)) for n in names}
    values = ("wavenumber", "density", "law", "sampled_law")
    columns |= {n: np.concatenate([getattr(r, n) for r in roads]) for n in values}
    lines = [displacement_psd(r.wavenumber, class_level(r.road_class)) for r in roads]
    columns["class_line"] = np.concatenate(lines)
    units = dict.fromkeys([*values, "class_line"], "m^3/rad")
    return FlatTable(columns, units | {"wavenumber": "rad/m"})


def _sizes(roads: tuple[ClassRoads, ...]) -> list[int]:
    return [len(r.wavenumber) for r in roads]


def _levels(roads: tuple[ClassRoads, ...]) -> FlatTable:
    names = ("road_class", "convention", "source", "nearest")
    columns = {n: np.array([getattr(r, n) for r in roads]) for n in names}
    units: dict[str, str] = {}

    def add(name: str, unit: str, values: list[float]) -> None:
        columns[name], units[name] = np.array(values), unit

    for name, unit in (("law_error", "dB"), ("class_error", "dB"), ("reference", "m^3/rad")):
        for part in Interval._fields:
            suffix = "" if part == "value" else f"_{part}"
            add(name + suffix, unit, [getattr(getattr(r, name), part) for r in roads])
    add("reference_law", "m^3/rad", [r.reference_law for r in roads])
    add("class_level", "m^3/rad", [class_level(r.road_class) for r in roads])
    add("variance", "m^2", [r.variance for r in roads])
    add("law_variance", "m^2", [r.law_variance for r in roads])
    add("iri", "m/km", [float(r.iri.mean()) for r in roads])
    add("iri_spread", "m/km", [float(r.iri.std(ddof=1)) for r in roads])
    add("iri_line", "m/km", [r.iri_line for r in roads])
    return FlatTable(columns, units)
