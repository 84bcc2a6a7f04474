"""Random roads of Brancati & Tufano 2022, Eq. 5-7, against ISO 8608."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from wheelhop.errors import InputError
from wheelhop.plots.brancati_road import Indices, RoadLine
from wheelhop.studies.brancati.road_rules import (
    RoadSettings,
    folded_psd,
    noise_readings,
    sampling_rules,
    validate_roads,
)
from wheelhop.studies.brancati.road_statistics import (
    THIRD_OCTAVE,
    FlatTable,
    Interval,
    decibels,
    level_ratio,
    line_iri,
    roughness_indices,
)
from wheelhop.vehicle.full_vehicle_parameters import suv
from wheelhop.vehicle.road import (
    CLASSES,
    Profile,
    class_level,
    class_of_level,
    displacement_psd,
    elevations,
    profile_psd,
    shape_filter_psd,
    stationary_variance,
)
from wheelhop.vehicle.road.build import SPACING, lines_of
from wheelhop.vehicle.road.isotropic import draw_tracks, prepare_isotropic
from wheelhop.vehicle.road.synthesis import HIGHEST_FREQUENCY

FILTER, PLANT = "shape filter", "plant"
"""Where roads come from: Eq. 6, or the isotropic surface under the full vehicle."""


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
        """Spectra of the shape filter by convention and its level, for `plot_road_classes`."""
        found = {}
        for c in self.settings.conventions:
            rows = [self.of(k, c) for k in self.settings.classes]
            error = float(np.mean([r.class_error.value for r in rows]))
            found[f"{c}: {error:+.1f} dB from the class"] = [r.line for r in rows]
        return found

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


def road_study(
    settings: RoadSettings, on_progress: Callable[[int, int], None] | None = None
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
        key = jax.random.fold_in(jax.random.key(settings.seed), CLASSES.index(name))
        for use, (source, draw) in enumerate(((FILTER, _filtered), (PLANT, _driven))):
            keys = jax.random.split(jax.random.fold_in(key, use), settings.roads)
            z, spacing = draw(keys, settings, stationary_variance(class_level(name), convention))
            found.append(_judged(z, spacing, settings, name, convention, source))
            if on_progress is not None:
                on_progress(2 * number + use + 1, 2 * len(cases))
    return RoadStudy(settings, tuple(found), sampling_rules(settings), noise_readings())


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
    band, third = settings.band, (1.0 / THIRD_OCTAVE, THIRD_OCTAVE)
    over_class = level_ratio(wave, density / line, band, extent)
    over_law = level_ratio(wave, density / law, third, extent)
    return ClassRoads(
        road_class=road_class,
        convention=convention,
        source=source,
        wavenumber=wave,
        density=density,
        law=law,
        sampled_law=sampled,
        law_error=Interval(*map(decibels, level_ratio(wave, density / sampled, band, extent))),
        class_error=Interval(*map(decibels, over_class)),
        nearest=class_of_level(nominal * over_class.value),
        reference_law=reference_law,
        reference=Interval(*(reference_law * v for v in over_law)),
        law_variance=sigma2 if source == FILTER else math.nan,
        variance=float(np.mean(z**2)),
        iri=roughness_indices(z, spacing),
        iri_line=line_iri(nominal),
    )


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
