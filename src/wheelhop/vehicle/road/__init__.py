"""Roads: ISO 8608 classes, synthesis, measured profiles, spectra and the roughness index."""

from wheelhop.vehicle.road.iso8608 import (
    CLASSES,
    class_level,
    class_of_level,
    displacement_psd,
    displacement_psd_cycles,
    road_velocity_intensity,
)
from wheelhop.vehicle.road.profile import Profile, elevation_at, profile_from_samples, resample
from wheelhop.vehicle.road.roughness_index import iri, iri_segments
from wheelhop.vehicle.road.shape_filter import elevations, shape_filter_psd, stationary_variance
from wheelhop.vehicle.road.spectrum import RoadFit, Spectrum, fit_iso8608, profile_psd
from wheelhop.vehicle.road.synthesis import synthesise

__all__ = [
    "CLASSES",
    "Profile",
    "RoadFit",
    "Spectrum",
    "class_level",
    "class_of_level",
    "displacement_psd",
    "displacement_psd_cycles",
    "elevation_at",
    "elevations",
    "fit_iso8608",
    "iri",
    "iri_segments",
    "profile_from_samples",
    "profile_psd",
    "resample",
    "road_velocity_intensity",
    "shape_filter_psd",
    "stationary_variance",
    "synthesise",
]
