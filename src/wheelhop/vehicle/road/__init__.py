"""Roads: ISO 8608 classes, synthesis, measured profiles, spectra and the roughness index."""

from wheelhop.vehicle.road.envelope import Envelope
from wheelhop.vehicle.road.iso8608 import (
    CLASSES,
    class_level,
    class_of_level,
    displacement_psd,
    displacement_psd_cycles,
    road_velocity_intensity,
)
from wheelhop.vehicle.road.isotropic import isotropic_tracks, two_track_coherence, wheel_lines
from wheelhop.vehicle.road.obstacles import Bump, SineSweep, Slope, Step, obstacle_tracks
from wheelhop.vehicle.road.profile import Profile, elevation_at, profile_from_samples, resample
from wheelhop.vehicle.road.roughness_index import iri, iri_segments
from wheelhop.vehicle.road.shape_filter import elevations, shape_filter_psd, stationary_variance
from wheelhop.vehicle.road.spectrum import RoadFit, Spectrum, fit_iso8608, profile_psd
from wheelhop.vehicle.road.surface import (
    RoadSurface,
    flat_surface,
    surface_from_grid,
    surface_from_tracks,
)
from wheelhop.vehicle.road.synthesis import synthesise
from wheelhop.vehicle.road.tracks import RoadGrid, tracks_from_profiles

__all__ = [
    "CLASSES",
    "Bump",
    "Envelope",
    "Profile",
    "RoadFit",
    "RoadGrid",
    "RoadSurface",
    "SineSweep",
    "Slope",
    "Spectrum",
    "Step",
    "class_level",
    "class_of_level",
    "displacement_psd",
    "displacement_psd_cycles",
    "elevation_at",
    "elevations",
    "fit_iso8608",
    "flat_surface",
    "iri",
    "iri_segments",
    "isotropic_tracks",
    "obstacle_tracks",
    "profile_from_samples",
    "profile_psd",
    "resample",
    "road_velocity_intensity",
    "shape_filter_psd",
    "stationary_variance",
    "surface_from_grid",
    "surface_from_tracks",
    "synthesise",
    "tracks_from_profiles",
    "two_track_coherence",
    "wheel_lines",
]
