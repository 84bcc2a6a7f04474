"""The measured road of Brancati & Tufano 2022, Fig. 12, against ISO 8608."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wheelhop.errors import InputError
from wheelhop.io.roads import read_road
from wheelhop.studies.brancati.road_statistics import (
    THIRD_OCTAVE,
    FlatTable,
    Interval,
    degrees_of_freedom,
    line_iri,
)
from wheelhop.vehicle.road import (
    Profile,
    RoadFit,
    class_of_level,
    displacement_psd,
    fit_iso8608,
    iri,
    iri_segments,
    profile_from_samples,
    profile_psd,
)


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
    if not len(segments):
        raise InputError(
            "road", f"it is {profile.length:g} m long", "Give at least one segment of 20 m."
        )
    level, waviness = fit_intervals(fit, profile.length)
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


def fit_intervals(fit: RoadFit, length: float) -> tuple[Interval, Interval]:
    """Level at waviness 2 [m^3/rad] and free waviness, by the bands' chi-square to first order."""
    width = 2 * math.pi * fit.frequency * (THIRD_OCTAVE - 1.0 / THIRD_OCTAVE)
    variance = 2.0 / degrees_of_freedom(width, length)
    x = np.log(fit.frequency) - np.mean(np.log(fit.frequency))
    normal = 1.959964
    level = normal * math.sqrt(float(np.sum(variance))) / len(x)
    slope = normal * math.sqrt(float(np.sum(x**2 * variance))) / float(np.sum(x**2))
    return (
        Interval(fit.iso_level, fit.iso_level * math.exp(-level), fit.iso_level * math.exp(level)),
        Interval(fit.waviness, fit.waviness - slope, fit.waviness + slope),
    )


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
